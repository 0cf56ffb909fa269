from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, NonFiniteVertexError, VertexIndexError
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.adapters.shapes import extensions, is_closed, lid, lid_for, meshes, nothing, open_cube


class Shell(NamedTuple):
    positions: np.ndarray
    triangles: np.ndarray


@given(
    data=st.data(),
    mesh=meshes(),
    floating=st.sampled_from([np.float32, np.float64]),
    container=st.sampled_from([tuple, list, Shell._make]),
)
def test_prefix_is_bit_equal_and_the_type_stays(
    data: st.DataObject, mesh: tuple, floating: type, container: object
) -> None:
    vertices, faces = (
        mesh[0].astype(floating),
        mesh[1].astype(data.draw(st.sampled_from([np.int32, np.int64, np.uint32]))),
    )
    pair = container([vertices, faces])
    copies = vertices.copy(), faces.copy()
    extension = data.draw(extensions(to_mesh(pair)))
    grown = extend(pair, extension)
    assert type(grown) is type(pair)
    new_vertices, new_faces = grown
    assert new_vertices.dtype == vertices.dtype
    assert new_faces.dtype == faces.dtype
    assert new_vertices[: len(vertices)].tobytes() == copies[0].tobytes()
    assert np.array_equal(new_faces[: len(faces)], copies[1])
    assert np.array_equal(new_vertices[len(vertices) :], extension.vertices.astype(floating))
    assert np.array_equal(new_faces[len(faces) :], extension.faces)
    assert np.array_equal(pair[0], copies[0])
    assert np.array_equal(pair[1], copies[1])


def test_lid_closes_the_cube() -> None:
    cube = open_cube()
    assert not is_closed(to_mesh(cube))
    assert is_closed(to_mesh(extend(cube, lid())))


def test_integer_positions_become_float64_and_keep_their_values() -> None:
    vertices, faces = open_cube(np.int32)
    grown, _ = extend((vertices, faces), lid())
    assert grown.dtype == np.float64
    assert np.array_equal(grown[:-1], vertices)
    assert grown[-1, 2] == 1 + 1 / 3


def test_too_narrow_indices_are_widened() -> None:
    vertices = np.tile(np.eye(3), (42, 1))  # 126 vertices: int8 holds indices to 127
    faces = np.array([[0, 1, 2]], dtype=np.int8)
    extension = extend(TriangleMesh(vertices, faces), nothing())
    assert len(extension.faces) == 1
    grown = lid()
    two = type(grown)(vertices=np.eye(3), faces=np.array([[126, 127, 128]]), face_loops=np.array([0]))
    _, indices = extend((vertices, faces), two)
    assert indices.tolist() == [[0, 1, 2], [126, 127, 128]]


def test_non_contiguous_arrays_are_read() -> None:
    vertices, faces = open_cube()
    mesh = to_mesh((np.asfortranarray(vertices), faces[:, ::-1]))
    assert np.array_equal(mesh.faces, faces[:, ::-1])


@pytest.mark.parametrize(
    ("vertices", "faces", "error"),
    [
        (np.zeros((4, 2)), np.array([[0, 1, 2]]), MeshShapeError),
        (np.zeros((4, 3)), np.array([[0.0, 1.0, 2.0]]), MeshShapeError),
        (np.zeros((4, 3)), np.array([[0, 1, 2, 3]]), MeshShapeError),
        (np.zeros((4, 3)), np.array([[0, 1, 4]]), VertexIndexError),
        (np.zeros((4, 3)), np.array([[0, 1, -1]]), VertexIndexError),
        (np.array([[0.0, 0.0, np.nan]] * 3), np.array([[0, 1, 2]]), NonFiniteVertexError),
    ],
)
def test_bad_arrays_give_typed_errors(vertices: np.ndarray, faces: np.ndarray, error: type[Exception]) -> None:
    with pytest.raises(error):
        to_mesh((vertices, faces))


def test_extension_that_names_a_missing_vertex_is_refused() -> None:
    extension = lid()
    wrong = type(extension)(vertices=extension.vertices, faces=extension.faces + 1, face_loops=extension.face_loops)
    with pytest.raises(VertexIndexError) as caught:
        extend(open_cube(), wrong)
    assert caught.value.fields == {"face": 0, "index": 9, "vertices": 9}


def test_triangle_mesh_keeps_and_extends_its_attributes() -> None:
    random = np.random.default_rng(5)
    vertices, faces = open_cube()
    mesh = TriangleMesh(
        vertices, faces, vertex_attributes={"color": random.uniform(size=(8, 3)), "heat": np.arange(8.0)}
    )
    assert to_mesh(mesh) is mesh
    grown = extend(mesh, lid_for(mesh))
    assert np.array_equal(grown.vertex_attributes["color"][:8], mesh.vertex_attributes["color"])
    assert grown.vertex_attributes["heat"][8, 0] == 3.5
    assert is_closed(grown)


def test_missing_or_misshapen_attributes_are_refused() -> None:
    vertices, faces = open_cube()
    mesh = TriangleMesh(vertices, faces, vertex_attributes={"color": np.zeros((8, 3))})
    with pytest.raises(MeshShapeError, match="'color'"):
        extend(mesh, lid())
    with pytest.raises(MeshShapeError, match="'color' has 3 columns"):
        extend(mesh, lid(color=np.zeros((1, 4))))
    assert len(extend(mesh, nothing()).vertices) == 8
