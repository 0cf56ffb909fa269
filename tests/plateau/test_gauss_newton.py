"""The boundary integrals of the problem, their derivatives, and the iteration on a problem with a known answer."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.arrays import NUMPY
from spinor_geom.domain import PlaneDomain
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network.discretisation import Discretisation
from spinor_geom.plateau.network.gauss_newton import gauss_newton
from spinor_geom.plateau.steps import Steps

KNOWN = gallery.enneper(0.8)
LOOP = KNOWN.rim(96)
DOMAIN = PlaneDomain.disk(0.8, 48)
NO_CORNERS = (np.empty(0),)


@pytest.fixture(scope="module")
def stage():
    curve = CurveTensors.of(BoundaryCurve.from_loop(LOOP), NUMPY)
    return Discretisation.first(DOMAIN, (curve,), NO_CORNERS, degree=12, offset=1.0, at_corner=9)


def exact_readout(stage):
    z = np.asarray(stage.panels.z)
    return stage.readout_of(np.stack([np.ones_like(z), z], axis=-1))


def test_equations_outnumber_unknowns(stage):
    unknowns = 4 * stage.network.mixing.shape[0]
    assert 2 * len(stage.panels.t) >= 1.5 * unknowns


def test_positions_equal_the_closed_formula_up_to_a_constant(stage):
    found = stage.problem.positions(exact_readout(stage))
    expected = KNOWN.position(stage.panels.z)
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-10)


def test_integral_around_the_boundary_vanishes(stage):
    f = stage.problem.null_curve(exact_readout(stage)) * stage.problem.dz[:, None]
    total = (stage.problem.weights[:, None] * f).sum(0)
    assert float(np.abs(total).max()) < 1e-11


def test_curve_tensors_equal_the_curve(stage):
    curve = BoundaryCurve.from_loop(LOOP)
    s = np.random.default_rng(0).uniform(-1, 2, 50)
    point, tangent = stage.problem.curves[0].point_and_derivative(np.asarray(s))
    np.testing.assert_allclose(point, curve.point(s), atol=1e-13)
    np.testing.assert_allclose(tangent, curve.derivative(s), atol=1e-10)


def fitted(stage, disturbance, **options):
    rng = np.random.default_rng(0)
    readout = exact_readout(stage)
    noise = np.asarray(rng.normal(size=readout.shape) + 1j * rng.normal(size=readout.shape))
    given = {"allowed": 1e-7, "steps": Steps(limit=40)} | options
    slide = np.asarray(stage.panels.t)
    return gauss_newton(stage.problem, readout + disturbance * noise, slide, **given)


def test_iteration_finds_the_known_surface_from_a_disturbed_start(stage):
    steps = Steps(limit=40)
    fit = fitted(stage, 1e-3, steps=steps)
    residuals = [step.residual for step in steps.history]
    assert (np.diff(residuals) < 0).all()
    # what is left is the spline's distance from the exact rim
    assert fit.residual < 1e-6
    found = stage.problem.positions(fit.readout) + fit.constant
    expected, _ = stage.problem.point_and_derivative(fit.slide)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_slide_stays_increasing(stage):
    fit = fitted(stage, 3e-2)
    assert float(np.diff(fit.slide).min()) > -1e-14
    assert float(fit.slide[-1] - fit.slide[0]) <= 1


def test_limit_on_steps_and_numbering(stage):
    steps = Steps(limit=6)
    for _ in range(4):
        steps.take("Newton", 1.0)
    fitted(stage, 1e-3, steps=steps)
    assert [(step.index, step.method) for step in steps.history[4:]] == [(5, "Gauss-Newton"), (6, "Gauss-Newton")]
