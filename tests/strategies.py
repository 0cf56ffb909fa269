"""Hypothesis strategies for the whole test suite: closed loops, plane domains, disks with holes, rigid motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from spinor_geom.domain import FourierBoundary
from spinor_geom.mesh.triangle_mesh import TriangleMesh

SEEDS = st.integers(min_value=0, max_value=2**32 - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidMotion:
    """x → R x + t with R in SO(3)."""

    rotation: np.ndarray
    translation: np.ndarray

    def __call__(self, points):
        return points @ self.rotation.T + self.translation


@dataclass(frozen=True, kw_only=True, eq=False)
class HoledDisk:
    """A triangulated disk from which the stars of some far-apart inner vertices were removed."""

    mesh: TriangleMesh
    removed: tuple[int, ...]
    holes: tuple[frozenset[int], ...]
    rim: frozenset[int]


@st.composite
def rigid_motions(draw, max_shift=10.0):
    """Rotations uniform in SO(3) with a shift of up to `max_shift` along each axis."""
    random = np.random.default_rng(draw(SEEDS))
    orthogonal, triangular = np.linalg.qr(random.normal(size=(3, 3)))
    orthogonal = orthogonal * np.sign(np.diag(triangular))
    if np.linalg.det(orthogonal) < 0:
        orthogonal[:, 0] = -orthogonal[:, 0]
    return RigidMotion(rotation=orthogonal, translation=random.uniform(-max_shift, max_shift, size=3))


@st.composite
def smooth_loops(draw, min_points=24, max_points=120, harmonics=3):
    """(M, 3) points of a random trigonometric curve around a unit circle, in order. Its curvature is bounded."""
    count = draw(st.integers(min_points, max_points))
    random = np.random.default_rng(draw(SEEDS))
    t = 2 * np.pi * np.arange(count) / count
    points = np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)
    for k in range(2, harmonics + 1):
        cosine, sine = random.uniform(-0.25, 0.25, size=(2, 3)) / k
        points = points + np.cos(k * t)[:, None] * cosine + np.sin(k * t)[:, None] * sine
    return points


@st.composite
def rough_loops(draw, max_noise=0.25, **options):
    """(M, 3) points of a smooth loop, each moved by Gaussian noise of up to `max_noise` of the mean edge length."""
    points = draw(smooth_loops(**options))
    random = np.random.default_rng(draw(SEEDS))
    edge = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean()
    return points + draw(st.floats(0.02, max_noise)) * edge * random.normal(size=points.shape)


@st.composite
def analytic_boundaries(draw, harmonics=5, most=0.5):
    """Random deformations of the circle that are simple: Σ |k c_k| over all k but 1 is at most `most` < 1 = |c_1|."""
    random = np.random.default_rng(draw(SEEDS))
    k = np.arange(-harmonics, harmonics + 1)
    c = random.normal(size=len(k)) + 1j * random.normal(size=len(k))
    c[np.isin(k, (0, 1))] = 0
    c *= draw(st.floats(0, most)) / np.abs(k * c).sum()
    c[k == 1] = 1
    return FourierBoundary(c, 64)


@st.composite
def holed_disks(draw, max_holes=5):
    """Curved triangulated disks with one-ring holes that share no vertex with each other or with the rim."""
    faces, points = _planar_triangulation(draw, min_points=80, max_points=250)
    rim = _rim(faces)
    random = np.random.default_rng(draw(SEEDS))
    wanted = draw(st.integers(0, max_holes))
    taken, removed, holes = set(rim), [], []
    for vertex in random.permutation(len(points)).tolist():
        star = faces[(faces == vertex).any(axis=1)]
        ring = set(star.ravel().tolist()) - {vertex}
        if len(removed) == wanted:
            break
        if vertex not in taken and not ring & taken:
            removed.append(vertex)
            holes.append(frozenset(ring))
            taken |= ring | {vertex}
    kept = ~np.isin(faces, removed).any(axis=1)
    mesh = TriangleMesh(_lifted(points, random), faces[kept])
    return HoledDisk(mesh=mesh, removed=tuple(removed), holes=tuple(holes), rim=frozenset(rim))


@st.composite
def ragged_meshes(draw):
    """A triangulated disk from which random faces were removed: bow-ties, islands, loose vertices."""
    faces, points = _planar_triangulation(draw, min_points=8, max_points=60)
    random = np.random.default_rng(draw(SEEDS))
    kept = random.uniform(size=len(faces)) > draw(st.floats(0.0, 0.7))
    kept[0] = True
    return TriangleMesh(_lifted(points, random), faces[kept])


def _planar_triangulation(draw, *, min_points, max_points):
    """Counter-clockwise Delaunay triangles over random points of the unit square, every point used."""
    random = np.random.default_rng(draw(SEEDS))
    points = random.uniform(size=(draw(st.integers(min_points, max_points)), 2))
    faces = Delaunay(points).simplices.astype(np.int64)
    sides = points[faces[:, 1:]] - points[faces[:, :1]]
    clockwise = sides[:, 0, 0] * sides[:, 1, 1] < sides[:, 0, 1] * sides[:, 1, 0]
    faces[clockwise] = faces[clockwise][:, ::-1]
    return faces, points


def _rim(faces):
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return set(unique[counts == 1].ravel().tolist())


def _lifted(points, random):
    """The points as a smooth graph over the plane."""
    a, b, phase = random.uniform(-3.0, 3.0, size=3)
    return np.column_stack([points, 0.2 * np.sin(a * points[:, 0] + b * points[:, 1] + phase)])
