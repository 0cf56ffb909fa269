"""TriangleMesh and MeshExtension: the values that they keep, and those that they refuse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from spinor_geom.errors import MeshShapeError, NonFiniteVertexError, SpinorGeomError, VertexIndexError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 1, 2]])


def test_arrays_are_read_only_copies() -> None:
    vertices, faces, colours = POINTS.copy(), FACES.copy(), np.ones((4, 3))
    mesh = TriangleMesh(vertices, faces, vertex_attributes={"color": colours})
    vertices[0, 0] = faces[0, 0] = colours[0, 0] = 3
    assert mesh.vertices[0, 0] == 0
    assert mesh.faces[0, 0] == 0
    assert mesh.vertex_attributes["color"][0, 0] == 1
    extension = MeshExtension(vertices=[[0, 0, 1]], faces=[[0, 1, 4]], face_loops=[0])
    for array in (mesh.vertices, mesh.faces, mesh.vertex_attributes["color"], extension.vertices, extension.faces):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 7


WHOLE = {"vertices": np.zeros((1, 3)), "faces": [[0, 1, 4]], "face_loops": [0]}


@pytest.mark.parametrize(
    ("made", "error", "fields"),
    [
        *(
            (lambda vertices=vertices: TriangleMesh(vertices, FACES), MeshShapeError, {})
            for vertices in (POINTS[:, :2], POINTS.ravel(), POINTS + 1j, POINTS.astype(str), [[0, 0, 0], [1, 0]])
        ),
        *(
            (lambda faces=faces: TriangleMesh(POINTS, faces), MeshShapeError, {})
            for faces in ([[0, 1, 2, 3]], [[0.0, 1.0, 2.0]], [[True, False, True]])
        ),
        *(
            (
                lambda index=index: TriangleMesh(POINTS, [[0, 1, 2], [0, 1, index]]),
                VertexIndexError,
                {"face": 1, "index": index, "vertices": 4},
            )
            for index in (-1, 4)
        ),
        *(
            (lambda bad=bad: TriangleMesh([*POINTS[:2], [0, bad, 0]], FACES), NonFiniteVertexError, {"vertex": 2})
            for bad in (np.nan, np.inf, -np.inf)
        ),
        *(
            (lambda bad=bad: TriangleMesh(POINTS, FACES, vertex_attributes={"color": bad}), MeshShapeError, {})
            for bad in (np.zeros((3, 2)), np.zeros((4, 2, 2)), ["a", "b", "c", "d"])
        ),
        *(
            (lambda bad=bad: MeshExtension(**(WHOLE | bad)), error, {})
            for bad, error in (
                ({"vertices": np.zeros((1, 2))}, MeshShapeError),
                ({"faces": np.zeros((1, 4), dtype=int)}, MeshShapeError),
                ({"face_loops": [0, 1]}, MeshShapeError),
                ({"vertex_attributes": {"color": np.zeros((2, 3))}}, MeshShapeError),
                ({"vertices": np.full((1, 3), np.nan)}, NonFiniteVertexError),
            )
        ),
    ],
)
def test_what_is_no_mesh_is_refused(made: Callable[[], Any], error: type[SpinorGeomError], fields: dict) -> None:
    with pytest.raises(error) as caught:
        made()
    assert fields.items() <= caught.value.fields.items()


def test_merging_keeps_the_lowest_index_and_its_attributes() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = TriangleMesh(vertices, [[0, 1, 2], [5, 1, 4]], vertex_attributes={"id": np.arange(6)})
    merged, new_index = mesh.merged()
    np.testing.assert_array_equal(merged.vertices, vertices[[0, 1, 2, 4]])
    np.testing.assert_array_equal(new_index, [0, 1, 2, 0, 3, 2])
    np.testing.assert_array_equal(merged.faces, [[0, 1, 2], [2, 1, 3]])
    np.testing.assert_array_equal(merged.vertex_attributes["id"].ravel(), [0, 1, 2, 4])
