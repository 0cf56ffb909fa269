"""Triangulations of closed curves with few charged triangles and small dihedral angles."""

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.discrete.first_fill import triangles_of
from spinor_geom.kernel import call, checked


class FlattestTriangulation:
    """Triangles (i, j, k), i < j < k, over a closed curve with the least sum of charges.

    Of several the one whose largest angle between neighbours is small is taken, then that of least area. Dynamic
    programming over the splits of every chord, O(n³) time. As it keeps only the best triangles beyond each chord, the
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
        """`around` are unit normals of the mesh's faces beside the edges from each point to the next, NaN for none.

        Edges i, j may be forbidden.
        """
        n = len(points)
        self._points, self._around = checked("points", points, np.float64, None, 3), np.ascontiguousarray(around)
        self._limits = np.where(forbidden_chords, -np.inf, 1.0)  # of the cosines
        self._limits[0, -1] = 1.0  # no chord, but the last edge of the curve
        self._charges = np.zeros((n, n, n), dtype=np.int32)
        self.least = 0.0

    def charge(self, triangles: Int[np.ndarray, "k 3"], charges: Int[np.ndarray, " k"]) -> None:
        """Sets the charges of triangles, which are 0 at first."""
        first, middle, last = triangles.T
        self._charges[first, last, middle] = charges

    def triangles(self) -> Int[np.ndarray, "t 3"] | None:
        """The triangulation, or None if every triangulation contains a forbidden edge."""
        n, least = len(self._points), np.zeros(2)
        split = np.zeros((n, n), dtype=np.int64)
        call("flattest_splits", n, self._points, self._around, self._limits, self._charges, split, least)
        self.least = float(least[0])
        return triangles_of(split) if least[1] > -np.inf else None
