"""Two checkouts timed side by side: cases that are slower in every round are listed, noise is not."""

import importlib
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from spinor_geom.bench.holes import all_rims

ROOT = Path(__file__).parents[2]


@pytest.fixture
def guard(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("guard")


class Clock:
    """Replaces a worker: returns given seconds, one after the other, and seven triangles for each hole."""

    def __init__(self, *seconds):
        self._seconds = cycle(seconds)

    def seconds(self, files):
        assert all(file.is_file() for file in files)
        return next(self._seconds)

    def count(self, files):
        return 7 * len(files)

    def triangles(self, files):
        return [[7, 7, 7] for _ in files]


@pytest.mark.parametrize(
    ("head", "is_slower"),
    [((1.1, 2.2, 1.05), True), ((0.9, 2.2, 1.2), False), ((1.0, 2.0, 1.0), False)],
    ids=["always", "twice", "never"],
)
def test_slower_means_slower_in_every_turn(guard, tmp_path, head, is_slower):
    mesh = all_rims("", np.zeros((3, 3)), [[0, 1, 2]])
    workers = [Clock(1.0, 2.0, 1.0), Clock(*head), Clock(0.5), Clock(0.25)]
    ((name, row, slower, beside),) = guard.measured({"two": lambda: [mesh, mesh]}, workers, tmp_path, 3)
    assert (name, slower) == ("two", is_slower)
    # the median of 1, 2 and 1 seconds for two meshes, in milliseconds
    assert row.startswith("| two | 500.0 | ")
    assert beside == [2 * np.median(head), 4 * np.median(head)]
    assert np.load(tmp_path / "two 1.npz")["triangles"].tolist() == [7, 7, 7]


@pytest.mark.slow
def test_a_checkout_is_as_fast_as_itself(guard, capsys):
    guard.main([str(ROOT), "--case", "smooth rim of 64 points", "--turns", "5"])
    row = capsys.readouterr().out.splitlines()[2]
    base, head = (float(cell) for cell in row.split("|")[2:4])
    # noise of single measurements is below 50 % even under load
    assert 0.5 < head / base < 2


def test_every_case_is_a_mesh_with_rims_to_fill(guard):
    for name in ("caps of 24 to 80 points", "smooth rim of 64 points", "noisy rim of 250 points"):
        for mesh in guard.CASES[name]():
            assert mesh.faces.max() == len(mesh.vertices) - 1
            assert len(mesh.rim) >= 24


def test_triangles_are_counted_by_hole(guard, tmp_path):
    from spinor_geom.fill.fill_hole import fill_hole

    (hole,) = guard.smooth(24)
    vertices, faces, rim = hole.vertices, hole.faces, hole.rim
    (open_faces, report) = fill_hole((vertices, faces), loop=1, return_report=True)
    counts = guard.triangles_at(np.arange(len(vertices)), report)
    added = len(open_faces[1]) - len(faces)
    assert added > 0
    assert counts == [added if vertex in rim else 0 for vertex in range(len(vertices))]


def test_whole_meshes_of_a_folder_have_all_their_rims(guard):
    cases = guard.whole_meshes(ROOT / "data")
    assert "plane_holes.obj" in cases
    assert "squiggle_on_sphere.obj" not in cases  # a curve
    (hole,) = cases["trimesh_reference.obj"]()
    assert (len(hole.rim), hole.edge_length) == (80, None)
