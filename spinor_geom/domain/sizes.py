"""How long the edges of a triangulation shall be beside a boundary and away from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import Rims, rim_successors
from spinor_geom.domain.nearest import NearestPoints, Regions

SizeFunction = Callable[[Complex[np.ndarray, " k"]], Float[np.ndarray, " k"]]
RegionSizes = Callable[[Complex[np.ndarray, " k"], Int[np.ndarray, " k"]], Float[np.ndarray, " k"]]
SizeBounds = Callable[[Complex[np.ndarray, " k"], Regions], tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]]

# Change of the edge length per unit of distance from the boundary, upwards.
GROWTH = 0.35


def graded_size(
    boundary: Complex[np.ndarray, " m"],
    *,
    growth: float = GROWTH,
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
    return lambda z: bounds(z, 0)[1]


def graded_sizes(polygons: Sequence[Complex[np.ndarray, " _"]]) -> RegionSizes:
    """`graded_size` inside each of several polygons, by their numbers."""
    rims = tuple(map(len, polygons))
    owner = np.repeat(np.arange(len(rims)), rims)
    bounds = size_bounds(np.concatenate(polygons), growth=GROWTH, decay=0.0, rims=rims, region=owner)
    return lambda z, region: bounds(z, region)[1]


def size_bounds(
    boundary: Complex[np.ndarray, " m"], *, growth: float, decay: float, rims: Rims | None = None, region: Regions = 0
) -> SizeBounds:
    """The range of edge lengths that pass gradually into those of a boundary.

    Args:
        boundary: Closed polygon, in units of Ω, or several, one after the other.
        growth: Increase of the upper bound per unit of distance; it is `graded_size`.
        decay: Decrease of the lower bound, from the local edge length at the nearest boundary vertex.
        rims: Numbers of vertices of the polygons; none for a single one.
        region: That each vertex bounds.

    Returns:
        A function from points (k,) and their regions to lower bounds (k,), which may be negative, and upper bounds
        (k,).
    """
    after = rim_successors(rims or (len(boundary),))
    edge = np.abs(boundary[after] - boundary)
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    own = local = 0.5 * (edge + edge[before])
    tree = NearestPoints(boundary, region)
    distance, index = tree.query(boundary, region, count=8)
    for _ in range(4):
        # where a region has fewer vertices
        local = (np.append(local, np.inf)[index] + growth * distance).min(axis=1)
    around = np.append(local, np.inf)

    def bounds(
        z: Complex[np.ndarray, " k"], region: Regions
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        distance, index = tree.query(z, region, count=3)
        low: Float[np.ndarray, " k"] = own[index[:, 0]] - decay * distance[:, 0]
        return low, (around[index] + growth * distance).min(axis=1)

    return bounds
