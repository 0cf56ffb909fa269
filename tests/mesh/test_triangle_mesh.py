"""TriangleMesh and MeshExtension: the values that they keep, and those that they refuse."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from spinor_geom.errors import MeshShapeError, NonFiniteVertexError, VertexIndexError
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
    for array in (mesh.vertices, mesh.faces, mesh.vertex_attributes["color"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 7


def test_input_arrays_stay_writable() -> None:
    vertices, faces = POINTS.copy(), FACES.copy()
    TriangleMesh(vertices, faces)
    assert vertices.flags.writeable
    assert faces.flags.writeable


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32, ">f8"])
def test_vertices_become_contiguous_float64(dtype: str) -> None:
    mesh = TriangleMesh(np.asfortranarray(POINTS.astype(dtype)), FACES.astype(np.uint16))
    assert mesh.vertices.dtype == np.float64
    assert mesh.vertices.dtype.isnative
    assert mesh.vertices.flags.c_contiguous
    assert mesh.faces.dtype == np.int64
    np.testing.assert_array_equal(mesh.vertices, POINTS)


def test_survives_pickle_and_deepcopy() -> None:
    mesh = TriangleMesh(POINTS, FACES, vertex_attributes={"u": np.arange(4.0)})
    for twin in (pickle.loads(pickle.dumps(mesh)), copy.deepcopy(mesh)):
        np.testing.assert_array_equal(twin.vertices, mesh.vertices)
        np.testing.assert_array_equal(twin.vertex_attributes["u"], mesh.vertex_attributes["u"])


def test_empty_faces_are_a_mesh() -> None:
    mesh = TriangleMesh(POINTS, np.array([]))
    assert mesh.faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (POINTS[:, :2], FACES),
        (POINTS.ravel(), FACES),
        (POINTS + 1j, FACES),
        (POINTS.astype(str), FACES),
        ([[0, 0, 0], [1, 0]], FACES),
        (POINTS, [[0, 1, 2, 3]]),
        (POINTS, [[0.0, 1.0, 2.0]]),
        (POINTS, [[True, False, True]]),
    ],
    ids=["2d", "flat", "complex", "text", "ragged", "quads", "float faces", "bool faces"],
)
def test_wrong_shape_or_dtype_is_refused(vertices: np.ndarray, faces: np.ndarray) -> None:
    with pytest.raises(MeshShapeError):
        TriangleMesh(vertices, faces)


@pytest.mark.parametrize("index", [-1, 4])
def test_index_out_of_range_names_the_face(index: int) -> None:
    with pytest.raises(VertexIndexError) as caught:
        TriangleMesh(POINTS, np.array([[0, 1, 2], [0, 1, index]]))
    assert caught.value.fields == {"face": 1, "index": index, "vertices": 4}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_coordinate_names_the_vertex(value: float) -> None:
    broken = POINTS.copy()
    broken[2, 1] = value
    with pytest.raises(NonFiniteVertexError) as caught:
        TriangleMesh(broken, FACES)
    assert caught.value.fields["vertex"] == 2


@pytest.mark.parametrize("values", [np.zeros((3, 2)), np.zeros((4, 2, 2)), ["a", "b", "c", "d"]])
def test_attribute_of_wrong_shape_is_refused(values: np.ndarray) -> None:
    with pytest.raises(MeshShapeError, match="'color'"):
        TriangleMesh(POINTS, FACES, vertex_attributes={"color": values})


def test_scalar_attribute_becomes_a_column() -> None:
    mesh = TriangleMesh(POINTS, FACES, vertex_attributes={"quality": [1, 2, 3, 4]})
    np.testing.assert_array_equal(mesh.vertex_attributes["quality"], [[1.0], [2.0], [3.0], [4.0]])


def test_merging_keeps_the_lowest_index_and_its_attributes() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = TriangleMesh(vertices, [[0, 1, 2], [5, 1, 4]], vertex_attributes={"id": np.arange(6)})
    merged, new_index = mesh.merged()
    np.testing.assert_array_equal(merged.vertices, vertices[[0, 1, 2, 4]])
    np.testing.assert_array_equal(new_index, [0, 1, 2, 0, 3, 2])
    np.testing.assert_array_equal(merged.faces, [[0, 1, 2], [2, 1, 3]])
    np.testing.assert_array_equal(merged.vertex_attributes["id"].ravel(), [0, 1, 2, 4])


def test_merging_a_mesh_without_equal_positions_changes_nothing() -> None:
    merged, new_index = TriangleMesh(POINTS, FACES).merged()
    np.testing.assert_array_equal(merged.vertices, POINTS)
    np.testing.assert_array_equal(new_index, np.arange(4))


def test_extension_converts_and_freezes() -> None:
    extension = MeshExtension(
        vertices=np.array([[0, 0, 1]]),
        faces=np.array([[0, 1, 4]], dtype=np.int32),
        face_loops=np.array([0]),
        vertex_attributes={"color": np.array([[1, 2, 3]], dtype=np.uint8)},
    )
    assert extension.vertices.dtype == np.float64
    assert extension.faces.dtype == np.int64
    assert extension.vertex_attributes["color"].dtype == np.float64
    assert not extension.face_loops.flags.writeable


@pytest.mark.parametrize(
    "broken",
    [
        {"vertices": np.zeros((1, 2))},
        {"faces": np.zeros((1, 4), dtype=int)},
        {"face_loops": np.array([0, 1])},
        {"vertex_attributes": {"color": np.zeros((2, 3))}},
    ],
    ids=["vertices", "faces", "face_loops", "vertex_attributes"],
)
def test_extension_of_wrong_shape_is_refused(broken: dict[str, np.ndarray]) -> None:
    whole = {"vertices": np.zeros((1, 3)), "faces": np.array([[0, 1, 4]]), "face_loops": np.array([0])}
    with pytest.raises(MeshShapeError):
        MeshExtension(**(whole | broken))


def test_extension_with_nan_is_refused() -> None:
    with pytest.raises(NonFiniteVertexError):
        MeshExtension(vertices=np.full((1, 3), np.nan), faces=FACES, face_loops=np.array([0]))
