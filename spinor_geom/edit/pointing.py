"""Which loop a person points at in a picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

_NEAR = 12.0  # pixels from the pointer to a rim
_MOST_TRIED = 50  # segments of rims near the pointer that may be hidden


def rim_at(
    here: Float[np.ndarray, "2"],
    begins: Float[np.ndarray, "n 3"],
    ends: Float[np.ndarray, "n 3"],
    depth: Callable[[float, float], float],
) -> int | None:
    """The nearest segment of a rim within some pixels that nothing hides, or None without one.

    Segments have positions in pixels and the depth in the third column. `depth` is that of what is seen at a pixel.
    """
    sides = ends - begins
    length = np.maximum((sides[:, :2] ** 2).sum(axis=1), 1e-12)
    along = np.clip(((here - begins[:, :2]) * sides[:, :2]).sum(axis=1) / length, 0, 1)
    nearest = begins + along[:, None] * sides
    distances = np.linalg.norm(nearest[:, :2] - here, axis=1)
    near = np.flatnonzero(distances <= _NEAR)
    tried = near[np.argsort(distances[near])][:_MOST_TRIED].tolist()
    return next((k for k in tried if nearest[k, 2] <= depth(*nearest[k, :2].tolist())), None)


def triangles_at(here: Float[np.ndarray, "2"], corners: Float[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " _"]:
    """The triangles that contain a point in the first two coordinates."""
    to, after = corners[:, :, :2] - here, np.roll(corners[:, :, :2] - here, -1, axis=1)
    turns = to[..., 0] * after[..., 1] - to[..., 1] * after[..., 0]
    return np.flatnonzero((turns >= 0).all(axis=1) | (turns <= 0).all(axis=1))


def polygons_at(
    here: Float[np.ndarray, "2"],
    begins: Float[np.ndarray, "n 3"],
    ends: Float[np.ndarray, "n 3"],
    numbers: Int[np.ndarray, " n"],
) -> Int[np.ndarray, " _"]:
    """The polygons that contain a point in the first two coordinates. `numbers` are those of the segments' polygons."""
    (x0, y0), (x1, y1) = (begins[:, :2] - here).T, (ends[:, :2] - here).T
    is_crossed = (y0 > 0) != (y1 > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_crossed &= x0 - y0 * (x1 - x0) / (y1 - y0) > 0
    return np.flatnonzero(np.bincount(numbers[is_crossed]) % 2)


def plane_depth(here: Float[np.ndarray, "2"], points: Float[np.ndarray, "n 3"]) -> float:
    """The depth at a pixel of the plane through points, which have their depth in the third column."""
    rows = np.column_stack([np.ones(len(points)), points[:, :2] - here])
    return float(np.linalg.lstsq(rows, points[:, 2])[0][0])
