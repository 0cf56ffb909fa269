"""Meshes of fewer triangles, for quick pictures and small pages."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

_MOST = 2**20  # cells of the grid along an axis, so that their numbers fit


def thinned(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], is_kept: Bool[np.ndarray, " n"], step: float
) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "g 3"], Int[np.ndarray, " m"], Int[np.ndarray, " g"]]:
    """A mesh with one vertex in each cell of a cubic grid, the mean of those there, and the vertices to be kept.

    Triangles that would be turned over are left out: others lie over and under them. `step` is the edge of a cell.

    Returns:
        Its vertices and faces, and the index of a vertex, or a face, of the given mesh for each of them.
    """
    used, place = np.unique(faces, return_inverse=True)
    points, place = vertices[used], place.reshape(-1, 3)
    above = points - points.min(axis=0)
    cell = (above / (max(step, above.max() / _MOST) or 1.0)).astype(np.int64) @ [1, _MOST + 1, (_MOST + 1) ** 2]
    kept_points = np.flatnonzero(is_kept[used])
    cell[kept_points] = -1 - kept_points
    _, first, new = np.unique(cell, return_index=True, return_inverse=True)
    means = np.stack([np.bincount(new, weights=axis) for axis in points.T], axis=1) / np.bincount(new)[:, None]
    corners = new[place]
    kept = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
    kept = kept[(_normals(means[corners[kept]]) * _normals(points[place[kept]])).sum(axis=1) >= 0]
    return means, corners[kept], used[first], kept


def _normals(corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
