"""Rims as people have them: cut along triangles out of known meshes, or with noise."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float, Int

from spinor_geom.bench.holes import Hole, all_rims, collar, lattice
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh

# a mesh, and the ball whose faces are cut out
_Cut = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "3"], float]

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
    return tuple(all_rims(name, *mesh) for name, mesh in zip(CUT, _cut_meshes(), strict=False))


def _cut_meshes(seed: int = 0) -> Iterator[tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]]:
    """Caps and windows of icospheres, UV spheres, tori, cylinders and noisy ellipsoids, each with a single rim."""
    random = np.random.default_rng(seed)
    for make in itertools.cycle((_icosphere, _uv_sphere, _torus, _cylinder, _ellipsoid)):
        vertices, faces, centre, radius = make(random)
        kept = faces[np.linalg.norm(vertices[faces].mean(axis=1) - centre, axis=1) > radius]
        used, index = np.unique(kept, return_inverse=True)
        mesh = TriangleMesh(vertices[used], index.reshape(kept.shape))
        loops = find_boundary_loops(mesh)
        if len(loops) == 1 and SHORTEST <= len(loops[0]) <= LONGEST:
            yield mesh.vertices, mesh.faces


def _icosphere(random: np.random.Generator) -> _Cut:
    """A unit sphere of 320 to 5,120 equal triangles."""
    return _around_vertex(trimesh.creation.icosphere(int(random.integers(2, 5))), random, 0.25, 0.9)


def _uv_sphere(random: np.random.Generator) -> _Cut:
    """A unit sphere by latitude and longitude: slivers at its poles."""
    count = int(random.integers(20, 45))
    return _around_vertex(trimesh.creation.uv_sphere(count=[count, count]), random, 0.25, 0.6)


def _torus(random: np.random.Generator) -> _Cut:
    """A torus of radii 1 and 0.4."""
    return _around_vertex(trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), random, 0.15, 0.45)


def _cylinder(random: np.random.Generator) -> _Cut:
    """A closed cylinder of radius 0.5, its side divided into a grid."""
    (column, row), side = lattice(40, 25, wrap_x=True)
    angle = 2 * np.pi * column / 40
    vertices = np.column_stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), row * 0.08 - 1])
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    faces = np.vstack([side, bottom, top])
    turn = random.uniform(0, 2 * np.pi)
    centre = np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), random.uniform(-0.4, 0.4)])
    return np.vstack([vertices, [[0, 0, -1], [0, 0, 1]]]), faces, centre, random.uniform(0.15, 0.4)


def _ellipsoid(random: np.random.Generator) -> _Cut:
    """An ellipsoid whose vertices are off by 15 % of an edge in every coordinate."""
    ball = trimesh.creation.icosphere(int(random.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * random.standard_normal(ball.vertices.shape)
    return _around_vertex(ball, random, 0.2, 0.6)


def _around_vertex(mesh: trimesh.Trimesh, random: np.random.Generator, least: float, most: float) -> _Cut:
    vertices = np.array(mesh.vertices)
    centre = vertices[int(random.integers(len(vertices)))]
    return vertices, np.array(mesh.faces), centre, random.uniform(least, most)
