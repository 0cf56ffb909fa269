"""The script that measures the figures: its tables, and where it puts them."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("figures")


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("figure_tables")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split(" | ")]


def test_a_curve_s_figures_stand_in_a_table(figures: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.main(["curves", "--only", "ellipse 2:1 height"]) == 0
    machine, _, title, _, header, rule, *rows = capsys.readouterr().out.splitlines()
    assert "cores" in machine
    assert title.startswith("### ")
    assert cells(header) == ["case", "figure", "target", "measured", "verdict"]
    assert set(cells(rule)) == {"---"}
    assert len(rows) == 2
    distance, converged = map(cells, rows)
    assert distance[2] == "≤ 1e-06"
    assert (float(distance[3]) <= 1e-6) == (distance[4] == "met")
    assert converged[4] in ("met", "**missed**")


def test_write_replaces_what_is_between_the_markers(
    figures: ModuleType, tables: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "README.md"
    page.write_text(f"before\n\n{tables.BEGIN}\nold\n{tables.END}\nafter\n", encoding="utf-8")
    monkeypatch.setattr(figures, "README", page)
    assert figures.main(["meshes", "--only", "trimesh_reference", "--write"]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"before\n\n{tables.BEGIN}\n\n")
    assert text.endswith(f"\n\n{tables.END}\nafter\n")
    assert "old" not in text
    (line,) = (line for line in text.splitlines() if line.startswith("| trimesh_reference.obj | 2 "))
    assert cells(line)[6] in ("yes", "no")
    assert tables.replaced_section(text, "new") == f"before\n\n{tables.BEGIN}\n\nnew\n\n{tables.END}\nafter\n"


@pytest.mark.parametrize("text", ["", "{BEGIN}", "{END} {BEGIN}", "{BEGIN} {END} {END}"])
def test_a_page_without_markers_is_refused(tables: ModuleType, text: str) -> None:
    with pytest.raises(ValueError, match="once each"):
        tables.replaced_section(text.format(BEGIN=tables.BEGIN, END=tables.END), "new")


def test_the_page_has_its_markers(tables: ModuleType) -> None:
    tables.replaced_section((BENCHMARKS / "README.md").read_text(encoding="utf-8"), "new")


@pytest.mark.parametrize(("value", "met"), [(1e-7, True), (2e-6, False), (float("nan"), False)])
def test_a_limit_is_met_or_missed(tables: ModuleType, value: float, met: bool) -> None:
    assert tables.Figure.at_most("loop", "error", value, 1e-6).met is met


def test_bars_in_cells_do_not_split_them(tables: ModuleType) -> None:
    table = tables.Table(title="t", columns=("|H|",), rows=(("1",),))
    assert "| \\|H\\| |" in str(table)


@pytest.mark.parametrize("arguments", [["curve"], ["meshes", "--data", "no such folder"]])
def test_mistaken_options_stop_before_anything_is_measured(figures: ModuleType, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        figures.main(arguments)
    assert stop.value.code == 2
