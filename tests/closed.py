"""Closed meshes."""

import numpy as np
from jaxtyping import Int

from spinor_geom.mesh.topology import HalfEdges


def is_watertight(faces: Int[np.ndarray, "f 3"]) -> bool:
    """Whether there are faces and every edge has exactly two, of opposite directions."""
    return HalfEdges.of(faces).is_closed
