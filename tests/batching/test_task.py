"""The results of a file: meshes, surfaces and records, the same bytes whichever files it is solved together with."""

from __future__ import annotations

import errno
import json
import os
import pickle
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinor_geom import ArraySurface, batch, boundary_loops, read_mesh
from spinor_geom.batching import archives, solver, workers
from spinor_geom.batching.archives import ArchiveReader
from spinor_geom.batching.inputs import Inputs, Source
from spinor_geom.batching.pictures import MeshPictures
from spinor_geom.batching.settings import BatchOptions, Limits
from spinor_geom.batching.store import STAGING, failure, opened_store
from spinor_geom.errors import BatchError, OptionError
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.solved_loops import solved_loops
from spinor_geom.isolate import FaultError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.batching.files import circle, curve_text, holed_text, packed_zip, record, results, vertex_lines, write_curves
from tests.fill.shapes import cylinder
from tests.systems import links, signals

Events = list[dict[str, Any]]
ROOT = Path(__file__).parents[2]
LIMITS = Limits(seconds=30.0, memory=1 << 30, retries=2)


def solved(given, output, *, together=16, **options):
    """Solves files in this process, in blocks of the given size."""
    chosen = BatchOptions(**options)
    events: Events = []
    with opened_store(output, chosen, resume=False) as store:
        sources = [asdict(source) for source in Inputs(given, output=output, limits=LIMITS)]
        for start in range(0, len(sources), together):
            job = {"sources": sources[start : start + together], "options": asdict(chosen)}
            solver.work(
                {**job, "store": asdict(store)}, events.append, archives=ArchiveReader(), pictures=MeshPictures()
            )
    return events


@pytest.fixture
def mixed(tmp_path):
    folder = tmp_path / "in"
    write_curves(folder, 5)
    (folder / "roof.obj").write_bytes(holed_text().encode())
    second = vertex_lines(circle(30, 8) + 3) + "l " + " ".join(map(str, [*range(-30, 0), -30])) + "\n"
    (folder / "two.obj").write_text(curve_text(circle(12, 20)) + second)
    (folder / "broken.obj").write_text("v 0 0 zero\n")
    return folder


def test_results_do_not_depend_on_what_is_solved_together(mixed, tmp_path):
    # the promise that a resumed run and a run on other workers leave the same bytes stands on this
    for together in (1, 3):
        solved([mixed], tmp_path / f"out{together}", together=together, what="surface")
    one = results(tmp_path / "out1")
    for path in (tmp_path / "out1" / "files").rglob("record.json"):
        json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(name))
    assert len(one) == 3 * 5 + 3 + 5 + 1
    assert results(tmp_path / "out3") == one


def test_a_patch_has_the_loop_as_its_rim_and_the_surface_can_be_loaded(tmp_path):
    path = tmp_path / "ring.obj"
    path.write_text("o ring\n" + curve_text(circle(40)))
    solved([path], tmp_path / "out", what="surface")
    found = record(tmp_path / "out", "ring.obj")
    (entry,) = found["loops"]
    assert entry["files"] == {"patch": "loop-0-ring.obj", "surface": "loop-0-ring.safetensors"}
    folder = tmp_path / "out" / "files" / "ring.obj"
    (rim,) = boundary_loops(folder / "loop-0-ring.obj")
    np.testing.assert_array_equal(np.sort(rim.points, axis=0), np.sort(circle(40), axis=0))
    (solved_alone,) = solved_loops([BoundaryLoop.from_points(circle(40))], FillOptions(), is_rim=False)
    alone = solved_alone.solution
    surface = ArraySurface.load(folder / "loop-0-ring.safetensors")
    z = alone.domain.triangulation.points
    np.testing.assert_array_equal(surface.position(z), alone.array_surface.position(z))
    assert (entry["name"], entry["origin"], entry["status"], entry["vertices"]) == ("ring", "curve", "done", 40)
    assert entry["area"] == alone.area
    assert entry["stability"]["verdict"] == alone.stability.verdict
    assert entry["residual_rms_per_edge"] == alone.boundary_residual.rms_per_edge
    assert entry["timings"]["total"] > 0
    assert found["version"]


