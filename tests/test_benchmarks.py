"""The script that measures the figures: its loops, its tables, and where it puts them."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from spinor_geom import TriangleMesh, boundary_loops, gallery
from spinor_geom.errors import SurfaceError
from tests.exact_solutions import ENNEPER, exact_solution

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


def test_a_limit_from_below_is_met_or_missed(tables: ModuleType) -> None:
    assert tables.Figure.at_least("loop", "order", 4.0, 3.8).met is True
    assert tables.Figure.at_least("loop", "order", float("nan"), 3.8).met is False


def test_even_samples_lie_on_the_curve_with_equal_edges(benchmark_modules: Callable[[str], ModuleType]) -> None:
    loop = benchmark_modules("figure_samples").evenly_sampled(gallery.ellipse(8.0), 400)
    x, y, _ = loop.points.T
    np.testing.assert_allclose((x / 8) ** 2 + y**2, 1, atol=1e-13)
    # at the ends of the long axis, radius of curvature 1/8, a chord of 0.08 is shorter than its arc by 1.7 %
    assert loop.edge_lengths.min() > 0.975 * loop.edge_lengths.max()
    assert not loop.corners.any()


def test_noise_is_isotropic_repeatable_and_as_large_as_stated(benchmark_modules: Callable[[str], ModuleType]) -> None:
    samples = benchmark_modules("figure_samples")
    loop = gallery.twisted_circle().sample(2000)
    moved = samples.noisy_loop(loop, 0.15, seed=3)
    moves = (moved.points - loop.points) / loop.mean_edge_length
    # 2000 numbers: the standard error of their deviation is 1.6 %
    np.testing.assert_allclose(moves.std(axis=0), 0.15, rtol=0.06)
    assert np.abs(np.corrcoef(moves.T) - np.eye(3)).max() < 0.1
    np.testing.assert_array_equal(moved.points, samples.noisy_loop(loop, 0.15, seed=3).points)
    assert (samples.noisy_loop(loop, 0.15, seed=4).points != moved.points).all()


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
        dataclasses.replace(
            (exact := exact_solution(ENNEPER, 24)),
            area=disk.area,
            stability=dataclasses.replace(
                exact.stability, verdict="stable" if disk.stable else "unstable", index=0 if disk.stable else 1
            ),
        )
        for disk in case.disks
    )
    assert all(figure.met for figure in solutions.case_figures(case, stable, unstable, (stable, stable, unstable)))
    wrong = dataclasses.replace(unstable, stability=stable.stability)
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


def test_holes_have_one_rim_and_one_outer_boundary(benchmark_modules: Callable[[str], ModuleType]) -> None:
    holes = benchmark_modules("figure_fillers").holes()
    assert [hole.rim for hole in holes] == [64, 256, 1000, 64]
    for hole in holes:
        mesh = TriangleMesh(hole.vertices, hole.faces)
        outer, rim = boundary_loops(mesh)
        assert (len(rim), len(outer)) == (hole.rim, hole.rim + 1)
        np.testing.assert_array_equal(np.sort(rim.vertex_ids), np.arange(hole.rim))


def test_our_fill_is_measured_whole(
    benchmark_modules: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    fillers = benchmark_modules("figure_fillers")
    monkeypatch.setattr(fillers, "RUNS", 1)
    hole = fillers.holes()[0]
    filled = fillers.ours(hole)
    *_, triangles, _, closed, kept = fillers.row(hole, "ours", filled)
    assert (closed, kept) == ("yes", "yes")
    assert int(triangles) == len(filled.faces) - len(hole.faces)
    # chords of the rim enclose less than the rim
    assert -0.006 < fillers.patch_area(hole, filled) / hole.area - 1 < 0
    left_open = dataclasses.replace(filled, vertices=filled.vertices + 1e-9, faces=filled.faces[:-1])
    *_, closed, kept = fillers.row(hole, "other", left_open)
    assert (closed, kept) == ("no, +3 open edges", "no")


def test_rims_are_measured_beside_their_targets(figures: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.main(["rims", "--only", "plane rings"]) == 0
    rows = [cells(line) for line in capsys.readouterr().out.splitlines() if line.startswith("| plane")]
    assert [row[4] for row in rows if row[1] == "error of the area"] == ["met", "met"]
