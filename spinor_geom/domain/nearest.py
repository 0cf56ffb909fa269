"""The nearest of some points of the plane, for one region or for many side by side."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree

# Regions are farther apart than any two points of one, in extents of the largest; they are kept apart by the half.
_APART = 8.0

Places = Complex[np.ndarray, " k"]
Lengths = Float[np.ndarray, " k"]
Owners = Int[np.ndarray, " k"]  # the regions of points
Regions = Owners | int  # or the one of all of them


class NearestPoints:
    """Finds the nearest of the points of a region.

    Regions lie above each other. The tree is split between them before it is within one, so that what is found for one
    does not depend on the others, down to the order of equal distances.
    """

    def __init__(self, points: Complex[np.ndarray, " n"], region: Regions = 0) -> None:
        self._apart = 1.0
        if len(points):
            self._apart = _APART * max(float(np.ptp(points.real)), float(np.ptp(points.imag)), np.finfo(float).tiny)
        self._tree = cKDTree(self._places(points, region), balanced_tree=False)

    def query(
        self, z: Places, region: Regions = 0, *, count: int = 1, within: float = np.inf
    ) -> tuple[Float[np.ndarray, "k c"], Int[np.ndarray, "k c"]]:
        """Distances and numbers of so many points nearest to each z, in order; infinite and n where there are fewer."""
        bound = min(within, 0.5 * self._apart)
        nearest = np.arange(1, min(count, max(self._tree.n, 1)) + 1)
        distance, index = self._tree.query(self._places(z, region), k=nearest, distance_upper_bound=bound)
        return np.asarray(distance), np.asarray(index)

    def _places(self, z: Places, region: Regions) -> Float[np.ndarray, "k 3"]:
        places = np.empty((len(z), 3))
        places[:, 0], places[:, 1], places[:, 2] = z.real, z.imag, self._apart * np.asarray(region)
        return places
