"""Merges the vertices of a mesh of any type whose adapter can."""

import math
from numbers import Real
from typing import Any

from spinor_geom import adapters
from spinor_geom.errors import OptionError


def merged(mesh: Any, merge: bool | float) -> Any:
    """A mesh with vertices merged: those up to a distance apart, in mesh units, or with True those equal to rounding.

    Raises:
        OptionError: no such distance, or a type whose vertices cannot be merged here.
    """
    if merge is False:
        return mesh
    if merge is not True and not (isinstance(merge, Real) and 0 <= merge < math.inf):
        raise OptionError(f"merge must be True, False or a distance from 0 on, not {merge!r}")
    return adapters.merged(mesh, "rounding" if merge is True else float(merge))
