"""The published figures: CSV files, plots and tables of a run, between the markers of the pages."""

import csv
import importlib
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from spinor_geom.bench import runner
from spinor_geom.bench.runner import PICTURED
from tests.bench.test_run import in_this_process

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "docs/benchmark.md", "benchmarks/README.md")


@pytest.fixture
def publish(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("publish")


@pytest.mark.slow
def test_one_command_measures_and_writes_the_figures_of_all_pages(publish, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    cases = {"disks": "enneper-0.8", "fills": "enneper-0.8", "cut-outs": PICTURED[0], "meshes": "demosthenes*"}
    few = [
        replace(
            part, cases=(cases[part.suites[0]],), methods=("spinor", "spinor-fill"), points=(64,), hole_points=(64,)
        )
        for part in publish.settings(ROOT / "data")
        if part.suites[0] in cases and {"spinor", "spinor-fill"} & set(part.methods)
    ]
    monkeypatch.setattr(publish, "settings", lambda data: [part for part in few if part.points == (64,)])
    monkeypatch.setattr(publish, "ROOT", tmp_path)
    for page in PAGES:
        (tmp_path / page).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / page, tmp_path / page)
    for _ in range(2):  # the second time nothing is measured
        publish.main([str(tmp_path / "run"), "--data", str(ROOT / "data")])
    for page in PAGES:
        text = (tmp_path / page).read_text(encoding="utf-8")
        assert "Measured at commit" in text
        assert str(ROOT) not in text
        for name in ("area", "seconds", "meshes") if page == PAGES[1] else ():
            assert f"(bench/{name}.png)" in text
            assert (tmp_path / "docs" / "bench" / f"{name}.png").stat().st_size < 150_000
    (row,) = csv.DictReader((tmp_path / "benchmarks" / "disks.csv").read_text(encoding="utf-8").splitlines())
    assert float(row["area_error"]) < 1e-12
    assert "error of the patch's area | −0.2" in (tmp_path / "README.md").read_text(encoding="utf-8")
