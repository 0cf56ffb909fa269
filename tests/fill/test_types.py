"""`fill_hole` of files gives files that can be written; objects are in `tests/adapters/test_objects`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from spinor_geom.adapters import MeshFile, read_mesh, to_mesh
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.topology import is_watertight
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
