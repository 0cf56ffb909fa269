"""Merges vertices of a mesh of any type whose adapter supports it."""

from typing import Any

from spinor_geom import adapters
from spinor_geom.fill.fill_options import require_merge


def merged(mesh: Any, merge: bool | float) -> Any:
    """Merges vertices up to a distance apart, in mesh units, or with True those equal up to rounding.

    Raises:
        OptionError: `merge` is not a distance, or this type of mesh cannot be merged.
    """
    if merge is False:
        return mesh
    require_merge(merge)
    return adapters.merged(mesh, "rounding" if merge is True else float(merge))
