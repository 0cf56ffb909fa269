"""The commands, run in this process: results, exit statuses, and what is printed."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.bench.holes import plane_square
from spinor_geom.cli import console
from spinor_geom.cli.main import build_parser, main
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.plateau.annulus import RimDisks
from tests.fill.shapes import collar, cylinder, figure_eight, obj_text, soup, spiked_tetrahedron, spokes, together, tube
from tests.fill.test_bridge import inner_rims, ring
from tests.render.test_viewer import data_of
from tests.systems import modes, undecodable


def write_obj(path, vertices, faces):
    path.write_text(obj_text(vertices, faces))
    return path


@pytest.fixture
def mesh_path(tmp_path):
    return write_obj(tmp_path / "tube.obj", *tube())


@pytest.fixture
def spiked_path(tmp_path):
    """The loop 0 is the hole that a spike pokes through, loop 1 the spike's own outline."""
    return write_obj(tmp_path / "spiked.obj", *spiked_tetrahedron())


class Terminal(io.StringIO):
    """A stream whose `isatty` is true."""

    def isatty(self):
        return True


def on_terminal(arguments):
    """The exit status of a command on a terminal, and its output there."""
    with contextlib.redirect_stdout(Terminal()) as terminal:
        status = main(arguments)
    return status, terminal.getvalue()


def test_fill_writes_a_mesh_and_a_report(mesh_path, tmp_path, capsys):
    output, report = tmp_path / "new" / "filled.ply", tmp_path / "new" / "report.json"
    assert main(["fill", str(mesh_path), "-o", str(output), "--report", str(report)]) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    *lines, counts = printed.err.splitlines()
    assert [line.partition(":")[2][:8] for line in lines] == [" loop 0 ", " loop 1 "]
    assert all("minimal" in line and "area" in line for line in lines)
    assert "2 of 2 loops filled" in counts
    assert boundary_loops(output) == []
    assert main(["fill", str(mesh_path), "-o", str(output), "--quiet"]) == 0
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", "")
    entry = json.loads(report.read_text())
    assert entry["complete"] is True
    assert entry["watertight"] is True
    assert entry["input"] == str(mesh_path)
    assert entry["output"] == str(output)
    assert [loop["filled"] for loop in entry["loops"]] == [True, True]
    assert sorted(path.name for path in output.parent.iterdir()) == ["filled.ply", "report.json"]


def test_surfaces_to_compare_with_are_solved_for_reports_only(tmp_path, monkeypatch):
    monkeypatch.setattr(RimDisks, "partitions", property(lambda self: pytest.fail("solved")))
    rings = together(ring(1.0, 1.5), ring(1.0, 1.5, height=0.5, down=True))
    path, loops = write_obj(tmp_path / "rings.obj", *rings), map(str, inner_rims(rings))
    arguments = ["fill", str(path), "--bridge", *loops, "-o", str(tmp_path / "out.ply")]
    assert on_terminal(arguments)[0] == 0
    with pytest.raises(pytest.fail.Exception, match="solved"):
        main([*arguments, "--report", str(tmp_path / "report.json")])


@pytest.mark.parametrize("choice", [["--loop", "1"], ["--keep-largest"], ["--max-perimeter", "6"]])
def test_a_choice_of_loops_leaves_others_open_with_status_0(mesh_path, tmp_path, choice):
    output, report = tmp_path / "filled.obj", tmp_path / "report.json"
    assert main(["fill", str(mesh_path), "-o", str(output), "--report", str(report), *choice]) == 0
    (left,) = boundary_loops(output)
    assert set(left.vertex_ids) == set(range(16))
    first, second = json.loads(report.read_text())["loops"]
    assert (first["requested"], first["filled"]) == (False, False)
    assert "not requested" in first["reason"]
    assert second["filled"]


