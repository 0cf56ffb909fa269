"""Triangulations of closed curves with small dihedral angles and without forbidden triangles."""

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import TINY
from spinor_geom.discrete.first_fill import triangles_of


def flattest_triangulation(
    points: Float[np.ndarray, "n 3"],
    around: Float[np.ndarray, "n 3"],
    forbidden_chords: Bool[np.ndarray, "n n"],
    forbidden_triangles: Bool[np.ndarray, "n n n"],
) -> Int[np.ndarray, "t 3"] | None:
    """Triangles (i, j, k), i < j < k, over a closed curve whose largest angle between neighbours is small.

    Ties are broken by area. Dynamic programming over the splits of every chord, O(n³) time; as it keeps only the best
    triangles beyond each chord, the largest angle is close to the minimum, but not always equal.

    `around` are unit normals of the mesh's faces beside the edges from each point to the next, NaN for none. Edges i, j
    and triangles i, j, k may be forbidden. None if every triangulation contains a forbidden one.

    Source: Liepa, "Filling holes in meshes", Symposium on Geometry Processing (2003).
    """
    n = len(points)
    index = np.arange(n)
    normals = np.full((n, n, 3), np.nan)  # of the triangle on the chord from i to j
    normals[index[:-1], index[1:]] = around[:-1]
    bend, area = np.zeros((n, n)), np.zeros((n, n))  # 1 − cosine of the largest angle, and twice the area, so far
    split = np.zeros((n, n), dtype=np.int64)
    for d in range(2, n):
        first = index[: n - d, None]
        middle, last = first + index[1:d], first + d
        a, b = points[middle] - points[first], points[last] - points[first]
        cross = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
        twice = np.sqrt(np.einsum("ikd,ikd->ik", cross, cross))
        normal = cross / np.maximum(twice, TINY)[:, :, None]
        beside = [normals[first, middle], normals[middle, last]]
        if d == n - 1:
            beside.append(around[None, -1:])
        most = np.maximum(bend[first, middle], bend[middle, last])
        for other in beside:
            cosine = np.einsum("ikd,ikd->ik", normal, np.broadcast_to(other, normal.shape))
            most = np.fmax(most, 1 - cosine)  # a NaN counts as no neighbour
        most[forbidden_triangles[first, middle, last]] = np.inf
        if d < n - 1:
            most[forbidden_chords[first[:, 0], last[:, 0]]] = np.inf
        total = twice + area[first, middle] + area[middle, last]
        least = most.min(axis=1, keepdims=True)
        best = np.where(most <= least, total, np.inf).argmin(axis=1)
        start, end, row = first[:, 0], last[:, 0], index[: n - d]
        normals[start, end] = normal[row, best]
        bend[start, end], area[start, end] = least[:, 0], total[row, best]
        split[start, d] = start + 1 + best
    return triangles_of(split) if np.isfinite(bend[0, -1]) else None
