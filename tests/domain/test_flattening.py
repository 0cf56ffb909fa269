"""Flattening: conformal, isometric on the boundary, closed, and simple."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from scipy.sparse import csc_array

from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.discrete.strip import discrete_annulus
from spinor_geom.domain.flattening import DirichletToNeumann, dirichlet_to_neumann, flatten, flatten_boundary, lay_out
from spinor_geom.domain.polygons import is_simple
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import DomainError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.fill.shapes import on_circle
from tests.loops import L_SHAPE, figure_eight, noisy_ellipse, planar, ramp
from tests.plateau.rims import ring
from tests.strategies import smooth_loops


def operator(matrix):
    return DirichletToNeumann(lambda: csc_array(matrix), len(matrix))


FLAT = np.array([1, 1j, 0])


def meshed(polygon, height=None):
    """A triangulated plane polygon as a graph over the plane: vertices, faces, number of boundary vertices."""
    mesh = triangulate_polygon(polygon)
    z = mesh.points
    up = np.zeros(len(z)) if height is None else height(z)
    return np.column_stack([z.real, z.imag, up]), mesh.faces, len(polygon)


def same_shape(polygon, other):
    """Largest distance between two polygons after the rigid motion that brings them together."""
    a, b = polygon - polygon.mean(), other - other.mean()
    turn = (b * np.conj(a)).sum()
    return np.abs(a * turn / abs(turn) - b).max()


def hills(z):
    return 0.4 * np.sin(2 * z.real) * np.cos(3 * z.imag)


SURFACES = {
    "hills": meshed(on_circle(60), hills),
    "cap": meshed(0.8 * on_circle(80), lambda z: np.sqrt(1 - np.abs(z) ** 2)),
    "L": meshed(planar(L_SHAPE, 60).points @ FLAT, hills),
    "noisy": (lambda disk: (disk.vertices, disk.faces, 100))(first_disk(noisy_ellipse().points)),
}
every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES.keys())


@every_surface
def test_turning_sums_to_a_full_turn(surface):
    neumann, turning = dirichlet_to_neumann(*surface)
    assert abs(turning.sum() - 2 * np.pi) < 1e-11
    u = np.random.default_rng(0).normal(size=len(turning))
    assert abs((turning + neumann @ u).sum() - 2 * np.pi) < 1e-9


@every_surface
def test_dirichlet_to_neumann_matrix_is_symmetric_and_kills_constants(surface):
    neumann = dirichlet_to_neumann(*surface)[0] @ np.eye(surface[2])
    np.testing.assert_allclose(neumann, neumann.T, atol=1e-12 * np.abs(neumann).max())
    assert np.abs(neumann.sum(axis=1)).max() < 1e-12 * np.abs(neumann).max() * len(neumann)
    eigenvalues = np.linalg.eigvalsh(neumann)
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]
    assert eigenvalues[1] > 1e-4 * eigenvalues[-1]


def test_dirichlet_to_neumann_matrix_of_the_disk_multiplies_by_the_wave_number():
    n = 96
    neumann = dirichlet_to_neumann(*meshed(on_circle(n)))[0]
    angle = np.angle(on_circle(n))
    for k in (1, 2, 4):
        u = np.cos(k * angle)
        # ∮ u ∂u/∂n = k ∮ u² = kπ
        assert abs(u @ (neumann @ u) / (k * np.pi) - 1) < 0.01 * k


@given(points=smooth_loops(max_points=80))
def test_flat_boundaries_are_simple_and_keep_their_edge_lengths(points):
    disk = first_disk(points)
    flat = flatten(disk.vertices, disk.faces, len(points))
    edge = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    assert is_simple(flat.boundary)
    ratio = np.log(np.abs(np.roll(flat.boundary, -1) - flat.boundary) / edge)
    assert np.abs(ratio).max() < 0.05
    np.testing.assert_allclose(flat.log_scale, (ratio + np.roll(ratio, 1)) / 2, atol=1e-12)


def test_ramp_of_more_than_a_turn_is_straightened_until_it_is_clear():
    loop = ramp(2.2)
    disk = first_disk(loop.points)
    _, turning = dirichlet_to_neumann(disk.vertices, disk.faces, len(loop))
    assert not is_simple(lay_out(loop.edge_lengths, turning, np.zeros(len(loop))))
    flat = flatten(disk.vertices, disk.faces, len(loop))
    assert is_simple(flat.boundary)
    assert flat.clearance >= 3
    assert 0.01 < np.abs(flat.log_scale).max() < 0.3


def test_flattening_is_straightened_where_the_curve_through_it_crosses_itself():
    vertices, faces, m = SURFACES["noisy"]
    seen = []

    def crossed_at_first(rims):
        seen.append(rims[0])
        return rims if len(seen) > 1 else (np.array([0, 1 + 1j, 1, 1j]),)

    flat = flatten(vertices, faces, m, drawn=crossed_at_first)
    np.testing.assert_array_equal(seen[0], flatten(vertices, faces, m).boundary)
    np.testing.assert_array_equal(seen[-1], flat.boundary)
    assert same_shape(seen[0], flat.boundary) > 1e-6
    with pytest.raises(DomainError, match="no simple plane domain"):
        flatten(vertices, faces, m, drawn=lambda rims: tuple(map(np.conj, rims)))


# --- laying out -------------------------------------------------------------------------------------------------------


def test_lay_out_closes_and_keeps_directions():
    rng = np.random.default_rng(0)
    edge = rng.uniform(0.5, 1.5, size=30)
    turning = np.full(30, 2 * np.pi / 30) + 0.1 * (lambda x: x - x.mean())(rng.normal(size=30))
    polygon = lay_out(edge, turning, np.zeros(30))
    sides = np.roll(polygon, -1) - polygon
    turns = np.angle(sides / np.roll(sides, 1))
    np.testing.assert_allclose(turns, turning, atol=1e-12)
    assert abs(turns.sum() - 2 * np.pi) < 1e-12
    # no edge is stretched more than it takes to close such a polygon
    assert np.abs(np.abs(sides) / edge - 1).max() < 0.5


def test_a_polygon_that_cannot_close_or_is_not_finite_is_none():
    # all its sides run to the right
    assert lay_out(np.ones(4), np.full(4, 0.1), np.zeros(4)) is None
    assert lay_out(np.ones(6), np.array([1, 1, np.nan, 1, 1, 1]), np.zeros(6)) is None


def test_boundary_that_stays_crossed_is_refused():
    """A figure eight has turning number 0; with Λ = 0 nothing can change that."""
    sides = np.roll(figure_eight(), -1) - figure_eight()
    turning = np.angle(sides / np.roll(sides, 1))
    with pytest.raises(DomainError, match="80 vertices"):
        flatten_boundary(np.abs(sides), turning, operator(np.zeros((80, 80))), clearance=1.0)


def helical_ramp(turns):
    """The outline of a ramp of radius 3, width 0.7 and pitch 2: two helices and two straight ends."""
    share = np.arange(77) / 76
    turn = 2 * np.pi * turns * share
    inner, outer = (np.column_stack([r * np.cos(turn), r * np.sin(turn), 2 * turns * share]) for r in (2.65, 3.35))
    middles = [(inner[k] + outer[k])[None] / 2 for k in (-1, 0)]
    points = np.concatenate([outer, middles[0], inner[::-1], middles[1]])
    return BoundaryLoop.from_points(points, corners=[0, 76, 78, 154])


@pytest.mark.parametrize("turns", [1.2, 1.3, 2.0])
def test_straightened_boundary_has_no_teeth(turns):
    """The ramp's outer helix leaves ears in its first fill, whose slivers must not make the boundary jagged."""
    loop = helical_ramp(turns)
    polygon = unfolded_loop(loop.points)
    turning = np.abs(np.angle(np.roll(np.roll(polygon, -1) - polygon, 1).conj() * (np.roll(polygon, -1) - polygon)))
    assert turning[~loop.corners].max() < 0.2
    np.testing.assert_allclose(turning[loop.corners], np.pi / 2, atol=0.2)


