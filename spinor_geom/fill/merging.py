"""Merges the vertices of a mesh of any type that can be rebuilt without them."""

import math
from numbers import Real
from typing import Any

import numpy as np

from spinor_geom.adapters import MeshFile
from spinor_geom.errors import OptionError
from spinor_geom.mesh.triangle_mesh import TriangleMesh


def merged(mesh: Any, merge: bool | float) -> Any:
    """A mesh with vertices merged: those up to a distance apart, in mesh units, or with True those equal to rounding.

    Raises:
        OptionError: no such distance, or a type whose vertices cannot be merged here.
    """
    if merge is False:
        return mesh
    if merge is not True and not (isinstance(merge, Real) and 0 <= merge < math.inf):
        raise OptionError(f"merge must be True, False or a distance from 0 on, not {merge!r}")
    within = "rounding" if merge is True else float(merge)
    if isinstance(mesh, MeshFile):
        return mesh.merged(within)
    if isinstance(mesh, TriangleMesh):
        return mesh.merged(within)[0]
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2 and all(isinstance(part, np.ndarray) for part in mesh):
        new, _ = TriangleMesh(*mesh).merged(within)
        # positions of the given dtype come back as they were
        parts = (new.vertices.astype(np.result_type(mesh[0], np.float32)), new.faces.astype(mesh[1].dtype))
        return mesh._make(parts) if hasattr(mesh, "_make") else type(mesh)(parts)
    raise OptionError(
        f"merge works for mesh files, TriangleMesh and pairs of numpy arrays, not {type(mesh).__name__}; merge the "
        "vertices with that library, or give (vertices, faces)"
    )
