"""Every defect of a mesh is refused by an error that names the element; what is allowed passes."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.errors import (
    DegenerateFaceError,
    DuplicateFaceError,
    InconsistentOrientationError,
    NonManifoldEdgeError,
)
from spinor_geom.mesh import TriangleMesh, find_boundary_loops, validate

STRIP = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])


def mesh_of(faces: np.ndarray) -> TriangleMesh:
    return TriangleMesh(np.random.default_rng(0).uniform(size=(int(np.max(faces)) + 1, 3)), faces)


class TestRefused:
    @pytest.mark.parametrize("face", [[3, 3, 5], [3, 5, 3], [5, 3, 3], [4, 4, 4]])
    def test_degenerate_face(self, face: list[int]) -> None:
        with pytest.raises(DegenerateFaceError) as caught:
            validate(mesh_of(np.vstack([STRIP, face])))
        assert caught.value.fields == {"face": 3, "vertices": tuple(face)}

    @pytest.mark.parametrize("face", [[2, 1, 3], [1, 3, 2], [1, 2, 3]], ids=["same", "rotated", "reversed"])
    def test_duplicate_face(self, face: list[int]) -> None:
        with pytest.raises(DuplicateFaceError) as caught:
            validate(mesh_of(np.vstack([STRIP, face])))
        assert caught.value.fields["faces"] == (1, 3)
        assert set(caught.value.fields["vertices"]) == {1, 2, 3}

    def test_duplicate_of_a_lone_face(self) -> None:
        with pytest.raises(DuplicateFaceError):
            validate(mesh_of(np.array([[0, 1, 2], [2, 1, 0]])))

    def test_duplicate_face_all_of_whose_edges_have_three_faces(self, tetrahedron: np.ndarray) -> None:
        with pytest.raises(DuplicateFaceError) as caught:
            validate(mesh_of(np.vstack([tetrahedron, tetrahedron[2, ::-1]])))
        assert caught.value.fields["faces"] == (2, 4)

    def test_inconsistent_orientation(self) -> None:
        faces = STRIP.copy()
        faces[2] = faces[2, ::-1]
        with pytest.raises(InconsistentOrientationError) as caught:
            validate(mesh_of(faces))
        assert set(caught.value.fields["edge"]) == {2, 3}
        assert set(caught.value.fields["faces"]) == {1, 2}

    def test_moebius_strip_has_no_consistent_orientation(self) -> None:
        faces = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 1], [1, 5, 0]])
        with pytest.raises(InconsistentOrientationError):
            validate(mesh_of(faces))

    def test_third_face_on_an_edge_beside_a_loop(self) -> None:
        with pytest.raises(NonManifoldEdgeError) as caught:
            validate(mesh_of(np.vstack([STRIP, [1, 2, 5]])))
        assert set(caught.value.fields["edge"]) == {1, 2}
        assert caught.value.fields["faces"] == (0, 1, 3)

    def test_third_face_on_an_edge_that_ends_at_a_loop(self, tetrahedron: np.ndarray) -> None:
        # two closed tetrahedra over the edge (0, 1), and a lone triangle that touches vertex 1
        mirrored = np.array([0, 1, 4, 5])[tetrahedron]
        with pytest.raises(NonManifoldEdgeError) as caught:
            validate(mesh_of(np.vstack([tetrahedron, mirrored, [1, 6, 7]])))
        assert set(caught.value.fields["edge"]) == {0, 1}
        assert len(caught.value.fields["faces"]) == 4


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
