from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError
from spinor_geom.fill.fill_hole import fill_hole
from tests.adapters.shapes import extensions, is_closed, lid, lid_for, meshes, open_cube
from tests.bench.test_holes import require_peer
from tests.fill.shapes import tube


@pytest.fixture(scope="module")
def open3d() -> Any:
    require_peer("open3d")
    import open3d

    return open3d


def made(open3d: Any, vertices: np.ndarray, faces: np.ndarray) -> Any:
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )


@settings(max_examples=30)
@given(data=st.data(), mesh=meshes())
def test_prefix_is_unchanged(open3d: Any, data: st.DataObject, mesh: tuple) -> None:
    vertices, faces = mesh
    n, f = len(vertices), len(faces)
    random = np.random.default_rng(n)
    utility = open3d.utility
    old = made(open3d, vertices, faces)
    old.vertex_colors = utility.Vector3dVector(random.uniform(size=(n, 3)))
    old.vertex_normals = utility.Vector3dVector(random.normal(size=(n, 3)))
    old.triangle_normals = utility.Vector3dVector(random.normal(size=(f, 3)))
    old.triangle_uvs = utility.Vector2dVector(random.uniform(size=(3 * f, 2)))
    old.triangle_material_ids = utility.IntVector(random.integers(0, 3, f).astype(np.int32))
    old.textures = [open3d.geometry.Image(np.zeros((2, 2, 3), dtype=np.uint8))]
    extension = data.draw(extensions(to_mesh(old)))
    new = extend(old, extension)
    assert type(new) is type(old)
    k, t = len(extension.vertices), len(extension.faces)
    assert np.array_equal(np.asarray(new.vertices), np.concatenate([vertices, extension.vertices]))
    assert np.array_equal(np.asarray(new.triangles), np.concatenate([faces, extension.faces]))
    for name, rows, corners in (
        ("vertex_colors", n + k, n),
        ("vertex_normals", n + k, n),
        ("triangle_normals", f + t, f),
        ("triangle_uvs", 3 * (f + t), 3 * f),
        ("triangle_material_ids", f + t, f),
    ):
        assert len(getattr(new, name)) == rows
        assert np.array_equal(np.asarray(getattr(new, name))[:corners], np.asarray(getattr(old, name)))
    assert len(new.textures) == 1
    assert (len(old.vertices), len(old.triangles)) == (n, f)


def test_lid_closes_the_cube_in_open3d_s_own_eyes(open3d: Any) -> None:
    cube = made(open3d, *open_cube())
    cube.compute_triangle_normals()
    cube.compute_adjacency_list()
    closed = extend(cube, lid())
    assert closed.is_watertight()
    assert is_closed(to_mesh(closed))
    assert len(closed.adjacency_list) == 9
    np.testing.assert_allclose(np.linalg.norm(closed.triangle_normals, axis=1), 1)
    assert (np.asarray(closed.triangle_normals)[10:, 2] > 0.5).all()


def test_colours_stay_between_0_and_1(open3d: Any) -> None:
    cube = made(open3d, *open_cube())
    cube.paint_uniform_color([1.0, 0.5, 0.0])
    assert to_mesh(cube).vertex_attributes["color"][0].tolist() == [1.0, 0.5, 0.0]
    closed = extend(cube, lid(color=np.array([[1.2, 0.5, -0.1]])))
    assert closed.vertex_colors[8].tolist() == [1.0, 0.5, 0.0]


def test_a_seam_of_normals_is_no_boundary(open3d: Any) -> None:
    box = open3d.geometry.TriangleMesh.create_box()
    corners = np.asarray(box.vertices)[np.asarray(box.triangles)].reshape(-1, 3)
    flat = made(open3d, corners, np.arange(len(corners)).reshape(-1, 3))
    flat.vertex_normals = open3d.utility.Vector3dVector(np.repeat(np.asarray(np.eye(3))[np.arange(12) % 3], 3, axis=0))
    assert is_closed(to_mesh(flat))


def test_a_hole_is_filled_and_the_type_stays(open3d: Any) -> None:
    given = made(open3d, *tube())
    given.compute_vertex_normals()
    filled, report = fill_hole(given, return_report=True)
    assert isinstance(filled, open3d.geometry.TriangleMesh)
    assert report.watertight
    assert filled.is_watertight()
    assert np.array_equal(np.asarray(filled.vertex_normals)[:48], np.asarray(given.vertex_normals))
    np.testing.assert_allclose(np.linalg.norm(filled.vertex_normals, axis=1), 1)


def test_a_mesh_of_tensors_is_refused_with_advice(open3d: Any) -> None:
    with pytest.raises(MeshShapeError, match=r"mesh.to_legacy\(\)"):
        to_mesh(open3d.t.geometry.TriangleMesh.create_box())
    colored = made(open3d, *open_cube())
    colored.paint_uniform_color([1.0, 0.5, 0.0])
    with pytest.raises(MeshShapeError, match="'color'"):
        extend(colored, lid())
    assert len(extend(colored, lid_for(to_mesh(colored))).triangles) == 14
