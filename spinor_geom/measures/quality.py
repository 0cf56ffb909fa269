"""How well shaped the triangles of a mesh are."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.operators import internal_angles


def smallest_angles(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Smallest angle of every triangle of a mesh, in degrees; 0 for a triangle without area."""
    # two equal corners leave the angles undefined
    return np.asarray(np.nan_to_num(np.degrees(internal_angles(vertices, faces)), nan=0.0).min(axis=1))
