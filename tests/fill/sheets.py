"""Sheets and vessels, cut along smooth rims and along whole triangles: borders and holes of known kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import igl
import numpy as np

from spinor_geom.bench.holes import lattice
from spinor_geom.mesh.topology import face_components
from tests.fill.shapes import rounds_and_rows

Mesh = tuple[np.ndarray, np.ndarray]
Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]
Kept = Callable[[np.ndarray], np.ndarray]


def largest(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    """The largest component that is connected by edges."""
    piece = face_components(faces)
    used, faces = np.unique(faces[piece == np.argmax(np.bincount(piece))], return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def terrain(seed: int, height: float, waves: float = 3.0) -> Heights:
    """Twelve random waves. The height is that of a wave of length 2π."""
    rng = np.random.default_rng(seed)
    vectors, phases = waves * rng.normal(size=(12, 2)), rng.uniform(0, 2 * np.pi, 12)
    heights = rng.normal(size=12) * height / waves

    def at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(np.sin(np.stack([x, y], axis=-1) @ vectors.T + phases) @ heights)

    return at


def square(side: int, height: Heights, kept: Kept | None = None) -> Mesh:
    """The graph of a function over the square of half width 1, and of its faces those kept, by their middles."""
    (x, y), faces = lattice(side, side)
    x, y = 2 * x / side - 1, 2 * y / side - 1
    if kept is not None:
        faces = faces[kept(np.column_stack([x, y])[faces].mean(axis=1))]
    return largest(np.column_stack([x, y, height(x, y)]), faces)


def round_sheet(height: Heights, *, ragged: bool) -> Mesh:
    """The graph of a function over the unit disk, its rim a circle or cut along whole triangles."""
    if ragged:
        return square(24, height, lambda p: np.hypot(*p.T) < 0.96)

    def point(angle: float, radius: float) -> tuple[float, float, float]:
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        return x, y, float(height(np.asarray(x), np.asarray(y)))

    return rounds_and_rows(point, 48, np.linspace(0.05, 1, 12))  # its longest loop is the rim


def strip(middle: np.ndarray, across: np.ndarray, wide: int = 2) -> Mesh:
    """A ribbon of 120 × `wide` squares around 121 points, from −½ to ½ of the vectors across it."""
    (x, y), faces = lattice(120, wide)
    place = x.astype(int)
    return middle[place] + (y / wide - 0.5)[:, None] * across[place], faces


def columns(*parts: np.ndarray | float) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*parts), axis=-1).astype(np.float64)


def moebius(width: float) -> Mesh:
    t = np.linspace(0, 2 * np.pi, 121)
    middle = columns(np.cos(t), np.sin(t), 0.0)
    across = columns(np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2))
    vertices, faces = strip(middle, width * across, 6)
    joined = np.arange(len(vertices))
    joined[120::121] = np.arange(0, len(vertices), 121)[::-1]  # the ends meet upside down
    return largest(vertices, joined[faces])


def ribbons() -> Iterator[tuple[str, Mesh]]:
    s = np.linspace(0, 1, 121)
    up, aside = columns(0 * s, 0.0, 1.0), columns(0 * s, 1.0, 0.0)
    arc = columns(np.cos(5.2 * s), np.sin(5.2 * s), 0.0)
    coil = columns(np.cos(2 * np.pi * s), np.sin(2 * np.pi * s), 1.5 * s)
    for length in (5, 20, 100):
        straight = columns(length * s, 0.0, 0.0)
        yield f"flat {length}", strip(straight, aside)
        yield f"arced {length}", strip(length / 5.2 * arc, up)
        yield f"flat arc {length}", strip(length / 5.2 * arc, arc)
        yield f"wavy {length}", strip(straight + np.sin(20 * s)[:, None] * up, aside)
        yield f"helix {length}", strip(length / 5.2 * coil, up)
        for turns in (0.25, 1, 3):
            angle = 2 * np.pi * turns * s
            yield f"twisted {turns} {length}", strip(straight, columns(0 * s, np.cos(angle), np.sin(angle)))


def tubes_of(axes: list[tuple[list[float], list[float], float]], kept: Kept, points: int = 28) -> Mesh:
    """The outside of thick segments (start, end, radius), and of its faces those kept."""
    ticks = np.linspace(-2.2, 2.2, points)
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).transpose(2, 1, 0, 3).reshape(-1, 3)

    def distance(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        share = np.clip((grid - start) @ (end - start) / np.sum((end - start) ** 2), 0, 1)
        return np.asarray(np.linalg.norm(grid - start - share[:, None] * (end - start), axis=1))

    values = np.min([distance(np.array(a), np.array(b)) - radius for a, b, radius in axes], axis=0)
    vertices, faces = igl.marching_cubes(values, grid, points, points, points, 0.0)[:2]
    faces = np.asarray(faces, dtype=np.int64)
    return largest(vertices, faces[kept(vertices[faces].mean(axis=1))])


def garments() -> Iterator[tuple[str, Mesh]]:
    shirt = [([0, 0, -3.0], [0, 0, 0.6], 0.8), ([-3.0, 0, 0.6], [3.0, 0, 0.6], 0.35), ([0, 0, 0.5], [0, 0, 3.0], 0.4)]
    yield "shirt", tubes_of(shirt, lambda p: (p[:, 2] > -1.7) & (abs(p[:, 0]) < 1.7) & (p[:, 2] < 1.6))
    yield (
        "shirt cut obliquely",
        tubes_of(
            shirt,
            lambda p: (
                (p[:, 2] + 0.4 * p[:, 0] > -1.4)
                & (abs(p[:, 0]) + 0.3 * p[:, 2] < 1.7)
                & (p[:, 2] - 0.3 * p[:, 1] < 1.5)
            ),
        ),
    )
    bend = [([0, 0, -3.0], [0, 0, 0.8], 0.5), ([0, 0, 0.8], [3.0, 0, 0.8], 0.5)]
    yield "bent tube", tubes_of(bend, lambda p: (p[:, 2] > -1.5) & (p[:, 0] < 1.5))
