"""Every format gives back the mesh that was written, or refuses it; what single precision changes is told."""

import json
from dataclasses import replace

import numpy as np
import pytest
import pyvista
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import MeshFile, mesh_files, read_mesh
from spinor_geom.adapters.contents import MOST_CHANGE
from spinor_geom.adapters.mesh_files import FORMATS, write_triangles
from spinor_geom.cli.main import main
from spinor_geom.errors import PrecisionError
from spinor_geom.fill.fill_hole import fill_hole
from tests.adapters.shapes import extension, glb_tree
from tests.fill.shapes import obj_text, tube

SINGLE = (".stl", ".glb")
ROUNDED = pytest.mark.parametrize("suffix", SINGLE)
UTM = np.array([500000.0, 5000000.0, 120.0])


def mesh_at(folder, offset, scale=1.0, *, single=False):
    """A tube as a file, in single precision if asked for."""
    vertices, faces = tube()
    vertices = vertices * scale + offset
    if single:
        vertices = vertices.astype(np.float32).astype(np.float64)
    path = folder / "tube.obj"
    path.write_text(obj_text(vertices, faces))
    return read_mesh(path)


def edge_change(before, after):
    """The largest relative change of an edge of faces, given by their corners (F, 3, 3)."""
    edges, changed = (corners - np.roll(corners, 1, axis=1) for corners in (before, after))
    return float((np.linalg.norm(changed - edges, axis=2) / np.linalg.norm(edges, axis=2)).max())


@pytest.mark.parametrize("suffix", list(FORMATS))
@given(ratio=st.floats(0, 12), direction=st.integers(0, 6), size=st.integers(-6, 6))
def test_every_writer_keeps_the_mesh_or_refuses_it(tmp_path_factory, suffix, ratio, direction, size):
    folder, scale = tmp_path_factory.mktemp("far"), 10.0**size
    offset = np.array([direction & 1, direction >> 1 & 1, direction >> 2 & 1]) * scale * 10**ratio
    file = mesh_at(folder, offset, scale)
    try:
        notes = file.write(folder / f"again{suffix}")
    except PrecisionError:
        assert suffix == ".stl"
        assert not (folder / f"again{suffix}").exists()
        return
    again = read_mesh(folder / f"again{suffix}").mesh
    assert len(again.vertices) == len(file.mesh.vertices)
    if suffix not in SINGLE:
        assert again.vertices.tobytes() == file.mesh.vertices.tobytes()
        return
    change = edge_change(file.mesh.vertices[file.mesh.faces], again.vertices[again.faces])
    assert change < 1.001 * MOST_CHANGE + 1e-14 * 10**ratio  # and rounding of the offset itself in float64
    assert all("relative to" in note for note in notes)


def test_a_glb_file_far_from_the_origin_has_an_offset_that_every_reader_adds(tmp_path, capsys):
    mesh_at(tmp_path, UTM)
    path, report = tmp_path / "filled.glb", tmp_path / "report.json"
    assert main(["fill", str(tmp_path / "tube.obj"), "-o", str(path), "--report", str(report)]) == 0
    told = "the positions are relative to (500000, 5000000, 120), the translation of the node"
    assert told in capsys.readouterr().err
    assert told in json.loads(report.read_text())["notes"][-1]
    filled = fill_hole(read_mesh(tmp_path / "tube.obj").as_stored(".glb")).mesh
    assert glb_tree(path.read_bytes())["nodes"] == [{"mesh": 0, "translation": UTM.tolist()}]
    again = read_mesh(path)
    np.testing.assert_array_equal(again.mesh.vertices, filled.vertices)
    other = trimesh.load_scene(path, process=False).to_mesh()
    np.testing.assert_allclose(other.vertices, filled.vertices, rtol=0, atol=1e-9)  # of the offset
    # a file with an offset is filled like another one
    open_again = fill_hole(mesh_at(tmp_path, UTM), 0)
    open_again.write(tmp_path / "open.glb")
    closed, result = fill_hole(tmp_path / "open.glb", return_report=True)
    assert result.watertight
    closed.write(tmp_path / "closed.glb")
    assert len(fill_hole(tmp_path / "closed.glb", return_report=True)[1].loops) == 0


@ROUNDED
def test_vertices_too_near_or_coordinates_too_small_for_floats_are_refused(tmp_path, suffix):
    file = mesh_at(tmp_path, np.zeros(3))
    near = np.array(file.mesh.vertices)
    near[1] = near[0] + [1e-12, 0, 0]
    for vertices in (near, file.mesh.vertices * 1e-60):
        contents = replace(file.contents, vertices=vertices, appended=None, suffix="")
        with pytest.raises(PrecisionError, match=r"write \.obj or \.off"):
            MeshFile.of_contents(contents, path=None).write(tmp_path / f"again{suffix}")


@pytest.mark.parametrize("suffix", [".ply", ".vtk", ".glb"])
def test_new_vertices_that_the_numbers_of_the_file_cannot_hold_are_refused(tmp_path, suffix):
    vertices, faces = tube()
    held = pyvista.PolyData.from_regular_faces((vertices + np.array([2.0**22, 0, 0])).astype(np.float32), faces)
    held.save(tmp_path / "tube.vtk")
    path = tmp_path / f"tube{suffix}"
    trimesh.Trimesh(held.points, faces, process=False).export(path) if suffix != ".vtk" else None
    far = read_mesh(path)
    middle = far.mesh.vertices[:16].mean(axis=0)
    rim = np.stack([np.arange(16), np.roll(np.arange(16), -1), np.full(16, 48)], axis=1)
    for shift, is_held in ((0.5, True), (1e-3, False)):
        moved = np.stack([middle, middle + np.array([shift, 0, 0])])
        rows = {name: np.zeros((2, x.shape[1])) for name, x in far.mesh.vertex_attributes.items()}
        new = extension(moved, [*rim, [0, 48, 49]], **rows)
        if is_held:
            far.extended(new).write(path)
            continue
        with pytest.raises(PrecisionError, match=rf"32-bit numbers of \{suffix} files"):
            far.extended(new).write(path)
        far.extended(new).write(tmp_path / "kept.obj")
        assert read_mesh(tmp_path / "kept.obj").mesh.vertices[-2:].tobytes() == moved.tobytes()


@pytest.mark.parametrize("suffix", [".obj", ".off"])
def test_text_is_written_without_a_search_for_what_single_precision_does_not_hold(tmp_path, monkeypatch, suffix):
    vertices, faces = tube()
    write_triangles(vertices.astype(np.float32), faces, path := tmp_path / f"tube{suffix}")
    file = read_mesh(path).extended(extension([[1.0, 0.0, 0.0]], [[0, 1, 48]]))
    monkeypatch.setattr(mesh_files, "is_held_in_single_precision", None)
    file.write(path)
    assert read_mesh(path).mesh.vertices[-1].tolist() == [1.0, 0.0, 0.0]
