"""The pairs of near segments are those of a search through all pairs, and take little memory."""

import subprocess
import sys

import numpy as np
import pytest

from spinor_geom.deadline import time_limit
from spinor_geom.errors import OptionError, OutOfTimeError
from spinor_geom.mesh import near_edges as module
from spinor_geom.mesh.intersections import _segment_distances
from spinor_geom.mesh.near_edges import near_edges


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


def test_pairs_do_not_depend_on_how_many_are_found_at_once(monkeypatch):
    starts, ends = segments("any", np.random.default_rng(7), 200)
    expected = near_edges(starts, ends, 0.5, np.less)
    assert len(expected) > 200
    monkeypatch.setattr(module, "AT_ONCE", 1)
    np.testing.assert_array_equal(near_edges(starts, ends, 0.5, np.less), expected)


def test_segments_are_finite():
    with pytest.raises(OptionError):
        near_edges(np.full((2, 3), np.nan), np.zeros((2, 3)), 1.0, np.less)


def test_the_search_ends_at_the_time_limit():
    starts, ends = segments("a chain", np.random.default_rng(0), 2000)
    with time_limit(-1), pytest.raises(OutOfTimeError):
        near_edges(starts, ends, 0.0, np.less)


def test_the_memory_for_a_polygon_with_long_spikes_is_linear():
    program = """
import resource, numpy as np
from spinor_geom.domain.polygons import crossing_edges
k = np.arange(6000)
star = np.where(k % 2, np.exp(1j), 0.2) * np.exp(2j * np.pi * k / len(k))
crossing_edges(star[:100])
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 2**26, used + 2**26))  # an array for all pairs has 144 MB
print(len(crossing_edges(star)))
"""
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100, check=True)
    assert process.stdout == "0\n"
