"""The cases that only this library solves: the cases, the measurements of the solutions, and the promises."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import spinor_geom
from spinor_geom import gallery, read_mesh, solve_plateau
from spinor_geom.bench import batches
from spinor_geom.bench.measured import null_error, solve_figures, untrue
from spinor_geom.bench.promises import WORKER_MIB, promises
from spinor_geom.bench.solves import QUICK, solves
from spinor_geom.bench.tasks import run as run_task
from spinor_geom.plateau.evidence import Evidence
from tests.bench.test_run import kept
from tests.exact_solutions import ENNEPER, exact_solution


def task(suite, case, **more):
    return {"suite": suite, "method": "spinor", "case": case, "repeat": 0, **more}


def measured(name):
    one = task(solves()[name].suite, name)
    return {**one, **run_task(one)}


@pytest.mark.parametrize("name", [name for name in QUICK if "formulas" not in name])
def test_promises_of_accuracy_are_kept(name):
    record = measured(name)
    figures = [figure for figure in promises([record]) if figure.kind == "accuracy"]
    assert figures
    assert [figure.text for figure in figures if not figure.met] == []


def test_a_catenoid_between_formulas_is_exact_and_an_annulus():
    record = measured("catenoid h = 0.5 of formulas")
    assert record["annulus"]
    assert record["area_error"] < 1e-12


def test_every_kind_of_loop_is_there():
    for kind in ("ellipse 32:1", "20% noise", "slit", "horseshoe", "ramp of 3", "hexagon", "L-shape", "zigzag"):
        assert any(kind in name for name in solves()), kind


def test_random_curves_are_counted_and_wrong_ones_named():
    def record(seed, **changed):
        done = {"status": "done", "rms_per_edge": 1e-8, "untrue": ""}
        return {**task("curves", f"random curve {seed}"), **done, **changed}

    refused = record(4, status="refused", rms_per_edge=None)
    wrong = record(6, untrue="its area and its mesh's are 10% apart")
    records = [record(2), record(3, rms_per_edge=5e-3), refused, wrong]
    (near,) = (f for f in promises(records) if "of an edge" in f.text)
    assert (near.measured, near.met) == ("3 of 4", False)
    assert kept("reported properties", *records) is False
    assert kept("without noise", *records)
    assert kept("15% noise", *records) is False


def test_statements_of_a_solution_are_checked():
    exact = exact_solution(ENNEPER, 120, radius=0.8)
    assert untrue(exact, 1e-8) == ""
    assert "apart" in untrue(dataclasses.replace(exact, area=1.1 * exact.area), 1e-8)
    # nine tenths as large, the surface misses the curve by far more than it says
    smaller = dataclasses.replace(exact, evidence=Evidence(make=lambda: exact.surface.transform(scale=0.9)))
    case = next(iter(solves().values()))
    figures = solve_figures(dataclasses.replace(case, also="untrue"), smaller)
    assert "not 0.0e+00" in figures["untrue"]


def test_the_null_error_detects_a_wrong_slide():
    solution = solve_plateau(gallery.twisted_circle(), model="series")
    assert null_error(solution) < 1e-13
    # the harmonic map of another slide is not conformal
    t = solution.matching[:, 0]
    slid = dataclasses.replace(solution.rims[0], matching=np.column_stack([t, t + 0.05 * np.sin(4 * np.pi * t)]))
    assert null_error(dataclasses.replace(solution, rims=(slid,))) > 1e-2


def test_files_of_a_batch_hold_one_loop_each(tmp_path: Path):
    folder = batches.write_files(tmp_path / "in", 2, batches.smooth)
    for seed, path in enumerate(sorted(folder.iterdir())):
        file = read_mesh(path)
        (curve,) = file.polylines
        np.testing.assert_array_equal(file.mesh.vertices[curve[:-1]], batches.smooth_loop(seed).points)
    for path in batches.write_files(tmp_path / "cut", 2, batches.cut).iterdir():
        assert len(spinor_geom.boundary_loops(path)) == 1


@pytest.mark.slow
def test_batches_are_measured_and_their_promises_judged():
    shares = {
        "smooth loops, one worker": 4e-3,
        "few inputs": 1e-2,
        "solved only, 64 at once": 0.05,
        "solved only, one by one": 0.05,
    }
    tasks = [task("batch", name, share=share) for name, share in shares.items()]
    done = [{**one, **run_task(one)} for one in tasks]
    assert [record["status"] for record in done] == 4 * ["done"]
    assert done[0]["files_failed"] == 0
    assert 50 < done[0]["worker_mib"] < WORKER_MIB
    assert done[1]["driver_mib"] > 50
    assert all(record["rate"] == pytest.approx(3 / record["seconds"]) for record in done[2:])
    cases = {f.case for f in promises(done)}
    assert cases == {"smooth loops, one worker", "solved only, 64 at once"}
    whole = {**task("batch", "smooth loops"), "status": "done", "rate": 70.0}
    alone = {**whole, "case": "smooth loops, one worker", "rate": 40.0}
    assert kept("loops per second", whole, alone)
    assert kept("that of one worker", whole, alone) is False
