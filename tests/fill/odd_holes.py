"""Seeded meshes with one irregular rim: points repeated, nearly equal, collinear, on spikes, pinched, or far away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.fill.shapes import collar

Random = np.random.Generator


def _star(random: Random, count: int) -> np.ndarray:
    """A wavy star-shaped polygon in space."""
    angle = 2 * np.pi * np.arange(count) / count
    radius = random.uniform(0.3, 1, count) if random.random() < 0.5 else 1 + 0.3 * np.sin(3 * angle)
    height = random.choice([0.0, 0.05, 0.5]) * random.normal(size=count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])


def _plane(random: Random, count: int) -> np.ndarray:
    return _star(random, count) @ np.diag([1, 1, 0])


def _any_points(random: Random, count: int) -> np.ndarray:
    """Random points: the edges cross each other in every projection."""
    return random.normal(size=(count, 3))


def _repeated(random: Random, count: int) -> np.ndarray:
    """Positions that come twice: of neighbours, and of points far from each other along the rim."""
    points = _star(random, count)
    for _ in range(random.integers(1, 4)):
        step = 1 if random.random() < 0.5 else random.integers(1, count)
        at = random.integers(count)
        points[at] = points[(at + step) % count]
    return points


def _nearly_repeated(random: Random, count: int) -> np.ndarray:
    points = _star(random, count)
    for _ in range(random.integers(1, 4)):
        at = random.integers(count)
        other = (at + random.integers(1, count)) % count
        points[at] = points[other] + 10.0 ** random.uniform(-14, -3) * random.normal(size=3)
    return points


def _on_lines(random: Random, count: int) -> np.ndarray:
    """A polygon of few corners whose sides are divided."""
    corners = min(count, int(random.integers(3, 7)))
    ends = _star(random, corners)
    share = np.linspace(0, corners, count, endpoint=False)
    first = share.astype(int)
    return ends[first] + (share - first)[:, None] * (ends[(first + 1) % corners] - ends[first])


def _there_and_back(random: Random, count: int) -> np.ndarray:
    """Spikes of width zero or nearly zero."""
    points = _star(random, count)
    for _ in range(random.integers(1, 3)):
        at = int(random.integers(count))
        tip = points[at] * random.uniform(1.5, 4) * random.choice([1, -0.2])
        hair = random.choice([0.0, 1e-9, 1e-3]) * random.normal(size=3)
        points = np.insert(points, at + 1, [tip, points[at] + hair], axis=0)
    return points


def _far_point(random: Random, count: int) -> np.ndarray:
    """One edge, or two, much longer than the others."""
    points = _star(random, count)
    if random.random() < 0.5:
        points[random.integers(count)] *= 10.0 ** random.uniform(1, 4)
        return points
    angle = np.pi * np.arange(count) / (count - 1)
    return np.column_stack([np.cos(angle), np.sin(angle), 0.1 * random.normal() * np.sin(2 * angle)])


def _touching(random: Random, count: int) -> np.ndarray:
    """A figure of eight whose middle is one point, or two at a small height over each other."""
    angle = 2 * np.pi * np.arange(count) / count
    height = random.choice([0.0, 1e-9, 1e-3, 0.2]) * np.cos(angle)
    return np.column_stack([np.sin(angle), np.sin(angle) * np.cos(angle), height])


def _comb(random: Random, count: int) -> np.ndarray:
    """A plane comb, whose teeth are narrow and near to each other."""
    teeth = max(1, count // 4)
    gap = 10.0 ** random.uniform(-4, -1)
    left = np.arange(teeth) * 2 * gap
    x = np.stack([left, left, left + gap, left + gap], axis=1).ravel()
    y = np.tile([0.0, 1.0, 1.0, 0.0], teeth)
    top = np.column_stack([x, y, np.zeros(len(x))])[::-1]
    return np.concatenate([top, [[0, -0.3, 0], [x.max(), -0.3, 0]]])


RIMS: dict[str, Callable[[Random, int], np.ndarray]] = {
    "star": _star,
    "plane": _plane,
    "any points": _any_points,
    "repeated": _repeated,
    "nearly repeated": _nearly_repeated,
    "on lines": _on_lines,
    "there and back": _there_and_back,
    "far point": _far_point,
    "touching": _touching,
    "comb": _comb,
}


def rim(kind: str, seed: int) -> np.ndarray:
    """The points of an irregular rim, 3 to about 100."""
    random = np.random.default_rng([seed, *kind.encode()])
    counts = [random.integers(3, 8), random.integers(8, 30), random.integers(30, 100)]
    count = int(random.choice(counts, p=[0.4, 0.4, 0.2]))
    return RIMS[kind](random, count)


def mesh(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A band of good or of poor triangles around an irregular rim. In some, two rim vertices are equal, a pinch."""
    points = rim(kind, seed)
    random = np.random.default_rng([seed, 1])
    count, away = len(points), points - points.mean(axis=0)
    offset = random.choice([0.02, 0.5]) * away
    if random.random() < 0.5:  # of poor triangles: thin, folded over, without area
        offset = offset * 10.0 ** random.uniform(-6, 0, (count, 1)) + random.choice([0.0, 0.1]) * random.normal(
            size=(count, 3)
        )
        offset[random.random(count) < 0.1] = 0
    vertices, faces = collar(points, offset)
    if count > 7 and random.random() < 0.2:
        faces[faces == count // 2] = 0
    return vertices, faces
