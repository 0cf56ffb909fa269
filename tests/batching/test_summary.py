"""Small pictures as SVG."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from spinor_geom.batching.summary import SIZE, thumbnail

SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]])
CLOSED = SQUARE[[0, 1, 2, 3, 0]]


@pytest.mark.parametrize("points", [CLOSED * 1e6, CLOSED[:, [2, 0, 1]], CLOSED[:, [1, 2, 0]] - 1e3])
def test_a_curve_fills_the_picture(points):
    (line,) = ElementTree.fromstring(thumbnail(points))
    numbers = np.array([pair.split(",") for pair in line.get("points", "").split()], dtype=float)
    assert numbers.shape == (5, 2)
    assert numbers.min() >= 0
    assert numbers.max() <= SIZE
    # the longer side fills the picture's width, the shorter one is seen at an angle
    assert np.ptp(numbers[:, 0]) > 0.85 * SIZE
    assert 0.3 * SIZE < np.ptp(numbers[:, 1]) < 0.5 * SIZE
