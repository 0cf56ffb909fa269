"""Monitored processes: the ways in which they end, and the errors that report it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from spinor_geom.isolate import Event, FaultError, Process, crash_of, module_path
from tests.systems import signals

BUSY = """
import os, sys, time
from spinor_geom.isolate import serve

def work(job, tell):
    taken = []
    tell({"begun": os.getpid()})
    print("a word", flush=True)
    os.write(2, b"and another\\n")
    if "signal" in job:
        os.kill(os.getpid(), job["signal"])
    if "status" in job:
        os._exit(job["status"])
    # never as long silent as a look at the limits is away
    while "take" in job or "talk" in job:
        tell({"still": True})
        if "take" in job:
            taken.append(bytearray(b"x") * job["take"])
        time.sleep(0.005)
    time.sleep(job.get("sleep", 0))

if __name__ == "__main__":
    serve(work)
"""


@pytest.fixture
def process(tmp_path, monkeypatch):
    (tmp_path / "busy_process.py").write_text(BUSY)
    monkeypatch.syspath_prepend(str(tmp_path))
    process = Process("busy_process")
    yield process
    process.end()


def fault_of(process, job, **limits):
    with pytest.raises(FaultError) as raised:
        process.run(job, lambda _: None, **{"seconds": 30.0, **limits})
    return raised.value


def test_one_process_does_one_job_after_the_other(process):
    events: list[Event] = []
    for _ in range(2):
        assert process.run({}, events.append, seconds=30.0) == "a word\nand another"
    assert events[0] == events[1]


@pytest.mark.parametrize(
    ("job", "reason"),
    [
        pytest.param({"signal": int(signal.SIGSEGV)}, "its process died by SIGSEGV: and another", marks=signals),
        ({"status": 3}, "its process died with status 3: and another"),
    ],
)
def test_the_end_of_a_process_is_reported_with_its_last_output(process, job, reason):
    fault = fault_of(process, job)
    assert (str(fault), fault.kind, fault.output) == (reason, "death", "a word\nand another")
    assert fault.last.keys() == {"begun"}
    # another process does the next
    process.run({}, lambda _: None, seconds=30.0)


@pytest.mark.parametrize(
    ("job", "limits", "kind", "reason"),
    [
        ({"sleep": 100}, {"seconds": 0.5}, "time", "its process took longer than 0.5 s; raise the limit"),
        (
            {"take": 1 << 20},
            {"memory": 100 << 20},
            "memory",
            "its process used more than 100 MiB of memory; raise the limit, or split the file",
        ),
    ],
)
def test_limits_hold_however_much_a_process_sends(process, job, limits, kind, reason):
    fault = fault_of(process, job, **limits)
    assert (fault.kind, str(fault)) == (kind, reason)


@pytest.mark.parametrize(
    ("status", "crash"),
    [
        *((status, "") for status in (0, 1, 255)),
        # Windows
        (0xC0000005, "an access violation"),
        (0xC00000FD, "a stack overflow"),
        (0xC0000409, "an abort"),
        (0xC000001D, "exception 0xC000001D"),
        # POSIX
        *([] if os.name == "nt" else [(-9, "SIGKILL"), (-11, "SIGSEGV"), (-1000, "signal 1000")]),
    ],
)
def test_exit_statuses_of_every_system_tell_crashes_from_ends(status, crash):
    assert crash_of(status) == crash


def test_a_caller_that_stops_listening_ends_the_process(process):
    events: list[Event] = []

    def interrupted(event):
        events.append(event)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process.run({"talk": 1}, interrupted, seconds=30.0)
    process.run({}, events.append, seconds=30.0)
    assert events[0] != events[1]


ROOT = Path(__file__).parents[1]
# a start-up file of processes, which puts a decoy into the folder {0} just before any module is looked for
DECOYS = """
import sys

def make_decoy(event, about):
    if event == "import":
        with open({0!r} + "/" + about[0].partition(".")[0] + ".py", "w") as file:
            file.write("open({1!r}, 'a').write(__name__ + ' ')")

sys.addaudithook(make_decoy)
"""
# of the benchmark, a small task
MEASURE = """
from spinor_geom.bench.runner import TASKS, run_isolated
task = {"suite": "fills", "method": "spinor", "case": "enneper-0.8", "n": 16, "repeat": 1, "view": None}
run_isolated([task], module=TASKS, time_limit=100.0, on_record=lambda _, record: print(record["status"]))
"""


@pytest.mark.slow
def test_no_process_imports_from_the_folder_of_the_mesh(tmp_path):
    program, executed = str(Path(sys.executable).with_name("spinor-geom")), tmp_path / "executed"
    folder, start = tmp_path / "scans", tmp_path / "start"
    folder.mkdir()
    start.mkdir()
    (folder / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\n")
    (start / "sitecustomize.py").write_text(DECOYS.format(str(folder), str(executed)))
    (tmp_path / "measure.py").write_text(MEASURE)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(start)])}
    for command in (
        [program, "batch", "mesh.obj", "-o", "batch", "--workers", "1"],
        [program, "fill", "mesh.obj", "-o", "filled.obj", "--picture", "picture.png"],
        [sys.executable, str(tmp_path / "measure.py")],
    ):
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True, timeout=300)
        assert not executed.exists(), executed.read_text()
    decoys = {path.stem for path in folder.glob("*.py")}
    assert decoys >= {"json", "runpy", "spinor_geom", "vtkmodules", "igl"}  # of this process and its workers


def test_a_process_has_the_current_folder_only_if_it_is_named(tmp_path, monkeypatch):
    package, here, other = str(ROOT), str(tmp_path), str(tmp_path.parent)
    monkeypatch.chdir(tmp_path)
    cases = [
        (["", ".", here, other], "", [other]),
        ([here, other], os.pathsep.join(["", "."]), [other]),
        ([here, other, ""], here, [here, other]),
    ]
    for path, named, kept in cases:
        monkeypatch.setattr(sys, "path", path)
        monkeypatch.setenv("PYTHONPATH", named)
        assert module_path() == kept
    monkeypatch.chdir(ROOT)  # the package itself was found here
    monkeypatch.setattr(sys, "path", ["", package, other])
    assert module_path() == ["", package, other]