def test_a_mesh_is_filled_and_keeps_its_own_bytes(tmp_path):
    path = tmp_path / "roof.obj"
    path.write_bytes(holed_text().encode())
    solved([path], tmp_path / "out")
    filled = tmp_path / "out" / "files" / "roof.obj" / "filled.obj"
    assert filled.read_bytes().startswith(holed_text().encode())
    assert boundary_loops(filled) == []
    found = record(tmp_path / "out", "roof.obj")
    assert (found["filled"], found["watertight"]) == ("filled.obj", True)
    assert found["loops"][0]["files"] == {"patch": "loop-0-roof%2Fsouth.obj"}


@pytest.mark.parametrize("format", ["obj", "npz"])
def test_loops_alone_are_written_without_being_solved(mixed, tmp_path, format, monkeypatch):
    monkeypatch.setattr("spinor_geom.plateau.problem.PlateauProblem.of", lambda *_: pytest.fail("a loop was solved"))
    solved([mixed], tmp_path / "out", what="loops", format=format)
    (first, second) = record(tmp_path / "out", "in/two.obj")["loops"]
    assert (first["status"], first["vertices"], second["vertices"]) == ("done", 12, 30)
    path = tmp_path / "out" / "files" / "in" / "two.obj" / second["files"]["loop"]
    if format == "npz":
        points = np.load(path, allow_pickle=False)["points"]
    else:
        (curve,) = read_mesh(path).contents.polylines
        assert curve[0] == curve[-1]
        points = read_mesh(path).mesh.vertices[curve[:-1]]
    np.testing.assert_array_equal(points, circle(30, 8) + 3)


def test_holes_can_be_continued_and_curves_stay_minimal(tmp_path):
    vertices, faces = cylinder(16, 4)
    lines = "".join("f " + " ".join(map(str, face)) + "\n" for face in (faces + 1).tolist())
    path = tmp_path / "tube.obj"
    around = "l -12 -11 -10 -9 -8 -7 -6 -5 -4 -3 -2 -1 -12\n"
    path.write_text(vertex_lines(vertices) + lines + vertex_lines(circle(12)) + around)
    solved([path], tmp_path / "out", continuity="C1", compare=True)
    *holes, curve = record(tmp_path / "out", "tube.obj")["loops"]
    assert [hole["continuation"]["started_from"] for hole in holes] == ["discrete", "discrete"]
    # two domes over circles of radius 1. The lids have π each
    assert all(hole["area"] > 3.5 and hole["comparison"] is None for hole in holes)
    assert (curve["origin"], curve["kind"], curve["continuation"]) == ("curve", "minimal", None)
    assert curve["comparison"] is not None


