"""Formats read by other libraries: .vtp and .vtk by PyVista."""

import numpy as np
import pytest
import pyvista

from spinor_geom.adapters import read_mesh
from spinor_geom.cli.main import main
from spinor_geom.errors import MeshFileError, NonFiniteVertexError
from spinor_geom.fill.fill_hole import fill_hole
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, is_closed
from tests.fill.shapes import tube

VTK = pytest.mark.parametrize("suffix", [".vtp", ".vtk"])


@VTK
@pytest.mark.parametrize("single", [False, True])
def test_a_vtk_file_is_filled_and_keeps_its_data(tmp_path, suffix, single):
    vertices, faces = tube()
    held = pyvista.PolyData.from_regular_faces(vertices.astype(np.float32) if single else vertices, faces)
    held.point_data["height"] = vertices[:, 2]
    held.cell_data["part"] = np.arange(64)
    held.save(tmp_path / f"tube{suffix}")
    filled, report = fill_hole(tmp_path / f"tube{suffix}", return_report=True)
    assert report.watertight
    filled.write(tmp_path / f"filled{suffix}")
    again = pyvista.read(tmp_path / f"filled{suffix}")
    assert again.points.dtype == held.points.dtype
    assert again.points[:48].tobytes() == held.points.tobytes()
    assert np.array_equal(again.regular_faces[:64], faces)
    assert np.array_equal(again.point_data["height"][:48], vertices[:, 2])
    assert np.array_equal(again.cell_data["part"][:64], np.arange(64))
    assert is_closed(read_mesh(tmp_path / f"filled{suffix}").mesh)


@VTK
def test_quads_lines_and_names_survive_from_one_format_to_the_other(tmp_path, suffix):
    cube = pyvista.PolyData.from_regular_faces(CUBE_POINTS, CUBE_QUADS)
    cube.point_data["class"] = np.arange(8)
    cube.point_data["RGB"] = np.full((8, 3), 200, dtype=np.uint8)
    cube.active_texture_coordinates = CUBE_POINTS[:, :2]
    cube.save(tmp_path / "cube.vtp")
    file = read_mesh(tmp_path / "cube.vtp")
    assert file.polygons.sizes.tolist() == [4] * 6
    assert file.mesh.labels == {"class"}
    file.write(tmp_path / "cube.ply")
    assert read_mesh(tmp_path / "cube.ply").mesh.vertex_attributes["color"][0].tolist() == [200] * 3
    read_mesh(tmp_path / "cube.ply").write(tmp_path / f"again{suffix}")
    again = read_mesh(tmp_path / f"again{suffix}")
    assert np.array_equal(again.mesh.vertices, CUBE_POINTS)
    assert again.polygons.rows() == CUBE_QUADS.tolist()
    assert set(again.mesh.vertex_attributes) == set(file.mesh.vertex_attributes)
    assert np.array_equal(again.mesh.vertex_attributes["uv"], CUBE_POINTS[:, :2])


@VTK
def test_a_damaged_vtk_file_is_an_error_that_names_it_and_nothing_is_printed(tmp_path, suffix, capfd):
    sphere, path = pyvista.Sphere(), tmp_path / f"damaged{suffix}"
    sphere.save(path)
    whole = path.read_bytes()
    # VTK itself reads half of a legacy file as a mesh without its normals
    for data in (whole[: len(whole) // 2], b"hello world\n", bytes(range(256))):
        path.write_bytes(data)
        with pytest.raises(MeshFileError, match=rf"damaged\{suffix}"):
            read_mesh(path)
    assert capfd.readouterr() == ("", "")


@VTK
def test_what_is_no_surface_or_not_finite_is_refused_with_the_file_name(tmp_path, suffix):
    sphere = pyvista.Sphere().strip()
    sphere.save(tmp_path / f"strips{suffix}")
    with pytest.raises(MeshFileError, match=r"strips.*: the mesh has triangle strips"):
        read_mesh(tmp_path / f"strips{suffix}")
    pyvista.PolyData.from_regular_faces(CUBE_POINTS * [1, 1, np.nan], CUBE_QUADS).save(tmp_path / f"nan{suffix}")
    with pytest.raises(NonFiniteVertexError, match=rf"nan\{suffix}: vertex 0"):
        read_mesh(tmp_path / f"nan{suffix}")
    image = tmp_path / {".vtp": "image.vti", ".vtk": "image_.vtk"}[suffix]
    pyvista.ImageData(dimensions=(2, 2, 2)).save(image)
    with pytest.raises(MeshFileError, match=r"holds '.*', not .*; extract the surface"):
        read_mesh(image.rename(tmp_path / f"image{suffix}"))


NAMED = {"H\u00f6he": (".ply",), "Temp": (), "temp": (".glb",), "a b": (), "a_b": (), "\u540d": (".ply",)}


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_names_that_a_format_cannot_hold_are_left_out_and_named(tmp_path, suffix, capsys):
    held = pyvista.PolyData.from_regular_faces(*tube())
    for number, name in enumerate(NAMED):
        held.point_data[name] = np.arange(48.0) + 100 * number
    held.save(tmp_path / "tube.vtp")
    file = read_mesh(tmp_path / "tube.vtp")
    notes = file.write(tmp_path / f"tube{suffix}")
    missing = [name for name, formats in NAMED.items() if suffix in formats]
    assert len(notes) == len(missing)
    assert all(any(repr(name) in note for note in notes) for name in missing)
    # every one that is there has its own values
    found = [tuple(values[:, 0]) for values in read_mesh(tmp_path / f"tube{suffix}").mesh.vertex_attributes.values()]
    wanted = [tuple(held.point_data[name]) for name in NAMED if name not in missing]
    assert sorted(found) == sorted(wanted)
    assert main(["fill", str(tmp_path / "tube.vtp"), "-o", str(tmp_path / f"filled{suffix}")]) == 0
    assert all(repr(name) in capsys.readouterr().err for name in missing[:1])


@pytest.mark.parametrize(
    ("suffix", "kept"), [(".obj", {"color"}), (".off", {"color"}), (".stl", set()), (".3mf", set())]
)
def test_attributes_that_a_format_cannot_store_are_named(tmp_path, suffix, kept):
    held = pyvista.PolyData.from_regular_faces(*tube())
    held.point_data["color"] = np.full((48, 3), 128, dtype=np.uint8)
    held.point_data["pressure"] = np.arange(48.0)
    held.save(tmp_path / "tube.vtp")
    file = read_mesh(tmp_path / "tube.vtp")
    notes = file.write(tmp_path / f"tube{suffix}")
    assert [note.split("'")[1] for note in notes] == [name for name in file.mesh.vertex_attributes if name not in kept]
    assert all("do not support it" in note for note in notes)
    assert read_mesh(tmp_path / f"tube{suffix}").write(tmp_path / f"again{suffix}") == ()
