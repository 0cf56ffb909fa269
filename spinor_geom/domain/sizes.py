"""Size functions: the wanted edge length at any point, from the lengths of the boundary edges."""

from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import Lengths, Owners, Places, rim_successors

Polygon = Complex[np.ndarray, " _"]
Regions = Owners | int  # of each point, or of all points
SizeFunction = Callable[[Places], Lengths]
RegionSizes = Callable[[Places, Owners], Lengths]
Bounded = Callable[[Lengths | float, Places, Regions], Lengths]

# largest increase and decrease of the edge length per unit of distance from the boundary
GROWTH, DECAY = 0.35, 0.5
# Distance between regions in a search tree, and the radius of searches; both exceed any loop.
_APART, _FARTHEST = 2.0**256, 2.0**255


def graded_size(*polygons: Polygon, growth: float = GROWTH) -> SizeFunction:
    """Edge length that equals the local one at the boundary polygons and grows with the distance from them.

    h(z) = min_j (e_j + growth·|z − b_j|) over the boundary vertices b_j nearest to z; e_j is the mean of the two
    boundary edges at b_j, lowered where a neighbour's e_i + growth·|b_i − b_j| is smaller. In units of Ω.
    """
    bounded = size_bounds(polygons, growth=growth, decay=0.0)
    return lambda z: bounded(np.inf, z, 0)


def graded_sizes(polygons: Sequence[Polygon], longest: Float[np.ndarray, " r"] | float = np.inf) -> RegionSizes:
    """`graded_size` in several regions, each bounded by one polygon, and at most about `longest` in each."""
    bounded = size_bounds(polygons, range(len(polygons)), growth=GROWTH, decay=DECAY)
    lengths = np.broadcast_to(longest, len(polygons))
    return lambda z, region: bounded(lengths[region], z, region)


def size_bounds(polygons: Sequence[Polygon], regions: Sequence[int] = (), *, growth: float, decay: float) -> Bounded:
    """A function that bounds edge lengths, the first argument, at points of Ω, the second; the third are their regions.

    The upper bound is `graded_size`. The lower bound is the local edge length at the nearest boundary vertex minus
    `decay` times the distance from it. `regions` is the region of each polygon, by default 0.
    """
    rims, boundary = tuple(map(len, polygons)), np.concatenate(polygons)
    region = np.repeat(regions or (0,) * len(rims), rims)
    after = rim_successors(rims)
    edge = np.abs(boundary[after] - boundary)
    own = local = 0.5 * (edge + edge[np.argsort(after)])
    tree = NearestPoints(boundary, region)
    distance, index = tree.query(boundary, region, count=8)
    for _ in range(4):
        local = (np.append(local, np.inf)[index] + growth * distance).min(axis=1)  # inf for missing neighbours
    least, most = local.min(), own.max()
    around, own = np.append(local, np.inf), np.append(own, -np.inf)

    def bounded(length: Lengths | float, z: Places, region: Regions) -> Lengths:
        # Farther from the boundary the bounds have no effect. In the middle of a disk all vertices are equally far, and
        # the search for the nearest ones would visit them all.
        far = max((np.max(length, initial=0.0) - least) / growth, most / decay) if decay else np.inf
        distance, index = tree.query(z, region, count=3, within=far)
        low = own[index[:, 0]] - decay * distance[:, 0]
        return np.asarray(np.minimum(np.maximum(length, low), (around[index] + growth * distance).min(axis=1)))

    return bounded


class NearestPoints:
    """KD-tree of the points of several regions; a query finds points of its own region only.

    Regions are stacked in a third coordinate, far apart and in order. The tree is split between regions first, so that
    the result in one region, including the order of equal distances, does not depend on the others.
    """

    def __init__(self, points: Complex[np.ndarray, " n"], region: Regions = 0) -> None:
        order = np.argsort(np.zeros(len(points), dtype=np.int64) + region, kind="stable")
        self._numbers = np.concatenate([order, [len(points)]])
        self._tree = cKDTree(_places(points, region)[order], balanced_tree=False, copy_data=False)

    def query(
        self, z: Places, region: Regions = 0, *, count: int = 1, within: float = np.inf
    ) -> tuple[Float[np.ndarray, "k c"], Int[np.ndarray, "k c"]]:
        """Distances and numbers of the `count` points nearest to each z, ascending; (inf, n) for those missing."""
        nearest = np.arange(1, min(count, max(self._tree.n, 1)) + 1)
        bound = min(within, _FARTHEST)
        distance, index = self._tree.query(_places(z, region), k=nearest, distance_upper_bound=bound)
        return np.asarray(distance), self._numbers[np.asarray(index)]

    def within(
        self, radius: Lengths, *, of: Places, region: Owners
    ) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
        """Pairs of a point and a centre, by their numbers, no farther from each other than the radius of the centre."""
        found = self._tree.query_ball_point(_places(of, region), radius, return_sorted=False)
        centre = np.repeat(np.arange(len(of)), [len(some) for some in found])
        return self._numbers[np.fromiter(chain.from_iterable(found), dtype=np.int64, count=len(centre))], centre


def _places(z: Places, region: Regions) -> Float[np.ndarray, "k 3"]:
    places = np.empty((len(z), 3))
    places[:, 0], places[:, 1], places[:, 2] = z.real, z.imag, _APART * np.asarray(region)
    return places
