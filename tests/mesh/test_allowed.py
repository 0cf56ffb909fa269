"""What may be wrong with a mesh away from its loops."""

from __future__ import annotations

import numpy as np

from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh

STRIP = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])


def mesh_of(faces: np.ndarray) -> TriangleMesh:
    return TriangleMesh(np.random.default_rng(0).uniform(size=(int(np.max(faces)) + 1, 3)), faces)


def test_third_faces_away_from_the_loops_are_allowed(tetrahedron: np.ndarray) -> None:
    # two closed tetrahedra over a common edge (4 faces there), and a triangle apart that has the only loop
    mirrored = np.array([0, 1, 4, 5])[tetrahedron]
    mesh = mesh_of(np.vstack([tetrahedron, mirrored, [6, 7, 8]]))
    (loop,) = find_boundary_loops(mesh)
    np.testing.assert_array_equal(loop.vertex_ids, [6, 8, 7])


def test_inner_face_of_a_closed_mesh_is_allowed() -> None:
    octahedron = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    wall = np.array([[0, 2, 1], [0, 1, 3]])
    assert find_boundary_loops(mesh_of(np.vstack([octahedron, wall]))) == []


def test_zero_area_face_with_three_vertices_is_allowed() -> None:
    mesh = TriangleMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    (loop,) = find_boundary_loops(mesh)
    np.testing.assert_array_equal(loop.vertex_ids, [0, 3, 2, 1])


def test_unreferenced_vertices_are_allowed() -> None:
    mesh = TriangleMesh(np.random.default_rng(1).uniform(size=(9, 3)), STRIP + 2)
    (loop,) = find_boundary_loops(mesh)
    assert set(loop.vertex_ids.tolist()) == {2, 3, 4, 5, 6}
