"""`fill_hole` returns the type that it was given: arrays, tensors, trimesh, pymeshlab, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymeshlab
import pytest
import torch
import trimesh

from spinor_geom.adapters import MeshFile, read_mesh, to_mesh
from spinor_geom.errors import UnknownMeshTypeError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import tube


def require_filled_tube(filled: object) -> None:
    """The tube's own 48 vertices and 64 faces first, unchanged; closed."""
    vertices, faces = tube()
    mesh = to_mesh(filled)
    np.testing.assert_allclose(mesh.vertices[:48], vertices, atol=1e-7)  # float32 in some formats
    np.testing.assert_array_equal(mesh.faces[:64], faces)
    assert len(mesh.vertices) > 48
    assert is_watertight(mesh.faces)
    assert boundary_loops(filled) == []


@pytest.mark.parametrize("container", [tuple, list])
@pytest.mark.parametrize(("real", "integer"), [(np.float64, np.int64), (np.float32, np.int32)])
def test_array_pairs_keep_their_dtypes(container: type, real: type, integer: type) -> None:
    vertices, faces = tube()
    given = container((vertices.astype(real), faces.astype(integer)))
    filled = fill_hole(given)
    assert type(filled) is container
    assert (filled[0].dtype, filled[1].dtype) == (real, integer)
    np.testing.assert_array_equal(filled[0][:48], given[0])
    require_filled_tube(filled)


def test_tensors_keep_their_dtypes() -> None:
    vertices, faces = tube()
    filled = fill_hole((torch.from_numpy(vertices).float(), torch.from_numpy(faces)))
    assert isinstance(filled[0], torch.Tensor)
    assert (filled[0].dtype, filled[1].dtype) == (torch.float32, torch.int64)
    require_filled_tube(filled)


def test_a_triangle_mesh_stays_one() -> None:
    filled = fill_hole(TriangleMesh(*tube()))
    assert isinstance(filled, TriangleMesh)
    require_filled_tube(filled)


def test_a_trimesh_keeps_its_colours_and_gets_new_ones() -> None:
    vertices, faces = tube()
    colors = np.column_stack([np.full((48, 3), (200, 100, 50)), np.full(48, 255)]).astype(np.uint8)
    given = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    filled = fill_hole(given)
    assert isinstance(filled, trimesh.Trimesh)
    assert filled.is_watertight
    # harmonic interpolation of one colour is that colour
    np.testing.assert_array_equal(filled.visual.vertex_colors, np.tile(colors[:1], (len(filled.vertices), 1)))
    assert len(given.vertices) == 48
    require_filled_tube(filled)


def test_a_mesh_set_gives_a_new_mesh_set() -> None:
    pymeshlab = pytest.importorskip("pymeshlab")
    vertices, faces = tube()
    given = pymeshlab.MeshSet(verbose=False)
    given.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)), "tube")
    filled = fill_hole(given)
    assert isinstance(filled, pymeshlab.MeshSet)
    assert given.current_mesh().face_number() == 64
    require_filled_tube(filled)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".glb"])
@pytest.mark.parametrize("kind", [str, Path])
def test_a_path_gives_a_mesh_file_that_can_be_written(tmp_path: Path, suffix: str, kind: type) -> None:
    source, target = tmp_path / f"tube{suffix}", tmp_path / f"filled{suffix}"
    trimesh.Trimesh(*tube(), process=False).export(source)
    before = source.read_bytes()
    filled = fill_hole(kind(source))
    assert isinstance(filled, MeshFile)
    require_filled_tube(filled)
    filled.write(target)
    require_filled_tube(read_mesh(target))
    assert source.read_bytes() == before


