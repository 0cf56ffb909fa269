from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import pyvista
import trimesh

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.errors import MeshFileError, MeshShapeError, NonFiniteVertexError, VertexIndexError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import (
    CUBE_POINTS,
    CUBE_QUADS,
    extension,
    is_closed,
    lid,
    lid_for,
    nothing,
    open_cube,
    quad_lines,
)

SUFFIXES = [".obj", ".ply", ".stl", ".off", ".glb"]


def cube_file(folder, suffix=".obj"):
    """The open cube of quads, with colours, in any format."""
    text = "".join(f"v {x} {y} {z} {x} {y} 0.5\n" for x, y, z in CUBE_POINTS.tolist())
    (folder / "cube.obj").write_text(text + quad_lines())
    if suffix != ".obj":
        read_mesh(folder / "cube.obj").write(folder / f"cube{suffix}")
    return folder / f"cube{suffix}"


@pytest.mark.parametrize("source", [".obj", ".ply", ".off", ".glb"])
@pytest.mark.parametrize("target", SUFFIXES)
def test_filled_files_close_in_every_format(tmp_path, source, target):
    file = read_mesh(cube_file(tmp_path, source))
    closed = file.extended(lid_for(file.mesh))
    closed.write(tmp_path / f"closed{target.upper()}")
    back = read_mesh(tmp_path / f"closed{target.upper()}")
    if target == ".stl":
        back = back.merged()
    assert is_closed(back.mesh)
    if target in (".obj", ".ply", ".off") and source != ".glb":
        assert back.polygons.sizes.tolist() == [4] * 5 + [3] * 4
    if target != ".stl":
        # corner by corner: the patch of a GLB file has its own copies of the rim's vertices
        assert np.allclose(back.mesh.vertices[back.mesh.faces], closed.mesh.vertices[closed.mesh.faces], atol=1e-7)
        ours, theirs = closed.contents.srgb[closed.mesh.faces], back.contents.srgb[back.mesh.faces]
        assert np.abs(ours - theirs).max() <= 0.5 / 255 + 1e-7


@pytest.mark.parametrize("encoding", ["ascii.ply", "binary.ply", ".off", ".glb", ".obj", ".stl"])
def test_files_of_trimesh_are_read_and_written_as_by_trimesh(tmp_path, encoding):
    ball = trimesh.creation.icosphere(subdivisions=1)
    path, anew = (tmp_path / f"{name}.{encoding.rpartition('.')[2]}" for name in ("ball", "anew"))
    if encoding != ".stl":
        ball.visual.vertex_colors = np.arange(len(ball.vertices) * 4).reshape(-1, 4) % 256
    ball.export(path, **({"encoding": encoding[:-4]} if encoding.endswith("ply") else {}))
    file = read_mesh(path)
    file.merged().write(anew)
    for other in (trimesh.load_mesh(path, process=False), trimesh.load_mesh(anew, process=False)):
        corners = other.vertices[other.faces]
        np.testing.assert_allclose(file.mesh.vertices[file.mesh.faces], corners, rtol=1e-6, atol=1e-8)
        if encoding[-3:] in ("ply", "glb"):
            np.testing.assert_allclose(file.mesh.vertex_attributes["color"], other.visual.vertex_colors, atol=1)
    # nothing added gives the same bytes. Of a part of them nothing is made up
    file.write(tmp_path / f"same{path.suffix}")
    data = path.read_bytes()
    assert (tmp_path / f"same{path.suffix}").read_bytes() == data or encoding == ".stl"
    refused = []
    for stop in range(0, len(data) - 9, 1 + len(data) // 300):
        path.write_bytes(data[:stop])
        try:
            assert len(read_mesh(path).mesh.faces) < len(file.mesh.faces)
        except (MeshFileError, NonFiniteVertexError, VertexIndexError):
            refused.append(stop)
    assert len(refused) > (20 if encoding == ".obj" else 250)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".glb", ".vtp"])
def test_edges_where_attributes_differ_are_no_boundary_and_others_are(tmp_path, suffix):
    vertices, faces = open_cube()
    soup = pyvista.PolyData.from_regular_faces(vertices[faces].reshape(-1, 3), np.arange(30).reshape(-1, 3))
    soup.save(tmp_path / "soup.vtp")
    soup.point_data.active_normals = np.repeat(soup.compute_normals().cell_data["Normals"], 3, axis=0)
    soup.active_texture_coordinates = np.random.default_rng(0).uniform(size=(30, 2))
    soup.save(tmp_path / "seams.vtp")
    for name, boundary in (("soup", 30), ("seams", 4)):
        read_mesh(tmp_path / f"{name}.vtp").write(tmp_path / f"again{suffix}")
        file = read_mesh(tmp_path / f"again{suffix}")
        assert len(boundary_edges(file.mesh.faces)) == boundary
        assert len(file.mesh.vertices) == 30
        assert len(boundary_edges(file.merged().mesh.faces)) == 4


