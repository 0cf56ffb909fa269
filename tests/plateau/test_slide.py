"""The isotonic slide around the circle."""

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.plateau.network.network_problem import nearest_increasing
from tests.strategies import SEEDS


def unbounded(n):
    return np.tile([-np.inf, np.inf], (n, 1))


def nearest_by_trying_all_blocks(s):
    """The non-decreasing s around the circle nearest to given ones: for every way to tie neighbours their means."""
    n = len(s)
    best = None
    for tied in product((False, True), repeat=n):
        if all(tied):
            continue
        start = next(i for i in range(n) if not tied[i]) + 1
        order = (start + np.arange(n)) % n
        turn = (start + np.arange(n)) // n
        block = np.cumsum([0, *(not tied[i] for i in order[:-1])])
        unrolled = s[order] + turn
        means = np.bincount(block, unrolled) / np.bincount(block)
        x = means[block]
        if (np.diff(x) < -1e-12).any() or x[-1] > x[0] + 1 + 1e-12:
            continue
        result = np.empty(n)
        result[order] = x - turn
        cost = ((result - s) ** 2).sum()
        if best is None or cost < best[0]:
            best = (cost, result)
    return best[1]


def is_increasing(s):
    return bool((np.diff(np.append(s, s[0] + 1)) >= -1e-15).all())


@given(n=st.integers(2, 7), seed=SEEDS, noise=st.sampled_from([0.02, 0.1, 0.3]))
def test_result_increases_around_the_circle(n, seed, noise):
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(0, 1, n)) + noise * rng.normal(size=n)
    assert is_increasing(nearest_increasing(s, rng.uniform(0.5, 1.5, n), unbounded(n)))


@given(n=st.integers(3, 7), seed=SEEDS)
def test_nearest_where_the_circle_is_cut_between_free_nodes(n, seed):
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(0, 1, n)) + 0.1 * rng.normal(size=n)
    nearest = nearest_by_trying_all_blocks(s)
    speed = np.ones(n)
    free = np.flatnonzero(np.diff(np.append(nearest[-1] - 1, nearest)) > 1e-9)
    speed[free[0]] = 2
    np.testing.assert_allclose(nearest_increasing(s, speed, unbounded(n)), nearest, atol=1e-12)


def test_increasing_slides_are_left_as_they_are():
    s = np.array([0.1, 0.2, 0.7, 0.9, 1.05])
    np.testing.assert_array_equal(nearest_increasing(s, np.ones(5), unbounded(5)), s)


def test_bounds_are_kept():
    s = np.array([0.1, 0.3, 0.2, 0.8])
    bounds = np.array([[0.0, 0.28], [0.0, 0.28], [0.28, 1.0], [0.28, 0.7]])
    found = nearest_increasing(s, np.array([2.0, 1, 1, 1]), bounds)
    assert is_increasing(found)
    assert (found >= bounds[:, 0]).all()
    assert (found <= bounds[:, 1]).all()
    np.testing.assert_allclose(found, [0.1, 0.25, 0.28, 0.7])
