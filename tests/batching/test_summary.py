"""Small pictures as SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from spinor_geom.batching.summary import MOST_FACES, SIZE, thumbnail

SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
NONE = np.zeros((0, 3), dtype=np.int64)


def test_a_surface_is_drawn_inside_the_picture() -> None:
    picture = ElementTree.fromstring(thumbnail(SQUARE * 1e6, HALVES, np.array([0, 1, 2, 3, 0])))
    assert [part.tag for part in picture] == ["path", "path", "polyline"]
    numbers = np.array([pair.split(",") for pair in picture[2].get("points", "").split()], dtype=float)
    assert numbers.shape == (5, 2)
    assert numbers.min() >= 0
    assert numbers.max() <= SIZE
    # the longer side fills the picture's width
    assert np.ptp(numbers[:, 0]) > 0.85 * SIZE


@pytest.mark.parametrize("points", [SQUARE, SQUARE[:2], np.zeros((3, 3)), SQUARE[:1]])
def test_curves_of_any_shape_are_drawn(points: np.ndarray) -> None:
    picture = ElementTree.fromstring(thumbnail(points, NONE, np.arange(len(points))))
    assert [part.tag for part in picture] == ["polyline"]
    assert "nan" not in picture[0].get("points", "")


def test_of_very_many_faces_only_the_rim_is_drawn() -> None:
    picture = ElementTree.fromstring(thumbnail(SQUARE, np.tile(HALVES, (MOST_FACES, 1)), np.arange(4)))
    assert [part.tag for part in picture] == ["polyline"]
