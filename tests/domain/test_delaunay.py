"""Constrained Delaunay triangulations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain.delaunay import constrained_delaunay
from tests.strategies import SEEDS


@given(st.integers(6, 60), st.integers(0, 80), SEEDS)
def test_faces_fill_the_polygon_and_no_inner_vertex_lies_in_a_circumcircle(n, count, seed):
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(0.6, 1.2, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.5, n)) / n)
    inner = 0.5 * np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))
    points = np.append(polygon, inner)
    faces = constrained_delaunay(points, (n,))
    assert len(faces) == 2 * (n + count) - 2 - n
    a, b, c = points[faces].T
    area = 0.5 * (np.conj(b - a) * (c - a)).imag
    assert (area > 0).all()
    assert area.sum() == pytest.approx(0.5 * (np.conj(polygon) * np.roll(polygon, -1)).imag.sum())
    # the circles of faces without boundary vertices are empty
    within = (faces >= n).all(axis=1)
    centre = a + 1j * ((b - a) * np.abs(c - a) ** 2 - (c - a) * np.abs(b - a) ** 2) / (4 * area)
    distance = np.abs(inner - centre[within, None])
    assert (distance > np.abs(a - centre)[within, None] * (1 - 1e-9)).all()
