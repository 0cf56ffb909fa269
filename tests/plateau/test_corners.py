"""Corresponding corners of Ω and Γ."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.domain import PlaneDomain
from spinor_geom.domain.plane_domain import SplineBoundary, panel_breaks
from spinor_geom.domain.quadrature import Panels
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.poles import edge_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.network.discretisation import ModulusFields
from spinor_geom.plateau.network.network_problem import path_across, slide_bounds
from tests.loops import CONVEX, L_SHAPE, planar
from tests.systems import every_second

FLAT = np.array([1, 1j, 0])


def domain_over(corners, edges=60):
    loop = planar(corners, edges)
    return PlaneDomain.from_boundary(loop.points @ FLAT, loop.corners)


def panels_on(domain):
    return Panels.around(domain, tuple(map(panel_breaks, domain.boundaries)), 8)


def fields_on(domain, panels):
    """The fields made of polynomials and of a pole beside each vertex, as fits make them."""
    poles, z = edge_poles(domain), np.asarray(panels.z)
    paths = [path_across(domain, hole)[0] for hole in range(len(domain.holes))]
    features = CauchyNetwork.orthonormal_on(
        z, np.asarray(panels.arc_weights), poles=np.asarray(poles.positions), scales=np.asarray(poles.scales), degree=8
    ).features(np.asarray(np.concatenate([panels.z, *paths])))
    return ModulusFields.of_corners(domain, panels, features)


def slopes(fields, panels):
    """g' of the fields conj(g), at the middle of neighbouring nodes; one field a column."""
    return np.diff(np.conj(fields.nodes), axis=0) / np.diff(panels.z)[:, None]


def square_ring():
    """A square with a turned square hole."""
    outer = domain_over([(0, 0), (1, 0), (1, 1), (0, 1)], 32).boundary
    hole = outer.vertices[::-1] * 0.4 * np.exp(0.3j)
    hole += np.mean(outer.vertices) - hole.mean()
    return PlaneDomain.inside(outer, holes=(SplineBoundary.through(hole, outer.corners[::-1]),))


DOMAINS = {"convex": (domain_over(CONVEX), 2), "L": (domain_over(L_SHAPE), 3), "ring": (square_ring(), 8)}


@pytest.mark.parametrize(("domain", "moduli"), DOMAINS.values(), ids=DOMAINS)
def test_fields_for_the_moduli_are_conformal_at_the_corners(domain, moduli):
    panels = panels_on(domain)
    fields = fields_on(domain, panels)
    slope = slopes(fields, panels)
    corner = domain.vertices[domain.corners]
    distance = np.abs(panels.z[1:, None] - corner).min(axis=1)
    near = distance < 1e-4
    # v = conj(g): ∂v/∂z̄ = conj(g'), which vanishes at the corners
    assert np.count_nonzero(near) >= 4 * len(corner)
    assert np.abs(slope[near]).max() < 1e-2 * np.abs(slope).max()


@pytest.mark.parametrize(("domain", "moduli"), DOMAINS.values(), ids=DOMAINS)
def test_there_is_a_field_for_each_modulus(domain, moduli):
    panels = panels_on(domain)
    fields = fields_on(domain, panels)
    assert fields.vertices.shape == (len(domain.vertices), moduli)
    assert np.abs(fields.vertices).max() <= domain.diameter * (1 + 1e-12)
    assert np.linalg.cond(np.concatenate([fields.vertices.real, fields.vertices.imag])) < 10
    # nodes right beside a vertex move as it does: nodes and vertices are the same fields
    beside = np.searchsorted(panels.t, domain.arcs[:, 0])
    np.testing.assert_allclose(fields.nodes[beside], fields.vertices, atol=0.05 * domain.diameter)


def test_field_of_a_winding_strip_stretches_it_along_its_length():
    angle = np.linspace(0, 1.8 * np.pi, 80)
    strip = np.concatenate([1.1 * np.exp(1j * angle), 0.9 * np.exp(1j * angle[::-1])])
    corners = np.isin(np.arange(160), [0, 79, 80, 159])
    domain = PlaneDomain.from_boundary(strip, corners)
    panels = panels_on(domain)
    slope = slopes(fields_on(domain, panels), panels)[:, 0]
    tangent = np.diff(panels.z) / np.abs(np.diff(panels.z))
    # ∂v/∂s along the boundary's tangent is conj(g'τ²): the strain
    strain = np.conj(slope * tangent**2)
    ends = strip[corners]
    inside = (np.abs(panels.z[1:, None] - ends).min(axis=1) > 0.3) & (np.abs(np.diff(panels.z)) > 1e-6)
    sign = np.sign(strain[inside].real.sum())
    assert (sign * strain[inside].real).min() > 0
    assert np.abs(strain[inside].imag).max() < 0.1 * np.abs(strain[inside].real).max()


def test_moved_domain_keeps_its_corners_angles():
    square = domain_over([(0, 0), (1, 0), (1, 1), (0, 1)], 80)
    moved = fields_on(square, panels_on(square)).moved(square, np.array([0.05]))
    t = moved.boundary.parameters[:-1][moved.boundary.corners]
    assert np.abs(moved.boundary.vertices - square.boundary.vertices).max() > 1e-3
    turn = np.angle(moved.boundary.derivative(t + 1e-9) / moved.boundary.derivative(t - 1e-9))
    # the sides become curved. The spline through 20 edges turns at the corner by the right angle to its own error
    np.testing.assert_allclose(turn, np.pi / 2, atol=2e-2)


def test_nodes_stay_on_their_side():
    boundary = domain_over([(0, 0), (2, 0), (0.5, 1.5)]).boundary
    first, second, third = boundary.parameters[:-1][boundary.corners]
    nodes = np.array([(first + second) / 2, (second + third) / 2, (third + 1) / 2])
    bounds = slide_bounds(boundary, np.array([0.2, 0.5, 0.7]), nodes)
    np.testing.assert_allclose(bounds, [[0.2, 0.5], [0.5, 0.7], [0.7, 1.2]], atol=1e-12)
    assert slide_bounds(boundary, np.empty(0), np.array([0.3])).tolist() == [[-np.inf, np.inf]]


@pytest.mark.parametrize(
    "curve",
    every_second([gallery.schwarz_d_quadrilateral(), gallery.schwarz_d_hexagon(), gallery.scherk(2.0)]),
    ids=lambda c: c.name,
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


def test_moduli_are_found_where_a_fit_is_near_at_its_nodes_alone():
    curve = gallery.schwarz_d_hexagon()
    # five or six edges a side: the nodes are met within the tolerance before the moduli are right
    solution = solve_plateau(curve.sample(32))
    assert solution.converged
    assert abs(solution.area / curve.disks[0].area - 1) < 2e-6


def test_moduli_are_right_where_a_fit_met_the_tolerance_without():
    known = gallery.schwarz_h(0.3)
    assert abs(solve_plateau(known.rim(64)).area / known.area - 1) < 1e-8


def test_a_polygon_given_by_its_corners_alone_is_met():
    known = gallery.schwarz_d_quadrilateral()
    corners = known.point(np.array(known.corners))
    solution = solve_plateau(BoundaryLoop.from_points(corners, corners=range(len(corners))))
    assert solution.converged
    assert len(solution.loop) == len(corners)
    assert abs(solution.area / known.disks[0].area - 1) < 1e-6
    at_corners = solution.surface.position(solution.loop_points_in_domain())
    np.testing.assert_allclose(at_corners, corners, atol=1e-4)
