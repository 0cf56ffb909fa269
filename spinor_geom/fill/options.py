"""Names of options: how patches meet the mesh, and what becomes of loose pieces in holes; cheap to import."""

from typing import Literal, TypeAlias, get_args

Continuity: TypeAlias = Literal["C0", "C1"]  # the tangents turn at the rim, or continue
Islands: TypeAlias = Literal["join", "ignore"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)
ISLANDS: tuple[Islands, ...] = get_args(Islands)