def broken_texts():
    """Files that were cut off, damaged, or made to be hard to read."""
    random = np.random.default_rng(7)
    squiggle = (ROOT / "data" / "squiggle_on_sphere.obj").read_bytes()
    whole = [holed_text().encode(), curve_text(circle(9)).encode(), squiggle]
    for data in whole:
        yield from (data[: int(share * len(data))] for share in random.random(8))
        for _ in range(8):
            damaged = bytearray(data)
            for place in random.integers(len(data), size=3):
                damaged[place] = random.integers(256)
            yield bytes(damaged)
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\n"
    for text in (
        "",
        "l 1 2 3 1\n",
        f"{corners}l 1 2 3 9\n",
        f"{corners}l 1 1 1\n",
        f"{corners}l 1 2 1 2 1\n",
        f"{corners}l 1 2 3 4 2 1\n",
        f"{corners}l 1 2\nl 2 3\nl 2 4\n",
        f"{corners}f 1 2 3\nf 1 2 3\n",
        f"{corners}f 1 2 3\nf 2 1 3\n",
        f"{corners}f 1 2 2\n",
        f"{corners}f 1 2 3\nf 1 2 4\nf 2 1 3\nf 1 2 3 4\n",
        f"{corners}f 1 2 3\n",
        "v 1e308 0 0\nv -1e308 0 0\nv 0 1e308 0\nv 0 0 1\nl 1 2 3 1\nf 1 2 3\nf 1 3 4\n",
        "v 1e-310 0 0\nv -1e-310 0 0\nv 0 1e-310 0\nl 1 2 3 1\n",
        "v nan nan nan\nv inf 0 0\nv 0 0 0\nl 1 2 3 1\nf 1 2 3\n",
        "v 0 0 0\nv 1 0 0\nv 2 0 0\nl 1 2 3 1\n",
        "v 0 0 0\nv 0 0 0\nv 0 0 0\nl 1 2 3 1\n",
        f"{corners}l 1 2 99999999999999999999\n",
        f"{corners}o {'x' * 5000}\ng {chr(0x2028)}../../{chr(0x202E)}\nl 1 2 4 3 1\n",
        f"{corners}call ../../etc/passwd\nmtllib /etc/shadow\ncsh rm\nl 1 2 4 3 1\n",
    ):
        yield text.encode()


@pytest.mark.parametrize("what", ["fill", "loops"])
def test_broken_files_fail_for_a_reason_and_alone(tmp_path, what):
    folder = tmp_path / "in"
    folder.mkdir()
    texts = list(broken_texts())
    for number, data in enumerate(texts if what == "loops" else texts[:32] + texts[48:]):
        (folder / f"{number:02}.obj").write_bytes(data)
    events = solved([folder], tmp_path / "out", what=what)
    done = [event["finished"] for event in events if "finished" in event]
    assert len(done) == len(list(folder.iterdir()))
    assert not [one for one in done if one["status"] == "fault"]
    assert all(one["reason"] or one["first"] for one in done if one["status"] != "done")
    # nothing but the results of each
    assert {path.name for path in tmp_path.iterdir()} == {"in", "out"}
    records = (tmp_path / "out" / "files").rglob("record.json")
    assert {path.parent.name for path in records} == {path.name for path in folder.iterdir()}


@dataclass(frozen=True)
class Harm:
    """Makes a folder when it is unpickled."""

    folder: Path

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def test_no_pickle_is_loaded(tmp_path):
    harm = Harm(tmp_path / "harm")
    for name in ("a.obj", "b.obj"):
        (tmp_path / name).write_bytes(pickle.dumps(harm))
    np.savez(tmp_path / "c.npz", x=np.array([harm], dtype=object), allow_pickle=True)
    (tmp_path / "c.npz").rename(tmp_path / "c.obj")
    events = solved([tmp_path / f"{name}.obj" for name in "abc"], tmp_path / "out")
    assert [event["finished"]["status"] for event in events if "finished" in event] == ["failed"] * 3
    assert not harm.folder.exists()
    pickle.loads(pickle.dumps(harm))
    assert harm.folder.exists()


@links
def test_nothing_is_written_where_a_link_leads_out(tmp_path):
    (path,) = write_curves(tmp_path / "in", 1)
    outside = tmp_path / "outside"
    outside.mkdir()
    options = BatchOptions()
    with opened_store(tmp_path / "out", options, resume=False) as store:
        (tmp_path / "out" / "files").mkdir()
        (tmp_path / "out" / "files" / "in").symlink_to(outside)
        (source,) = Inputs([path.parent], output=tmp_path / "out", limits=LIMITS)
        with pytest.raises(BatchError, match="to outside the output folder"):
            store.commit(source, {}, {})
    assert list(outside.iterdir()) == []


def test_a_run_that_lost_its_folder_writes_no_more(tmp_path):
    (path,) = write_curves(tmp_path / "in", 1)
    options = BatchOptions()
    with opened_store(tmp_path / "out", options, resume=False) as old:
        pass
    with opened_store(tmp_path / "out", options, resume=False):
        (source,) = Inputs([path], output=tmp_path / "out", limits=LIMITS)
        with pytest.raises(BatchError, match="another run"):
            old.commit(source, {}, {})
    assert not (tmp_path / "out" / "files" / "curve000.obj").exists()