def test_quads_of_a_file_stay_quads(tmp_path: Path) -> None:
    vertices, _ = tube(8, 2)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    quads = [f"f {k + 1} {(k + 1) % 8 + 1} {(k + 1) % 8 + 9} {k + 9}" for k in range(8)]
    path = tmp_path / "quads.obj"
    path.write_text("\n".join([*lines, *quads]) + "\n")
    filled, report = fill_hole(path, return_report=True)
    assert report.watertight
    filled.write(tmp_path / "filled.obj")
    text = (tmp_path / "filled.obj").read_text()
    assert text.startswith(path.read_text())
    assert [len(line.split()) for line in text.splitlines() if line.startswith("f ")][:9] == [5] * 8 + [4]


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_an_stl_path_is_merged_filled_and_written_back(tmp_path: Path, kind: str) -> None:
    vertices, faces = tube()
    needle = np.array([[3, 3, 4]])
    corners = vertices[np.vstack([faces, needle])].astype(np.float32)
    if kind == "text":
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in facet)
            + "endloop\nendfacet\n"
            for facet in corners.tolist()
        )
        (tmp_path / "a.stl").write_text(f"solid a\n{facets}endsolid a\n")
    else:
        records = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")])
        records["corners"] = corners
        (tmp_path / "a.stl").write_bytes(b"\0" * 80 + np.uint32(len(corners)).tobytes() + records.tobytes())
    filled, report = fill_hole(str(tmp_path / "a.stl"), return_report=True)
    assert report.watertight
    assert [note.rpartition(" ")[2] for note in report.notes] == [str(len(vertices)), "1"]
    assert report.to_dict()["notes"] == list(report.notes)
    filled.write(tmp_path / "b.stl")
    assert (tmp_path / "b.stl").read_bytes().startswith(b"solid") == (kind == "text")
    back = read_mesh(tmp_path / "b.stl")
    assert np.array_equal(back.mesh.vertices[back.mesh.faces[: len(faces)]], corners[:-1])
    assert is_watertight(back.mesh.faces)


@pytest.mark.parametrize("kind", ["trimesh", "ply", "TriangleMesh"])
def test_integer_labels_stay_classes_that_exist(tmp_path: Path, kind: str) -> None:
    vertices, faces = tube()
    labels = np.where(vertices[:, 0] > 0, 10, 3)
    mesh: object = TriangleMesh(vertices, faces, vertex_attributes={"label": labels})
    if kind == "trimesh":
        mesh = trimesh.Trimesh(vertices, faces, process=False, vertex_attributes={"label": labels})
    if kind == "ply":
        lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *(f"property double {x}" for x in "xyz")]
        lines += ["property int label", f"element face {len(faces)}", "property list uchar int vertex_indices"]
        lines += ["end_header", *(f"{x} {y} {z} {n}" for (x, y, z), n in zip(vertices.tolist(), labels, strict=True))]
        lines += [f"3 {a} {b} {c}" for a, b, c in faces]
        (tmp_path / "labels.ply").write_text("\n".join([*lines, ""]))
        mesh = tmp_path / "labels.ply"
    filled = fill_hole(mesh)
    found = to_mesh(filled).vertex_attributes["label"][:, 0]
    assert len(found) > len(vertices)
    np.testing.assert_array_equal(found[: len(labels)], labels)
    assert set(found) == {3.0, 10.0}
    assert to_mesh(filled).labels == {"label"}


def test_a_point_cloud_is_refused_with_advice() -> None:
    with pytest.raises(UnknownMeshTypeError, match=r"PointCloud .* reconstruct faces first"):
        fill_hole(trimesh.PointCloud(tube()[0]))


def test_the_other_meshes_of_a_set_stay() -> None:
    vertices, faces = tube()
    meshes = pymeshlab.MeshSet()
    for k, name in enumerate("abc"):
        meshes.add_mesh(pymeshlab.Mesh(vertices + 9 * k, faces), name)
    meshes.set_current_mesh(1)
    filled = fill_hole(meshes)
    assert filled.mesh_number() == 3
    assert filled.current_mesh().label() == "b"
    assert filled.current_mesh().face_number() > len(faces)
    others = {mesh.label(): mesh.face_number() for mesh in filled if mesh.label() != "b"}
    assert others == {"a": len(faces), "c": len(faces)}
