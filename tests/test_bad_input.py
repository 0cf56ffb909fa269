"""Every kind of bad input gives a correct result or a typed error that names the element."""

from __future__ import annotations

import re

import numpy as np
import pytest

import spinor_geom
from spinor_geom import gallery
from spinor_geom.cli.main import main
from spinor_geom.errors import (
    ArgumentTypeError,
    DuplicateVertexError,
    ImperfectFillWarning,
    MeshExtentError,
    NoFacesError,
    NonFiniteVertexError,
    SpinorGeomError,
    VertexIndexError,
)
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.render.portrait import Portrait
from tests.fill.shapes import obj_text, soup, tube

Pair = tuple[np.ndarray, np.ndarray]


V, F = tube()


def put(array, place, value):
    """A copy with another entry."""
    changed = array.copy()
    changed[place] = value
    return changed


NAN = put(V, (5, 1), np.nan), F
SOUP = soup((V, F))
REFUSED: dict[str, tuple[Pair, type[SpinorGeomError], str]] = {
    "NaN": (NAN, NonFiniteVertexError, "vertex 5"),
    "index out of range": ((V, put(F, (7, 2), 48)), VertexIndexError, "face 7 has vertex index 48"),
    "soup": (SOUP, DuplicateVertexError, "--merge"),
    "points alone": ((V, np.empty((0, 3), dtype=int)), NoFacesError, "48 vertices but no faces"),
    "far too small": ((1e-150 * V, F), MeshExtentError, "extent of 2.0e-150"),
    "far too large": ((1e100 * V, F), MeshExtentError, "scale the mesh"),
}
BOTH = ["minimal", "minimal"]
UNFIT: dict[str, tuple[Pair, str, list[str]]] = {
    "degenerate": ((V, np.vstack([F, [3, 3, 4]])), "face 64", BOTH),
    "duplicate": ((V, np.vstack([F, F[9, [1, 2, 0]]])), "9, 64", BOTH),
    "flipped": ((V, put(F, 9, F[9, ::-1])), "first face 9", BOTH),
    "three at a rim's edge": (
        (np.vstack([V, [[3.0, 0, 0]]]), np.vstack([F, [F[0, 0], F[0, 2], 48]])),
        r"edge \(17, 0\) has 3 faces, such as",
        [*BOTH, "None"],
    ),
}


@pytest.mark.parametrize(("broken", "error", "words"), REFUSED.values(), ids=REFUSED)
def test_a_broken_mesh_is_refused_by_name(broken, error, words):
    for function in (fill_hole, boundary_loops):
        with pytest.raises(error, match=words):
            function(broken)


@pytest.mark.parametrize(("broken", "words", "kinds"), UNFIT.values(), ids=UNFIT)
def test_faces_that_do_not_fit_at_a_rim_are_reported_with_its_patch(broken, words, kinds):
    _, report = fill_hole(broken, return_report=True)
    assert sorted(map(str, (outcome.kind for outcome in report.loops)), reverse=True) == kinds
    assert any(re.search(words, sentence) for sentence in report.shortcomings), report.shortcomings
    assert not report.watertight
    with pytest.warns(ImperfectFillWarning, match=words):
        fill_hole(broken)


def test_a_rim_in_one_point_is_the_only_shortcoming_reported():
    vertices, faces = tube()
    vertices[:16] = vertices[0]
    _, report = fill_hole((vertices, faces), return_report=True)
    assert sorted(outcome.filled for outcome in report.loops) == [False, True]
    assert any("encloses no area" in sentence for sentence in report.shortcomings)


@pytest.mark.parametrize("scale", [1e-65, 1e-12, 1e12, 1e65])
def test_the_unit_of_length_does_not_matter(scale):
    vertices, faces = tube()
    reports = [fill_hole((vertices * unit, faces), return_report=True)[1] for unit in (1.0, scale)]
    assert all(report.complete and report.watertight and report.intersection_free for report in reports)
    own, scaled = ([outcome.solution.area for outcome in report.loops] for report in reports)
    assert np.array(scaled) / scale**2 == pytest.approx(own, rel=1e-12)


