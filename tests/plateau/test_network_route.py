"""The surface of a fit: its paths avoid the poles, and the residual contains the error of paths that do not."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.network import network_route
from spinor_geom.plateau.network.network_route import NetworkSolver
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem


@pytest.mark.parametrize("order", [1, 2])
def test_residual_contains_the_errors_of_the_surface_s_paths(monkeypatch, order):
    monkeypatch.setattr(network_route, "PATH_ORDER", order)
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
    network = NetworkSolver(problem=PlateauProblem.of([loop], Options()))
    # a ninth of its points are corners of 90°: with them it would count as rough
    assert not network._is_rough
