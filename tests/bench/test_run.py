"""A run: resumed where it was killed, its promises, its files."""

import csv
import json
from pathlib import Path

import pytest

from spinor_geom.bench import run_tables, runner
from spinor_geom.bench.promises import promises
from spinor_geom.bench.runner import DESCRIPTION, RECORDS, Settings, measure
from spinor_geom.bench.tasks import run as run_task
from spinor_geom.cli.main import main
from spinor_geom.errors import OptionError
from spinor_geom.version import program_version

DATA = Path(__file__).parents[2] / "data"

SMALL = Settings.short(
    suites=("disks", "fills"),
    cases=("plane-square", "enneper-0.5"),
    methods=("spinor", "libigl", "spinor-fill"),
    points=(16, 64),
    hole_points=(16,),
)


def loop_record(**changed):
    record = {
        **{"suite": "disks", "status": "done", "case": "enneper-0.8", "method": "spinor", "n": 64, "edge": 0.1},
        **{"seconds": 0.1, "cold_seconds": None, "memory_mib": 300.0, "triangles": 500, "vertices": 300, "area": 3.5},
        **{"area_error": 1e-8, "mesh_area_error": 2e-3, "rim_kept": True, "open_edges": 0, "nonmanifold_edges": 0},
        **{"crossings": 0, "min_angle": 30.0, "converged": True, "message": "", "exact_curvature_median": 1e-15},
        **{"curvature_max": 1.0, "curvature_rms": 0.1, "commit": program_version(), "load": 0.5},
    }
    return {**record, **changed}


def libigl_record(**changed):
    return loop_record(**{"method": "libigl", "area_error": 2e-3, "exact_curvature_median": None, **changed})


def in_this_process(tasks, *, module, time_limit, on_record):
    """The same as `run_isolated`, without a new process, which takes seconds to start."""
    for task in tasks:
        on_record(task, run_task(task))


def kept(part, *records):
    """Whether the promises whose text has this part are kept; None if there are none."""
    found = [promise.met for promise in promises(records) if part in promise.text]
    return all(found) if found else None


def test_promises_are_kept_or_missed():
    closer = "area error at most that of libigl"
    assert kept(closer, loop_record(), libigl_record())
    assert kept(closer, loop_record(area_error=1e-5), libigl_record()) is False
    # at another sampling there is nothing to compare
    assert kept(closer, loop_record(n=128), libigl_record()) is None
    assert kept("keeps the rim", loop_record())
    assert kept("keeps the rim", loop_record(rim_kept=False)) is False
    assert kept("exact |H|", loop_record(exact_curvature_median=1e-8)) is False
    assert kept("exact |H|", loop_record(exact_curvature_median=None)) is False
    assert kept("area error at most", loop_record(area_error=1e-5)) is False


def hole_record(method, **changed):
    record = {
        **{"suite": "fills", "status": "done", "case": "enneper-0.8", "method": method, "n": 64, "seconds": 1.0},
        **{"area_error": 1e-3, "rim_kept": True, "old_faces_kept": True, "open_rim_edges": 0, "new_open_edges": 0},
        "nonmanifold_edges": 0,
    }
    return {**record, **changed}


def test_our_fill_is_measured_against_every_filler_that_closes_the_rim():
    nearer = "every other filler"
    ours, other = hole_record("spinor-fill", area_error=1e-8), hole_record("cgal")
    assert kept(nearer, ours, other)
    assert kept(nearer, hole_record("spinor-fill", area_error=2e-7), other) is False
    # the least ratio counts, whoever it belongs to
    assert kept(nearer, ours, other, hole_record("vtk", area_error=9e-5)) is False
    # neither a hole that was left open nor another sampling is an answer
    for spared in (hole_record("vtk", area_error=0.0, open_rim_edges=3), hole_record("vtk", area_error=0.0, n=256)):
        assert kept(nearer, ours, other, spared)
    assert kept(nearer, ours) is None
    # in a plane every triangulation is exact
    assert kept(nearer, *({**record, "case": "plane-l"} for record in (ours, other))) is None


@pytest.mark.usefixtures("importable")
def test_a_killed_run_goes_on(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    seen = []

    def killed(record, done, total):
        seen.append((record["case"], record["method"], done, total))
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(SMALL, folder, on_record=killed)
    lines = (folder / RECORDS).read_text(encoding="utf-8").splitlines()
    assert len(lines) == 2
    # the process died in the middle of a line
    (folder / RECORDS).write_text("\n".join(lines) + '\n{"key": "half', encoding="utf-8")
    again = []
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    run = measure(SMALL, folder, on_record=lambda record, done, total: again.append(done))
    total = seen[0][3]
    assert again == list(range(3, total + 1))
    assert len(run.records) == total
    assert (folder / RECORDS).read_text(encoding="utf-8").count("\n") == total
    # nothing is left to do, under no name of the folder of meshes
    assert Settings(data=Path()) == Settings(data=Path.cwd())
    measure(SMALL, folder, on_record=lambda *_: pytest.fail("measured again"))
    by_method = {(r["method"], r["case"], r["n"]): r for r in run.records}
    ours, theirs = by_method["spinor", "enneper-0.5", 64], by_method["libigl", "enneper-0.5", 64]
    assert ours["status"] == theirs["status"] == "done"
    assert ours["area_error"] < 1e-6 < theirs["area_error"] < 0.05
    assert ours["distance_max"] < 0.01
    assert by_method["spinor-fill", "plane-square", 16]["open_rim_edges"] == 0
    run_tables.write(run)
    text = (folder / run_tables.PAGE).read_text(encoding="utf-8")
    assert "http" not in text.replace("http-equiv", "")
    # plots and the row of each method come first, the promises last
    order = [text.index(f"<h3>{title}<") for title in ("Area error", "Seconds", "Methods", "Methods and tools")]
    assert order == sorted(order)
    assert text.index("<h2>Promises<") > order[-1]
    assert len(text) < 5_000_000
    rows = list(csv.DictReader((folder / run_tables.CSV).read_text(encoding="utf-8").splitlines()))
    assert len(rows) == total
    # figures of other versions are not mixed in
    description = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    description["machine"]["versions"]["libigl"] = "1"
    (folder / DESCRIPTION).write_text(json.dumps(description), encoding="utf-8")
    with pytest.raises(OptionError, match="other versions"):
        measure(SMALL, folder)


def test_the_command_measures_and_reports_what_is_missed(tmp_path, capsys, monkeypatch):
    pytest.importorskip("torch")
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    folder = tmp_path / "run"
    chosen = ["--suite", "disks", "--cases", "enneper-0.5", "--methods", "spinor,libigl"]
    status = main(["bench", "--quick", *chosen, "-o", str(folder)])
    assert status == 0
    assert (folder / run_tables.PAGE).exists()
    assert capsys.readouterr().err == ""
    assert main(["bench", "--cases", "nothing", "-o", str(folder)]) == 2
    assert "there is no case 'nothing'" in capsys.readouterr().err