@pytest.mark.parametrize(
    "wrong",
    [
        {"what": "holes"},
        {"format": "step"},
        {"time_limit": 0},
        {"what": "loops", "format": "ply"},
        {"what": "loops", "pictures": True},
        {"edge_length": "long"},
        {"tolerance": -1.0},
        {"closing": float("nan")},
        {"workers": 0},
        {"workers": 1, "scheduler": "tcp://127.0.0.1:1"},
        {"retries": -1},
        {"memory_limit": -5},
    ],
)
def test_options_are_checked_before_anything_is_made(tmp_path, wrong):
    with pytest.raises(OptionError):
        batch(write_curves(tmp_path / "in", 1), tmp_path / "out", **wrong)
    assert not (tmp_path / "out").exists()


def test_arrays_are_written_as_npz(tmp_path):
    (tmp_path / "roof.obj").write_bytes(holed_text().encode())
    solved([tmp_path / "roof.obj"], tmp_path / "out", format="npz")
    with np.load(tmp_path / "out" / "files" / "roof.obj" / "filled.npz", allow_pickle=False) as arrays:
        assert boundary_loops((arrays["vertices"], arrays["faces"])) == []
        own = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0], [0.5, 0.5, 1]])
        np.testing.assert_array_equal(arrays["vertices"][:5], own)


@pytest.fixture
def process(harmful_site, monkeypatch):
    """Runs a block in a process of its own, as a worker does."""
    monkeypatch.setenv("PYTHONPATH", harmful_site)

    def run(given, output, *, token=None, **changed):
        options = BatchOptions()
        with opened_store(output, options, resume=output.exists()) as store:
            job = {
                "sources": [asdict(source) for source in Inputs(given, output=output, limits=LIMITS)],
                "options": asdict(options),
                "store": {"output": store.output, "token": token or store.token},
            }
            return workers.run_block(job, replace(LIMITS, **changed))

    yield run
    for _, process in workers._processes.values():
        process.end()


@signals
def test_a_crash_costs_only_the_file_that_causes_it(process, tmp_path):
    folder = tmp_path / "in"
    paths = write_curves(folder, 2)
    # a run that has to stop leaves the process ready for the next
    stopped = process(paths, tmp_path / "other", token="that of another run")
    assert "another run" in stopped["stop"]

    (folder / "crash.obj").write_text(paths[0].read_text())
    done = process([folder], tmp_path / "out", retries=0)
    assert done["stop"] == ""
    found = {one["key"].removeprefix("in/"): (one["status"], one["reason"]) for one in done["finished"]}
    done = {f"curve00{k}.obj": ("done", "") for k in (0, 1)}
    assert found == {"crash.obj": ("fault", "its process died by SIGSEGV"), **done}
    assert record(tmp_path / "out", "in/crash.obj")["reason"] == "its process died by SIGSEGV"


def test_what_a_bundle_does_is_no_fault_of_the_last_file_read(tmp_path, monkeypatch):
    class Solver:
        def run(self, job, send, **limits):
            events: Events = []
            assert limits == {"seconds": 30.0, "memory": 1 << 30}
            if len(job["sources"]) == 1:
                solver.work(job, send, archives=ArchiveReader(), pictures=MeshPictures())
                return
            with monkeypatch.context() as patch:
                patch.setattr(solver, "_patches", lambda *_, **__: 1 / 0)
                solver.work(job, events.append, archives=ArchiveReader(), pictures=MeshPictures())
            raise FaultError("took too long", kind="time", last=events[-1], output="")

    monkeypatch.setattr(workers, "process_of_thread", lambda _: Solver())
    options, output = BatchOptions(), tmp_path / "out"
    with opened_store(output, options, resume=False) as store:
        sources = [asdict(source) for source in Inputs(write_curves(tmp_path / "in", 3), output=output, limits=LIMITS)]
        job = {"sources": sources, "options": asdict(options), "store": asdict(store)}
        done = workers.run_block(job, LIMITS)
    assert [one["status"] for one in done["finished"]] == ["done"] * 3