@pytest.mark.parametrize(
    ("options", "kinds"),
    [
        (["--film", "0", "--smooth", "1"], ["minimal", "smooth"]),
        (["--smooth", "0"], ["smooth", None]),
        (["--smooth", "0", "--loop", "1"], ["smooth", "minimal"]),
        (["--continuity", "Smooth", "--film", "1"], ["smooth", "minimal"]),
    ],
)
def test_each_has_its_continuity(mesh_path, tmp_path, options, kinds):
    report = tmp_path / "report.json"
    assert main(["fill", str(mesh_path), "-o", str(tmp_path / "f.obj"), "--report", str(report), *options]) == 0
    assert [loop["kind"] for loop in json.loads(report.read_text())["loops"]] == kinds


def test_a_missed_tolerance_gives_status_1_if_strict(mesh_path, tmp_path, capsys):
    output = tmp_path / "filled.obj"
    for strict in (False, True):
        arguments = ["fill", str(mesh_path), "-o", str(output), "--loop", "0", "--tolerance", "1e-16"]
        assert main([*arguments, *(["--strict"] * strict)]) == int(strict)
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("is not within the tolerance") == 1
        assert len(boundary_loops(output)) == 1


def test_loops_left_open_give_status_1_and_borders_0(tmp_path, capsys):
    vertices, faces = tube()
    lone = write_obj(tmp_path / "lone.obj", np.vstack([vertices, np.eye(3) + 4]), np.vstack([faces, [48, 49, 50]]))
    assert main(["fill", str(lone), "-o", str(tmp_path / "filled.obj")]) == 1
    assert "(3 vertices) was left open: the loop is the outline of face 64" in capsys.readouterr().err
    sheet = write_obj(tmp_path / "sheet.obj", *ring(1.0, 1.5))
    assert main(["fill", str(sheet), "-o", str(tmp_path / "filled.obj")]) == 0
    assert "loop 0 (24 vertices) was left open: it is the border of a sheet" in capsys.readouterr().err
    assert len(boundary_loops(tmp_path / "filled.obj")) == 1
    assert main(["fill", str(sheet), "-o", str(tmp_path / "filled.obj"), "--loop", "0,1"]) == 1
    assert "the patch crosses" in capsys.readouterr().err
    assert boundary_loops(tmp_path / "filled.obj") == []


def test_a_patch_that_crosses_the_mesh_gives_status_1(spiked_path, tmp_path, capsys):
    output, report = tmp_path / "filled.obj", tmp_path / "report.json"
    arguments = ["fill", str(spiked_path), "-o", str(output), "--loop", "0", "--report", str(report)]
    assert main(arguments) == 1
    printed = capsys.readouterr().err
    assert printed.startswith(
        "spinor-geom: loop 0 (3 vertices): the patch crosses the mesh in 1 pair of faces, first (4, 3)"
    )
    assert len(printed.splitlines()) == 2  # and the counts
    assert len(boundary_loops(output)) == 1
    entry = json.loads(report.read_text())
    assert (entry["complete"], entry["intersection_free"]) == (True, False)
    assert entry["loops"][0]["mesh_intersections"] == 1


def test_a_loop_that_crosses_itself_is_named_and_listed(tmp_path, capsys, monkeypatch):
    path = write_obj(tmp_path / "eight.obj", *collar(figure_eight(16, 0.5), np.array([0, 0, 0.3])))
    assert main(["fill", str(path), "-o", str(tmp_path / "filled.obj")]) == 1
    printed = capsys.readouterr().err
    assert "loop 0 (16 vertices) is closed by a discrete surface" in printed
    assert "the loop crosses or touches itself: its edges" in printed
    assert main(["loops", str(path)]) == 0
    assert capsys.readouterr().out.count("crosses or touches itself in 1 pair of edges") == 2
    assert main(["loops", str(path), "--json", "--html", str(tmp_path / "loops.html")]) == 0
    assert "<h1>Boundary loops of eight.obj</h1>" in (tmp_path / "loops.html").read_text(encoding="utf-8")
    entries = json.loads(capsys.readouterr().out)
    assert [(entry["crossings"], entry["all_crossings_counted"]) for entry in entries] == [(1, True), (1, True)]
    monkeypatch.setattr("spinor_geom.cli.loops._SECONDS_TO_COUNT", -1)
    assert main(["loops", str(path)]) == 0
    assert capsys.readouterr().out.count("its crossings were not counted") == 2
    assert main(["loops", str(path), "--json"]) == 0
    entry = json.loads(capsys.readouterr().out)[0]
    assert (entry["crossings"], entry["all_crossings_counted"]) == (None, False)


