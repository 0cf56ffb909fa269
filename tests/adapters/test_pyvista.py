import numpy as np
import pytest
import pyvista

from spinor_geom.adapters import extend, to_mesh
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, lid, lid_for
from tests.fill.shapes import tube

OPEN_QUADS = CUBE_QUADS[:-1]


def poly_data(vertices, faces):
    return pyvista.PolyData.from_regular_faces(vertices, faces)


def polygons_in(mesh):
    return [mesh.get_cell(k).point_ids for k in range(mesh.n_cells)]


def test_points_and_lines_beside_the_faces_stay_with_their_data():
    quads, lines = [4, 0, 1, 3, 2, 4, 4, 6, 7, 5], [2, 0, 4, 3, 0, 4, 5]
    cube = pyvista.PolyData(CUBE_POINTS, faces=quads, lines=lines, verts=[1, 6])
    cube.cell_data["part"] = [7, 8, 8, 1, 2]  # VTK's order: points, lines, faces
    assert len(to_mesh(cube).faces) == 4
    closed = extend(cube, lid())
    assert closed.lines.tolist() == lines
    assert closed.verts.tolist() == [1, 6]
    assert closed.cell_data["part"].tolist() == [7, 8, 8, 1, 2, 8, 8, 8, 8]
    mixed = cube.cast_to_unstructured_grid()
    assert np.array_equal(to_mesh(mixed).faces, to_mesh(cube).faces)
    assert polygons_in(extend(mixed, lid()))[:5] == polygons_in(mixed)


def test_names_tell_normals_colours_texture_and_labels():
    cube = poly_data(CUBE_POINTS, OPEN_QUADS)
    cube.point_data["color"] = np.arange(8.0)
    cube.point_data["scan"] = np.full((8, 4), 200, dtype=np.uint8)
    cube.point_data["class"] = np.arange(8)
    cube.active_texture_coordinates = CUBE_POINTS[:, :2]
    mesh = to_mesh(cube)
    assert set(mesh.vertex_attributes) == {"attribute color", "color", "class", "uv"}
    assert mesh.vertex_attributes["color"].max() == 200
    assert mesh.labels == {"class"}
    closed = extend(cube, lid_for(mesh))
    assert closed.point_data["scan"][8].tolist() == [200] * 4
    assert closed.active_texture_coordinates[8].tolist() == [0.5, 0.5]


def test_a_mesh_of_pyvista_s_has_the_fill_as_a_method():
    if not hasattr(pyvista, "register_dataset_accessor"):
        pytest.skip("this PyVista has no accessors")
    import spinor_geom.fill.pyvista_accessor  # noqa: F401  (an installed package is found by its entry point)

    for mesh in (poly_data(*tube()), poly_data(*tube()).cast_to_unstructured_grid()):
        assert len(mesh.spinor.boundary_loops()) == 2
        filled, report = mesh.spinor.fill_hole(0, tolerance=1e-4, return_report=True)
        assert type(filled) is type(mesh)
        assert [loop.filled for loop in report.loops] == [True, False]
