"""What meshio, Open3D and PyMeshLab each do in their own way; what all types have in common is in `test_objects`."""

import meshio
import numpy as np
import pytest

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, is_closed, lid, lid_for, open_cube
from tests.bench.test_holes import require_peer


def test_quads_and_polygons_stay_and_are_closed_by_a_lid():
    cube = meshio.Mesh(CUBE_POINTS, [("quad", CUBE_QUADS[:3]), ("polygon", CUBE_QUADS[3:5])])
    assert len(to_mesh(cube).faces) == 10
    closed = extend(cube, lid())
    assert np.array_equal(closed.cells[0].data, CUBE_QUADS[:3])
    assert closed.cells[1].type == "polygon"
    assert is_closed(to_mesh(closed))


@pytest.fixture(scope="module")
def open3d():
    require_peer("open3d")
    import open3d

    return open3d


def made(open3d, vertices, faces):
    triangles = open3d.utility.Vector3iVector(faces.astype(np.int32))
    return open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(vertices), triangles)


def test_normals_and_neighbours_of_an_open3d_mesh_are_computed_again(open3d):
    cube = made(open3d, *open_cube())
    cube.compute_triangle_normals()
    cube.compute_adjacency_list()
    closed = extend(cube, lid())
    assert len(closed.adjacency_list) == 9
    np.testing.assert_allclose(np.linalg.norm(closed.triangle_normals, axis=1), 1)
    assert (np.asarray(closed.triangle_normals)[10:, 2] > 0.5).all()


def test_a_seam_of_normals_is_no_boundary(open3d):
    box = open3d.geometry.TriangleMesh.create_box()
    corners = np.asarray(box.vertices)[np.asarray(box.triangles)].reshape(-1, 3)
    flat = made(open3d, corners, np.arange(len(corners)).reshape(-1, 3))
    flat.vertex_normals = open3d.utility.Vector3dVector(np.repeat(np.asarray(np.eye(3))[np.arange(12) % 3], 3, axis=0))
    assert is_closed(to_mesh(flat))


def test_a_mesh_of_tensors_is_refused_with_advice(open3d):
    with pytest.raises(MeshShapeError, match=r"mesh.to_legacy\(\)"):
        to_mesh(open3d.t.geometry.TriangleMesh.create_box())


def mesh_set(vertices, faces, label="a mesh", **arrays):
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32), **arrays), label)
    return meshes


def test_the_current_mesh_of_a_set_is_taken_and_the_others_stay():
    import pymeshlab

    meshes = mesh_set(*open_cube(), label="cube")
    meshes.add_mesh(pymeshlab.Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32)), "triangle")
    assert len(to_mesh(meshes).faces) == 1
    meshes.set_current_mesh(0)
    closed = extend(meshes, lid_for(to_mesh(meshes)))
    assert closed.current_mesh().label() == "cube"
    assert {mesh.label(): mesh.face_number() for mesh in closed} == {"cube": 14, "triangle": 1}
    assert meshes.mesh_number() == 2


def test_colors_outside_of_the_range_are_clipped():
    cube = mesh_set(*open_cube(), v_color_matrix=np.ones((8, 4)))
    closed = extend(cube, lid(color=np.array([[1.5, -0.5, 0.2, 1.0]]), scalar=np.zeros((1, 1))))
    assert closed.current_mesh().vertex_color_matrix()[8].tolist() == [1.0, 0.0, 0.2, 1.0]