def test_a_file_that_cannot_be_read_now_is_tried_again(tmp_path, monkeypatch):
    (path,) = write_curves(tmp_path / "in", 1)
    packed = packed_zip(tmp_path / "a.zip", [("b.obj", path.read_bytes())])

    def failing(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    read_bytes = Path.read_bytes
    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", lambda own: failing() if own == path else read_bytes(own))
        patch.setattr(archives.zipfile, "ZipFile", failing)
        solved([path, packed], tmp_path / "out")
    for key in ("curve000.obj", "a.zip/b.obj"):
        found = record(tmp_path / "out", key)
        assert (found["status"], "Input/output error" in found["reason"]) == ("fault", True)
    with opened_store(tmp_path / "out", BatchOptions(), resume=True) as store:
        for source in Inputs([path, packed], output=tmp_path / "out", limits=LIMITS):
            assert store.completed(source) is None


def test_results_that_cannot_be_written_fail_one_file_only(tmp_path):
    paths = write_curves(tmp_path / "in", 3)
    with opened_store(tmp_path / "out", BatchOptions(), resume=False) as store:
        sources = list(Inputs(paths, output=tmp_path / "out", limits=LIMITS))
        # a file stands where a folder is to be made
        Path(store.output, "files").mkdir()
        store.folder("curve001.obj").write_text("")
        events: Events = []
        job = {"sources": [asdict(source) for source in sources], "options": asdict(BatchOptions())}
        solver.work({**job, "store": asdict(store)}, events.append, archives=ArchiveReader(), pictures=MeshPictures())
    found = {one["key"]: one["status"] for one in (event["finished"] for event in events if "finished" in event)}
    assert found == {"curve000.obj": "done", "curve001.obj": "fault", "curve002.obj": "done"}
    assert not [event for event in events if "stop" in event]


def test_results_that_cannot_be_written_stop_the_batch(tmp_path):
    source = Source(key="a.obj", path="a.obj")
    with opened_store(tmp_path / "out", BatchOptions(), resume=False) as store:
        (tmp_path / "out" / STAGING).write_text("")  # no folder
        with pytest.raises(BatchError, match="cannot be written to"):
            store.commit(source, failure("a.obj", ""), {})
        (tmp_path / "out" / STAGING).unlink()

        def full(_):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with pytest.raises(BatchError, match="No space left on device"):
            store.commit(source, failure("a.obj", ""), {"a.obj": full})


def test_a_process_that_cannot_start_stops_the_batch(process, tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['scipy'] = None\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]]))
    done = process(write_curves(tmp_path / "in", 3), tmp_path / "out")
    assert done["finished"] == []
    assert "cannot start: its process died with status 1: ModuleNotFoundError" in done["stop"]


@pytest.mark.parametrize("what", ["fill", "loops"])
def test_lines_and_points_beside_faces_are_a_note(tmp_path, what):
    stray = "p 1 2 3\nl 1 2 3\nl 4 5 4\n"
    (tmp_path / "stray.obj").write_bytes(holed_text().encode() + stray.encode())
    (tmp_path / "lines.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\n" + "l 1 2 3\n")
    solved([tmp_path / "stray.obj", tmp_path / "lines.obj"], tmp_path / "out", what=what)
    found = (tmp_path / "out" / "files" / name / "record.json" for name in ("stray.obj", "lines.obj"))
    record, lines = (json.loads(path.read_text()) for path in found)
    assert (record["status"], lines["status"]) == ("done", "failed")
    assert [loop["status"] for loop in record["loops"] if loop["origin"] == "curve"] == ["open", "open"]
    notes = [note for note in record["notes"] if "beside the faces, is not filled" in note]
    assert len(notes) == 2
    assert "the curve is open" in notes[0]
