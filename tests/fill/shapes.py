"""Small meshes with holes, and patches that need no solver."""

from __future__ import annotations

import numpy as np

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch


def tube(sides: int = 16, rings: int = 3, *, squeeze: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """An open tube about the z axis, normals outwards: two holes, the lower one larger."""
    angle = 2 * np.pi * np.arange(sides) / sides
    levels = [
        np.column_stack(
            [(1.0 - 0.1 * k) * np.cos(angle), squeeze * (1.0 - 0.1 * k) * np.sin(angle), np.full(sides, 0.5 * k)]
        )
        for k in range(rings)
    ]
    a = np.arange(sides)
    b = (a + 1) % sides
    faces = [
        np.concatenate([np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])]) + k * sides
        for k in range(rings - 1)
    ]
    return np.concatenate(levels), np.concatenate(faces)


def folded_quad() -> tuple[np.ndarray, np.ndarray]:
    """Two triangles with a common edge (1, 3): its hole of four vertices has a free diagonal (0, 2) and a taken one."""
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
    count = len(loop)
    rim = np.arange(count)
    return Patch(
        vertices=np.vstack([loop.points, loop.centroid]),
        faces=np.column_stack([rim, np.roll(rim, -1), np.full(count, count)]),
        boundary_size=count,
        points=np.append(on_circle(count), 0),
    )


def on_circle(count: int) -> np.ndarray:
    return np.exp(2j * np.pi * np.arange(count) / count)


def undirected_edges(faces: np.ndarray) -> np.ndarray:
    """All sides of all faces, lower vertex first."""
    return np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def as_mesh(pair: tuple[np.ndarray, np.ndarray], **attributes: np.ndarray) -> TriangleMesh:
    return TriangleMesh(*pair, vertex_attributes=attributes)
