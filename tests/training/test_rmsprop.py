"""The paper's Algorithm 1: the loss falls, divergence is reported."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import OptionError
from spinor_geom.gallery import curves
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.training import RMSprop, rmsprop, train_by_rmsprop
from spinor_geom.training.boundary import FORMS, RayBoundary
from spinor_geom.training.rmsprop import _Training

CURVE = curves.twisted_circle()
# a small network with large steps: the paper's takes an hour
SMALL = RMSprop(depth=2, width=8, learning_rate=2e-3, batch=64, points=256, order=16, epochs=12)


@pytest.fixture(scope="module")
def whole():
    return train_by_rmsprop(CURVE, options=SMALL)


def test_the_boundary_comes_near_to_the_curve(whole):
    result = whole
    assert result.status == "finished"
    assert len(result.history) == SMALL.epochs
    losses = [step.loss for step in result.history]
    assert losses[-1] < 0.05 * losses[0]
    assert result.misfit.max == result.history[-1].boundary_error < 0.25 * result.history[0].boundary_error
    assert isinstance(result.surface, SpinorSurface)
    assert (np.diff(result.matching, axis=0) > 0).all()


def test_the_reported_distance_is_that_of_the_surface(whole):
    t = np.arange(512) / 512
    r = whole.surface.position(np.exp(2j * np.pi * t))
    gamma = CURVE.point(np.arange(4096) / 4096)
    away = np.linalg.norm(r[:, None] - gamma, axis=-1).min(axis=1)
    # the trapezoidal rule in training, and the exact surface here
    assert away.max() <= whole.misfit.max + 0.01 * whole.diagonal
    assert abs(np.sqrt(np.mean(away**2)) - whole.misfit.rms) < 0.01 * whole.diagonal


def test_a_surface_that_has_collapsed_to_a_point_of_the_curve_is_far_from_it():
    training = _Training(BoundaryCurve.from_formula(CURVE), SMALL, torch.device("cpu"))
    with torch.no_grad():
        for parameter in training.boundary.network.parameters():
            parameter.zero_()
        training.boundary.constant.copy_(torch.tensor(CURVE.point(np.array(0.0))))
    result = training._result("finished", "all epochs were done", 0.0)
    gamma = CURVE.point(np.arange(4096) / 4096)
    away = np.linalg.norm(gamma - CURVE.point(np.array(0.0)), axis=1)
    speed = np.linalg.norm(CURVE.derivative(np.arange(4096) / 4096), axis=1)
    # between two points of the boundary Γ is sampled at a few points
    assert result.misfit.rms == pytest.approx(np.sqrt(speed @ away**2 / speed.sum()), rel=0.05)
    assert result.misfit.max == pytest.approx(away.max(), rel=0.05)


def test_seconds_are_those_of_the_training_alone(monkeypatch):
    clock = [0.0]

    def takes(seconds, method):
        def timed(self, *arguments):
            clock[0] += seconds
            return method(self, *arguments)

        return timed

    monkeypatch.setattr(rmsprop.time, "perf_counter", lambda: clock[0])
    for name, seconds in (("_epoch", 1.0), ("_diverged", 100.0)):
        monkeypatch.setattr(rmsprop._Training, name, takes(seconds, getattr(rmsprop._Training, name)))
    result = train_by_rmsprop(CURVE, options=replace(SMALL, epochs=3))
    assert [step.seconds for step in result.history] == [1.0, 2.0, 3.0]
    assert result.seconds == 3.0


@pytest.mark.parametrize("learning_rate", [0.5, 1e3])
def test_divergence_is_a_status_and_the_surface_is_finite(learning_rate):
    result = train_by_rmsprop(CURVE, options=replace(SMALL, learning_rate=learning_rate, epochs=50))
    assert result.status == "diverged"
    assert "smaller learning rate" in result.reason
    assert len(result.history) < 50
    assert all(np.isfinite(step.loss) for step in result.history)
    assert np.isfinite(result.surface.position(np.array([0.5j, 1.0]))).all()
    assert np.isfinite(result.misfit.max)


@pytest.mark.parametrize("name", FORMS)
def test_a_boundary_that_moves_has_the_derivatives_of_its_own_curve(name):
    network = ComplexMLP(depth=2, width=5, generator=torch.Generator().manual_seed(0))
    boundary = RayBoundary(network, np.zeros(3), name, rule("gauss", 40))
    s, step = torch.linspace(0, 1, 9, dtype=torch.float64)[:-1].requires_grad_(), 1e-6
    with torch.no_grad():
        (r0, v0), (r1, v1) = (boundary.point_and_velocity(s + way * step) for way in (-1, 1))
        values = boundary.differentiable_point_and_velocity(s)
        for value, own in zip(values, boundary.point_and_velocity(s), strict=True):
            torch.testing.assert_close(value, own, rtol=0, atol=1e-14)
    slopes = (r1 - r0) / (2 * step), (v1 - v0) / (2 * step)
    for value, other in zip(boundary.differentiable_point_and_velocity(s), slopes, strict=True):
        (by_s,) = torch.autograd.grad(value[:, 0].sum(), s, retain_graph=True)
        torch.testing.assert_close(by_s, other[:, 0], rtol=1e-6, atol=1e-6)


BAD = [{"epochs": -1}, {"points": 10}, {"batch": np.nan}, {"learning_rate": 0.0}, {"tangent_weight": -1.0}]
BAD += [{"representation": "weierstrass"}, {"quadrature": "simpson", "order": 3}]


@pytest.mark.parametrize("options", BAD)
def test_bad_options_are_refused(options):
    with pytest.raises(OptionError):
        RMSprop(**options)
