"""Boundary curves, the inside test and the tree of paths of plane domains."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.deadline import time_limit
from spinor_geom.domain import FourierBoundary, PlaneDomain, SplineBoundary
from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.errors import DomainError, DtypeError, OptionError
from tests.loops import L_SHAPE, planar

FLAT = np.array([1, 1j, 0])
ANGLES = 2 * np.pi * np.arange(80) / 80
# three frequencies of either sign, without symmetry
BENT = FourierBoundary(np.array([0.05j, 0.1, 0.2 - 0.1j, 1.0 + 0.5j, 1.2, 0.15 + 0.1j, -0.05]), 72)
DOMAINS = {
    "disk": PlaneDomain.disk(),
    "bent": PlaneDomain.inside(BENT),
    "ellipse": PlaneDomain.from_boundary(8 * np.cos(ANGLES) + 1j * np.sin(ANGLES)),
    "L": PlaneDomain.from_boundary(planar(L_SHAPE, 60).points @ FLAT, planar(L_SHAPE, 60).corners),
    "horseshoe": PlaneDomain.from_boundary(
        np.concatenate([3 * np.exp(2.9j * np.linspace(-1, 1, 60)), 2 * np.exp(2.9j * np.linspace(1, -1, 40))])
    ),
}
every_domain = pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS.keys())


@every_domain
def test_boundary_passes_through_its_vertices_and_repeats_after_one_turn(domain):
    boundary = domain.boundary
    assert isinstance(boundary, Boundary)
    t = boundary.parameters
    assert t[0] == 0
    assert t[-1] == 1
    np.testing.assert_allclose(boundary.point(t[:-1]), boundary.vertices, atol=1e-14)
    np.testing.assert_allclose(boundary.point(t + 3), boundary.point(t), atol=1e-12)


@every_domain
def test_boundary_derivative_equals_difference_quotient(domain):
    t = np.random.default_rng(0).uniform(size=200)
    h = 1e-6
    quotient = (domain.boundary.point(t + h) - domain.boundary.point(t - h)) / (2 * h)
    derivative = domain.boundary.derivative(t)
    # truncation h² and rounding 1e-16/h. A corner nearer than h would show, and there is none
    assert np.abs(quotient - derivative).max() < 1e-7 * np.abs(derivative).max()


def test_spline_with_corners_has_straight_sides():
    square = SplineBoundary.through(np.array([0, 1, 2, 2 + 1j, 2 + 2j, 1 + 2j, 2j, 1j]), np.arange(8) % 2 == 0)
    t = np.linspace(0, 1, 400, endpoint=False)
    z = square.point(t)
    distance = np.minimum(np.minimum(z.real, 2 - z.real), np.minimum(z.imag, 2 - z.imag))
    assert np.abs(distance).max() < 1e-14


@pytest.mark.parametrize("n", [7, 8, 72, 101])
def test_grid_of_a_fourier_boundary_is_the_series_and_its_derivatives_at_equal_steps(n):
    t = np.arange(n) / n
    z, dz, ddz = BENT.grid(n)
    np.testing.assert_allclose(z, BENT.point(t), atol=1e-13)
    np.testing.assert_allclose(dz, BENT.derivative(t), atol=1e-12)
    k = BENT.frequencies
    np.testing.assert_allclose(ddz, np.exp(2j * np.pi * k * t[:, None]) @ (-((2 * np.pi * k) ** 2) * BENT.coefficients))


@given(radius=st.floats(0.01, 3), angle=st.floats(0, 2 * np.pi))
def test_distance_from_a_circle(radius, angle):
    z = np.array([radius * np.exp(1j * angle)])
    # the sagitta of 16 × 64 edges
    np.testing.assert_allclose(DOMAINS["disk"].distance_outside(z), radius - 1, atol=5e-6)


@given(x=st.floats(-1, 3), y=st.floats(-1, 3))
def test_inside_of_the_l(x, y):
    margin = min(abs(x), abs(y), abs(x - 2), abs(y - 2), abs(x - 1), abs(y - 1))
    inside = (0 < x < 2 and 0 < y < 1) or (0 < x < 1 and 0 < y < 2)
    if margin > 1e-9:
        assert DOMAINS["L"].contains(np.array(x + 1j * y)) == inside


def edges_from_root(domain):
    """The number of edges from each vertex of a triangulation to its root; fails if a path does not end there."""
    level, at = np.zeros(len(domain.parents), dtype=int), np.arange(len(domain.parents))
    for _ in at:
        level += at != domain.root
        at = domain.parents[at]
    assert (at == domain.root).all()
    return level


@every_domain
def test_paths_span_all_vertices_inside_the_domain(domain):
    mesh = domain.triangulation
    n = len(mesh.points)
    level = edges_from_root(domain)
    assert sorted(np.argsort(level).tolist()) == list(range(n))
    assert (level > 0).sum() == n - 1
    assert domain.parents[domain.root] == domain.root
    others = np.delete(np.arange(n), domain.root)
    np.testing.assert_array_equal(level[domain.parents[others]], level[others] - 1)
    edges = np.sort(np.column_stack([others, domain.parents[others]]), axis=1)
    assert (edges[:, None] == mesh.edges).all(axis=2).any(axis=1).all()
    # edges between two boundary vertices may run along ∂Ω. All others lie inside
    inner = (edges >= mesh.boundary_size).any(axis=1)
    samples = mesh.points[edges[inner]] @ np.array([[0.01, 0.3, 0.5, 0.8, 0.99], [0.99, 0.7, 0.5, 0.2, 0.01]])
    assert domain.contains(samples).all()


@every_domain
def test_paths_start_inside_and_reach_the_boundary_last(domain):
    m = domain.triangulation.boundary_size
    assert domain.root >= m
    boundary_parents = np.delete(domain.parents, domain.root)
    # near ∂Ω the poles are near: only a vertex without an inner neighbour hangs on the boundary
    assert (boundary_parents < m).mean() < 0.02


def test_crossed_and_clockwise_boundaries_are_refused():
    with pytest.raises(DomainError):
        PlaneDomain.from_boundary(np.array([0, 1 + 1j, 1, 1j, -1 + 0.5j]))
    with pytest.raises(DomainError, match="clockwise"):
        PlaneDomain.from_boundary(np.exp(-1j * ANGLES))


def test_divided_domain_has_the_same_boundary():
    is_corner = np.array([True, False, True, True, False])
    domain = PlaneDomain.from_boundary(np.array([0, 2, 2 + 2j, 1 + 0.5j, 2j]), is_corner)
    finer = domain.divided(3)
    t = np.random.default_rng(0).random(100)
    np.testing.assert_allclose(finer.boundary.point(t), domain.boundary.point(t), atol=1e-14)
    np.testing.assert_allclose(finer.boundary.derivative(t), domain.boundary.derivative(t), atol=1e-12)
    np.testing.assert_array_equal(finer.vertices[::3], domain.vertices)
    np.testing.assert_array_equal(np.flatnonzero(finer.boundary.corners), 3 * np.flatnonzero(domain.boundary.corners))
    assert len(finer.log_scale) == len(finer.vertices)


@pytest.mark.parametrize("t", [-0.1, 2.0, np.nan, np.inf])
def test_parameters_of_no_boundary_are_refused(t):
    for method in (PlaneDomain.disk().point, PlaneDomain.disk().derivative):
        with pytest.raises(OptionError, match="not a parameter"):
            method(np.array([0.5, t]))
    with pytest.raises(OptionError):
        PlaneDomain.annulus(0.5).point(np.array(4.0))


@pytest.mark.parametrize("shape", [(2,), (0,), (3, 3)])
def test_fourier_boundaries_take_an_odd_number_of_coefficients(shape):
    with pytest.raises(DtypeError, match="odd number of coefficients"):
        FourierBoundary(np.ones(shape), 16)


def test_a_time_limit_changes_no_domain():
    # the triangulations of domains are cached: one that a limit cut would be returned without a limit, too
    t = 2 * np.pi * np.arange(300) / 300
    vertices = (1 + 0.3 * np.cos(7 * t)) * np.exp(1j * t)
    with time_limit(-1.0):
        under_limit = PlaneDomain.from_boundary(vertices)
    assert under_limit.triangulation.is_complete
    assert under_limit.triangulation.angles.min() > 20
