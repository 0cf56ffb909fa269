"""Open curves through points, with corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from spinor_geom.errors import OptionError, RepeatedPointError
from spinor_geom.mesh.array_checks import freeze_points


@dataclass(frozen=True, eq=False)
class OpenCurve:
    """An open curve through points in order.

    Attributes:
        points: (m, 3) real numbers, m ≥ 2, in mesh units.
        corners: indices of the inner points that are corners, or "auto" to detect them.

    Raises:
        MeshShapeError, NonFiniteVertexError, RepeatedPointError: as for `BoundaryLoop.from_points`.
        OptionError: fewer than two points, or a corner is no inner point.
    """

    points: Float[np.ndarray, "m 3"]
    corners: Literal["auto"] | ArrayLike = "auto"

    def __post_init__(self) -> None:
        points = freeze_points(self.points, name="points")
        if len(points) < 2:
            raise OptionError(f"an open curve needs at least 2 points, got {len(points)}")
        equal = np.flatnonzero((points[1:] == points[:-1]).all(axis=1))
        if len(equal):
            raise RepeatedPointError(index=int(equal[0]))
        self.__dict__["points"] = points
        corners = np.array([]) if isinstance(self.corners, str) and self.corners == "auto" else np.asarray(self.corners)
        if corners.size and (corners.dtype.kind not in "iu" or corners.min() < 1 or corners.max() > len(points) - 2):
            raise OptionError(
                f"corners of an open curve are inner points, 1 to {len(points) - 2}, got {self.corners!r}"
            )

    def __repr__(self) -> str:
        return f"OpenCurve({len(self.points)} points)"

    @property
    def is_detected(self) -> bool:
        """Whether corners are detected. Two points are the ends of a straight line."""
        return len(self.points) > 2 and isinstance(self.corners, str) and self.corners == "auto"

    @property
    def is_corner(self) -> Bool[np.ndarray, " m"]:
        """Which points are given as corners."""
        return np.isin(np.arange(len(self.points)), np.array([]) if isinstance(self.corners, str) else self.corners)
