"""How long the edges of a triangulation shall be beside a boundary and away from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Complex

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.domain.nearest import Lengths, NearestPoints, Owners, Places, Regions

SizeFunction = Callable[[Places], Lengths]
RegionSizes = Callable[[Places, Owners], Lengths]
SizeBounds = Callable[[Places, Regions], tuple[Lengths, Lengths]]

# Change of the edge length per unit of distance from the boundary, upwards.
GROWTH = 0.35


def graded_size(*polygons: Complex[np.ndarray, " _"], growth: float = GROWTH) -> SizeFunction:
    """Edge length that is the local one at the closed polygons of a boundary and grows with the distance from them.

    h(z) = min_j (e_j + growth·|z − b_j|) over the boundary vertices b_j nearest to z; e_j is the mean of the two
    boundary edges at b_j, lowered where a neighbour's e_i + growth·|b_i − b_j| is smaller. In units of Ω.
    """
    bounds = size_bounds(polygons, growth=growth, decay=0.0)
    return lambda z: bounds(z, 0)[1]


def graded_sizes(polygons: Sequence[Complex[np.ndarray, " _"]]) -> RegionSizes:
    """`graded_size` inside each of several polygons, by their numbers."""
    bounds = size_bounds(polygons, range(len(polygons)), growth=GROWTH, decay=0.0)
    return lambda z, region: bounds(z, region)[1]


def size_bounds(
    polygons: Sequence[Complex[np.ndarray, " _"]], regions: Sequence[int] = (), *, growth: float, decay: float
) -> SizeBounds:
    """The range of edge lengths that pass gradually into those of closed polygons: of one region, or of those named.

    As functions of points (k,) and their regions. The upper bound is `graded_size`; the lower one, which may be
    negative, falls by `decay` per unit of distance from the local edge length at the nearest vertex.
    """
    rims, boundary = tuple(map(len, polygons)), np.concatenate(polygons)
    region = np.repeat(regions or (0,) * len(rims), rims)
    after = rim_successors(rims)
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

    def bounds(z: Places, region: Regions) -> tuple[Lengths, Lengths]:
        distance, index = tree.query(z, region, count=3)
        low: Lengths = own[index[:, 0]] - decay * distance[:, 0]
        return low, (around[index] + growth * distance).min(axis=1)

    return bounds
