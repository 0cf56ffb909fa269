from __future__ import annotations

import numpy as np
import pytest
import pyvista
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, VertexIndexError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extensions, is_closed, lid, lid_for, meshes, nothing
from tests.fill.shapes import tube

OPEN_QUADS = CUBE_QUADS[:-1]


def poly_data(vertices: np.ndarray, faces: np.ndarray) -> pyvista.PolyData:
    return pyvista.PolyData.from_regular_faces(vertices, faces)


def grid(vertices: np.ndarray, faces: np.ndarray) -> pyvista.UnstructuredGrid:
    kind = pyvista.CellType.TRIANGLE if faces.shape[1] == 3 else pyvista.CellType.QUAD
    cells = np.column_stack([np.full(len(faces), faces.shape[1]), faces]).ravel()
    return pyvista.UnstructuredGrid(cells, np.full(len(faces), kind), vertices)


KINDS = pytest.mark.parametrize("made", [poly_data, grid], ids=["PolyData", "UnstructuredGrid"])


def polygons_in(mesh: pyvista.DataSet) -> list[list[int]]:
    return [mesh.get_cell(k).point_ids for k in range(mesh.n_cells)]


@KINDS
@settings(max_examples=30)
@given(data=st.data(), mesh=meshes(), single=st.booleans())
def test_prefix_is_unchanged(made: type, data: st.DataObject, mesh: tuple, single: bool) -> None:
    vertices, faces = mesh
    n, f = len(vertices), len(faces)
    random = np.random.default_rng(n)
    old = made(vertices.astype(np.float32) if single else vertices, faces)
    old.point_data["label"] = np.arange(n, dtype=np.int16)
    old.point_data["flow"] = random.normal(size=(n, 3))
    old.point_data["RGB"] = random.integers(0, 256, (n, 3), dtype=np.uint8)
    old.point_data["word"] = np.array(list("abcdefghijkl"[:n]))
    old.point_data.active_normals = random.normal(size=(n, 3)).astype(np.float32)
    old.cell_data["part"] = np.arange(f)
    old.field_data["unit"] = ["mm"]
    extension = data.draw(extensions(to_mesh(old)))
    new = extend(old, extension)
    k, t = len(extension.vertices), len(extension.faces)
    assert type(new) is type(old)
    assert new.points.dtype == old.points.dtype
    assert new.points[:n].tobytes() == old.points.tobytes()
    np.testing.assert_allclose(new.points[n:], extension.vertices, rtol=1e-6)
    assert polygons_in(new) == [*faces.tolist(), *extension.faces.tolist()]
    assert new.point_data.keys() == old.point_data.keys()
    for name, values in old.point_data.items():
        assert np.array_equal(new.point_data[name][:n], values)
        assert new.point_data[name].dtype == values.dtype
        assert len(new.point_data[name]) == n + k
    assert np.array_equal(new.cell_data["part"], [*range(f), *[0] * t])
    assert list(new.field_data["unit"]) == ["mm"]
    assert new.point_data.active_normals_name == old.point_data.active_normals_name
    assert new.point_data.active_scalars_name == old.point_data.active_scalars_name
    assert (old.n_points, old.n_cells) == (n, f)


@KINDS
def test_quads_stay_and_are_closed_by_a_lid(made: type) -> None:
    cube = made(CUBE_POINTS, OPEN_QUADS)
    assert len(to_mesh(cube).faces) == 10
    closed = extend(cube, lid())
    assert polygons_in(closed)[:5] == OPEN_QUADS.tolist()
    assert is_closed(to_mesh(closed))
    assert (
        closed.extract_feature_edges(
            boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=True
        ).n_cells
        == 0
    )  # in VTK's own eyes


def test_points_and_lines_beside_the_faces_stay_with_their_data() -> None:
    cube = pyvista.PolyData(
        CUBE_POINTS, faces=[4, 0, 1, 3, 2, 4, 4, 6, 7, 5], lines=[2, 0, 4, 3, 0, 4, 5], verts=[1, 6]
    )
    cube.cell_data["part"] = [7, 8, 8, 1, 2]  # VTK's order: points, lines, faces
    assert len(to_mesh(cube).faces) == 4
    closed = extend(cube, lid())
    assert closed.lines.tolist() == [2, 0, 4, 3, 0, 4, 5]
    assert closed.verts.tolist() == [1, 6]
    assert closed.cell_data["part"].tolist() == [7, 8, 8, 1, 2, 8, 8, 8, 8]
    mixed = cube.cast_to_unstructured_grid()
    assert np.array_equal(to_mesh(mixed).faces, to_mesh(cube).faces)
    assert polygons_in(extend(mixed, lid()))[:5] == polygons_in(mixed)


def test_an_edge_where_normals_or_texture_differ_is_a_seam() -> None:
    box = pyvista.Cube(clean=False)
    assert box.n_points == 24
    assert is_closed(to_mesh(box))
    assert boundary_loops(box) == []


def test_names_tell_normals_colours_texture_and_labels() -> None:
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


@KINDS
def test_a_hole_is_filled_and_the_type_stays(made: type) -> None:
    vertices, faces = tube()
    given = made(vertices, faces)
    given.point_data["height"] = vertices[:, 2]
    filled, report = fill_hole(given, return_report=True)
    assert type(filled) is type(given)
    assert report.watertight
    assert np.array_equal(filled.point_data["height"][:48], vertices[:, 2])
    # harmonic, so between the values on the rims
    assert -1e-9 <= filled.point_data["height"].min() <= filled.point_data["height"].max() <= 1 + 1e-9
    assert boundary_loops(filled) == []


def test_data_without_a_surface_are_refused_with_advice() -> None:
    solid = pyvista.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid()
    with pytest.raises(MeshShapeError, match=r"\(VOXEL\); call grid.extract_surface\(\)"):
        to_mesh(solid)
    strips = pyvista.Sphere().strip()
    with pytest.raises(MeshShapeError, match=r"strips; call mesh.triangulate\(\)"):
        extend(strips, nothing())
    broken = pyvista.PolyData(CUBE_POINTS[:3], faces=[3, 0, 1, 2])
    broken.points = CUBE_POINTS[:2]
    with pytest.raises(VertexIndexError):
        to_mesh(broken)
    cube = poly_data(CUBE_POINTS, OPEN_QUADS)
    cube.point_data["height"] = np.arange(8.0)
    with pytest.raises(MeshShapeError, match="'height'"):
        extend(cube, lid())


def test_a_mesh_of_pyvista_s_has_the_fill_as_a_method() -> None:
    if not hasattr(pyvista, "register_dataset_accessor"):
        pytest.skip("this PyVista has no accessors")
    import spinor_geom.fill.pyvista_accessor  # noqa: F401  (an installed package is found by its entry point)

    for made in (poly_data, grid):
        mesh = made(*tube())
        assert len(mesh.spinor.boundary_loops()) == 2
        filled, report = mesh.spinor.fill_hole(0, tolerance=1e-4, return_report=True)
        assert type(filled) is type(mesh)
        assert [loop.filled for loop in report.loops] == [True, False]
