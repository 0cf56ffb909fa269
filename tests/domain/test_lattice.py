"""Points of a triangular lattice inside polygons."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain.polygons import lattice_inside
from tests.strategies import SEEDS

ROW = np.sqrt(0.75)


def lattice(spacing, reach):
    """All points of the lattice in a square about 0."""
    rows, columns = np.meshgrid(np.arange(-2 * reach, 2 * reach + 1), np.arange(-2 * reach, 2 * reach + 1))
    return (spacing * (columns + 0.5 * (rows % 2) + 1j * ROW * rows)).ravel()


def winds_around(polygon, z):
    offset = polygon - z[:, None]
    return np.angle(np.roll(offset, -1, axis=1) * np.conj(offset)).sum(axis=1) > np.pi


def same_points(a, b):
    return len(a) == len(b) and np.allclose(np.sort_complex(a.round(9)), np.sort_complex(b.round(9)))


@given(st.integers(3, 40), SEEDS, st.floats(0.03, 0.5))
def test_lattice_points_inside_star_shaped_polygons(n, seed, spacing):
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(0.3, 1.2, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.9, n)) / n)
    # random sides hold no lattice point
    expected = lattice(spacing, int(2 / spacing))
    assert same_points(lattice_inside(polygon, spacing), expected[winds_around(polygon, expected)])


def test_rows_may_enter_a_polygon_more_than_once():
    comb = np.array([0, 7, 7 + 3j, 6 + 3j, 6 + 1j, 4 + 1j, 4 + 3j, 3 + 3j, 3 + 1j, 1 + 1j, 1 + 3j, 3j]) + 0.01 + 0.013j
    expected = lattice(0.21, 50)
    assert same_points(lattice_inside(comb, 0.21), expected[winds_around(comb, expected)])
