"""Triangulations of closed curves with few charged triangles and small dihedral angles."""

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import TINY
from spinor_geom.discrete.first_fill import triangles_of

_OVER_COSINES = 4.0  # more than the difference of two cosines


class FlattestTriangulation:
    """Triangles (i, j, k), i < j < k, over a closed curve with the least sum of charges.

    Of several the one whose largest angle between neighbours is small is taken, then that of least area. Dynamic
    programming over the splits of every chord, O(n³) time; as it keeps only the best triangles beyond each chord, the
    largest angle is close to the minimum, but not always equal.

    Attributes:
        least: sum of the charges of the last triangulation.

    Source: Liepa, "Filling holes in meshes", Symposium on Geometry Processing (2003).
    """

    def __init__(
        self,
        points: Float[np.ndarray, "n 3"],
        around: Float[np.ndarray, "n 3"],
        forbidden_chords: Bool[np.ndarray, "n n"],
    ) -> None:
        """Computes the normals and areas of all triangles.

        `around` are unit normals of the mesh's faces beside the edges from each point to the next, NaN for none. Edges
        i, j may be forbidden.
        """
        n = len(points)
        index = np.arange(n)
        # Quantities of the chord i to i + l are at [..., i, l], and "behind" at [..., i + l, l]; the steps then need
        # slices only. Vectors are one array for each coordinate, on which operations are several times as fast.
        chords = points.T[:, (index[:, None] + index) % n] - points.T[:, :, None]
        # normals of the triangles on the chords, cosine of the largest angle, twice the area, and the charges, so far
        self._best, self._best_behind = np.zeros((2, 6, n, n))
        self._best[:3, :, 1], self._best_behind[:3, 1:, 1] = around.T, around.T[:, :-1]
        self._best[3], self._best_behind[3] = 1.0, 1.0
        self._split = np.zeros((n, n), dtype=np.int64)
        # of the triangles i, i + m, i + l, at [l - 2][..., i, m - 1]; the limits are those of the cosines
        self._normals, self._areas, self._limits, self._charges = [], [], [], []
        self.least = 0.0
        for length in range(2, n):
            a, b = chords[:, : n - length, 1:length], chords[:, : n - length, length, None]
            normals = a[[1, 2, 0]] * b[[2, 0, 1]]
            normals -= a[[2, 0, 1]] * b[[1, 2, 0]]
            areas = np.sqrt(np.einsum("dik,dik->ik", normals, normals))
            normals /= np.maximum(areas, TINY)
            limits = np.ones_like(areas)
            if length < n - 1:
                limits[forbidden_chords.diagonal(length)] = -np.inf
            else:
                np.fmin(limits, np.einsum("dik,d->ik", normals, around[-1]), out=limits)
            self._normals.append(normals)
            self._areas.append(areas)
            self._limits.append(limits)
            self._charges.append(np.zeros_like(areas))

    def charge(self, triangles: Int[np.ndarray, "k 3"], charges: Int[np.ndarray, " k"]) -> None:
        """Sets the charges of triangles, which are 0 at first."""
        for (first, middle, last), charge in zip(triangles.tolist(), charges.tolist(), strict=True):
            self._charges[last - first - 2][first, middle - first - 1] = charge

    def triangles(self) -> Int[np.ndarray, "t 3"] | None:
        """The triangulation, or None if every triangulation contains a forbidden edge."""
        n, best, best_behind = len(self._split), self._best, self._best_behind
        steps = zip(self._normals, self._areas, self._limits, self._charges, strict=True)
        for d, (normals, own_areas, limits, own_charges) in enumerate(steps, start=2):
            ahead, behind = best[:, : n - d, 1:d], best_behind[:, d:, d - 1 : 0 : -1]
            cosines = np.minimum(ahead[3], behind[3])
            np.minimum(cosines, limits, out=cosines)
            for other in (ahead[:3], behind[:3]):
                # NaN counts as no neighbour
                np.fmin(cosines, np.einsum("dik,dik->ik", normals, other), out=cosines)
            areas = own_areas + ahead[4]
            areas += behind[4]
            charges = own_charges + ahead[5]
            charges += behind[5]
            value = cosines - _OVER_COSINES * charges
            place = np.where(value >= value.max(axis=1, keepdims=True), areas, np.inf).argmin(axis=1)
            row = np.arange(n - d)
            found = best[:, : n - d, d]
            found[:3] = normals[:, row, place]
            for k, values in enumerate((cosines, areas, charges), start=3):
                found[k] = values[row, place]
            best_behind[:, d:, d] = found
            self._split[: n - d, d] = row + 1 + place
        self.least = float(best[5, 0, -1])
        return triangles_of(self._split) if best[3, 0, -1] > -np.inf else None
