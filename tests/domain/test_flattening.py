"""Flattening: conformal, isometric on the boundary, closed, and simple."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import (
    crossing_edges,
    dirichlet_to_neumann,
    flatten,
    flatten_boundary,
    is_simple,
    lay_out,
    outer_clearance,
    untangled,
)
from spinor_geom.domain.sizes import graded_size
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import DomainError
from tests.loops import L_SHAPE, noisy_ellipse, planar, ramp
from tests.strategies import SEEDS, smooth_loops

FLAT = np.array([1, 1j, 0])


def circle(n, radius=1.0):
    return radius * np.exp(2j * np.pi * np.arange(n) / n)


def meshed(polygon, height=None):
    """A triangulated plane polygon as a graph over the plane: vertices, faces, number of boundary vertices."""
    mesh = triangulate_polygon(polygon, graded_size(polygon))
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
    "hills": meshed(circle(60), hills),
    "cap": meshed(circle(80, 0.8), lambda z: np.sqrt(1 - np.abs(z) ** 2)),
    "L": meshed(planar(L_SHAPE, 60).points @ FLAT, hills),
    "noisy": (lambda disk: (disk.vertices, disk.faces, 100))(first_disk(noisy_ellipse().points)),
}
every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES.keys())


@every_surface
def test_turning_sums_to_a_full_turn(surface):
    make_neumann, turning = dirichlet_to_neumann(*surface)
    assert abs(turning.sum() - 2 * np.pi) < 1e-11
    u = np.random.default_rng(0).normal(size=len(turning))
    assert abs((turning + make_neumann() @ u).sum() - 2 * np.pi) < 1e-9


@every_surface
def test_dirichlet_to_neumann_matrix_is_symmetric_and_kills_constants(surface):
    neumann = dirichlet_to_neumann(*surface)[0]()
    np.testing.assert_array_equal(neumann, neumann.T)
    assert np.abs(neumann.sum(axis=1)).max() < 1e-12 * np.abs(neumann).max() * len(neumann)
    eigenvalues = np.linalg.eigvalsh(neumann)
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]
    assert eigenvalues[1] > 1e-4 * eigenvalues[-1]


def test_dirichlet_to_neumann_matrix_of_the_disk_multiplies_by_the_wave_number():
    n = 96
    neumann = dirichlet_to_neumann(*meshed(circle(n)))[0]()
    angle = np.angle(circle(n))
    for k in (1, 2, 4):
        u = np.cos(k * angle)
        # ∮ u ∂u/∂n = k ∮ u² = kπ
        assert abs(u @ neumann @ u / (k * np.pi) - 1) < 0.01 * k


@pytest.mark.parametrize("polygon", [circle(50), planar(L_SHAPE, 60).points @ FLAT], ids=["circle", "L"])
def test_plane_mesh_flattens_to_itself(polygon):
    flat = flatten(*meshed(polygon * np.exp(0.7j) + 3 - 2j))
    assert same_shape(flat.boundary, polygon) < 1e-10
    assert np.abs(flat.log_scale).max() < 1e-10


def test_rolled_up_sheet_flattens_to_the_sheet():
    sheet = planar([(0, 0), (2, 0), (2, 1), (0, 1)], 120).points @ FLAT
    vertices, faces, m = meshed(sheet)
    radius = 0.5
    rolled = np.column_stack(
        [radius * np.cos(vertices[:, 0] / radius), vertices[:, 1], radius * np.sin(vertices[:, 0] / radius)]
    )
    flat = flatten(rolled, faces, m)
    # chords across the roll are shorter than arcs by (edge/radius)²/24
    assert same_shape(flat.boundary, sheet) < 2e-3


def test_cap_of_a_sphere_flattens_to_a_regular_polygon():
    flat = flatten(*SURFACES["cap"])
    assert np.ptp(np.abs(flat.boundary - flat.boundary.mean())) < 1e-2
    np.testing.assert_allclose(
        np.abs(np.roll(flat.boundary, -1) - flat.boundary), 2 * 0.8 * np.sin(np.pi / 80), rtol=5e-3
    )


@settings(max_examples=10)
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

    def crossed_at_first(polygon):
        seen.append(polygon)
        return polygon if len(seen) > 1 else np.array([0, 1 + 1j, 1, 1j])

    flat = flatten(vertices, faces, m, drawn=crossed_at_first)
    np.testing.assert_array_equal(seen[0], flatten(vertices, faces, m).boundary)
    np.testing.assert_array_equal(seen[-1], flat.boundary)
    assert same_shape(seen[0], flat.boundary) > 1e-6
    with pytest.raises(DomainError, match="no simple plane domain"):
        flatten(vertices, faces, m, drawn=np.conj)


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


def test_lay_out_scales_edges_by_the_mean_log_scale_of_their_ends():
    n = 24
    u = np.full(n, np.log(3.0))
    polygon = lay_out(np.full(n, 0.1), np.full(n, 2 * np.pi / n), u)
    np.testing.assert_allclose(np.abs(np.roll(polygon, -1) - polygon), 0.3, rtol=1e-12)


def test_polygon_that_cannot_close_is_none():
    # all its sides run to the right
    assert lay_out(np.ones(4), np.full(4, 0.1), np.zeros(4)) is None


# --- crossings --------------------------------------------------------------------------------------------------------


def proper_crossings(a):
    """Pairs of edges that are not neighbours and cross, one pair after another."""
    m = len(a)

    def side(p, q, r):
        return np.sign(((q - p).conjugate() * (r - p)).imag)

    return {
        (i, j)
        for i in range(m)
        for j in range(i + 2, m)
        if (j + 1) % m != i
        and side(a[i], a[i + 1], a[j]) != side(a[i], a[i + 1], a[(j + 1) % m])
        and side(a[j], a[(j + 1) % m], a[i]) != side(a[j], a[(j + 1) % m], a[i + 1])
    }


@settings(max_examples=30)
@given(n=st.integers(4, 12), seed=SEEDS)
def test_crossings_equal_those_found_pair_by_pair(n, seed):
    polygon = np.random.default_rng(seed).normal(size=(n, 2)) @ np.array([1, 1j])
    assert set(map(tuple, crossing_edges(polygon).tolist())) == proper_crossings(polygon)


def test_edge_that_folds_back_onto_its_neighbour_counts():
    assert crossing_edges(np.array([0, 2, 1, 1 + 1j, 1j])).tolist() == [[0, 1]]


@pytest.mark.parametrize("angle", np.linspace(0.1, 1.5, 8))
def test_edges_of_a_straight_side_do_not_cross(angle):
    polygon = planar([(0, 0), (2, 0), (2.5, 1), (1.2, 2.2), (-0.3, 1.1)], 60).points @ FLAT * np.exp(1j * angle)
    noise = np.random.default_rng(0).normal(size=(len(polygon), 2)) @ np.array([1, 1j])
    assert is_simple(polygon)
    assert is_simple(polygon + 1e-16 * noise)


def test_only_counter_clockwise_polygons_without_crossings_are_simple():
    assert is_simple(circle(20))
    assert not is_simple(circle(20)[::-1])
    assert not is_simple(np.array([0, 1 + 1j, 1, 1j]))
    assert not is_simple(np.repeat(circle(20), [1] * 19 + [2]))


# --- untangling -------------------------------------------------------------------------------------------------------


def test_small_lobes_are_drawn_in_and_nothing_else_is_moved():
    polygon = circle(60)
    tangled = polygon.copy()
    tangled[[20, 21]] = tangled[[21, 20]]
    tangled[40:44] = tangled[40:44][::-1]
    assert not is_simple(tangled)
    result = untangled(tangled)
    assert is_simple(result)
    moved = np.flatnonzero(result != tangled)
    assert set(moved.tolist()) <= set(range(19, 23)) | set(range(39, 45))


def figure_eight():
    # no vertex at the crossing
    t = 2 * np.pi * (np.arange(80) + 0.3) / 80
    return np.sin(t) + 1j * np.sin(2 * t)


def test_far_parts_that_cross_are_not_untangled():
    assert untangled(figure_eight()) is None


def test_simple_polygon_is_left_as_it_is():
    np.testing.assert_array_equal(untangled(circle(30)), circle(30))


# --- clearance --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.2, 0.5])
def test_clearance_of_a_horseshoe_is_its_gap_in_edges(gap):
    # a ring of width 1 that is open by `gap` at its far end
    outer = np.arcsin(gap / 2 / 3)
    inner = np.arcsin(gap / 2 / 2)
    angle = np.pi - np.linspace(outer, 2 * np.pi - outer, 180)
    back = np.pi - np.linspace(2 * np.pi - inner, inner, 120)
    polygon = np.concatenate([3 * np.exp(-1j * angle), 2 * np.exp(-1j * back)])
    assert is_simple(polygon)
    edge = np.abs(np.roll(polygon, -1) - polygon)
    clearance = outer_clearance(polygon)
    assert gap / edge.max() * 0.9 < clearance < gap / np.median(edge) * 1.2


def test_narrow_inside_is_no_lack_of_clearance():
    strip = planar([(0, 0), (20, 0), (20, 0.3), (0, 0.3)], 160).points @ FLAT
    assert outer_clearance(strip) == np.inf
    assert outer_clearance(circle(50)) == np.inf


def test_boundary_that_stays_crossed_is_refused():
    """A figure eight turns by nothing; with Λ = 0 there is nothing to straighten it by."""
    sides = np.roll(figure_eight(), -1) - figure_eight()
    turning = np.angle(sides / np.roll(sides, 1))
    with pytest.raises(DomainError, match="80 vertices"):
        flatten_boundary(np.abs(sides), turning, lambda: np.zeros((80, 80)), clearance=1.0)


@pytest.mark.parametrize("turns", [1.2, 1.3, 2.0])
def test_straightened_boundary_has_no_teeth(turns):
    """The ramp's outer helix leaves ears in its first fill, whose slivers must not turn the boundary to and fro."""
    loop = gallery.helical_ramp(turns).sample(160)
    polygon = unfolded_loop(loop.points)
    turning = np.abs(np.angle(np.roll(np.roll(polygon, -1) - polygon, 1).conj() * (np.roll(polygon, -1) - polygon)))
    assert turning[~loop.corners].max() < 0.2
    np.testing.assert_allclose(turning[loop.corners], np.pi / 2, atol=0.2)
