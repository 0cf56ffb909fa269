"""Levenberg-Marquardt: networks approximate given p and q, and their surfaces the curve."""

import numpy as np
import pytest
import torch

from spinor_geom import gallery
from spinor_geom.deadline import time_limit
from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.gallery import curves
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.training import LevenbergMarquardt, train_by_levenberg_marquardt
from spinor_geom.training.boundary import BoundaryNodes

CPU = torch.device("cpu")
CURVES = {"twisted circle": curves.twisted_circle(), "tennis seam": curves.tennis_seam(0.8)}


def solved(curve, points=128):
    return solve_plateau(curve.sample(points), tolerance=1e-6)


@pytest.fixture(scope="module")
def solutions():
    return {name: solved(curve) for name, curve in CURVES.items()}


def trained(solution, **options):
    given = {"start": solution.surface, "matching": solution.matching}
    return train_by_levenberg_marquardt(solution.curve, **given, options=LevenbergMarquardt(**options))


def distance(surface, curve, count=500):
    """Largest distance of the boundary from the curve, by positions and nearest points."""
    r = surface.position(surface.domain.boundary.point(np.arange(count) / count))
    return np.linalg.norm(r - curve.point(curve.nearest(r)), axis=1).max()


@pytest.mark.parametrize("name", CURVES)
def test_small_networks_reach_the_paper_curves(name, solutions):
    result = trained(solutions[name])
    assert result.status == "converged"
    assert result.max_per_diagonal < 1e-6
    assert distance(result.surface, solutions[name].curve) < 1.1e-6 * result.diagonal
    assert abs(result.surface.area() / solutions[name].area - 1) < 1e-6


def test_the_result_has_its_steps_and_its_distance(solutions):
    steps = []
    solution = solutions["tennis seam"]
    given = {"start": solution.surface, "matching": solution.matching}
    result = train_by_levenberg_marquardt(solution.curve, **given, on_step=steps.append)
    assert steps == list(result.history)
    assert [step.index for step in steps] == list(range(1, len(steps) + 1))
    losses = [step.loss for step in steps if step.method == "distillation"]
    assert (np.diff(losses) <= 0).all()
    assert losses[-1] < 1e-5 * losses[0]
    assert (np.diff([step.seconds for step in steps]) >= 0).all()
    assert result.misfit.rms < result.misfit.max < 1.1 * distance(result.surface, solution.curve, 2048)
    assert (np.diff(result.matching, axis=0) > 0).all()


def test_a_finger_of_the_curve_that_the_boundary_passes_over_counts():
    height, width = 0.2, 0.002

    def fingered(order):
        """A derivative of the unit circle with a finger too narrow for any node of the boundary."""

        def at(s):
            away = (np.mod(s - 0.5021 + 0.5, 1.0) - 0.5) / width
            finger = (1, -2 * away / width, (4 * away**2 - 2) / width**2)[order] * height * np.exp(-(away**2))
            circle = (2j * np.pi) ** order * np.exp(2j * np.pi * s)
            return np.stack([circle.real, circle.imag, finger], axis=-1)

        return at

    curve = ClosedCurve(point=fingered(0), derivative=fingered(1), second_derivative=fingered(2))
    disk = gallery.plane_disk().surface
    options = LevenbergMarquardt(nodes=16, polishing_steps=0, tolerance=1e-3)
    result = train_by_levenberg_marquardt(curve, start=disk, options=options)
    assert result.status == "stopped"
    assert 0.8 * height < result.misfit.max < 1.01 * height
    plain = train_by_levenberg_marquardt(gallery.curves.ellipse(1.0), start=disk, options=options)
    assert plain.misfit.max < 1e-3 * plain.diagonal


def test_networks_that_are_too_small_stop_with_the_reason(solutions):
    result = trained(solutions["tennis seam"], depth=1, width=4, distillation_steps=5)
    assert result.status == "stopped"
    assert "wider network" in result.reason
    assert np.isfinite(result.misfit.max)


def square():
    side = np.arange(10) / 10
    vertices = np.concatenate([side, 1 + 1j * side, 1 + 1j - side, 1j - 1j * side])
    return PlaneDomain.from_boundary(vertices, np.arange(40) % 10 == 0)


@pytest.mark.parametrize("domain", [PlaneDomain.disk(), square()], ids=["disk", "square"])
def test_positions_at_nodes_are_those_of_the_surface(domain):
    series = PowerSeries(torch.tensor([[1, 0.5j], [0.2, 1], [0.3j, 0]], dtype=torch.complex128))
    surface = SpinorSurface(series, domain)
    nodes = BoundaryNodes.on(domain, 64, CPU)
    with torch.no_grad():
        found = nodes.positions(series.value(nodes.z)).numpy()
    exact = surface.position(nodes.z.numpy())
    np.testing.assert_allclose(found - found[0], exact - exact[0], atol=1e-9)
    assert abs(float(nodes.weights.sum()) - 1) < 1e-14


@pytest.mark.parametrize("options", [{"nodes": 2}, {"nodes": np.inf}, {"tolerance": 0.0}, {"polishing_steps": -1}])
def test_bad_options_are_refused(options):
    with pytest.raises(OptionError, match=next(iter(options))):
        LevenbergMarquardt(**options)


def test_the_reason_names_limits_of_steps_and_of_time(solutions):
    few = {"distillation_steps": 2, "polishing_steps": 2}
    assert trained(solutions["tennis seam"], **few).reason.endswith("the limit of 2 polishing steps was reached")
    with time_limit(1e-9):
        late = trained(solutions["tennis seam"])
    assert late.reason.endswith("after 0 steps: the time limit was reached")
