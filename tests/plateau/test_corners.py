"""Corners of Ω and of Γ that belong together."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.domain import PlaneDomain
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.corners import CornerPairs, ModulusFields
from tests.loops import CONVEX, L_SHAPE, planar

FLAT = np.array([1, 1j, 0])


def domain_over(corners, edges=60):
    loop = planar(corners, edges)
    return PlaneDomain.from_boundary(loop.points @ FLAT, loop.corners)


@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE], ids=["convex", "L"])
def test_fields_for_the_moduli_are_conformal_at_the_corners(corners):
    domain = domain_over(corners)
    fields = ModulusFields.of(domain)
    corner = domain.boundary.vertices[domain.boundary.corners]
    h = 1e-6
    # v = conj(g): ∂v/∂z̄ = conj(g′), which vanishes at the corners
    by_x = (fields(corner + h) - fields(corner - h)) / (2 * h)
    by_y = (fields(corner + 1j * h) - fields(corner - 1j * h)) / (2 * h)
    assert np.abs(by_x + 1j * by_y).max() < 1e-5
    # n corners have n − 3 moduli
    assert by_x.shape[1] >= len(corner) - 3
    assert np.abs(fields(domain.boundary.vertices)).max() <= domain.diameter * (1 + 1e-12)
    assert np.linalg.matrix_rank(np.concatenate([fields(corner).real, fields(corner).imag])) == by_x.shape[1]


def test_three_corners_have_no_moduli():
    triangle = domain_over([(0, 0), (2, 0), (0.5, 1.5)])
    fields = ModulusFields.of(triangle)
    assert fields(triangle.boundary.vertices).shape == (len(triangle.boundary.vertices), 0)
    assert ModulusFields.of(PlaneDomain.disk()).potentials == ()


def test_moved_domain_keeps_its_corners_angles():
    square = domain_over([(0, 0), (1, 0), (1, 1), (0, 1)], 80)
    moved = ModulusFields.of(square).moved(square, np.array([0.05, 0.02]))
    t = moved.boundary.parameters[:-1][moved.boundary.corners]
    assert np.abs(moved.boundary.vertices - square.boundary.vertices).max() > 1e-3
    turn = np.angle(moved.boundary.derivative(t + 1e-9) / moved.boundary.derivative(t - 1e-9))
    # the sides become curved; the spline through 20 edges turns at the corner by the right angle to its own error
    np.testing.assert_allclose(turn, np.pi / 2, atol=2e-3)


def test_nodes_stay_on_their_side():
    pairs = CornerPairs(t=np.array([0.1, 0.4, 0.8]), s=np.array([0.2, 0.5, 0.7]))
    low, high = pairs.slide_bounds(np.array([0.05, 0.2, 0.5, 0.9])).T
    np.testing.assert_allclose(low, [-0.3, 0.2, 0.5, 0.7], atol=1e-12)
    np.testing.assert_allclose(high, [0.2, 0.5, 0.7, 1.2], atol=1e-12)
    nothing = CornerPairs(t=np.empty(0), s=np.empty(0)).slide_bounds(np.array([0.3]))
    assert nothing.tolist() == [[-np.inf, np.inf]]


@pytest.mark.parametrize(
    "curve", [gallery.schwarz_d_quadrilateral(), gallery.schwarz_d_hexagon(), gallery.scherk(2.0)], ids=lambda c: c.name
)
def test_corners_of_the_surface_lie_on_those_of_the_loop(curve):
    solution = solve_plateau(curve.sample(64), tolerance=1e-4)
    assert solution.converged
    assert solution.stability.verdict == "stable"
    assert abs(solution.area / curve.disks[0].area - 1) < 1e-5
    boundary = solution.domain.boundary
    corners = solution.surface.position(boundary.vertices[boundary.corners])
    gap = np.linalg.norm(corners - solution.loop.points[solution.loop.corners], axis=1)
    assert gap.max() < 1e-2 * solution.loop.mean_edge_length