def test_merged_closes_a_soup_and_keeps_polygons_and_curves(tmp_path):
    corners = CUBE_POINTS[CUBE_QUADS[:-1]].reshape(-1, 3)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners.tolist())
    text += "".join(f"f {i} {i + 1} {i + 2} {i + 3}\n" for i in range(1, 20, 4)) + "l 1 2\n"
    (tmp_path / "soup.obj").write_text("mtllib a.mtl\n" + text)
    soup = read_mesh(tmp_path / "soup.obj")
    assert len(boundary_edges(soup.mesh.faces)) == 20
    merged = soup.merged()
    assert len(boundary_edges(merged.mesh.faces)) == 4
    assert merged.polygons.sizes.tolist() == [4] * 5
    merged.write(tmp_path / "merged.obj")
    back = read_mesh(tmp_path / "merged.obj")
    assert back.polygons.rows() == merged.polygons.rows()
    lines, wanted = ([curve.tolist() for curve in file.contents.polylines] for file in (back, merged))
    assert lines == wanted
    assert "mtllib" not in (tmp_path / "merged.obj").read_text()


def test_attributes_go_from_obj_to_glb_as_far_as_the_format_allows(tmp_path):
    random = np.random.default_rng(4)
    uv, normals = random.uniform(size=(8, 2)), random.normal(size=(8, 3))
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE_POINTS.tolist())
    text += "".join(f"vt {u} {v}\n" for u, v in uv.tolist())
    text += "".join(f"vn {a} {b} {c}\n" for a, b, c in normals.tolist())
    (tmp_path / "a.obj").write_text(text + quad_lines("{0}/{0}/{0}"))
    read_mesh(tmp_path / "a.obj").write(tmp_path / "a.glb")
    attributes = read_mesh(tmp_path / "a.glb").mesh.vertex_attributes
    assert np.allclose(attributes["uv"], uv, atol=1e-7)
    assert np.array_equal(attributes["normal"], normals.astype(np.float32))
    contents = replace(read_mesh(tmp_path / "a.obj").contents, attributes={"wide": np.ones((8, 5))})
    wide = MeshFile.of_contents(contents, path=None)
    wide.write(tmp_path / "wide.glb")
    assert dict(read_mesh(tmp_path / "wide.glb").mesh.vertex_attributes) == {}
    wide.write(tmp_path / "wide.ply")
    assert sorted(read_mesh(tmp_path / "wide.ply").mesh.vertex_attributes) == [f"wide_{k}" for k in range(5)]


