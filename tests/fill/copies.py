"""Polygons of several kinds, meshes around them, and copies that differ by position, units, and numbering."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.stats import special_ortho_group

Mesh = tuple[np.ndarray, np.ndarray]
Move = Callable[[np.ndarray], np.ndarray]


def _round(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angle = 2 * np.pi * np.arange(count) / count
    return angle, np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), (-1.0) ** np.arange(count)


def _star(rng: np.random.Generator) -> np.ndarray:
    angle, radius = np.sort(rng.uniform(0, 2 * np.pi, 21)), rng.uniform(0.2, 1, 21)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])


def _comb(rng: np.random.Generator) -> np.ndarray:
    teeth = [[[k, 0, 0], [k, rng.uniform(1, 9), 0], [k + 0.5, rng.uniform(1, 9), 0], [k + 0.5, 0, 0]] for k in range(4)]
    points = np.concatenate([*teeth, [[4, -1, 0], [0, -1, 0]]]).astype(float)
    points[:, 2] = 0.1 * rng.normal(size=len(points))
    return points


def _spiral(rng: np.random.Generator) -> np.ndarray:
    s = np.linspace(0.1, 1, 7)
    arm = np.column_stack([s * np.cos(14 * s), s * np.sin(14 * s), 0 * s])
    return np.concatenate([arm, 1.01 * arm[::-1] + rng.normal(size=(7, 3)) * 1e-3])


def _smooth(rng: np.random.Generator) -> np.ndarray:
    angle, points, _ = _round(24)
    for k in (2, 3):
        a, b = rng.uniform(-0.2, 0.2, (2, 3))
        points = points + np.cos(k * angle)[:, None] * a + np.sin(k * angle)[:, None] * b
    return points


POLYGONS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "star": _star,
    "comb": _comb,
    "spiral": _spiral,
    "smooth": _smooth,
    "circle": lambda rng: _round(16)[1],
    "zigzag": lambda rng: _round(18)[1] + 0.4 * _round(18)[2][:, None] * [0, 0, 1],
    "tall zigzag": lambda rng: _round(18)[1] + 0.8 * _round(18)[2][:, None] * [0, 0, 1],
    "noisy": lambda rng: _round(20)[1] + 0.1 * rng.normal(size=(20, 3)),
    "almost round": lambda rng: _round(14)[1] + 1e-11 * rng.normal(size=(14, 3)),
    "random": lambda rng: rng.normal(size=(11, 3)),
    "walk": lambda rng: np.cumsum(rng.normal(size=(15, 3)), axis=0),
    "quad": lambda rng: rng.normal(size=(4, 3)),
}


def motions(rng: np.random.Generator) -> Iterator[tuple[float, Move]]:
    """Rigid motions, scalings and a reflection, with the scale of each."""
    turn, shift = special_ortho_group.rvs(3, random_state=rng), rng.normal(size=3)
    yield 1.0, lambda x: x @ turn.T + 3 * shift
    yield 1e3, lambda x: 1e3 * x
    yield 0.125, lambda x: x / 8
    yield 1.0, lambda x: x * [1, 1, -1]


def bucket(points: np.ndarray) -> Mesh:
    """A mesh with one hole, bounded by a polygon."""
    m, centre = len(points), points.mean(axis=0)
    depth = np.linalg.norm(points - centre, axis=1).max() * np.array([0, 0, 1.0])
    ring = centre + 1.2 * (points - centre) - 0.3 * depth
    i, j = np.arange(m), np.roll(np.arange(m), -1)
    faces = [np.column_stack(three) for three in ((i, i + m, j), (j, i + m, j + m), (i + m, 0 * i + 2 * m, j + m))]
    return np.vstack([points, ring, centre - 2 * depth]), np.concatenate(faces)


def renumbered(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The mesh with vertices, faces and the corners of faces in another order."""
    vertices, faces = mesh
    numbers = rng.permutation(len(vertices))
    moved = np.empty_like(vertices)
    moved[numbers] = vertices
    turned = (rng.integers(3, size=len(faces))[:, None] + np.arange(3)) % 3
    return moved, np.take_along_axis(numbers[faces], turned, axis=1)[rng.permutation(len(faces))]
