"""Several disks of one loop: known ones are found, unstable ones are replaced, and failures are reported."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import DomainError, FirstFillError, OutOfTimeError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import PlateauSolution, Stability, disk_search, plan, solve_plateau
from spinor_geom.plateau.disk_search import ThinnedLoop, find_disks, lower_beside, replace_unstable
from spinor_geom.plateau.network import network_route
from spinor_geom.plateau.steps import Steps
from tests.exact_solutions import ENNEPER, exact_solution, with_stability
from tests.plateau.solved import distance_to_surface

# What the spline through so many points leaves of the curve's own area, relative to it.
SPLINE = 2e-6
UNSTABLE = Stability(verdict="unstable", eigenvalue=0.9, index=1, total_curvature=7.0)


def seam(a: float, points: int = 100) -> BoundaryLoop:
    return gallery.tennis_seam(a).sample(points)


@cache
def all_disks(kind: str, parameter: float, points: int = 100) -> tuple[PlateauSolution, ...]:
    loop = seam(parameter, points) if kind == "seam" else gallery.enneper(parameter).rim(points)
    return solve_plateau(loop, all_solutions=True)


def start_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the solver start from the harmonic disk over a plane one, which leads to symmetric disks."""

    def round_disk(points):
        return ThinnedLoop(loop=BoundaryLoop.from_points(points), indices=np.arange(len(points))).round_disk()

    monkeypatch.setattr(network_route, "first_disk", round_disk)


def solver_of(loop: BoundaryLoop, monkeypatch: pytest.MonkeyPatch):
    """The rim of a loop, and the function that solves from a discrete disk over it."""
    handed = []
    monkeypatch.setattr(plan, "find_disks", lambda rim, function: handed.extend([rim, function]) or ())
    solve_plateau(loop, all_solutions=True)
    return handed


def is_area(found: float, known: float, error: float = SPLINE) -> bool:
    return abs(found / known - 1) < error


# --- known lists ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("a", [*(pytest.param(a, marks=pytest.mark.slow) for a in (0.76, 0.6)), 0.75])
def test_tennis_seams_below_the_threshold_bound_two_stable_disks_and_a_symmetric_one(a):
    stable, symmetric = gallery.tennis_seam(a).disks
    found = all_disks("seam", a, 128 if a == 0.6 else 100)
    assert [s.stability.verdict for s in found] == ["stable", "stable", "unstable"]
    assert [s.stability.index for s in found] == [0, 0, 1]
    for solution in found[:2]:
        assert is_area(solution.area, stable.area, SPLINE + stable.relative_error)
    assert is_area(found[2].area, symmetric.area)


def test_stable_disks_of_a_tennis_seam_are_images_of_each_other():
    first, second, symmetric = all_disks("seam", 0.75)
    turned = first.surface.position(first.domain.triangulation.points[first.domain.triangulation.boundary_size :])
    turned = turned @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, -1]])  # the seam's own rotary reflection
    assert distance_to_surface(turned, second.surface).max() < 1e-4
    assert distance_to_surface(turned, symmetric.surface).max() > 0.01
    assert distance_to_surface(turned, first.surface).max() > 0.01


@pytest.mark.parametrize(("kind", "parameter"), [("seam", 0.8), ("Enneper", 0.9)])
def test_loops_with_one_disk_have_one(kind, parameter):
    (only,) = all_disks(kind, parameter)
    area = gallery.tennis_seam(0.8).disks[0].area if kind == "seam" else gallery.enneper(0.9).area
    assert only.stability.verdict == "stable"
    assert only.stability.index == 0
    assert is_area(only.area, area)


# --- ways to other disks ----------------------------------------------------------------------------------------------


def test_ridge_between_two_stable_disks_leads_to_the_saddle(monkeypatch):
    rim, function = solver_of(seam(0.75, 64), monkeypatch)
    search = disk_search._Search(rim=rim, solve=function)
    search.start(partial(first_disk, rim.points))
    # mirrored in the harmonic disk, which is beside the saddle
    middle = rim.round_disk()
    first = rim.round_positions(search.entries[0].solution)
    search.start(lambda: replace(middle, vertices=2 * middle.vertices - first))
    (pair,) = list(search.open_pairs())
    search.start(partial(search.ridge, *pair))
    assert [s.stability.index for s in search.result()] == [0, 0, 1]


# --- unstable ---------------------------------------------------------------------------------------------------------


def test_unstable_disk_is_kept_on_request_and_left_otherwise(monkeypatch):
    start_round(monkeypatch)
    stable, symmetric = gallery.tennis_seam(0.75).disks
    kept = solve_plateau(seam(0.75), model="cauchy", unstable="keep")
    assert kept.stability.verdict == "unstable"
    assert kept.stability.index == 1
    assert is_area(kept.area, symmetric.area)
    steps = []
    left = solve_plateau(seam(0.75), model="cauchy", on_iteration=steps.append)
    assert left.stability.verdict == "stable"
    assert left.converged
    assert is_area(left.area, stable.area)
    # the steps and times of the disk that was left count
    assert tuple(steps) == left.history
    assert left.history[: len(kept.history)] == kept.history
    assert [step.index for step in left.history] == list(range(1, len(left.history) + 1))
    assert left.timings["unstable"] > 0
    assert f"replaces an unstable surface of {kept.area / left.area:.6g} times the area" in left.reason


