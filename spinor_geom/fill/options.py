"""Options: how patches meet the mesh, loose pieces in holes, vertices that are merged first; cheap to import."""

import math
from numbers import Real
from typing import Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError

Continuity: TypeAlias = Literal["C0", "C1"]  # the tangents turn at the rim, or continue
Islands: TypeAlias = Literal["join", "ignore"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)
ISLANDS: tuple[Islands, ...] = get_args(Islands)


def merge_distance(merge: bool | float) -> float | Literal["rounding"]:
    """The distance, in mesh units, up to which an option other than False merges vertices; "rounding" for True."""
    if merge is True:
        return "rounding"
    if isinstance(merge, Real) and 0 <= merge < math.inf:
        return float(merge)
    raise OptionError(f"merge must be True, False or a distance from 0 on, not {merge!r}")