def test_crossings_that_were_not_all_counted_are_told_so(tmp_path, capsys):
    points = np.random.default_rng(0).normal(size=(2000, 3)) * [1, 1, 0]
    path, page = tmp_path / "tangle.obj", tmp_path / "loops.html"
    lines = [f"v {x} {y} {z}\n" for x, y, z in points]
    path.write_text("".join([*lines, f"f {' '.join(map(str, range(1, 2001)))}\n"]))
    assert main(["loops", str(path), "--html", str(page)]) == 0
    for text in (capsys.readouterr().out, page.read_text(encoding="utf-8")):
        assert re.search(r"crosses or touches itself in at least \d{6} pairs of edges", text)
    assert main(["loops", str(path), "--json"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)
    assert (entry["crossings"] >= 100_000, entry["all_crossings_counted"]) == (True, False)


def test_merge_closes_a_soup(tmp_path, capsys):
    path, output = str(write_obj(tmp_path / "soup.obj", *soup(tube()))), tmp_path / "filled.obj"
    assert main(["fill", path, "-o", str(output)]) == 2
    assert "--merge" in capsys.readouterr().err
    assert main(["fill", path, "-o", str(output), "--merge"]) == 0
    assert boundary_loops(output) == []
    assert main(["loops", path, "--merge"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3


MERGES = {
    **dict.fromkeys(("--merge in.obj", "in.obj --merge", "--merge --json in.obj", "--merge -- in.obj"), True),
    **dict.fromkeys(("--merge 1e-6 in.obj", "in.obj --merge 1e-6", "--merge=1e-6 in.obj"), 1e-6),
    **dict.fromkeys(("in.obj", "-- in.obj"), False),
    **{"--mer in.obj": True, "--merge 0 in.obj": 0.0},
}


@pytest.mark.parametrize("text", MERGES)
@pytest.mark.parametrize("command", ["loops", "fill -o out.obj"])
def test_merge_takes_numbers_only(command, text):
    words = [*command.split(), *text.split()]
    if command != "loops":
        words = [word for word in words if word != "--json"]
    arguments = build_parser().parse_args(words)
    assert arguments.input == Path("in.obj")
    assert arguments.merge == MERGES[text]
    assert isinstance(arguments.merge, type(MERGES[text]))


@pytest.mark.parametrize("folder", [".", "..", "2026.11.28"])
def test_merge_takes_no_folder_of_dots_and_digits_for_a_number(folder):
    arguments = build_parser().parse_args(["batch", "--merge", folder, "-o", "out"])
    assert (arguments.merge, arguments.inputs) == (True, [folder])


@pytest.mark.parametrize(("columns", "continuity"), [(30, "C0"), (50, "C0"), (80, "C0"), (80, "C1")])
def test_a_narrow_table_of_a_fill_has_whole_numbers(columns, continuity, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    vertices, faces = tube()
    far = write_obj(tmp_path / "far.obj", 1234.5 * vertices, faces)
    _, text = on_terminal(["fill", str(far), "-o", str(tmp_path / "filled.obj"), "--continuity", continuity])
    plain = re.sub(r"\x1b\[[\d;]*m", "", text)
    assert "…" not in plain
    loops = fill_hole(far, continuity=continuity, return_report=True)[1].loops
    assert all(f"{outcome.area:.4g}" in plain.split() for outcome in loops)
    if columns == 80:
        header = next(line.split() for line in plain.splitlines() if "loop" in line)
        assert {"loop", "kind", "area", "faces"} <= set(header)
        assert max(map(len, plain.splitlines())) <= 80


def test_loops_piped_or_as_json_are_boundary_loops(mesh_path, capsys):
    assert main(["loops", str(mesh_path)]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split("\t")[:3] == ["loop", "points", "perimeter"]
    assert [row.split("\t")[:2] for row in rows] == [["0", "16"], ["1", "16"]]
    assert main(["loops", str(mesh_path), "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)
    for entry, loop in zip(entries, boundary_loops(mesh_path), strict=True):
        assert entry["vertex_ids"] == loop.vertex_ids.tolist()
        assert entry["perimeter"] == loop.perimeter


def test_borders_of_sheets_are_named(tmp_path, capsys):
    path = write_obj(tmp_path / "sheet.obj", *plane_square(6))
    assert main(["loops", str(path)]) == 0
    assert "border of a sheet, left open unless named" in capsys.readouterr().out
    assert main(["loops", str(path), "--json"]) == 0
    assert [entry["border"] for entry in json.loads(capsys.readouterr().out)] == [True]


def test_a_closed_mesh_has_no_loops(mesh_path, tmp_path, capsys):
    closed = tmp_path / "closed.obj"
    assert main(["fill", str(mesh_path), "-o", str(closed)]) == 0
    assert main(["loops", str(closed)]) == 0
    assert "closed" in capsys.readouterr().out
    assert main(["fill", str(closed), "-o", str(tmp_path / "again.obj")]) == 0
    assert (tmp_path / "again.obj").read_text() == closed.read_text()


def test_the_table_is_coloured_where_the_terminal_has_colours(mesh_path, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm-256color")
    for options, green, yellow in (([], 2, 0), (["--tolerance", "1e-16"], 0, 2), (["--loop", "1"], 1, 0)):
        _, text = on_terminal(["fill", str(mesh_path), "-o", str(tmp_path / "filled.obj"), *options])
        assert (text.count("\x1b[32mminimal"), text.count("\x1b[33mminimal")) == (green, yellow)
    assert "\x1b[2mleft open" in text
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[32m" not in on_terminal(["fill", str(mesh_path), "-o", str(tmp_path / "filled.obj")])[1]


def test_cells_are_no_markup():
    with contextlib.redirect_stdout(Terminal()) as terminal:
        console.show_table(["remark"], [["[red]a[/red]"]], piped=True)
    assert "[red]a[/red]" in terminal.getvalue()


def test_progress_is_drawn_on_a_terminal_only(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    for stream, drawn in ((Terminal(), True), (io.StringIO(), False)):
        with contextlib.redirect_stderr(stream), console.progress("filling") as bar:
            bar(1, 2)
            bar.stage("loop 1: mesh")
        assert ("filling loop 1: mesh" in stream.getvalue()) is drawn


PROGRAM = "import sys; from spinor_geom.cli.main import main; sys.exit(main(sys.argv[1:]))"


def run_alone(*arguments, stdout):
    """Runs a command in a new process."""
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=120, check=False)


@pytest.mark.parametrize("command", ["loops", "--help"])
def test_a_reader_that_stops_early_is_no_error(command, mesh_path):
    reading, writing = os.pipe()
    os.close(reading)
    done = run_alone(command, *[mesh_path][: command == "loops"], stdout=writing)
    os.close(writing)
    assert (done.stderr, done.returncode) == ("", 0)


class Refusing(io.StringIO):
    """Standard output to which nothing can be written. Its descriptor is that of a file."""

    def __init__(self, code, descriptor):
        super().__init__()
        self.code, self.descriptor = code, descriptor

    def write(self, text):
        raise OSError(self.code, os.strerror(self.code))

    def fileno(self):
        return self.descriptor


@pytest.mark.parametrize(
    ("code", "status", "message"),
    [
        (errno.EPIPE, 1, ""),  # one loop is left open, whoever reads
        (errno.EINVAL, 1, ""),  # a closed pipe on Windows
        (errno.ENOSPC, 2, "standard output: No space left"),
    ],
)
def test_output_that_is_not_taken_costs_no_file(code, status, message, spiked_path, tmp_path, monkeypatch, capsys):
    files = [tmp_path / name for name in ("f.obj", "r.json", "p.html")]
    filled = ["fill", str(spiked_path), "-o", str(files[0]), "--loop", "0", "--compare"]
    filled += ["--report", str(files[1]), "--html", str(files[2])]
    with (tmp_path / "stream").open("w") as file:
        monkeypatch.setattr(sys, "stdout", Refusing(code, file.fileno()))
        assert main(filled) == status
        monkeypatch.undo()
    assert all(path.stat().st_size for path in files)
    errors = capsys.readouterr().err
    assert ("standard output" in errors, message in errors) == (bool(message), True)


@modes
@pytest.mark.parametrize("command", ["fill", "loops"])
def test_streams_that_the_shell_closed_are_no_error_and_no_file_gets_the_output(command, mesh_path, tmp_path):
    filled = tmp_path / "filled.obj"
    arguments = {"fill": ["fill", mesh_path, "-o", filled, "--quiet"], "loops": ["loops", mesh_path]}[command]
    shell = ["sh", "-c", '"$@" <&- >&-', "sh", sys.executable, "-c", PROGRAM, *map(str, arguments)]
    done = subprocess.run(shell, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
    assert (done.stderr, done.returncode) == ("", 0)
    assert command != "fill" or read_mesh(filled).mesh.faces.max() < len(read_mesh(filled).mesh.vertices)


@undecodable
def test_names_that_are_no_text_and_terminals_without_our_characters_show_question_marks(
    mesh_path, tmp_path, monkeypatch
):
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    with pytest.raises(SystemExit, match="0"):
        main(["fill", "--help"])
    assert b"N[,N?]" in sys.stdout.buffer.getvalue()
    named = mesh_path.rename(tmp_path / os.fsdecode(b"\xff tube.obj"))
    page, turned = tmp_path / "page.html", tmp_path / os.fsdecode(b"\xff.html")
    assert main(["fill", str(named), "-o", str(tmp_path / "filled.obj"), "--html", str(page), "--quiet"]) == 0
    assert "? tube.obj" in page.read_text("utf-8")
    assert main(["morph", "catenoid", "-o", str(turned)]) == 0


@pytest.mark.parametrize("message", ["", "Unable to allocate 24.0 GiB"])
def test_too_little_memory_is_one_sentence_and_status_2(mesh_path, capsys, monkeypatch, message):
    def fails(*_, **__):
        raise MemoryError(message)

    monkeypatch.setattr("spinor_geom.cli.loops.Filling", fails)
    assert main(["loops", str(mesh_path)]) == 2
    assert capsys.readouterr().err == f"spinor-geom: {message or 'there is not enough memory'}\n"


SIZES = {"512M": 512 << 20, "4GiB": 4 << 30, "1.5g": 3 << 29, "700kb": 700 << 10, "9": 9}


@pytest.mark.parametrize(("text", "size"), SIZES.items())
def test_sizes_may_have_units(text, size):
    arguments = build_parser().parse_args(["batch", "a.obj", "-o", "out", "--memory-limit", text])
    assert arguments.memory_limit == size


def test_compare_prints_and_writes_a_page(mesh_path, tmp_path, capsys):
    page = tmp_path / "new" / "comparison.html"
    assert main(["compare", str(mesh_path), "--json", "-o", str(page)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert list(figures) == ["loop 0", "loop 1"]
    assert figures["loop 0"]["patch_to_surface"]["mean"] < figures["loop 0"]["baseline_to_surface"]["mean"] + 1e-6
    text = page.read_text()
    assert "<h2>loop 1</h2>" in text
    assert "distance to the exact surface" in json.dumps(data_of(text)["views"])


def test_compare_takes_a_mesh_of_a_loop(mesh_path, tmp_path, capsys):
    mine = write_obj(tmp_path / "mine.obj", *spokes(boundary_loops(mesh_path)[1].points))
    command = ["compare", str(mesh_path), "--with", str(mine)]
    assert main([*command, "--loop", "1"]) == 0
    assert "given mesh" in capsys.readouterr().out
    cases = ([], "--loop"), (["--loop", "0"], "another boundary than the surface"), (["--loop", "7"], "does not exist")
    for wrong, message in cases:
        assert main([*command, *wrong]) == 2
        assert message in capsys.readouterr().err
    assert main(["compare", str(mesh_path), "-o", str(mesh_path)]) == 2  # the input is kept


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        (["fill", "in.obj", "-o", "out.obj", "--tolerence=1e-4"], "--tolerance"),
        (["batch", "in.obj", "-o", "out", "--worker-s", "2"], "--workers"),
        (["compair", "in.obj"], "compare"),
        (["fill", "in.obj", "-o", "out.obj", "--zzz"], None),
        (["fill", "in.obj", "-o", "out.obj", "--islands", "joined"], "join"),
    ],
)
def test_a_near_option_is_suggested(line, meant, capsys):
    with pytest.raises(SystemExit) as ended:
        main(line)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert f"did you mean {meant}" in error if meant else "did you mean" not in error


@pytest.mark.parametrize(
    ("writer", "error"),
    [
        ("png.atomic_path", KeyboardInterrupt()),
        ("report.write_text", OSError(28, "No space left on device")),
        ("files._replace", KeyboardInterrupt()),
    ],
)
@pytest.mark.usefixtures("drawn_by_one_process")
def test_an_interrupted_fill_changes_none_of_its_files(mesh_path, tmp_path, monkeypatch, writer, error):
    pytest.importorskip("pyvista")
    outputs = {"-o": "out.obj", "--report": "out.json", "--picture": "out.png", "--html": "out.html"}
    for name in list(outputs.values())[::2]:
        (tmp_path / name).write_text("old")

    def failing(*_):
        raise error

    module, name = writer.split(".")
    package = {"fill": "cli.", "files": ""}.get(module, "render.")
    monkeypatch.setattr(f"spinor_geom.{package}{module}.{name}", failing)
    arguments = [word for option, name in outputs.items() for word in (option, str(tmp_path / name))]
    expected = 130 if isinstance(error, KeyboardInterrupt) else 2
    assert main(["fill", str(mesh_path), *arguments]) == expected
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path != mesh_path}
    assert left == {"out.obj": b"old", "out.png": b"old"}


def test_links_in_a_circle_are_one_sentence_as_input_and_replaced_as_output(mesh_path, tmp_path, capsys):
    link = tmp_path / "circle.obj"
    link.symlink_to(link)
    assert main(["fill", str(link), "-o", str(tmp_path / "out.obj")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    assert main(["fill", str(mesh_path), "-o", str(link), "--report", str(tmp_path / "report.json")]) == 0
    assert link.is_file()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are made by POSIX systems")
@pytest.mark.parametrize(
    ("command", "name", "output"),
    [
        ("fill", "mesh.obj", "out.obj"),
        ("loops", "mesh.ply", ""),
        ("solve", "curve.obj", "out.step"),
        ("membrane", "frame.json", "out.obj"),
        ("render", "surface.safetensors", "out.png"),
        ("batch", "list.csv", "out"),
    ],
)
def test_pipes_without_a_writer_and_devices_are_refused_at_once(command, name, output, tmp_path):
    os.mkfifo(tmp_path / name)
    (tmp_path / "device").mkdir()
    os.symlink("/dev/zero", tmp_path / "device" / name)
    for source in (tmp_path / name, tmp_path / "device" / name):
        done = run_alone(
            command, source, *(["-o", source.with_name(output)] if output else []), stdout=subprocess.DEVNULL
        )
        if command == "batch":  # one input of several
            assert done.returncode == 1
            assert "not a regular file" in (source.with_name(output) / "failures.log").read_text()
        else:
            assert (done.returncode, done.stderr.count("\n")) == (2, 1)
            assert "not a regular file" in done.stderr


def test_a_terminated_fill_leaves_no_temporary_files(mesh_path, tmp_path):
    (tmp_path / "out.obj").write_text("old")
    program = """if True:
        import os, signal, sys
        from spinor_geom import files
        from spinor_geom.cli.main import main
        files._replace = lambda _: os.kill(os.getpid(), signal.SIGTERM)
        sys.exit(main())
    """
    command = [sys.executable, "-c", program, "fill", str(mesh_path), "-o", str(tmp_path / "out.obj")]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (130, "spinor-geom: interrupted\n")
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path != mesh_path}
    assert left == {"out.obj": b"old"}


def test_many_loops_are_counts_and_exceptions(tmp_path, capsys):
    vertices, faces = tube()
    copies = 11
    many = np.concatenate([vertices + np.array([10 * k, 0, 0]) for k in range(copies)])
    mesh = write_obj(tmp_path / "tubes.obj", many, np.concatenate([faces + k * len(vertices) for k in range(copies)]))
    assert main(["fill", str(mesh), "-o", str(tmp_path / "filled.obj")]) == 0
    (counts,) = capsys.readouterr().err.splitlines()
    assert "22 of 22 loops filled" in counts


def test_warnings_that_differ_by_numbers_are_one_line(tmp_path, capsys):
    vertices, faces = tube()
    faces[0] = faces[0, ::-1]  # at one end
    tubes = np.concatenate([vertices + np.array([10 * k, 0, 0]) for k in range(12)])
    lone = np.array([[0, 50, 0], [1, 50, 0], [0, 51, 0]])
    many = np.concatenate([tubes, *(lone + np.array([5 * k, 0, 0]) for k in range(2))])
    triangles = [faces + k * len(vertices) for k in range(12)] + [np.arange(6).reshape(2, 3) + len(tubes)]
    mesh, report = write_obj(tmp_path / "tubes.obj", many, np.concatenate(triangles)), tmp_path / "report.json"
    assert main(["fill", str(mesh), "-o", str(tmp_path / "filled.obj"), "--report", str(report)]) == 1
    flipped, outline, counts = capsys.readouterr().err.splitlines()
    assert "opposite orientation" in flipped
    assert re.search(r"; likewise 11 other loops: \d+, \d+, \d+, \d+, \d+, \.\.\. \(--report lists all\)$", flipped)
    assert outline.startswith("spinor-geom: loop 24 (3 vertices) was left open: the loop is the outline")
    assert outline.endswith("; likewise 1 other loop: 25")
    assert "24 of 26 loops filled" in counts
    notes = [note for loop in json.loads(report.read_text())["loops"] for note in loop["notes"]]
    assert sum("opposite orientation" in note for note in notes) == 12


def test_edit_opens_a_window_and_prints_what_was_saved(tmp_path, monkeypatch, capsys):
    path = write_obj(tmp_path / "in.obj", *cylinder(16, 4))
    opened: list[tuple[object, ...]] = []

    def window(*job, time_limit, module, on_event):
        opened.append(job)
        on_event({"told": "saved", "notes": ["a note"], "is_good": False, "command": "spinor-geom fill"})

    monkeypatch.setattr("spinor_geom.cli.edit.draw_apart", window)
    monkeypatch.setenv("DISPLAY", ":0")
    assert main(["edit", str(path), "--merge", "0.5"]) == 1
    *_, output, command = opened[0]
    assert output == tmp_path / "in_filled.obj"
    assert command == ["spinor-geom", "fill", str(path), "-o", str(output), "--merge", "0.5"]
    said = capsys.readouterr()
    assert said.out == "spinor-geom fill\n"
    assert "a note" in said.err
    assert main(["edit", str(path), "-o", str(path)]) == 1
    assert "the input was replaced" in capsys.readouterr().err
    # nothing to fill, and outputs that cannot be written: no window
    closed = tmp_path / "closed.obj"
    fill_hole(read_mesh(path)).write(closed)
    assert main(["edit", str(closed)]) == 0
    assert "nothing to fill" in capsys.readouterr().out
    for output in (tmp_path, path / "out.ply", tmp_path / "out.xyz"):
        assert main(["edit", str(path), "-o", str(output)]) == 2
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if sys.platform.startswith("linux"):
        capsys.readouterr()
        assert main(["edit", str(path)]) == 2
        assert "no display" in capsys.readouterr().err
    assert len(opened) == 2
