"""No loop takes far more work than others of its size: a route that would cost too much gives way to the next."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from spinor_geom import BoundaryLoop, solve_plateau
from spinor_geom.errors import SpinorGeomError
from spinor_geom.plateau.harmonic.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network import network_route
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.solution import PlateauSolution
from tests.systems import every_second


def waist(n: int, width: float) -> BoundaryLoop:
    """A smooth loop that nearly touches itself."""
    t = 2 * np.pi * np.arange(n) / n
    lobes = np.column_stack([np.cos(t), np.sin(t) * (width + np.cos(t) ** 2), 0.2 * np.sin(2 * t)])
    return BoundaryLoop.from_points(lobes, corners=())


def star(n: int, seed: int) -> BoundaryLoop:
    """Spikes of random lengths and heights."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    radius, height = rng.uniform(0.4, 1.6, n), 0.3 * rng.normal(size=n)
    return BoundaryLoop.from_points(np.column_stack([radius * np.cos(t), radius * np.sin(t), height]))


@pytest.mark.parametrize("n", [28, 100, 400])
def test_slides_and_domains_have_at_most_16_nodes_a_point(n: int) -> None:
    # short loops have as many as are quick for any
    assert HarmonicSolver(problem=PlateauProblem.of([waist(n, 0.03)], Options())).most_nodes <= max(1024, 1.01 * 16 * n)


def test_narrow_smooth_loops_keep_the_area_of_their_curve() -> None:
    """A surface through 28 points alone would bulge between them by much of the waist."""
    few, many = (solve_plateau(waist(n, 0.01)) for n in (28, 112))
    assert few.converged
    assert many.converged
    assert abs(few.area / many.area - 1) < 1e-5


@pytest.mark.parametrize("seed", every_second(range(3)))
def test_networks_that_cannot_meet_the_tolerance_do_not_grow_on(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work of a linearisation is the number of features cubed. The largest number takes seconds."""
    fit, work = network_route.gauss_newton, []

    def counted(problem, readout, slide, **options):
        before = options["steps"].left
        found = fit(problem, readout, slide, **options)
        work.append(len(readout) ** 3 * (before - options["steps"].left))
        return found

    monkeypatch.setattr(network_route, "gauss_newton", counted)
    solution = solve_plateau(star(40, seed), between="smooth")
    assert not solution.converged
    assert sum(work) < 3 * 420**3  # three steps with all features


def test_fits_with_more_features_end_at_short_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A twisted strip whose ends are square: its fit with twice the features took five Jacobians and hardly moved."""
    t, s = np.linspace(0, 1, 19), np.array([-1, 1]) / 3
    along, across = np.concatenate([t, [1, 1], t[::-1], [0, 0]]), np.concatenate([np.full(19, -1), s, np.ones(19), -s])
    y, z = 0.04 * across * [np.cos(3 * along), np.sin(3 * along)]
    fit, steps = network_route.gauss_newton, []

    def counted(problem, readout, slide, **options):
        before = options["steps"].left
        found = fit(problem, readout, slide, **options)
        steps.append(before - options["steps"].left if options.get("near") else 0)
        return found

    monkeypatch.setattr(network_route, "gauss_newton", counted)
    strip = np.column_stack([2 * along, 0.3 * np.sin(5 * along) + y, z])
    solve_plateau(BoundaryLoop.from_points(strip, corners=()), tolerance=1e-5)
    assert 1 <= sum(steps) <= 4


@pytest.mark.parametrize("n", range(4, 9))
def test_small_random_polygons_raise_typed_errors_only(n: int) -> None:
    for seed in range(3):
        loop = BoundaryLoop.from_points(np.random.default_rng(seed).uniform(-1, 1, (n, 3)))
        with contextlib.suppress(SpinorGeomError):
            assert isinstance(solve_plateau(loop, max_iterations=60), PlateauSolution)
