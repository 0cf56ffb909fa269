"""Polygons of known divisions into quadrilaterals."""

import numpy as np
import pytest

from spinor_geom.domain.delaunay import cross
from spinor_geom.nurbs.quadrangulation import cut_open, quadrangulated, sides_of

L_SHAPE = np.array([0, 2, 2 + 1j, 1 + 1j, 1 + 2j, 2j])


def neighbours(count: int) -> np.ndarray:
    return np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1)


def area(z: np.ndarray) -> float:
    return float(cross(z, np.roll(z, -1, axis=-1)).sum() / 2)


def test_an_l_shape_is_cut_from_its_reentrant_corner() -> None:
    quads = quadrangulated(L_SHAPE, neighbours(6))
    assert sorted(sorted(quad) for quad in quads.tolist()) == [[0, 1, 2, 3], [0, 3, 4, 5]]


@pytest.mark.parametrize("count", [8, 14, 40])
def test_quadrilaterals_fill_a_polygon(count: int) -> None:
    angle = 2 * np.pi * (np.arange(count) + 0.3 * np.sin(np.arange(count))) / count
    z = (1 + 0.4 * np.cos(3 * angle)) * np.exp(1j * angle)
    quads = quadrangulated(z, neighbours(count))
    assert quads is not None
    assert len(quads) == count // 2 - 1
    assert area(z[quads]) == pytest.approx(area(z))
    assert min(area(quad) for quad in z[quads]) > 0


def test_corners_are_left_out_where_sides_pass_them() -> None:
    """A square with three more corners on its sides, of which two can be left out."""
    z = np.array([0, 0.5, 1, 1 + 0.5j, 1 + 1j, 0.5 + 1j, 1j])
    assert quadrangulated(z, neighbours(7)) is None
    quads = quadrangulated(z, np.concatenate([neighbours(7), [[0, 2], [2, 4], [4, 6]]]))
    assert quads.tolist() == [[0, 2, 4, 6]]
    (one, two) = quadrangulated(z, np.concatenate([neighbours(7), [[2, 4]]]))
    assert sorted(sorted(quad) for quad in (one.tolist(), two.tolist())) == [[0, 1, 5, 6], [1, 2, 4, 5]]


def test_an_annulus_is_cut_open_once() -> None:
    angle = 2 * np.pi * np.arange(8) / 8
    z = np.concatenate([np.exp(1j * angle), 0.5 * np.exp(-1j * angle)])
    polygon = cut_open(z, (8, 8))
    assert len(polygon) == 18
    first, last = polygon[0], polygon[-1]
    assert (polygon == first).sum() == (polygon == last).sum() == 2
    assert area(z[polygon]) == pytest.approx(area(z[:8]) + area(z[8:]))
    # sides of two steps from every corner of both rims: those that pass an end of the cut are none
    pairs = np.concatenate([[(k + 8 * rim, (k + 2) % 8 + 8 * rim) for k in range(8)] for rim in (0, 1)])
    sides = sides_of(polygon, pairs, np.full(16, 2))
    assert len(sides) == 18 + 14
    quads = quadrangulated(z[polygon], sides)
    assert quads is not None
    assert len(quads) == 4
    used = np.unique(polygon[quads])
    assert area(z[polygon[quads]]) == pytest.approx(area(z[used[used < 8]]) + area(z[used[used >= 8]]))
