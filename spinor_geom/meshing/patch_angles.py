"""Angles of the triangles of a patch, and between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.kernel import call, checked


@dataclass(frozen=True, kw_only=True, eq=False)
class PatchAngles:
    """Angles of the triangles of a patch and between their normals, in degrees.

    Attributes:
        free: the smallest angle of each triangle that is not between two edges of the rim, or ∞ if all are.
        at_rim: the smallest angle between two edges of the rim that belong to one triangle, or ∞ for none.
        folds: number of half-edges across which the normal turns by more than 90°.
        largest_bend: the largest angle between triangles at an edge without a vertex of the rim, or 0 without any.
        rms_bend: the root of the mean square of these angles, weighted by the lengths of the edges.
        edge: the mean length of these edges, in mesh units.
    """

    free: Float[np.ndarray, " f"]
    at_rim: float
    folds: int
    largest_bend: float
    rms_bend: float
    edge: float

    @classmethod
    def of(
        cls, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], after: Int[np.ndarray, " m"]
    ) -> PatchAngles:
        """The angles of faces over vertices, of which the first ones are the rim, each followed by `after`."""
        n, f, m = len(vertices), len(faces), len(after)
        free, figures = np.empty(f), np.empty(5)
        points = np.ascontiguousarray(vertices, dtype=np.float64)
        corners = checked("faces", faces, np.int64, None, 3, least=0, most=n - 1)
        call("patch_angles", n, points, f, corners, m, after, free, figures)
        at_rim, folds, largest, square, edge = figures.tolist()
        return cls(
            free=free, at_rim=at_rim, folds=int(folds), largest_bend=largest, rms_bend=float(np.sqrt(square)), edge=edge
        )

    @property
    def smallest_free(self) -> float:
        """The smallest angle that is not between two edges of the rim, or ∞ for none."""
        return float(self.free.min(initial=np.inf))
