"""Better places for the inner points of a plane triangulation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import ConstrainedDelaunay, cross

# smoothing may make a triangle less round only down to this (1: equilateral)
_ROUND_ENOUGH = 0.4
# more moves, or a new triangulation between them, make no angle better
_MOVES = 2
# a point of a poor triangle tries eight places around it, at these shares of the mean length of its edges
_POLISHING_STEPS = (0.3, 0.3, 0.15, 0.15, 0.08, 0.08)
_AROUND = np.append(0, np.exp(2j * np.pi * np.arange(8) / 8))


def smooth(mesh: ConstrainedDelaunay) -> None:
    """Moves inner points to the mean of their neighbours, twice, where no face is flipped, and triangulates anew."""
    points, faces, m = mesh.points, mesh.triangles, mesh.boundary_size
    n = len(points)
    if n == m:
        return
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    degree = np.bincount(a, minlength=n)[m:]
    for _ in range(_MOVES):
        total = np.bincount(a, points.real[b], n) + 1j * np.bincount(a, points.imag[b], n)
        moved = points.copy()
        moved[m:] = total[m:] / degree
        points = _held_back(points, moved, faces, mesh.region)
    mesh.move(points, np.unique(mesh.region[m:]))


def polish(mesh: ConstrainedDelaunay, min_angle: float) -> None:
    """Moves inner points of triangles with an angle below `min_angle` degrees to the best of a few places nearby."""
    sine = np.sin(np.radians(min_angle))
    for step in _POLISHING_STEPS:
        points, faces = mesh.points, mesh.triangles
        chosen = _worst_points(mesh, faces, sine)
        if not chosen.any():
            break
        # every corner of a face at a chosen point, sorted by point
        corner = np.flatnonzero(chosen[faces].ravel())
        corner = corner[np.argsort(faces.ravel()[corner], kind="stable")]
        own, face, k = faces.ravel()[corner], corner // 3, corner % 3
        p, q = points[faces[face, (k + 1) % 3]], points[faces[face, (k + 2) % 3]]
        start = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
        vertex, count = own[start], np.diff(np.append(start, len(own)))
        reach = np.add.reduceat(np.abs(p - points[own]), start) / count
        mean = np.add.reduceat(p, start) / count
        places = points[vertex][:, None] + step * reach[:, None] * _AROUND
        places = np.append(places, mean[:, None], axis=1)
        sines = smallest_sine(np.repeat(places, count, axis=0), p[:, None], q[:, None])
        best = np.minimum.reduceat(sines, start, axis=0).argmax(axis=1)
        points = points.copy()
        points[vertex] = places[np.arange(len(vertex)), best]
        mesh.move(points, np.unique(mesh.region[vertex]))


def smallest_sine(
    a: Complex[np.ndarray, "*#n"], b: Complex[np.ndarray, "*#n"], c: Complex[np.ndarray, "*#n"]
) -> Float[np.ndarray, "*n"]:
    """Sine of the smallest angle of triangles a, b, c; negative for clockwise ones."""
    ab, bc, ca = np.abs(b - a), np.abs(c - b), np.abs(a - c)
    longest = np.maximum(ab, np.maximum(bc, ca))
    middle = ab + bc + ca - longest - np.minimum(ab, np.minimum(bc, ca))
    return np.asarray(cross(b - a, c - a) / (longest * middle))


def _worst_points(mesh: ConstrainedDelaunay, faces: Int[np.ndarray, "t 3"], sine: float) -> Bool[np.ndarray, " n"]:
    """Marks inner points of poor triangles that are worse than all their neighbours: these can move independently."""
    n = len(mesh.points)
    quality = smallest_sine(*mesh.points[faces].T)
    poor = np.flatnonzero(quality < sine)
    key = np.full(n, np.inf)
    np.minimum.at(key, faces[poor].ravel(), np.repeat(quality[poor], 3))
    key[: mesh.boundary_size] = np.inf
    # the corners of one triangle share its quality: the place among its region's points decides
    for own in mesh.own:
        key[own] += np.arange(len(own)) * 1e-12
    least = np.full(n, np.inf)
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    np.minimum.at(least, a, key[b])
    np.minimum.at(least, b, key[a])
    return np.asarray(np.isfinite(key) & (key < least))


def _held_back(
    points: Complex[np.ndarray, " n"],
    moved: Complex[np.ndarray, " n"],
    faces: Int[np.ndarray, "t 3"],
    region: Int[np.ndarray, " n"],
) -> Complex[np.ndarray, " n"]:
    """The moved points, except around faces that the move would flip or make thin."""
    before = _roundness(points[faces])
    for _ in range(10):
        after = _roundness(moved[faces])
        worse = (after < _ROUND_ENOUGH) & (after < before)
        if not worse.any():
            return moved
        back = faces[worse].ravel()
        moved[back] = points[back]
    # nothing moves in regions where that was not enough
    return np.where(np.isin(region, region[back]), points, moved)


def _roundness(p: Complex[np.ndarray, "t 3"]) -> Float[np.ndarray, " t"]:
    """Area over the sum of squared edges, 1 for an equilateral triangle, not positive for a flipped one."""
    b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    squares = np.abs(b) ** 2 + np.abs(c) ** 2 + np.abs(c - b) ** 2
    return np.asarray(2 * np.sqrt(3.0) * cross(b, c) / squares)
