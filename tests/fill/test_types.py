"""`fill_hole` of files gives files that can be written; objects are in `tests/adapters/test_objects`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.fill.fill_hole import fill_hole
from tests.closed import is_watertight
from tests.fill.shapes import tube


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
