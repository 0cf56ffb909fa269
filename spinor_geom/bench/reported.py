"""Generated meshes of the kinds that people report as hard to close: steep bowls and tubes cut along triangles."""

from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from spinor_geom.bench.cases import Hole, all_rims, lattice
from spinor_geom.mesh.topology import face_components

Ball = Literal["icosphere-2", "icosphere-3", "icosphere-4", "uv-sphere-24", "uv-sphere-32"]
Rim = Literal["ragged", "smooth"]
_Mesh: TypeAlias = tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]

BALLS: tuple[Ball, ...] = ("icosphere-3", "icosphere-4", "uv-sphere-24", "uv-sphere-32")
STEEPEST, SHALLOWEST = 85.0, 45.0  # degrees between the wall and the plane of the rim
NOISES = (0.0, 0.002, 0.005, 0.01, 0.02)  # standard deviations of the vertices' displacements, per radius


def bowl(opening: float, ball: Ball = "icosphere-4", *, rim: Rim = "ragged", noise: float = 0.0, seed: int = 0) -> Hole:
    """The part of a unit sphere within an angle of its lowest point; a film over the rim meets the wall at that angle.

    Args:
        opening: The angle, in degrees.
        ball: How the sphere is triangulated; its triangles lie at random to the cut.
        rim: "ragged" keeps whole triangles, by their centroids; "smooth" cuts triangles at the plane of the rim.
        noise: Standard deviation of displacements of all vertices, per radius.
        seed: Of the triangles' position, of the noise, and of the bowl's own position.
    """
    rng = np.random.default_rng(seed)
    name, _, count = ball.rpartition("-")
    sphere = (
        trimesh.creation.icosphere(int(count))
        if name == "icosphere"
        else trimesh.creation.uv_sphere(count=[int(count)] * 2)
    )
    points, faces = _turned(np.array(sphere.vertices), rng), np.array(sphere.faces)
    height = -np.cos(np.radians(opening))
    if rim == "smooth":
        slice_faces: Any = trimesh.intersections.slice_faces_plane
        points, faces, _ = slice_faces(
            points, faces, plane_normal=np.array([0.0, 0.0, -1.0]), plane_origin=np.array([0.0, 0.0, height])
        )
        # a cut edge has a point for each of its faces
        _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
        points, faces = _largest(points[first], same.reshape(-1)[faces])
    else:
        centroids = points[faces].mean(axis=1)
        points, faces = _largest(points, faces[centroids[:, 2] < height * np.linalg.norm(centroids, axis=1)])
    points = _turned(points + noise * rng.standard_normal(points.shape), rng)
    return all_rims(f"bowl-{opening:.0f}-{ball}-{rim}-{noise:g}-{seed}", points, faces)


def cut_tube(tilt: float, around: int = 32, *, noise: float = 0.0, seed: int = 0) -> Hole:
    """A tube of radius 1, both of whose ends are cut obliquely along whole triangles.

    Args:
        tilt: Degrees by which the planes of the cuts lean to opposite sides.
        around: Triangle edges around the tube.
        noise: Standard deviation of displacements of all vertices, per radius.
        seed: Of the noise and of the tube's position.
    """
    rng = np.random.default_rng(seed)
    edge, length = 2 * np.pi / around, 6.0
    (x, y), faces = lattice(around, round(length / edge), wrap_x=True)
    angle = edge * x
    points = np.stack([np.cos(angle), np.sin(angle), edge * y], axis=1)
    centroids = points[faces].mean(axis=1)
    lean = np.tan(np.radians(tilt)) * (centroids[:, 0] + rng.uniform(-0.1, 0.1))
    low, high = 1.8 + lean, edge * y.max() - 1.8 - lean
    points, faces = _largest(points, faces[(centroids[:, 2] > low) & (centroids[:, 2] < high)])
    points = _turned(points + noise * rng.standard_normal(points.shape), rng)
    return all_rims(f"tube-{tilt:.0f}-{around}-{noise:g}-{seed}", points, faces)


def reported_bowls(count: int = 60, *, rim: Rim = "ragged") -> Iterator[Hole]:
    """Bowls over the whole range of openings, spheres and noises; those of either rim are the same otherwise."""
    for k, opening in enumerate(np.linspace(SHALLOWEST, STEEPEST, count).tolist()):
        yield bowl(opening, BALLS[k % len(BALLS)], rim=rim, noise=NOISES[k % len(NOISES)], seed=k)


def reported_tubes(count: int = 20) -> Iterator[Hole]:
    """Tubes cut at right angles to their axis and up to 35° from that, with 16 to 48 edges around."""
    for k, tilt in enumerate(np.linspace(0.0, 35.0, count).tolist()):
        yield cut_tube(tilt, (16, 24, 32, 48)[k % 4], noise=NOISES[k % len(NOISES)], seed=k)


def _turned(points: Float[np.ndarray, "n 3"], rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    return np.asarray(Rotation.random(rng=rng).apply(points))


def _largest(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> _Mesh:
    """The largest piece of a mesh that hangs together through edges, and its vertices alone."""
    piece = face_components(faces)
    used, rest = np.unique(faces[piece == np.argmax(np.bincount(piece))], return_inverse=True)
    return points[used], rest.reshape(-1, 3)
