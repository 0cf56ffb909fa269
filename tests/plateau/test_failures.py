"""Problems that cannot be solved end, or raise a typed error: singular equations, numbers that are not finite."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from spinor_geom import gallery
from spinor_geom.arrays import NUMPY
from spinor_geom.deadline import time_limit
from spinor_geom.errors import SingularMatrixError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau, solve_plateau_batch
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.harmonic_route import FLATTENING, UNIT_DISK, HarmonicSolver
from spinor_geom.plateau.network.discretisation import Discretisation
from spinor_geom.plateau.network.gauss_newton import gauss_newton
from spinor_geom.plateau.network.network_route import NetworkSolver
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plan import nearest_surface
from spinor_geom.plateau.problem import PlateauProblem, Route
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.threads import one_thread
from spinor_geom.plateau.vertices import vertex_route
from tests.loops import noisy_ellipse
from tests.strategies import SEEDS

SMOOTH = gallery.enneper(0.8).rim(24)


def singular(*_: object, **__: object) -> None:
    raise np.linalg.LinAlgError("k-th leading minor of the array is not positive definite")


def singular_in_torch(*_: object, **__: object) -> None:
    import torch

    torch.linalg.cholesky(torch.zeros(2, 2))


@pytest.mark.parametrize("fail", [singular, singular_in_torch])
def test_singular_equations_are_a_typed_error_and_other_routes_are_tried(
    monkeypatch: pytest.MonkeyPatch, fail: Callable[..., None]
) -> None:
    monkeypatch.setattr(HarmonicSolver, "_fitted", fail)
    monkeypatch.setattr(vertex_route, "_fitted", fail)
    assert solve_plateau(SMOOTH).route == "network"
    monkeypatch.setattr(NetworkSolver, "solve", fail)
    with pytest.raises(SingularMatrixError, match=r"check the loop"):
        solve_plateau(SMOOTH)
    answers = list(solve_plateau_batch([SMOOTH, noisy_ellipse(40), SMOOTH], between="free"))
    assert all(isinstance(answer, SingularMatrixError) for answer in answers)


@pytest.mark.parametrize("distance", [np.nan, np.inf, 1e24])
def test_a_surface_that_is_farther_from_the_loop_than_its_size_is_none(distance: float) -> None:
    def diverging(problem: PlateauProblem) -> RouteResult:
        found = UNIT_DISK.solve(problem)
        return replace(found, misfit=replace(found.misfit, rms=distance))

    diverged, problem = Route("disk", diverging), PlateauProblem.of([SMOOTH], Options())
    with one_thread():
        assert nearest_surface((diverged, FLATTENING), problem).route == "flattened"
        with pytest.raises(SurfaceError):
            nearest_surface((diverged,), problem)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_gauss_newton_ends_where_the_energy_is_not_finite(value: float) -> None:
    curve = CurveTensors.of(BoundaryCurve.from_loop(SMOOTH), NUMPY)
    domain = gallery.enneper(0.8).surface.domain
    stage = Discretisation.first(domain, (curve,), (np.empty(0),), degree=8, offset=1.0, at_corner=9)
    z = np.asarray(stage.panels.z)
    with one_thread():
        readout = stage.readout_of(np.stack([np.ones_like(z), z], axis=-1)) * value
    slide = np.asarray(np.sort(stage.panels.t % 1))
    steps = Steps(limit=100)
    with one_thread(), time_limit(60.0):  # an endless iteration would reach it
        fit = gauss_newton(stage.problem, readout, slide, allowed=1e-3, steps=steps)
    assert len(steps.history) < 20
    assert not fit.residual < 1


@settings(max_examples=1)
@given(seed=SEEDS)
def test_cracks_hairs_and_coincident_points_raise_nothing_untyped(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(12, 52))
    t = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(t), np.sin(t), random.uniform(0, 0.5) * np.cos(2 * t)], axis=1)
    crack = points * [1, 10.0 ** random.uniform(-8, -3), 1]
    place = int(random.integers(n))
    hair = np.insert(points, place + 1, [1.5 * points[place], points[place] * (1 + 1e-8)], axis=0)
    pairs = points.copy()
    pairs[random.choice(n, 4)] = points[random.choice(n, 4)] + 1e-9 * random.normal(size=(4, 3))
    closed = (crack, hair, pairs)
    loops = [BoundaryLoop(points=p, vertex_ids=np.arange(len(p)), corners=np.zeros(len(p), bool)) for p in closed]
    # a second is enough for most, and what is cut short is typed too
    for options in ({"between": "free"}, {"model": "cauchy"}, {"model": "series"}):
        answers = list(solve_plateau_batch(loops, time_limit=1.0, max_iterations=20, **options))
        assert len(answers) == len(loops)
