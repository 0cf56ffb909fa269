"""Cameras of scenes: parallel projections, and how they frame points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

_ALONG = np.cos(np.pi / 4)  # within 45° of the upward axis another one is upwards


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A parallel projection: `direction` is the unit vector to the eye, `radius` half the height that is shown."""

    focus: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    radius: float

    @property
    def frame(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors to the right, upwards and to the eye, as rows."""
        return _frame(self.direction, self.up)

    @classmethod
    def around(
        cls,
        points: Float[np.ndarray, "n 3"],
        direction: Float[np.ndarray, "3"],
        up: Float[np.ndarray, "3"],
        *,
        aspect: float = 1,
    ) -> Camera:
        """The closest camera in a direction that shows all points. `aspect` is the picture's width per height."""
        frame = _frame(direction, up)
        seen = points @ frame.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        radius = float(((high - low)[:2] / [aspect, 1]).max() / 2) or 1.0
        return cls(focus=(low + high) / 2 @ frame, direction=direction, up=up, radius=radius)

    @classmethod
    def facing(
        cls,
        points: Float[np.ndarray, "n 3"],
        normal: Float[np.ndarray, "3"],
        up: Literal["y", "z"] = "y",
        *,
        aspect: float = 1,
    ) -> Camera:
        """As `around`, against a unit normal. `up` is the axis that is upwards."""
        place = "xyz".index(up)
        axis = np.eye(3)[place]
        if abs(normal[place]) > _ALONG:
            axis = np.array([0.0, 0.0, -np.sign(normal[1])] if up == "y" else [0.0, 1.0, 0.0])
        return cls.around(points, normal, upright(normal, axis), aspect=aspect)


def upright(direction: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The unit vector perpendicular to a direction that is nearest to an axis."""
    up = axis - (axis @ direction) * direction
    return np.asarray(up / np.linalg.norm(up))


def _frame(direction: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    return np.stack([np.cross(up, direction), up, direction])
