"""`spinor-geom membrane`: cables and forces of a frame file, and one sentence for bad files."""

import json

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.cli.main import main

SIDES = [{"cable": [[0, 0, 0], [1, 0, 0]], "tension": 1.5}, {"cable": [[1, 0, 0], [1, 1, 0]], "tension": 1.5}]
DIAGONAL = {"symmetric": [[0, 0, 0], [1, -1, 0]]}
HALF = np.arcsin(1 / 3)


def write(path, content):
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.mark.parametrize("suffix", [".obj", ".step"])
def test_half_a_square_has_a_film_and_forces(suffix, tmp_path, capsys):
    if suffix == ".step":
        pytest.importorskip("OCP")
    frame = write(tmp_path / "frame.json", {"edges": [SIDES[1], DIAGONAL, SIDES[0]]})
    film, page = tmp_path / "new" / f"tent{suffix}", tmp_path / "pages" / "tent.html"
    assert main(["membrane", frame, "-o", str(film), "--html", str(page)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["length"] for one in found["cables"]] == pytest.approx([3 * HALF] * 4, abs=1e-8)
    np.testing.assert_allclose(found["total_force"], 0, atol=1e-8)
    assert list(found["edge_forces"]) == ["0", "0.1", "2", "2.1"]
    # two cables pull at each corner along its diagonal
    size = 1.5 * np.sqrt(2) * (np.cos(HALF) + np.sin(HALF))
    forces = [one["force"] for one in found["supports"]]
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), size, rtol=1e-6)
    assert film.stat().st_size
    assert "support 3" in page.read_text()
    if suffix == ".obj":
        assert len(read_mesh(film).mesh.faces)


def test_a_film_without_forces_is_balanced(tmp_path, capsys):
    t = 2 * np.pi * np.arange(24) / 24
    ring = np.column_stack([np.cos(t), np.sin(t), 0 * t]).tolist()
    frame = write(tmp_path / "frame.json", {"edges": [{"ring": ring}]})
    assert main(["membrane", frame, "-o", str(tmp_path / "lid.obj")]) == 0
    assert json.loads(capsys.readouterr().out)["area"] == pytest.approx(np.pi, rel=1e-9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is no JSON file"),
        ("[" * 100_000, "is no JSON file"),
        ('{"edges": [{"cable": [], "tension": 1' + 5000 * "0" + "}]}", "edge 0: 'tension' must be a number"),
        ([], "the only key 'edges'"),
        ('{"edges": [{"tension": 1, "tension": 2}]}', "the key 'tension' is given twice"),
        ({"edges": []}, "two edges or more"),
        ({"edges": [], "unit": "mm"}, "the only key 'edges'"),
        ({"edges": [SIDES[0], {"rope": []}]}, "edge 1: must be an object with one of the keys"),
        ({"edges": [SIDES[0], {**SIDES[1], "tensoin": 1}]}, "edge 1: the key 'tensoin' is unknown"),
        ({"edges": [{**SIDES[0], "tension": "1"}]}, "edge 0: 'tension' must be a number"),
        ({"edges": [{**SIDES[0], "tension": 10**400}]}, "edge 0: 'tension' must be a number"),
        ({"edges": [{**SIDES[0], "tension": -1}]}, "edge 0: tension must be"),
        ({"edges": [{**SIDES[0], "length": 2}]}, "edge 0: a cable has a tension or a length"),
        ({"edges": [SIDES[0], {"fixed": [[1, 0, 0]]}]}, "edge 1: 'fixed' must be two points or more"),
        ({"edges": [SIDES[0], {"fixed": [[1, 0, 0], [1, True, 0]]}]}, "edge 1: 'fixed' must be two points or more"),
        ({"edges": [SIDES[0], {"fixed": [[1, 0, 0], [1, float("nan"), 0]]}]}, "edge 1: 'fixed' must be two points"),
        ({"edges": [SIDES[0], {"fixed": [[1, 0, 0], [1, 0, 0]]}]}, "edge 1: point 0 of"),
        ({"edges": [SIDES[0], {"ring": [[1, 0, 0], [1, 1, 0]]}]}, "edge 1: a loop needs"),
        ({"edges": [*SIDES, {"symmetric": [[0, 0, 0], [0, 0, 0]]}]}, "the normal of plane 0 is 0"),
        ({"edges": [SIDES[0], DIAGONAL]}, "edge 0 ends 1"),
        ({"edges": SIDES}, "edge 1 ends"),
    ],
)
def test_a_bad_frame_is_told(tmp_path, capsys, content, message):
    frame = write(tmp_path / "frame.json", content)
    assert main(["membrane", frame, "-o", str(tmp_path / "tent.obj")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
