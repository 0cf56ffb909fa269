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
    # Quantities of the chord i to i + l are at [..., i, l], and "behind" at [..., i + l, l]; the loop below then needs
    # slices only. Vectors are one array for each coordinate, on which operations are several times as fast.
    chords = points.T[:, (index[:, None] + index) % n] - points.T[:, :, None]
    # unit normals of the triangles on the chords; 1 − cosine of the largest angle, and twice the area, so far
    normals, normals_behind = np.full((2, 3, n, n), np.nan)
    normals[:, :, 1] = around.T
    normals_behind[:, 1:, 1] = around.T[:, :-1]
    bend, bend_behind, area, area_behind = np.zeros((4, n, n))
    split = np.zeros((n, n), dtype=np.int64)
    forbidden = np.zeros((n, n, n), dtype=bool)  # by first point, and offsets of the last and of the middle one
    first, middle, last = np.nonzero(forbidden_triangles)
    forbidden[first, last - first, middle - first] = True
    for d in range(2, n):
        ahead, back = (..., slice(0, n - d), slice(1, d)), (..., slice(d, n), slice(d - 1, 0, -1))
        a, b = chords[ahead], chords[:, : n - d, d : d + 1]
        normal = a[[1, 2, 0]] * b[[2, 0, 1]]
        normal -= a[[2, 0, 1]] * b[[1, 2, 0]]
        twice = np.sqrt(np.einsum("dik,dik->ik", normal, normal))
        normal /= np.maximum(twice, TINY)
        beside = [normals[ahead], normals_behind[back]]
        if d == n - 1:
            beside.append(around[-1][:, None, None])
        most = np.maximum(bend[ahead], bend_behind[back])
        for other in beside:
            cosine = np.einsum("dik,dik->ik", normal, np.broadcast_to(other, normal.shape))
            most = np.fmax(most, 1 - cosine)  # a NaN counts as no neighbour
        if len(first):
            most[forbidden[: n - d, d, 1:d]] = np.inf
        if d < n - 1:
            most[forbidden_chords.diagonal(d)] = np.inf
        total = twice + area[ahead] + area_behind[back]
        least = most.min(axis=1, keepdims=True)
        best = np.where(most <= least, total, np.inf).argmin(axis=1)
        row = index[: n - d]
        normals[:, row, d] = normals_behind[:, row + d, d] = normal[:, row, best]
        bend[row, d] = bend_behind[row + d, d] = least[:, 0]
        area[row, d] = area_behind[row + d, d] = total[row, best]
        split[row, d] = row + 1 + best
    return triangles_of(split) if np.isfinite(bend[0, -1]) else None