# --- with a hole ------------------------------------------------------------------------------------------------------


def ellipse(a, b, centre, count):
    turn = 2 * np.pi * np.arange(count) / count
    return centre + a * np.cos(turn) + 1j * b * np.sin(turn)


@pytest.mark.parametrize("hole", [(0.3, 0.3, 0.6 + 0.1j), (0.9, 0.05, 0.0), (0.2, 0.25, -1.5)])
def test_plane_annulus_is_laid_out_as_it_is(hole):
    outer, inner = ellipse(2.0, 1.0, 0.0, 60), ellipse(*hole, 40)[::-1]
    plane = triangulate_polygon(outer, holes=[inner])
    turned = plane.points * np.exp(0.7j)
    vertices = np.column_stack([turned.real, turned.imag, np.full(len(turned), 2.0)])
    flat = flatten(vertices, plane.faces, 100, holes=(40,))
    # the first vertex of the outer rim lies at 0, and its first edge is turned back to the real axis
    both = flat.boundary
    expected = plane.points[:100] - outer[0]
    scale = both[1] / expected[1]
    assert abs(abs(scale) - 1) < 1e-10
    np.testing.assert_allclose(both, scale * expected, atol=1e-9)
    assert np.ptp(flat.log_scale) < 1e-9


@pytest.mark.parametrize("curvature", [0.0, 0.3])
def test_two_holes_are_laid_out_where_they_are(curvature):
    outer = ellipse(2.0, 1.0, 0.0, 40)
    holes = [ellipse(0.3, 0.3, 0.8 + 0.1j, 40)[::-1], ellipse(0.25, 0.4, -0.9 - 0.2j, 40)[::-1]]
    rims = [outer, *holes]
    plane = triangulate_polygon(outer, holes=holes)
    # a cylinder unrolls as it is
    x, z = plane.points.real, plane.points
    bent = (x, 0 * x) if not curvature else (np.sin(curvature * x) / curvature, np.cos(curvature * x) / curvature)
    vertices = np.column_stack([bent[0], z.imag, bent[1]])
    flat = flatten(vertices, plane.faces, 120, holes=(40, 40))
    # of a cylinder the triangles are chords
    assert same_shape(flat.boundary, np.concatenate(rims)) < (3e-3 if curvature else 1e-9)


def test_strip_around_a_tube_becomes_a_ring():
    turn = np.arange(48) / 48
    top, bottom = ring(1.0, 0.3, stretch=3.0).point(turn), ring(1.0, -0.3, stretch=3.0).point(turn)[::-1]
    plane, descent = discrete_annulus(top, bottom, relative_change=1e-3)
    flat = flatten(descent.vertices, plane.faces, 96, holes=(48,))
    outer, inner = flat.rims
    assert is_simple(outer)
    assert is_simple(inner[::-1])
    away = outer - inner.mean()
    assert abs(np.angle(np.roll(away, -1) / away).sum() - 2 * np.pi) < 1e-9


@pytest.mark.parametrize("size", [1e20, 1e30])
def test_a_matrix_that_rounding_makes_indefinite_raises_a_typed_error(size):
    """Slivers make Λ so large that rounding hides the rest: some straightenings cannot be solved for."""
    m = 24
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(m, 3))
    turning = np.full(m, 6 * np.pi / m)  # three times around: not simple
    with suppress(DomainError):
        assert is_simple(flatten_boundary(np.ones(m), turning, operator(size * slopes @ slopes.T)).boundary)
