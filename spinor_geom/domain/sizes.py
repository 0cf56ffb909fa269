"""How long the edges of a triangulation shall be beside a boundary and away from it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import Rims, plane_coordinates, rim_successors

SizeFunction = Callable[[Complex[np.ndarray, " k"]], Float[np.ndarray, " k"]]
SizeBounds = Callable[[Complex[np.ndarray, " k"]], tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]]


def graded_size(
    boundary: Complex[np.ndarray, " m"],
    *,
    growth: float = 0.35,
    rims: Rims | None = None,
) -> SizeFunction:
    """Edge length that is the local one at the boundary and grows with the distance from it.

    h(z) = min_j (e_j + growth·|z − b_j|) over the boundary vertices b_j nearest to z; e_j is the mean of the two
    boundary edges at b_j, lowered where a neighbour's e_i + growth·|b_i − b_j| is smaller.

    Args:
        boundary: Closed polygon, in units of Ω, or several, one after the other.
        growth: Increase of h per unit of distance.
        rims: Numbers of vertices of the polygons; none for a single one.

    Returns:
        A function from points (k,) to edge lengths (k,).
    """
    bounds = size_bounds(boundary, growth=growth, decay=0.0, rims=rims)
    return lambda z: bounds(z)[1]


def size_bounds(
    boundary: Complex[np.ndarray, " m"], *, growth: float, decay: float, rims: Rims | None = None
) -> SizeBounds:
    """The range of edge lengths that pass gradually into those of a boundary.

    Args:
        boundary: Closed polygon, in units of Ω, or several, one after the other.
        growth: Increase of the upper bound per unit of distance; it is `graded_size`.
        decay: Decrease of the lower bound, from the local edge length at the nearest boundary vertex.
        rims: Numbers of vertices of the polygons; none for a single one.

    Returns:
        A function from points (k,) to lower bounds (k,), which may be negative, and upper bounds (k,).
    """
    after = rim_successors(rims or (len(boundary),))
    edge = np.abs(boundary[after] - boundary)
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    own = local = 0.5 * (edge + edge[before])
    tree = cKDTree(plane_coordinates(boundary))
    distance, index = tree.query(plane_coordinates(boundary), k=min(8, len(boundary)))
    for _ in range(4):
        local = (local[index] + growth * distance).min(axis=1)
    neighbours = min(3, len(boundary))

    def bounds(z: Complex[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        distance, index = map(np.asarray, tree.query(plane_coordinates(z), k=neighbours))
        low: Float[np.ndarray, " k"] = own[index[:, 0]] - decay * distance[:, 0]
        return low, (local[index] + growth * distance).min(axis=1)

    return bounds
