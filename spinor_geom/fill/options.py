"""How patches meet the mesh: their tangents turn at the rim ("C0"), or go on ("C1"); cheap to import."""

from typing import Literal, TypeAlias, get_args

Continuity: TypeAlias = Literal["C0", "C1"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)
