"""Merges the vertices of a mesh of any type whose adapter can."""

from typing import Any

from spinor_geom import adapters
from spinor_geom.fill.options import require_merge


def merged(mesh: Any, merge: bool | float) -> Any:
    """A mesh with vertices merged: those up to a distance apart, in mesh units, or with True those equal to rounding.

    Raises:
        OptionError: no such distance, or a type whose vertices cannot be merged here.
    """
    if merge is False:
        return mesh
    require_merge(merge)
    return adapters.merged(mesh, "rounding" if merge is True else float(merge))
