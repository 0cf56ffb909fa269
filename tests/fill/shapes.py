"""Small meshes with holes, and patches that need no solver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch


def without(mesh: tuple[np.ndarray, np.ndarray], removed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A mesh without some faces, and without the vertices that only they used."""
    vertices, faces = mesh
    used, faces = np.unique(faces[~removed], return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def together(*pieces: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Several meshes as one, without merging vertices."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
    faces = [own + start for (_, own), start in zip(pieces, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in pieces]), np.concatenate(faces)


def circle(count: int, radius: float = 1.0, height: float = 0.0, *, bend: float = 0.0, waves: int = 2) -> np.ndarray:
    """Points at equal steps of a horizontal circle, lifted by cosine waves."""
    t = 2 * np.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), height + bend * np.cos(waves * t)])


def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    ball = trimesh.creation.icosphere(subdivisions)
    return np.array(ball.vertices), np.array(ball.faces)


def bowl_below(height: float, subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of the unit sphere whose middles lie below a height."""
    vertices, faces = icosphere(subdivisions)
    return without((vertices, faces), vertices[faces][:, :, 2].mean(axis=1) > height)


def hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The convex hull of points around the origin, all of them on it, normals outwards."""
    faces = ConvexHull(points).simplices
    inwards = np.linalg.det(points[faces]) < 0
    return points, np.where(inwards[:, None], faces[:, ::-1], faces)


def soup(mesh: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with corners of its own for each face."""
    vertices, faces = mesh
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def spokes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles from the edges of a closed polygon to its mean."""
    ring = np.arange(len(points))
    faces = np.column_stack([ring, np.roll(ring, -1), np.full(len(points), len(points))])
    return np.vstack([points, points.mean(axis=0)]), faces


def tube(sides: int = 16, rings: int = 3, *, squeeze: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """An open tube about the z axis, normals outwards: two holes, the lower one larger."""
    levels = [circle(sides, 1.0 - 0.1 * k, 0.5 * k) * [1, squeeze, 1] for k in range(rings)]
    a = np.arange(sides)
    b = (a + 1) % sides
    band = np.concatenate([np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])])
    faces = [band + k * sides for k in range(rings - 1)]
    return np.concatenate(levels), np.concatenate(faces)


def rounds_and_rows(
    point: Callable[[float, float], tuple[float, float, float]], rounds: int, rows: np.ndarray, *, closed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh of a surface over an angle and the values of another parameter, with alternating diagonals."""
    angle = 2 * np.pi * np.arange(rounds) / rounds
    vertices = np.array([point(a, row) for row in rows for a in angle])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(rounds), np.arange(len(rows) - (not closed))))
    a, b = j * rounds + i, j * rounds + (i + 1) % rounds
    c, d = ((k + rounds) % len(vertices) for k in (a, b))
    one = np.where(((i + j) % 2)[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    other = np.where(((i + j) % 2)[:, None], np.stack([a, d, c], 1), np.stack([b, d, c], 1))
    return vertices, np.concatenate([one, other])


def cylinder(rounds: int = 48, rows: int = 31, *, half: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    return rounds_and_rows(lambda a, z: (np.cos(a), np.sin(a), z), rounds, np.linspace(-half, half, rows))


def obj_text(vertices: np.ndarray, faces: np.ndarray, *more: str) -> str:
    """An OBJ file, with further lines at its end."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, dtype=np.float64).tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (np.asarray(faces) + 1).tolist()]
    return "\n".join([*lines, *more, ""])


def folded_quad() -> tuple[np.ndarray, np.ndarray]:
    """Two triangles with the common edge (1, 3). Of the diagonals of their hole, (0, 2) is free, (1, 3) is an edge."""
    vertices = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.5]])
    return vertices, np.array([[0, 1, 3], [1, 2, 3]])


def fan(loop: BoundaryLoop, apex: int = 0) -> Patch:
    """Triangles from one rim vertex to all others: a patch without inner vertices, all its inner edges chords."""
    count = len(loop)
    order = (np.arange(count) + apex) % count
    faces = np.column_stack([np.full(count - 2, order[0]), order[1:-1], order[2:]])
    return Patch(vertices=loop.points, faces=faces, boundary_size=count, points=on_circle(count))


def cone(loop: BoundaryLoop) -> Patch:
    """Triangles from every rim edge to one inner vertex."""
    vertices, faces = spokes(loop.points)
    return Patch(vertices=vertices, faces=faces, boundary_size=len(loop), points=np.append(on_circle(len(loop)), 0))


def on_circle(count: int) -> np.ndarray:
    return np.exp(2j * np.pi * np.arange(count) / count)


def undirected_edges(faces: np.ndarray) -> np.ndarray:
    """All sides of all faces, lower vertex first."""
    return np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def as_mesh(pair: tuple[np.ndarray, np.ndarray], **attributes: np.ndarray) -> TriangleMesh:
    return TriangleMesh(*pair, vertex_attributes=attributes)


def collar(rim: np.ndarray, offset: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """A band along a closed polygon: its vertices first, then each once more, moved by an offset."""
    count = len(rim)
    a = np.arange(count)
    b = np.roll(a, -1)
    faces = np.concatenate([np.column_stack([a, a + count, b]), np.column_stack([b, a + count, b + count])])
    return np.concatenate([rim, rim + offset]), faces


def trefoil(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A knotted rim with a narrow band on its outer side."""
    t = 2 * np.pi * np.arange(count) / count
    rim = np.column_stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)])
    outwards = rim - (np.roll(rim, -1, axis=0) + np.roll(rim, 1, axis=0)) / 2
    return collar(rim, 0.1 * outwards / np.linalg.norm(outwards, axis=1, keepdims=True))


def figure_eight(count: int, shift: float) -> np.ndarray:
    """A lemniscate in the plane z = 0; shift 0 puts two of its points into its middle, if 4 divides their number."""
    t = 2 * np.pi * (np.arange(count) + shift) / count
    return np.column_stack([np.sin(t), np.sin(t) * np.cos(t), np.zeros(count)])


def spiked_tetrahedron(height: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """A tetrahedron without its bottom, and a lone upright triangle whose tip is at a height over that hole."""
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, 4], [1, 1, height], [0.9, 1, -1], [1.1, 1.1, -1]])
    return vertices, np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3], [4, 5, 6]])


def linked_rings() -> tuple[np.ndarray, np.ndarray]:
    """Two flat rings across each other, with the holes 0-31 and 64-95; each passes through the hole of the other."""
    vertices, faces = collar(circle(32), 0.2 * circle(32))
    upright = 0.5 * vertices[:, [0, 2, 1]] + np.array([1.0, 0.01, 0.02])
    return np.concatenate([vertices, upright]), np.concatenate([faces, faces + len(vertices)])
