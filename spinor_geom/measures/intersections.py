"""Where a triangle mesh passes through itself."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def self_intersections(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "k 2"]:
    """Pairs of faces that meet otherwise than in their common vertices and edges, by exact predicates.

    Returns:
        Face indices, each pair once, smaller index first, sorted; empty for an embedded mesh.

    Source: Shewchuk (1997), Adaptive precision floating-point arithmetic and fast robust geometric predicates, for the
    predicates.
    """
    import igl.predicates

    found, pairs, _ = igl.predicates.find_self_intersections(
        np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int64)
    )
    if not found:
        return np.zeros((0, 2), dtype=np.int64)
    return np.unique(np.sort(pairs.astype(np.int64), axis=1), axis=0)
