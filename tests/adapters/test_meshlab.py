from __future__ import annotations

import numpy as np
import pymeshlab
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError
from tests.adapters.shapes import extensions, is_closed, lid, lid_for, meshes, nothing, open_cube


def mesh_set(vertices: np.ndarray, faces: np.ndarray, label: str = "a mesh", **arrays: np.ndarray) -> pymeshlab.MeshSet:
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32), **arrays), label)
    return meshes


@settings(max_examples=40)
@given(data=st.data(), mesh=meshes())
def test_prefix_is_unchanged(data: st.DataObject, mesh: tuple) -> None:
    vertices, faces = mesh
    n, f = len(vertices), len(faces)
    random = np.random.default_rng(n)
    old = mesh_set(
        vertices,
        faces,
        v_color_matrix=random.integers(0, 256, (n, 4)) / 255,
        v_scalar_array=random.normal(size=n),
        v_tex_coords_matrix=random.uniform(size=(n, 2)),
        w_tex_coords_matrix=random.uniform(size=(3 * f, 2)),
        f_color_matrix=random.integers(0, 256, (f, 4)) / 255,
        f_scalar_array=random.normal(size=f),
    )
    extension = data.draw(extensions(to_mesh(old)))
    new = extend(old, extension)
    assert isinstance(new, pymeshlab.MeshSet)
    assert new.mesh_number() == 1
    a, b = old.current_mesh(), new.current_mesh()
    assert b.vertex_matrix()[:n].tobytes() == vertices.tobytes()
    assert np.array_equal(b.vertex_matrix()[n:], extension.vertices)
    assert np.array_equal(b.face_matrix(), np.concatenate([faces, extension.faces]))
    for name in ("vertex_color_matrix", "vertex_scalar_array", "vertex_tex_coord_matrix"):
        assert np.array_equal(getattr(b, name)()[:n], getattr(a, name)())
    for name in ("face_color_matrix", "face_scalar_array"):
        assert np.array_equal(getattr(b, name)()[:f], getattr(a, name)())
    assert np.array_equal(b.wedge_tex_coord_matrix()[: 3 * f], a.wedge_tex_coord_matrix())
    assert np.array_equal(
        b.vertex_scalar_array()[n:], extension.vertex_attributes.get("scalar", np.zeros((0, 1)))[:, 0]
    )
    assert b.label() == "a mesh"
    assert a.vertex_number() == n


def test_lid_closes_the_cube_and_the_transform_stays() -> None:
    cube = mesh_set(*open_cube())
    cube.compute_matrix_from_translation(axisx=5.0, freeze=False)
    closed = extend(cube, lid_for(to_mesh(cube)))
    assert is_closed(to_mesh(closed))
    assert np.array_equal(closed.current_mesh().transform_matrix(), cube.current_mesh().transform_matrix())
    assert closed.current_mesh().transform_matrix()[0, 3] == 5.0
    assert closed.get_topological_measures()["boundary_edges"] == 0


def test_current_mesh_is_taken_and_the_set_stays() -> None:
    meshes = mesh_set(*open_cube(), label="cube")
    meshes.add_mesh(pymeshlab.Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32)), "triangle")
    assert len(to_mesh(meshes).faces) == 1
    meshes.set_current_mesh(0)
    assert len(to_mesh(meshes).faces) == 10
    closed = extend(meshes, lid_for(to_mesh(meshes)))
    assert closed.current_mesh().label() == "cube"
    assert meshes.mesh_number() == 2


def test_deleted_elements_are_left_out() -> None:
    vertices, faces = open_cube()
    meshes = mesh_set(vertices, faces)
    meshes.compute_selection_by_condition_per_face(condselect="fi < 2")
    meshes.meshing_remove_selected_faces()
    assert np.array_equal(to_mesh(meshes).faces, faces[2:])
    assert len(extend(meshes, nothing()).current_mesh().face_matrix()) == 8


def test_empty_set_is_a_typed_error() -> None:
    with pytest.raises(MeshShapeError, match="holds no mesh"):
        to_mesh(pymeshlab.MeshSet(verbose=False))


def test_colors_outside_of_the_range_are_clipped() -> None:
    cube = mesh_set(*open_cube(), v_color_matrix=np.ones((8, 4)))
    closed = extend(cube, lid(color=np.array([[1.5, -0.5, 0.2, 1.0]]), scalar=np.zeros((1, 1))))
    assert closed.current_mesh().vertex_color_matrix()[8].tolist() == [1.0, 0.0, 0.2, 1.0]
