"""Rims as people have them: cut along triangles out of known meshes, or with noise."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float

from spinor_geom.bench.cut_outs import cut
from spinor_geom.bench.holes import Hole, collar, lattice

SHORTEST, LONGEST = 13, 120
CUT = tuple(f"cut-{place:02}" for place in range(60))
"""Names of the first 60 rims of so many points that are cut out of generated meshes."""

NOISY: Mapping[str, tuple[float, int]] = {
    f"noise-{noise:.0%}-{points}": (noise, points) for noise in (0.05, 0.15, 0.3) for points in (100, 250, 600, 1200)
}
"""Noise in mean edges and points of rims with noise."""


def ragged_hole(name: str) -> Hole:
    """The rim of a name."""
    return _collar(*NOISY[name]) if name in NOISY else _cut_rims()[CUT.index(name)]


def _collar(noise: float, points: int) -> Hole:
    """A strip outside a noisy ellipse."""
    random = np.random.default_rng(points)
    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).mean()
    inner = rim + noise * edge * random.standard_normal(rim.shape)
    outer = np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)])
    return collar(f"noise-{noise:.0%}-{points}", inner, outer)


@lru_cache(maxsize=1)
def _cut_rims() -> tuple[Hole, ...]:
    return tuple(replace(hole, name=name) for name, hole in zip(CUT, _cut_holes(), strict=False))


def _cut_holes() -> Iterator[Hole]:
    """Caps and windows of icospheres, UV spheres, tori, cylinders and noisy ellipsoids, each with a single rim."""
    random = np.random.default_rng(0)
    for make, least, most in itertools.cycle(_MESHES):
        mesh = make(random)
        centre = _side(random) if make is _cylinder else mesh.vertices[int(random.integers(len(mesh.vertices)))]
        removed = np.linalg.norm(mesh.triangles_center - centre, axis=1) <= random.uniform(least, most)
        hole = cut("", "curved", (np.array(mesh.vertices), np.array(mesh.faces)), removed).hole
        if len(hole.loops) == 1 and SHORTEST <= len(hole.loops[0]) <= LONGEST:
            yield hole


def _uv_sphere(random: np.random.Generator) -> trimesh.Trimesh:
    """A unit sphere by latitude and longitude: slivers at its poles."""
    count = int(random.integers(20, 45))
    return trimesh.creation.uv_sphere(count=[count, count])


def _cylinder(_: np.random.Generator) -> trimesh.Trimesh:
    """A closed cylinder of radius 0.5, its side divided into a grid."""
    (column, row), side = lattice(40, 25, wrap_x=True)
    angle = 2 * np.pi * column / 40
    vertices = np.column_stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), row * 0.08 - 1])
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    ends = [[0, 0, -1], [0, 0, 1]]
    return trimesh.Trimesh(np.vstack([vertices, ends]), np.vstack([side, bottom, top]), process=False)


def _side(random: np.random.Generator) -> Float[np.ndarray, "3"]:
    """A point of the cylinder's side."""
    turn = random.uniform(0, 2 * np.pi)
    return np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), random.uniform(-0.4, 0.4)])


def _ellipsoid(random: np.random.Generator) -> trimesh.Trimesh:
    """An ellipsoid whose vertices are off by 15 % of an edge in every coordinate."""
    ball: trimesh.Trimesh = trimesh.creation.icosphere(int(random.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * random.standard_normal(ball.vertices.shape)
    return ball


# what is cut, and the radii of the balls that cut it
_MESHES: tuple[tuple[Callable[[np.random.Generator], trimesh.Trimesh], float, float], ...] = (
    (lambda random: trimesh.creation.icosphere(int(random.integers(2, 5))), 0.25, 0.9),
    (_uv_sphere, 0.25, 0.6),
    (lambda _: trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), 0.15, 0.45),
    (_cylinder, 0.15, 0.4),
    (_ellipsoid, 0.2, 0.6),
)
