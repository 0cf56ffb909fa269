"""The script that measures the figures: its loops, its tables, and where it puts them."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from spinor_geom import gallery, read_mesh
from spinor_geom.bench import runner
from spinor_geom.bench.page import write
from spinor_geom.bench.runner import Settings, measure
from spinor_geom.bench.tables import Table
from spinor_geom.errors import SurfaceError
from tests.bench.test_run import in_this_process
from tests.exact_solutions import ENNEPER, exact_solution, with_stability

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def benchmark_modules(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module


@pytest.fixture
def figures(benchmark_modules: Callable[[str], ModuleType]) -> ModuleType:
    return benchmark_modules("figures")


@pytest.fixture
def tables(benchmark_modules: Callable[[str], ModuleType]) -> ModuleType:
    return benchmark_modules("figure_tables")


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
    # a smooth curve of a hundred points is met to rounding, as its own promise says
    assert (distance[2], distance[4]) == ("≤ 1e-06", "met")
    assert float(distance[3]) <= 1e-6
    assert converged[3].startswith("yes, ")
    assert converged[4] == "met"


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
    assert cells(line)[2:7] == ["2", "100.0%", "100.0%", cells(line)[5], "yes"]
    assert float(cells(line)[5]) <= 1e-3
    assert tables.replaced_section(text, "new") == f"before\n\n{tables.BEGIN}\n\nnew\n\n{tables.END}\nafter\n"


@pytest.mark.parametrize("text", ["", "{BEGIN}", "{END} {BEGIN}", "{BEGIN} {END} {END}"])
def test_a_page_without_markers_is_refused(tables: ModuleType, text: str) -> None:
    with pytest.raises(ValueError, match="once each"):
        tables.replaced_section(text.format(BEGIN=tables.BEGIN, END=tables.END), "new")


def test_the_page_has_its_markers(tables: ModuleType) -> None:
    tables.replaced_section((BENCHMARKS / "README.md").read_text(encoding="utf-8"), "new")


def test_the_tables_of_a_run_are_put_on_the_page(
    figures: ModuleType, tables: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "README.md"
    page.write_text(f"before\n{tables.BENCH_BEGIN}\nold\n{tables.BENCH_END}\nafter\n", encoding="utf-8")
    (tmp_path / "tables.md").write_text(
        "machine\n\n### Promises\n\none\n\n### Odd rims, in full\n\nlong\n", encoding="utf-8"
    )
    monkeypatch.setattr(figures, "README", page)
    assert figures.main(["--bench", str(tmp_path)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text == f"before\n{tables.BENCH_BEGIN}\n\nmachine\n\n### Promises\n\none\n\n{tables.BENCH_END}\nafter\n"
    figures.with_bench((BENCHMARKS / "README.md").read_text(encoding="utf-8"), tmp_path)


@pytest.mark.parametrize(("value", "met"), [(1e-7, True), (2e-6, False), (float("nan"), False)])
def test_a_limit_is_met_or_missed(tables: ModuleType, value: float, met: bool) -> None:
    assert tables.Figure.at_most("loop", "error", value, 1e-6).met is met


def test_bars_in_cells_do_not_split_them() -> None:
    table = Table(title="t", columns=("|H|",), rows=(("1",),))
    assert "| \\|H\\| |" in str(table)


@pytest.mark.parametrize("arguments", [["curve"], ["meshes", "--data", "no such folder"]])
def test_mistaken_options_stop_before_anything_is_measured(figures: ModuleType, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        figures.main(arguments)
    assert stop.value.code == 2


def test_a_limit_from_below_is_met_or_missed(tables: ModuleType) -> None:
    assert tables.Figure.at_least("loop", "order", 4.0, 3.8).met is True
    assert tables.Figure.at_least("loop", "order", float("nan"), 3.8).met is False


def test_every_kind_of_loop_is_there_once(benchmark_modules: Callable[[str], ModuleType]) -> None:
    names = [name for name, _ in benchmark_modules("figure_loops").cases()]
    assert len(set(names)) == len(names)
    for kind in ("ellipse 32:1", "20% noise", "slit", "horseshoe", "ramp of 3", "hexagon", "L-shape", "zigzag"):
        assert any(kind in name for name in names), kind


def test_a_slit_s_figures_stand_in_a_table(figures: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.main(["any_loop", "--only", "slit 50 × 0.866, "]) == 0
    rows = capsys.readouterr().out.splitlines()[-3:]
    assert [cells(row)[1] for row in rows] == [
        "RMS distance from Γ / mean edge",
        "converged to 0.001",
        "area, relative error",
    ]
    assert cells(rows[0])[-1] == "met"
    assert float(cells(rows[2])[3]) < 1e-9


def test_random_loops_are_counted_and_wrong_ones_named(benchmark_modules: Callable[[str], ModuleType]) -> None:
    loops = benchmark_modules("figure_loops")
    good = loops.RandomRecord(name="a", noisy=False, rms=1e-8, silent="", told="residual", seconds=1.0)
    rough = dataclasses.replace(good, name="b", noisy=True, rms=5e-3)
    none = dataclasses.replace(good, name="c", rms=np.inf, told="no plane domain")
    wrong = dataclasses.replace(good, name="d", silent="its area and its mesh's are 10% apart")
    near, smooth, noisy, silent, _ = loops.random_figures([good, rough, none, wrong])
    assert (near.measured, near.target, near.met) == ("3", "≥ 4", False)
    assert (smooth.met, noisy.met) == (True, False)
    assert (silent.measured, silent.met) == ("1", False)
    assert [row[0] for row in loops.far_table([good, rough, none, wrong]).rows] == ["c", "d"]


def test_what_a_solution_says_is_checked(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    loops = benchmark_modules("figure_loops")
    exact = exact_solution(ENNEPER, 120, radius=0.8)

    def record(solution):
        monkeypatch.setattr(loops, "timed_solve", lambda loop, tolerance: (solution, 0.5))
        return loops.random_record(27, "curve", noisy=False)

    assert record(exact).silent == ""
    assert "apart" in record(dataclasses.replace(exact, area=1.1 * exact.area)).silent
    # nine tenths as large, the surface misses the curve by far more than it says
    smaller = dataclasses.replace(exact, surface=exact.surface.transform(scale=0.9))
    assert "not 0.0e+00" in record(smaller).silent


def test_verdicts_are_compared_with_what_is_known(benchmark_modules: Callable[[str], ModuleType]) -> None:
    solutions = benchmark_modules("figure_solutions")
    case = next(case for case in solutions.cases() if case.name.startswith("tennis seam a=0.75"))
    stable, unstable = (
        with_stability(
            dataclasses.replace((exact := exact_solution(ENNEPER, 24)), area=disk.area),
            dataclasses.replace(
                exact.stability, verdict="stable" if disk.stable else "unstable", index=0 if disk.stable else 1
            ),
        )
        for disk in case.disks
    )
    assert all(figure.met for figure in solutions.case_figures(case, stable, unstable, (stable, stable, unstable)))
    wrong = with_stability(unstable, stable.stability)
    usual, kept, area, first, second = solutions.case_figures(case, unstable, wrong, (stable,))
    assert [usual.met, kept.met, area.met, first.met, second.met] == [False, False, False, True, False]
    assert second.measured == "not found"


def test_solves_are_timed_and_weighed(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    speed = benchmark_modules("figure_speed")
    monkeypatch.setattr(speed, "RUNS", 1)
    case = speed.SpeedCase(
        name="ellipse", loop=lambda: gallery.ellipse(2.0, 0.3).sample(24), tolerance=1e-2, seconds=9.0
    )
    record = speed.timed_record(case)
    assert len(record.seconds) == 1
    assert record.memory > 0.05
    assert [figure.met for figure in speed.record_figures(case, record)] == [True] * 3


def test_a_refused_loop_is_sent_as_such(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    speed = benchmark_modules("figure_speed")

    def refused(case):
        raise SurfaceError("no surface")

    monkeypatch.setattr(speed, "timed_record", refused)
    receiver, sender = speed.multiprocessing.Pipe(duplex=False)
    speed.send_record(speed.cases()[0], sender)
    assert receiver.recv().refusal == "no surface"


def test_power_series_meet_their_targets_and_the_null_error_sees_a_wrong_slide(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    paper = benchmark_modules("figure_paper")
    monkeypatch.setattr(paper, "RUNS", 1)
    curve = gallery.twisted_circle()
    distance, null, area, seconds = paper.exact_figures(curve, curve.disks[0].area, "circle", keep=True)
    assert [figure.met for figure in (distance, null, area)] == [True] * 3
    assert seconds.target == "≤ 0.1"
    solution = paper.solve_plateau(curve, model="series")
    # the harmonic map of another slide is not conformal
    t = solution.matching[:, 0]
    other = np.column_stack([t, t + 0.05 * np.sin(4 * np.pi * t)])
    slid = dataclasses.replace(solution.rims[0], matching=other)
    assert paper.null_error(dataclasses.replace(solution, rims=(slid,))) > 1e-2


@pytest.mark.parametrize(("slope", "met"), [(-3.9, True), (-3.7, False), (float("nan"), False)])
def test_slopes_are_compared_with_the_rule_s_order(
    benchmark_modules: Callable[[str], ModuleType], slope: float, met: bool
) -> None:
    figure = benchmark_modules("figure_paper").slope_figure("a", "simpson", slope, "9 points")
    assert (figure.target, figure.met) == ("-4 ± 0.2", met)


def test_the_paper_s_training_is_measured_as_far_as_it_went(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    paper = benchmark_modules("figure_paper")
    small = paper.RMSprop(depth=2, width=5, points=64, batch=32, order=8)
    monkeypatch.setattr(paper, "RMSprop", lambda **options: dataclasses.replace(small, **options))
    monkeypatch.setattr(paper, "PAPER", dataclasses.replace(paper.PAPER, depth=2, width=10, tolerance=1e-3))
    ended, falls, largest, *_ = paper.rmsprop_figures(gallery.twisted_circle(), paper.Training(epochs=4), "circle")
    assert (ended.measured, ended.met) == ("finished after 4 of 800 epochs", None)
    assert falls.name == "loss falls on average, 4 parts"
    assert largest.name.endswith("after 4 of 800 epochs")


def test_batches_have_their_place_on_the_page_and_files_of_one_loop(
    benchmark_modules: Callable[[str], ModuleType], tables: ModuleType, tmp_path: Path
) -> None:
    batches = benchmark_modules("batch")
    page = (BENCHMARKS / "README.md").read_text(encoding="utf-8")
    assert "\n\nnew\n\n" in tables.replaced_section(page, "new", begin=batches.BEGIN, end=batches.END)
    folder = batches.write_files(tmp_path / "in", 2, batches.rough_loop)
    for seed, path in enumerate(sorted(folder.iterdir())):
        file = read_mesh(path)
        (curve,) = file.polylines
        np.testing.assert_array_equal(file.mesh.vertices[curve[:-1]], batches.rough_loop(seed).points)


def test_loops_are_solved_alone_and_side_by_side(benchmark_modules: Callable[[str], ModuleType]) -> None:
    table = benchmark_modules("batch").side_by_side(count=2)
    assert [row[0] for row in table.rows] == ["12", "24", "48", "100"]
    assert {row[-1] for row in table.rows} == {"2 of 2"}


def test_rims_are_measured_beside_their_targets(figures: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.main(["rims", "--only", "plane rings"]) == 0
    rows = [cells(line) for line in capsys.readouterr().out.splitlines() if line.startswith("| plane")]
    assert [row[4] for row in rows if row[1] == "error of the area"] == ["met", "met"]


def test_a_run_of_cut_outs_becomes_tables_a_csv_and_a_picture(
    figures: ModuleType, tables: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    run = tmp_path / "run"
    settings = Settings.short(cases=("torus-outside-0.4", "open-cone"), methods=("spinor-fill",))
    write(measure(settings, run))
    page = tmp_path / "README.md"
    page.write_text(f"before\n\n{tables.CUT_OUTS_BEGIN}\nold\n{tables.CUT_OUTS_END}\nafter\n", encoding="utf-8")
    places = {"README": page, "CUT_OUTS": tmp_path / "all.csv", "PICTURE": tmp_path / "all.png"}
    for name, value in {**places, "PICTURED": ("torus-outside-0.4",)}.items():
        monkeypatch.setattr(figures, name, value)
    assert figures.main(["--cut-outs", str(run)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "old" not in text
    assert "| spinor-fill | 1 of 1 |" in text
    header, *lines = places["CUT_OUTS"].read_text(encoding="utf-8").splitlines()
    assert [line.split(",")[1] for line in lines] == ["torus-outside-0.4", "open-cone"]
    # neither paths of this machine nor what a tool said
    assert str(tmp_path) not in text + "".join(lines)
    assert "distance" in header.split(",")
    assert places["PICTURE"].stat().st_size > 5000
