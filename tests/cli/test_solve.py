"""`spinor-geom solve`: outputs, exit statuses, and one sentence for bad input."""

from pathlib import Path

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.cli.main import _with_joined_numbers, main
from spinor_geom.mesh.find_loops import find_boundary_loops
from tests.closed import is_watertight
from tests.fill.shapes import circle, obj_text, tube


def write_obj(path, *curves, closed=True):
    lines, first = [], 1
    for curve in curves:
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in curve.tolist()]
        numbers = [*range(first, first + len(curve)), *([first] if closed else [])]
        lines.append("l " + " ".join(map(str, numbers)))
        first += len(curve)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_curves_become_one_film(tmp_path):
    pytest.importorskip("OCP")
    from spinor_geom.adapters.open_cascade import read_shape
    from tests.open_cascade import free_wires, is_valid

    for curves in ([circle(40, bend=0.3)], [circle(40), circle(40, height=0.7)]):
        source = write_obj(tmp_path / "curves.obj", *curves)
        assert main(["solve", str(source), "-o", str(tmp_path / "new" / "film.step")]) == 0
        shape = read_shape(tmp_path / "new" / "film.step")
        assert is_valid(shape)
        assert free_wires(shape)[0] == len(curves)


def test_a_rim_of_a_mesh_is_chosen_by_its_number(tmp_path, capsys):
    pytest.importorskip("OCP")
    source = tmp_path / "tube.obj"
    source.write_text(obj_text(*tube()))
    film = str(tmp_path / "film.brep")
    assert main(["solve", str(source), "-o", film]) == 2
    assert "choose with --loop" in capsys.readouterr().err
    assert main(["solve", str(source), "-o", film, "--loop", "0"]) == 0
    assert main(["solve", str(source), "-o", film, "--loop", "7"]) == 2
    assert "loop 7" in capsys.readouterr().err


def test_a_missed_tolerance_is_status_1(tmp_path, capsys):
    pytest.importorskip("OCP")
    square = np.array([[x, y, (x + y) % 2] for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    source = write_obj(tmp_path / "square.obj", square)
    arguments = ["solve", str(source), "-o", str(tmp_path / "film.step"), "--tolerance", "1e-13", "--deviation", "1e-2"]
    assert main(arguments) == 1
    assert "above the tolerance 1.0e-13" in capsys.readouterr().err


def test_bad_input_is_one_sentence(tmp_path, capsys):
    source = write_obj(tmp_path / "curve.obj", circle(40, bend=0.3))
    assert main(["solve", str(source), "-o", str(tmp_path / "film.txt")]) == 2
    assert "'.txt' is not a CAD format" in capsys.readouterr().err
    pytest.importorskip("OCP")
    film = str(tmp_path / "film.step")
    apart = write_obj(tmp_path / "apart.obj", circle(40), circle(40, height=9))
    opened = write_obj(tmp_path / "open.obj", circle(40), closed=False)
    for path, message in ((opened, "curve 0: the curve is open"), (apart, "solve the curves one by one")):
        assert main(["solve", str(path), "-o", film]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert not Path(film).exists()


def test_a_mesh_or_a_solid_is_written(tmp_path, capsys):
    source = str(write_obj(tmp_path / "curves.obj", circle(40, bend=0.3)))
    film, solid = tmp_path / "film.ply", tmp_path / "solid.stl"
    assert main(["solve", source, "-o", str(film), "--edge-length", "0.05"]) == 0
    assert len(find_boundary_loops(read_mesh(film).mesh)) == 1
    assert main(["solve", source, "-o", str(solid), "--thickness", "0.1", "--edge", "straight"]) == 0
    assert is_watertight(read_mesh(solid).mesh.faces)
    assert main(["solve", source, "-o", str(solid), "--thickness", "8"]) == 1
    assert "choose a smaller --thickness" in capsys.readouterr().err
    for output, options in (("film.stl", ["--unit", "cm"]), ("film.step", ["--thickness", "1"])):
        assert main(["solve", source, "-o", str(tmp_path / output), *options]) == 2


@pytest.mark.parametrize(
    ("given", "joined"),
    [
        (["--loop", "0", "2", "x.obj"], ["--loop", "0,2", "x.obj"]),
        (["--film", "0-3", "5", "7-9"], ["--film", "0-3,5,7-9"]),
        (["--loop", "1", "--", "2"], ["--loop", "1", "--", "2"]),
        (["--time-limit", "1", "2"], ["--time-limit", "1", "2"]),
    ],
)
def test_numbers_of_loops_may_be_apart(given, joined):
    assert _with_joined_numbers(given) == joined


def test_gaps_of_curves_are_closed_up_to_a_share_of_an_edge(tmp_path, capsys):
    ring = circle(40, bend=0.3)
    edge = float(np.linalg.norm(ring[1] - ring[0]))
    for gap, options, status in ((1e-4, [], 0), (1e-2, [], 2), (1e-2, ["--closing", "0.1"], 0)):
        nearly = np.vstack([ring, ring[:1] + np.array([0, 0, gap * edge])])
        source = write_obj(tmp_path / "ring.obj", nearly, closed=False)
        assert main(["solve", str(source), "-o", str(tmp_path / "film.stl"), *options]) == status, gap
    assert "closed over a gap" in capsys.readouterr().err
