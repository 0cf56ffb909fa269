"""Closed plane polygons: crossings, lobes, clearance, and the region that several of them bound."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.domain.polygons import are_inside, bound_domain, crossing_edges, is_simple, outer_clearance, untangled
from tests.domain.test_lattice import winds_around
from tests.fill.shapes import on_circle
from tests.loops import figure_eight
from tests.strategies import SEEDS

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


@given(n=st.integers(4, 12), seed=SEEDS)
def test_crossings_equal_those_found_pair_by_pair(n, seed):
    polygon = np.random.default_rng(seed).normal(size=(n, 2)) @ np.array([1, 1j])
    assert set(map(tuple, crossing_edges(polygon).tolist())) == proper_crossings(polygon)


def test_edge_that_folds_back_onto_its_neighbour_counts():
    assert crossing_edges(np.array([0, 2, 1, 1 + 1j, 1j])).tolist() == [[0, 1]]


def test_only_counter_clockwise_polygons_without_crossings_are_simple():
    assert is_simple(on_circle(20))
    assert not is_simple(on_circle(20)[::-1])
    assert not is_simple(np.array([0, 1 + 1j, 1, 1j]))
    assert not is_simple(np.repeat(on_circle(20), [1] * 19 + [2]))


# --- untangling -------------------------------------------------------------------------------------------------------


@settings(max_examples=200)
@given(st.integers(3, 30), SEEDS, st.floats(0, 1.5))
def test_a_polygon_is_simple_if_no_edges_cross(n, seed, noise):
    """Star-shaped polygons are found without looking for crossings."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(n) + noise * rng.uniform(-1, 1, n)) / n
    z = (1 - 0.6 * rng.uniform(0, 1, n) * min(noise, 1)) * np.exp(1j * turn)
    area = np.imag(np.conj(z) * np.roll(z, -1)).sum()
    assert is_simple(z) == (area > 0 and not len(crossing_edges(z)))


def test_small_lobes_are_drawn_in_and_nothing_else_is_moved():
    polygon = on_circle(60)
    tangled = polygon.copy()
    tangled[[20, 21]] = tangled[[21, 20]]
    tangled[40:44] = tangled[40:44][::-1]
    assert not is_simple(tangled)
    result = untangled(tangled)
    assert is_simple(result)
    moved = np.flatnonzero(result != tangled)
    assert set(moved.tolist()) <= set(range(19, 23)) | set(range(39, 45))


def test_far_parts_that_cross_are_not_untangled():
    assert untangled(figure_eight()) is None


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
    clearance = outer_clearance(polygon, 8.0)
    assert gap / edge.max() * 0.9 < clearance < gap / np.median(edge) * 1.2
    assert outer_clearance(polygon, 1.01 * clearance) == clearance
    assert outer_clearance(polygon, 0.99 * clearance) == np.inf


# --- several ----------------------------------------------------------------------------------------------------------


def test_polygons_bound_a_domain_where_the_holes_lie_inside_and_apart():
    hole = 0.2 * on_circle(16)[::-1]
    assert bound_domain((on_circle(30), hole, hole + 0.5))
    assert not bound_domain((on_circle(30), hole[::-1]))
    assert not bound_domain((on_circle(30), hole + 0.9))
    assert not bound_domain((on_circle(30), hole + 2.0))
    assert not bound_domain((on_circle(30), hole, hole + 0.3))
    assert not bound_domain((on_circle(30), hole, hole / 2))


@given(st.integers(3, 40), SEEDS)
def test_points_inside_a_polygon_are_those_around_which_it_winds(n, seed):
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(0.3, 1.2, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.9, n)) / n)
    z = rng.uniform(-1.3, 1.3, 200) + 1j * rng.uniform(-1.3, 1.3, 200)
    assert np.array_equal(are_inside(z, polygon), winds_around(polygon, z))
