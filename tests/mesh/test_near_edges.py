"""The pairs of near segments and points are those of a search through all pairs, and take little memory."""

import numpy as np
import pytest

from spinor_geom.deadline import time_limit
from spinor_geom.errors import OptionError, OutOfTimeError
from spinor_geom.kernel import call
from spinor_geom.mesh import near_edges as near_edges_module
from spinor_geom.mesh.intersections import _segment_distances
from spinor_geom.mesh.near_edges import AT_ONCE, near_edges, near_points


def segments(kind, rng, count=60):
    starts = rng.normal(size=(count, 3))
    if kind == "a chain":
        return starts, np.roll(starts, -1, axis=0)
    ends = starts + 0.5 * rng.normal(size=(count, 3))
    if kind == "parallel":
        ends = starts + rng.uniform(0.1, 1, (count, 1)) * [1, 2, 3]
    if kind == "in a plane":
        starts[:, 2] = ends[:, 2] = 0
    if kind == "on a line":
        starts, ends = (np.outer(points[:, 0], [1.0, 2.0, 3.0]) for points in (starts, ends))
    if kind == "points":
        ends[::2] = starts[::2]
    return starts, ends


@pytest.mark.parametrize("kind", ["any", "a chain", "parallel", "in a plane", "on a line", "points"])
@pytest.mark.parametrize("distance", [0.0, 0.2])
def test_pairs_are_those_of_a_search_through_all(kind, distance):
    for seed in range(5):
        starts, ends = segments(kind, np.random.default_rng(seed))
        pairs = np.stack(np.triu_indices(len(starts), 1), axis=1)
        i, j = pairs.T
        apart = _segment_distances(starts[i], ends[i], starts[j], ends[j])
        found = near_edges(starts, ends, distance, np.less).tolist()
        assert found == sorted(found)
        # apart from rounding: of distances here, and there of 1e-7 of lengths below 10
        assert set(map(tuple, found)) >= set(map(tuple, pairs[apart <= distance - 1e-12 * (distance > 0)].tolist()))
        assert set(map(tuple, found)) <= set(map(tuple, pairs[apart <= distance + 1e-6].tolist()))


@pytest.mark.parametrize("kind", ["any", "a chain", "parallel", "in a plane", "on a line", "points"])
def test_near_points_are_those_of_a_search_through_all(kind):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        starts, ends = segments(kind, rng)
        points, radii = segments(kind, rng, 90)[0], rng.choice([0.0, 0.1, 1.0], 90)
        pairs = np.argwhere(np.ones((len(starts), len(points))))
        i, j = pairs.T
        apart = _segment_distances(starts[i], ends[i], points[j], points[j]) - radii[j]
        found = set(map(tuple, near_points(starts, ends, points, radii, lambda one, _: one > 3).tolist()))
        assert found >= set(map(tuple, pairs[(apart <= -1e-14) & (i > 3)].tolist()))
        assert found <= set(map(tuple, pairs[(apart <= 1e-10) & (i > 3)].tolist()))


def test_the_search_ends_where_enough_are_found():
    starts, ends = segments("any", np.random.default_rng(0), 2000)
    assert AT_ONCE <= len(near_edges(starts, ends, np.inf, np.less, enough=10)) + 2000 < 2 * AT_ONCE


def test_segments_are_finite():
    with pytest.raises(OptionError):
        near_edges(np.full((2, 3), np.nan), np.zeros((2, 3)), 1.0, np.less)


def test_the_search_ends_at_the_time_limit():
    starts, ends = segments("a chain", np.random.default_rng(0), 2000)
    with time_limit(-1):
        with pytest.raises(OutOfTimeError):
            near_edges(starts, ends, 0.0, np.less)
        with pytest.raises(OutOfTimeError):
            near_points(starts, ends, starts, np.ones(2000), np.less)


def test_few_pairs_are_looked_at_together_even_of_many_segments():
    angle = 2 * np.pi * np.arange(AT_ONCE + 5) / (AT_ONCE + 5)
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    counts = []

    def wanted(i, j):
        counts.append(len(i))
        return j - i == AT_ONCE + 4

    assert near_edges(points, np.roll(points, -1, axis=0), 0.0, wanted).tolist() == [[0, AT_ONCE + 4]]
    assert max(counts) <= AT_ONCE < sum(counts)


def test_the_search_tree_of_many_points_is_made_once(monkeypatch):
    points = np.zeros((AT_ONCE + 5, 3))
    points[:, 0] = np.arange(len(points))
    calls = []
    monkeypatch.setattr(near_edges_module, "call", lambda *arguments: (calls.append(arguments[0]), call(*arguments)))
    found = near_points(points[:50], points[:50], points, np.full(len(points), 0.5), lambda i, j: i == j)
    assert (len(found), calls) == (50, ["near_points"])