def test_failed_writing_leaves_the_old_file(tmp_path, monkeypatch):
    file = read_mesh(cube_file(tmp_path))
    target = tmp_path / "target.ply"
    target.write_bytes(b"old")

    def full_disk(path, data):
        with path.open("wb") as stream:
            stream.write(data[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(MeshFileError, match="No space left"):
        file.write(target)
    monkeypatch.undo()
    assert target.read_bytes() == b"old"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["cube.obj", "target.ply"]


@pytest.mark.parametrize("name", ["missing.obj", "folder.obj", "mesh", "mesh.obj.gz"])
def test_files_that_cannot_be_read_are_named(tmp_path, name):
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(MeshFileError) as caught:
        read_mesh(tmp_path / name)
    assert caught.value.fields["path"] == tmp_path / name


@pytest.mark.parametrize("name", ["a.step", "missing/a.obj"])
def test_files_that_cannot_be_written_are_named(tmp_path, name):
    with pytest.raises(MeshFileError) as caught:
        read_mesh(cube_file(tmp_path)).write(tmp_path / name)
    assert caught.value.fields["path"] == tmp_path / name


def test_extensions_that_do_not_fit_are_refused(tmp_path):
    file = read_mesh(cube_file(tmp_path))
    with pytest.raises(MeshShapeError, match="'color'"):
        file.extended(lid())
    assert len(file.extended(nothing()).mesh.faces) == 10
    with pytest.raises(VertexIndexError):
        file.extended(extension([], [0, 1, 8]))


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_file_that_was_read_is_closed_so_that_windows_lets_it_be_replaced(suffix, tmp_path):
    path = cube_file(tmp_path, suffix)
    file = read_mesh(path)
    maps = Path("/proc/self/maps")  # where the system tells
    assert str(path) not in {one.path for one in psutil.Process().open_files()}
    assert not maps.exists() or str(path) not in maps.read_text()
    file.write(path)
    assert len(read_mesh(path).mesh.faces) == len(file.mesh.faces)


def with_unused_nan(path):
    """The open cube with three vertices more, NaN or infinite, in the middle of its vertices. No face uses them."""
    points = np.insert(CUBE_POINTS, [3, 3, 5], [[np.nan] * 3, [0, np.inf, 0], [-np.inf, np.nan, 1]], axis=0)
    quads = CUBE_QUADS[:-1]
    quads = quads + 2 * (quads >= 3) + (quads >= 5)
    rows = [" ".join(map(repr, row)) for row in points.tolist()]
    rows[3] = "1.#QNAN -1.#IND00 nan(ind)"  # as C libraries write NaN
    if path.suffix == ".obj":
        text = "".join(f"v {row}\n" for row in rows) + "vt nan nan\nvn nan 0 0\n"
        text += "".join(f"f {' '.join(map(str, quad))}\n" for quad in (quads + 1).tolist())
    elif path.suffix == ".off":
        faces = (f"4 {' '.join(map(str, quad))}" for quad in quads.tolist())
        text = "\n".join(["OFF", f"{len(points)} 5 0", *rows, *faces])
    else:
        data = pyvista.PolyData.from_regular_faces(points, quads)
        if path.suffix == ".vtk":
            data.save(path)
            return path
        text = "ply\nformat ascii 1.0\nelement vertex 11\nproperty double x\nproperty double y\nproperty double z\n"
        text += "element face 5\nproperty list uchar int vertex_indices\nend_header\n"
        text += "\n".join([*rows, *(f"4 {' '.join(map(str, quad))}" for quad in quads.tolist()), ""])
    path.write_text(text)
    return path


@pytest.mark.parametrize("source", [".obj", ".ply", ".off", ".vtk"])
def test_vertices_that_are_nan_and_in_no_face_stay_and_are_told(tmp_path, source):
    file = read_mesh(with_unused_nan(tmp_path / f"nan{source}"))
    filled, report = fill_hole(file, return_report=True)
    assert report.watertight
    told = "3 vertices, first vertex 3, have a NaN or infinite coordinate, but no face uses them"
    assert told in report.notes
    for target in FORMATS:
        notes = filled.write(tmp_path / f"filled{target}")
        again = read_mesh(tmp_path / f"filled{target}")
        assert is_closed(again.mesh if target != ".glb" else again.merged().mesh)
        assert any("NaN" in note for note in notes) == (target in (".glb", ".3mf", ".vtp"))
        if target in (".obj", ".ply", ".off", ".vtk"):
            assert again.mesh.vertices.tobytes() == filled.mesh.vertices.tobytes()
    for merge in (True, 1e-3):
        merged, report = fill_hole(file, merge=merge, return_report=True)
        assert report.watertight
        assert np.array_equal(merged.mesh.vertices[:11], file.mesh.vertices, equal_nan=True)


@pytest.mark.parametrize(
    ("source", "place"), [(".obj", "line 4: "), (".ply", "line 13: "), (".off", "line 6: "), (".vtk", "")]
)
def test_a_vertex_that_is_nan_and_in_a_face_is_refused_with_both(tmp_path, source, place):
    path = with_unused_nan(tmp_path / f"nan{source}")
    file = read_mesh(path)
    corners = np.array(file.polygons.corners)
    corners[9] = 3
    polygons = replace(file.polygons, corners=corners)
    with pytest.raises(
        NonFiniteVertexError, match=rf"^{place}vertex 3 has a NaN .* and is used by face 2; correct it(\n|$)"
    ):
        MeshFile.of_contents(replace(file.contents, polygons=polygons), path=None)


def test_names_that_are_left_out_are_told(tmp_path):
    text = cube_file(tmp_path).read_text()
    (tmp_path / "parts.obj").write_text(text.replace("f ", "o roof\nf ", 1) + "o floor\nf 1 2 3\n")
    file = read_mesh(tmp_path / "parts.obj")
    assert file.left_out(".obj") == ()
    assert "the names of objects and groups are left out" in file.left_out(".ply")
    assert "the names of objects and groups are left out" in file.merged().left_out(".obj")
