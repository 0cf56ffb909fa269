"""The surface of a fit: its paths keep clear of the poles, and where they do not the residual tells."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.domain import PlaneDomain
from spinor_geom.holomorphic.poles import Poles
from spinor_geom.plateau import network_route, solve_plateau
from spinor_geom.plateau.network_route import _clear_of_poles
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.task import Task

ANGLES = 2 * np.pi * np.arange(24) / 24


def dented(depth):
    """A circle with a dent between its vertices 0 and 1, and a pole in the dent beside their chord."""
    boundary = PlaneDomain.from_boundary(np.exp(1j * ANGLES) * (1 - depth * (np.arange(24) < 2))).boundary
    middle = boundary.point(boundary.parameters[:2].mean())
    chord = boundary.vertices[:2].mean()
    return PlaneDomain.inside(boundary), chord + 0.1 * (chord - middle), abs(chord - middle)


def test_polygon_keeps_clear_of_a_pole_that_the_boundary_goes_around():
    domain, pole, sagitta = dented(0.3)
    clear = _clear_of_poles(domain, Poles(positions=np.array([pole]), scales=np.ones(1)))
    t = np.linspace(0, 1, 500)
    np.testing.assert_allclose(clear.boundary.point(t), domain.boundary.point(t), atol=1e-14)
    v = clear.boundary.vertices
    along = v[:, None] + (np.roll(v, -1) - v)[:, None] * np.linspace(0, 1, 101)
    assert np.abs(domain.boundary.vertices[:2].mean() - pole) < 0.2 * sagitta
    assert np.abs(along - pole).min() > 0.4 * np.abs(domain.boundary.point(np.linspace(0, 1, 5000)) - pole).min()
    assert len(clear.log_scale) == len(v) > 24


def test_domain_stays_where_poles_are_far():
    domain, _, _ = dented(0.3)
    assert _clear_of_poles(domain, Poles(positions=2 * np.exp(1j * ANGLES), scales=np.ones(24))) is domain


@pytest.mark.parametrize("order", [1, 2])
def test_residual_tells_what_the_surface_s_paths_lose(monkeypatch, order):
    monkeypatch.setattr(network_route, "_PATH_ORDER", order)
    loop = gallery.twisted_circle().sample(48)
    solution = solve_plateau(loop, model="cauchy", max_iterations=20)
    boundary = solution.domain.boundary
    r = solution.surface.position(boundary.point(np.arange(480) / 480))
    away = np.linalg.norm(r - solution.curve.point(solution.curve.nearest(r)), axis=1)
    measured = np.sqrt(np.mean(away**2))
    assert measured > 1e-5 * loop.mean_edge_length
    # the way along Γ is not a distance from it: at most twice as large on this curve
    assert 0.5 * measured < solution.boundary_residual.rms < 4 * measured


def test_corners_do_not_make_a_polygon_rough():
    loop = gallery.schwarz_prism(1.5).sample(64)
    assert np.count_nonzero(loop.corners) == 8
    network = Task.of(loop, Options.checked("auto", 1e-3, 80, "leave", "cpu")).network
    # a ninth of its points are corners of 90°: it would count as ragged, and be spared the second start that it needs
    assert network._turning < 1e-6
