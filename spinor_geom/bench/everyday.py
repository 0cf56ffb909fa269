"""The holes that people have: rims cut along triangles out of generated meshes, and collars around noisy rims."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import islice
from typing import TypeAlias

import numpy as np
import trimesh
from jaxtyping import Float, Int

from spinor_geom.bench.holes import Hole, all_rims
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh

_Mesh: TypeAlias = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]
# a mesh, and the sphere that is cut out of it: its middle and its radius
_Cut: TypeAlias = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "3"], float]

SHORTEST, LONGEST, RIMS = 13, 120, 60
NOISE, POINTS = (0.05, 0.15, 0.3), (100, 250, 600, 1200)

NOISY: Mapping[str, tuple[float, int]] = {
    f"collar-{noise:.0%}-{points}": (noise, points) for noise in NOISE for points in POINTS
}
"""Collars: noise in mean edges, points."""

EVERYDAY = (*(f"rim-{place:02d}" for place in range(RIMS)), *NOISY)
"""Names of all of them."""


def everyday_hole(name: str) -> Hole:
    """The hole of a name."""
    vertices, faces = _collar(*NOISY[name]) if name in NOISY else _rims()[int(name.removeprefix("rim-"))]
    return all_rims(name, vertices, faces)


@cache
def _rims() -> list[_Mesh]:
    """The first 60 meshes with a single rim of 13 to 120 points."""
    return list(islice(_generated(), RIMS))


def _generated() -> Iterator[_Mesh]:
    """Caps and windows of icospheres, UV spheres, tori, cylinders and noisy ellipsoids, cut along triangles."""
    random = np.random.default_rng(0)
    while True:
        for vertices, faces, centre, radius in (
            _icosphere(random),
            _uv_sphere(random),
            _torus(random),
            _cylinder(random),
            _ellipsoid(random),
        ):
            kept = faces[np.linalg.norm(vertices[faces].mean(axis=1) - centre, axis=1) > radius]
            used, index = np.unique(kept, return_inverse=True)
            pair = vertices[used], index.reshape(kept.shape)
            loops = find_boundary_loops(TriangleMesh(*pair))
            if len(loops) == 1 and SHORTEST <= len(loops[0]) <= LONGEST:
                yield pair


def _icosphere(random: np.random.Generator) -> _Cut:
    """A unit sphere of 320 to 5,120 equal triangles."""
    return _cut(trimesh.creation.icosphere(int(random.integers(2, 5))), random, 0.25, 0.9)


def _uv_sphere(random: np.random.Generator) -> _Cut:
    """A unit sphere by latitude and longitude: slivers at its poles."""
    count = int(random.integers(20, 45))
    return _cut(trimesh.creation.uv_sphere(count=[count, count]), random, 0.25, 0.6)


def _torus(random: np.random.Generator) -> _Cut:
    """A torus of radii 1 and 0.4."""
    return _cut(trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), random, 0.15, 0.45)


def _cylinder(random: np.random.Generator) -> _Cut:
    """The side of a cylinder of radius 0.5, divided into a grid."""
    angle, height = np.meshgrid(2 * np.pi * np.arange(40) / 40, np.linspace(-1, 1, 26))
    vertices = np.column_stack([0.5 * np.cos(angle.ravel()), 0.5 * np.sin(angle.ravel()), height.ravel()])
    row, column = (part.ravel() for part in np.meshgrid(np.arange(25), np.arange(40), indexing="ij"))
    a, b = 40 * row + column, 40 * row + (column + 1) % 40
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    faces = np.vstack([np.column_stack([a, b, b + 40]), np.column_stack([a, b + 40, a + 40]), bottom, top])
    turn = random.uniform(0, 2 * np.pi)
    centre = np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), random.uniform(-0.4, 0.4)])
    return np.vstack([vertices, [[0, 0, -1], [0, 0, 1]]]), faces, centre, random.uniform(0.15, 0.4)


def _ellipsoid(random: np.random.Generator) -> _Cut:
    """An ellipsoid whose vertices are off by 15 % of an edge in every coordinate."""
    ball = trimesh.creation.icosphere(int(random.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * random.standard_normal(ball.vertices.shape)
    return _cut(ball, random, 0.2, 0.6)


def _cut(mesh: trimesh.Trimesh, random: np.random.Generator, least: float, most: float) -> _Cut:
    vertices = np.asarray(mesh.vertices)
    centre = vertices[int(random.integers(len(vertices)))]
    return vertices, np.asarray(mesh.faces), centre, random.uniform(least, most)


def _collar(noise: float, points: int) -> _Mesh:
    """A strip outside a noisy ellipse: its inner rim is the hole, its outer one is closed by a cone below."""
    random = np.random.default_rng(points)
    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).mean()
    inner = rim + noise * edge * random.standard_normal(rim.shape)
    outer = np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)])
    i, j = np.arange(points), (np.arange(points) + 1) % points
    faces = np.vstack(
        [
            np.column_stack([i, i + points, j]),
            np.column_stack([j, i + points, j + points]),
            np.column_stack([i + points, np.full(points, 2 * points), j + points]),
        ]
    )
    return np.vstack([inner, outer, [[0, 0, -3]]]), faces