def test_limit_on_steps_holds_for_replacements(monkeypatch):
    start_round(monkeypatch)
    loop = seam(0.75, 64)
    kept = solve_plateau(loop, model="cauchy", unstable="keep")
    solution = solve_plateau(loop, model="cauchy", max_iterations=len(kept.history))
    assert solution.stability.verdict == "unstable"
    assert solution.history == kept.history
    assert "no better one was found" in solution.reason


def test_disk_without_time_for_its_stability_is_returned(monkeypatch):
    monkeypatch.setattr(PlateauSolution, "stability", property(_without_time))
    assert "before its stability was computed" in solve_plateau(seam(0.75, 64), between="quintic").reason


def unstable_ennepers_disk() -> tuple[PlateauSolution, ThinnedLoop]:
    exact = exact_solution(((1, 0), (0, 1.2)), 64)
    return with_stability(exact, UNSTABLE), ThinnedLoop(loop=exact.loop, indices=np.arange(64))


def left(solution: PlateauSolution, rim: ThinnedLoop, solve_from) -> PlateauSolution:
    lower = partial(lower_beside, rim=rim, solve=solve_from, steps=Steps(limit=9))
    return replace_unstable(solution, lower, "along its eigenvectors")


def test_stable_disk_comes_back_as_it_is():
    exact = exact_solution(ENNEPER, 64)
    assert left(exact, ThinnedLoop(loop=exact.loop, indices=np.arange(64)), _fails) is exact


def test_disk_that_cannot_be_left_comes_back_with_the_reason():
    unstable, rim = unstable_ennepers_disk()
    solution = left(unstable, rim, _fails)
    assert solution.surface is unstable.surface
    assert solution.stability is UNSTABLE
    assert "no better one was found along its eigenvectors" in solution.reason


def test_lower_disk_far_from_the_loop_is_no_better_one():
    unstable, rim = unstable_ennepers_disk()
    tries = []

    def poor(disk):
        tries.append(disk)
        residual = replace(unstable.boundary_residual, rms=1e-3)
        return replace(unstable, area=0.9 * unstable.area, converged=False, boundary_residual=residual)

    assert left(unstable, rim, poor).surface is unstable.surface
    assert len(tries) == 2  # one to each side


def test_disks_beside_an_unstable_one_lie_on_its_two_sides():
    unstable, rim = unstable_ennepers_disk()
    up, down = (next(direction) for direction in disk_search._displaced(unstable, rim))
    for disk in (up, down):
        assert np.array_equal(disk.vertices[:64], rim.points)
        assert disk.areas[-1] < 0.9999 * unstable.area
    middle = unstable.surface.position(rim.domain_mesh(unstable).points)
    normal = unstable.surface.normal(rim.domain_mesh(unstable).points)
    along_up, along_down = (((disk.vertices - middle) * normal).sum(axis=1)[64:].mean() for disk in (up, down))
    assert along_up > 0.01
    assert along_down < -0.01


# --- what fails -------------------------------------------------------------------------------------------------------


def _without_time(_):
    raise OutOfTimeError


def _fails(disk):
    raise DomainError("folded")


def test_search_in_which_nothing_is_found_raises_the_first_error(monkeypatch):
    rim = ThinnedLoop(loop=seam(0.75, 32), indices=np.arange(32))
    with pytest.raises(DomainError, match="folded"):
        find_disks(rim, _fails)

    def no_fill(points):
        raise FirstFillError("no fill")

    monkeypatch.setattr(disk_search, "first_disk", no_fill)
    with pytest.raises(FirstFillError, match="no fill"):
        find_disks(rim, _fails)


@pytest.mark.parametrize("radius", [1.1, pytest.param(1.5, marks=pytest.mark.slow)])
def test_ennepers_own_disk_is_the_unstable_one_of_three(radius):
    *stable, own = all_disks("Enneper", radius)
    assert [s.stability.index for s in stable] == [0, 0]
    assert own.stability.verdict == "unstable"
    assert own.stability.index == 1
    assert is_area(own.area, gallery.enneper(radius).area)
    assert is_area(stable[0].area, stable[1].area, 1e-7)
    assert stable[0].area < own.area


@pytest.mark.parametrize("radius", [1.02, pytest.param(1.5, marks=pytest.mark.slow)])
def test_ennepers_disk_is_left_near_and_far_from_its_threshold(monkeypatch, radius):
    start_round(monkeypatch)
    solution = solve_plateau(gallery.enneper(radius).rim(64), model="cauchy")
    assert solution.stability.verdict == "stable"
    assert solution.converged
    assert solution.area < (1 - 1e-4) * gallery.enneper(radius).area
