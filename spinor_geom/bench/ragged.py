"""Ragged rims: bowls and tubes like those of public bug reports, noisy rims, and rims cut along triangles."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from spinor_geom.bench.cut_outs import TUBE, cylinder
from spinor_geom.bench.holes import Hole, all_rims, collar, cut_hole, lattice, sphere
from spinor_geom.bench.odd_holes import moebius_and_lips, nothing_missing
from spinor_geom.mesh.topology import face_components

BALLS = ("icosphere-3", "icosphere-4", "uv-sphere-24", "uv-sphere-32")
NOISES = (0.0, 0.002, 0.005, 0.01, 0.02)  # standard deviations of the vertices' displacements, per radius
CUT = tuple(f"cut-{k:02}" for k in range(60))
"""Names of the rims of 13 to 120 points that are cut out of generated meshes."""
NOISY: Mapping[str, tuple[float, int]] = {
    f"noise-{noise:.0%}-{points}": (noise, points) for noise in (0.05, 0.15, 0.3) for points in (100, 250, 600, 1200)
}
"""Noise in mean edges and number of points of the noisy rims."""


@cache
def reported_holes() -> Mapping[str, Hole]:
    """The cases of the suite "reports" by name."""
    return {h.name: h for h in (*reported_bowls(), *reported_tubes(), *nothing_missing(), *moebius_and_lips())}


def reported_bowls(count: int = 60) -> Iterator[Hole]:
    """Bowls with openings of 45° to 85°, all spheres and noises in turn."""
    return (reported_bowl(k, count) for k in range(count))


def reported_bowl(number: int, count: int = 60) -> Hole:
    """One of them."""
    opening = float(np.linspace(45.0, 85.0, count)[number])
    return bowl(opening, BALLS[number % len(BALLS)], noise=NOISES[number % len(NOISES)], seed=number)


def reported_tubes(count: int = 20) -> Iterator[Hole]:
    """Tubes with tilts of 0° to 35° and 16 to 48 edges around."""
    for k, tilt in enumerate(np.linspace(0.0, 35.0, count).tolist()):
        yield cut_tube(tilt, (16, 24, 32, 48)[k % 4], noise=NOISES[k % len(NOISES)], seed=k)


def bowl(opening: float, ball: str = "icosphere-4", *, noise: float = 0.0, seed: int = 0) -> Hole:
    """The part of a unit sphere within an angle, in degrees, of its lowest point. A flat lid meets it at that angle.

    The sphere is rotated at random. The rim consists of edges of its triangles. `noise` is the standard deviation of
    the vertices' displacements, per radius.
    """
    rng = np.random.default_rng(seed)
    mesh = sphere(ball)
    points, faces = _turned(np.array(mesh.vertices), rng), np.array(mesh.faces)
    height = -np.cos(np.radians(opening))
    centroids = points[faces].mean(axis=1)
    faces = faces[centroids[:, 2] < height * np.linalg.norm(centroids, axis=1)]
    return _reported(f"bowl-{opening:.0f}-{ball}-ragged", points, faces, noise, seed, rng)


def cut_tube(tilt: float, around: int = 32, *, noise: float = 0.0, seed: int = 0) -> Hole:
    """A tube of radius 1 with ends cut along whole triangles, tilted in opposite directions by `tilt` degrees.

    `around` is the number of edges around the tube, `noise` as for `bowl`.
    """
    rng = np.random.default_rng(seed)
    edge, length = 2 * np.pi / around, 6.0
    (x, y), faces = lattice(around, round(length / edge), wrap_x=True)
    angle = edge * x
    points = np.stack([np.cos(angle), np.sin(angle), edge * y], axis=1)
    centroids = points[faces].mean(axis=1)
    lean = np.tan(np.radians(tilt)) * (centroids[:, 0] + rng.uniform(-0.1, 0.1))
    low, high = 1.8 + lean, edge * y.max() - 1.8 - lean
    faces = faces[(centroids[:, 2] > low) & (centroids[:, 2] < high)]
    return _reported(f"tube-{tilt:.0f}-{around}", points, faces, noise, seed, rng)


def _reported(
    name: str,
    points: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    noise: float,
    seed: int,
    rng: np.random.Generator,
) -> Hole:
    """The largest connected component of a mesh, with noise and rotated at random."""
    piece = face_components(faces)
    used, rest = np.unique(faces[piece == np.argmax(np.bincount(piece))], return_inverse=True)
    points = points[used]
    points = _turned(points + noise * rng.standard_normal(points.shape), rng)
    return all_rims(f"{name}-{noise:g}-{seed}", points, rest.reshape(-1, 3))


def _turned(points: Float[np.ndarray, "n 3"], rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    return np.asarray(Rotation.random(rng=rng).apply(points))


def ragged_hole(name: str) -> Hole:
    """A hole by its name in `NOISY` (a strip below a noisy ellipse) or in `CUT`."""
    if name not in NOISY:
        return replace(_cut_rims()[CUT.index(name)], name=name)
    noise, points = NOISY[name]
    return wavy_rim(name, points, noise)


def wavy_rim(name: str, points: int, noise: float = 0.0) -> Hole:
    """A strip down from a wavy ellipse, whose points have noise in mean edges."""
    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).mean()
    inner = rim + noise * edge * np.random.default_rng(points).standard_normal(rim.shape)
    return collar(name, inner, np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)]))


@cache
def _cut_rims() -> list[Hole]:
    """Caps and windows of spheres, tori, cylinders and noisy ellipsoids, each with a single rim."""
    rng, found = np.random.default_rng(0), list[Hole]()
    for make, least, most in itertools.cycle(_MESHES):
        mesh = make(rng)
        if make is _closed_cylinder:  # a point of its side
            turn = rng.uniform(0, 2 * np.pi)
            centre = np.array([TUBE * np.cos(turn), TUBE * np.sin(turn), rng.uniform(-0.4, 0.4)])
        else:
            centre = mesh.vertices[int(rng.integers(len(mesh.vertices)))]
        removed = np.linalg.norm(mesh.triangles_center - centre, axis=1) <= rng.uniform(least, most)
        hole = cut_hole("", np.array(mesh.vertices), np.array(mesh.faces), removed)
        if len(hole.loops) == 1 and 13 <= len(hole.loops[0]) <= 120:
            found.append(hole)
        if len(found) == len(CUT):
            break
    return found


def _closed_cylinder(_: np.random.Generator) -> trimesh.Trimesh:
    vertices, side = cylinder(40, 25)
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    ends = [[0, 0, -1], [0, 0, 1]]
    return trimesh.Trimesh(np.vstack([vertices, ends]), np.vstack([side, bottom, top]), process=False)


def _ellipsoid(rng: np.random.Generator) -> trimesh.Trimesh:
    """An ellipsoid with noise of 15 % of an edge in every coordinate."""
    ball: trimesh.Trimesh = trimesh.creation.icosphere(int(rng.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, rng.uniform(0.4, 0.9), rng.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * rng.standard_normal(ball.vertices.shape)
    return ball


# meshes, and the smallest and largest radius of the balls that are cut out of them
_MESHES: tuple[tuple[Callable[[np.random.Generator], trimesh.Trimesh], float, float], ...] = (
    (lambda rng: sphere(f"icosphere-{rng.integers(2, 5)}"), 0.25, 0.9),
    (lambda rng: sphere(f"uv-sphere-{rng.integers(20, 45)}"), 0.25, 0.6),
    (lambda _: trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), 0.15, 0.45),
    (_closed_cylinder, 0.15, 0.4),
    (_ellipsoid, 0.2, 0.6),
)
