"""The page of figures and the CSV beside it: both contain the measurements of a run, and they agree."""

import csv
import importlib
from pathlib import Path

import pytest

from spinor_geom.bench import run_tables, runner
from spinor_geom.bench.runner import Settings, measure
from tests.bench.test_run import in_this_process

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def publish(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("publish")


def test_a_run_becomes_csv_and_tables_and_replaces_an_earlier_one(publish, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    run = tmp_path / "run"
    settings = Settings.short(suites=("disks", "odd"), cases=("enneper-0.8", "open-cone"), methods=("spinor", "cgal"))
    run_tables.write(measure(settings, run))
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n\n{publish.BEGIN}\nold\n{publish.END}\nafter\n", encoding="utf-8")
    monkeypatch.setattr(publish, "HERE", tmp_path)
    monkeypatch.setattr(publish, "README", readme)
    for _ in range(2):
        publish.main([str(run)])
        text = readme.read_text(encoding="utf-8")
        assert text.startswith(f"before\n\n{publish.BEGIN}\n\n### Suites")
        assert text.endswith(f"{publish.END}\nafter\n")
        assert "old\n" not in text
        rows = list(csv.DictReader((tmp_path / "disks.csv").read_text(encoding="utf-8").splitlines()))
        # loops of 32 points are not mentioned
        assert [row["n"] for row in rows] == ["64"]
    assert all(row["commit"] and row["date"] and float(row["load"]) >= 0 for row in rows)
    assert float(rows[0]["area_error"]) < 1e-12
    # no paths of this machine
    assert str(tmp_path) not in text + (tmp_path / "disks.csv").read_text(encoding="utf-8")


def test_records_are_read_back(publish, tmp_path, monkeypatch):
    monkeypatch.setattr(publish, "HERE", tmp_path)
    alike = {"suite": "fills", "case": "scherk", "n": 64, "kind": "corners"}
    records = [
        {**alike, "method": "cgal", "status": "done", "seconds": 0.5, "rim_kept": False},
        {**alike, "method": "open3d", "status": "crashed", "reason": "signal 11, it died"},
        {**alike, "method": "cgal", "status": "done", "seconds": 2.0, "rim_kept": True, "n": 256},
    ]
    (tmp_path / "fills.csv").write_text(publish.csv_text(records), encoding="utf-8")
    assert publish.read("fills") == records


@pytest.mark.parametrize("suite", sorted(path.stem for path in BENCHMARKS.glob("*.csv")))
def test_the_page_is_of_the_csv_beside_it(publish, suite):
    records = publish.read(suite)
    assert f"| [{suite}]({suite}.csv) | {len(records)} |" in publish.README.read_text(encoding="utf-8")
    for record in records:
        assert {"suite", "case", "method", "status", "commit", "date"} <= record.keys()
        assert record["suite"] == suite
    assert len({publish.key(record) for record in records}) == len(records)