def write(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


BAD_FILES: list[tuple[str, str | bytes]] = [
    ("missing.obj", ""),
    ("garbage.glb", b"glTF\xff\xff"),
    ("broken.obj", "v 0 0 zero\nf 1 2 3\n"),
    ("curve.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\n"),
    ("nan.obj", obj_text(*NAN)),
    ("soup.obj", obj_text(*SOUP)),
    ("points.obj", "v 0 0 0\n"),
]


@pytest.mark.parametrize(("name", "content"), BAD_FILES)
@pytest.mark.parametrize("command", ["fill", "loops"])
def test_a_bad_file_gives_one_sentence_and_status_2(tmp_path, capsys, command, name, content):
    path = tmp_path / name if name.startswith("missing") else write(tmp_path / name, content)
    output = tmp_path / "out" / "filled.obj"
    status = main([command, str(path), *(["-o", str(output)] if command == "fill" else [])])
    printed = capsys.readouterr()
    assert status == 2
    assert printed.out == ""
    assert printed.err.startswith("spinor-geom: ")
    assert printed.err.count("\n") == 1
    assert "Traceback" not in printed.err
    assert not output.parent.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fill"], "IN"),
        (["fill", "mesh.obj"], "--output"),
        (["fill", "mesh.obj", "-o", "o.obj", "--loop", "first"], "not a list of numbers"),
        (["fill", "mesh.obj", "-o", "o.obj", "--loop=-1"], "numbered from 0"),
        (["fill", "mesh.obj", "-o", "o.obj", "--tolerance", "0"], "not a positive number"),
        (["fill", "mesh.obj", "-o", "o.obj", "--edge-length", "nan"], "not a positive number"),
        (["fill", "mesh.obj", "-o", "o.obj", "--max-perimeter", "long"], "not a positive number"),
        (["render", "mesh.obj", "-o", "o.png", "--size", "100000x100000"], "not a size"),
        (["render", "mesh.obj", "-o", "o.png", "--eye=0,0,0"], "--eye"),
        (["render", "mesh.obj", "-o", "o.png", "--up=x"], "--up"),
        (["loops", "mesh.obj", "--merge=nan"], "not a number of at least 0"),
        (["batch", "mesh.obj", "-o", "out", "--workers", "0"], "--workers"),
        (["batch", "mesh.obj", "-o", "out", "--memory-limit", "4X"], "--memory-limit"),
        (["mend", "mesh.obj"], "invalid choice"),
        ([], "COMMAND"),
    ],
)
def test_bad_arguments_are_explained(capsys, arguments, words):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--report", "--html", "--picture"])
@pytest.mark.parametrize("name", ["tube.obj", "o.obj"])
def test_a_file_named_twice_is_kept(tmp_path, capsys, option, name):
    path = write(tmp_path / "tube.obj", obj_text(*tube()))
    assert main(["fill", str(path), "-o", str(tmp_path / "o.obj"), option, str(tmp_path / "x" / ".." / name)]) == 2
    assert f"{name} is given twice" in capsys.readouterr().err
    assert path.read_text() == obj_text(*tube())
    if option == "--picture":
        assert main(["loops", str(path), option, str(path)]) == 2
    assert main(["fill", str(path), "-o", str(path)]) == 0
    assert boundary_loops(path) == []


LOOP = gallery.tennis_seam(0.8).sample(24)
WRONG_TYPES = {
    "mesh_patch of a loop": lambda: spinor_geom.mesh_patch(LOOP),
    "mesh_patch of a surface": lambda: spinor_geom.mesh_patch(spinor_geom.solve_plateau(LOOP).surface),
    "report of a mesh": lambda: spinor_geom.report((np.eye(3), np.array([[0, 1, 2]]))),
    "Portrait of a number": lambda: Portrait.of(3),
    "read_mesh of an array": lambda: spinor_geom.read_mesh(np.eye(3)),
}


@pytest.mark.parametrize("call", WRONG_TYPES.values(), ids=WRONG_TYPES)
def test_wrong_argument_types_are_refused_with_the_right_ones(call):
    with pytest.raises(ArgumentTypeError, match=r"takes .*, not "):
        call()
