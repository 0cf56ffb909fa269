"""Refinement, and the reasons given for fits that miss their tolerance."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.arrays import NUMPY
from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import DomainError, SingularMatrixError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network import discretisation, network_route
from spinor_geom.plateau.network.discretisation import Discretisation
from spinor_geom.plateau.network.gauss_newton import Fit
from spinor_geom.plateau.options import Cauchy
from tests.loops import noisy_ellipse

POLES = 48


@pytest.fixture(scope="module")
def stage():
    """A network beside Enneper's disk."""
    curve = CurveTensors.of(BoundaryCurve.from_loop(gallery.enneper(0.8).rim(96)), NUMPY)
    nothing = (np.empty(0),)
    return Discretisation.first(PlaneDomain.disk(0.8, POLES), (curve,), nothing, degree=12, offset=1.0, at_corner=9)


def fit_of(stage, p, q):
    """A fit with given p and q at the nodes."""
    return Fit.at(stage.problem, stage.readout_of(np.stack([p, q], axis=-1)), np.asarray(stage.panels.t))


def test_refinement_adds_where_the_residual_is_and_keeps_the_fit(stage):
    z = np.asarray(stage.panels.z)
    fit = fit_of(stage, np.ones_like(z), z + 0.02 / (z - 1.0))
    energy = np.zeros(len(stage.panels.breaks) - 1)
    energy[7] = 1e-10
    finer = stage.refined(energy, 1e-8)
    assert POLES < len(finer.poles.positions) <= POLES + 3
    assert len(finer.panels.breaks) == len(stage.panels.breaks) + 1
    readout, slide = finer.transferred(stage, fit)
    z = np.array([0.1 + 0.2j, -0.3j])
    difference = finer.network.features(z) @ readout - stage.network.features(z) @ fit.readout
    assert float(np.abs(difference).max()) < 1e-5
    np.testing.assert_allclose(slide, finer.panels.t, atol=1e-12)


def test_share_at_corners_counts_the_edges_that_end_there():
    corners = np.isin(np.arange(12), [0, 3, 6, 9])
    x, y, _ = gallery.polygon([(0, 0, 0), (3, 0, 0), (3, 3, 0), (0, 3, 0)]).sample(12).points.T
    domain = PlaneDomain.from_boundary(x + 1j * y, corners)
    curve = CurveTensors.of(BoundaryCurve.from_loop(gallery.enneper(0.8).rim(12)), NUMPY)
    pairs = np.arange(4) / 4
    stage = Discretisation.first(domain, (curve,), (pairs,), degree=4, offset=1.0, at_corner=9)
    # of the three edges of each side the middle one ends at no corner. Each edge has its length as its energy
    assert stage.share_at_corners(np.diff(stage.panels.breaks)) == pytest.approx(2 / 3)


@pytest.fixture
def small_networks(monkeypatch):
    """Networks of few features: fits that end for another reason end in the same way, in less time."""
    monkeypatch.setattr(discretisation, "_MAX_FEATURES", 60)


@pytest.mark.usefixtures("small_networks")
def test_rough_loop_is_reported_to_limit_a_full_network():
    solution = solve_plateau(noisy_ellipse(40, amount=0.3), tolerance=1e-12, model=Cauchy(degree=4))
    assert not solution.converged
    assert "the network has the largest number of features" in solution.reason
    assert "the loop is rough: its points are 0.44 edges from cubics through their neighbours" in solution.reason


@pytest.mark.usefixtures("small_networks")
@pytest.mark.parametrize("error", [DomainError("folded"), SingularMatrixError(size=3)], ids=["domain", "matrix"])
def test_first_fit_stands_where_no_finer_disk_can_be_made(monkeypatch, error):
    def fails(*_):
        fails.called = True
        raise error

    monkeypatch.setattr(network_route, "finer_disk", fails)
    solution = solve_plateau(gallery.l_shape(0.5).sample(32), model="cauchy", tolerance=1e-13)
    assert fails.called
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-2  # of a small network


@pytest.mark.slow
def test_reentrant_corners_meet_small_tolerances():
    curve = gallery.l_shape(rise=0.5)
    solution = solve_plateau(curve, tolerance=1e-6)
    assert solution.boundary_residual.rms_per_edge < 3e-6
    # 7e-6 without the opening of the corner, at which p and q are singular
    assert solution.boundary_residual.max < 1e-6 * solution.loop.diagonal
