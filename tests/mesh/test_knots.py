"""Knots with known determinants, and curves that only look knotted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from spinor_geom import gallery
from spinor_geom.mesh.knots import knot_determinant
from tests.strategies import rigid_motions


def torus_knot(p: int, q: int, points: int = 200) -> np.ndarray:
    """It winds p times around the axis of a torus and q times around its core; knotted where neither is 1."""
    t = 2 * np.pi * np.arange(points) / points
    r = 2 + 0.8 * np.cos(q * t)
    return np.stack([r * np.cos(p * t), r * np.sin(p * t), 0.8 * np.sin(q * t)], axis=1)


def figure_eight_knot(points: int = 200) -> np.ndarray:
    t = 2 * np.pi * np.arange(points) / points
    return np.stack([(2 + np.cos(2 * t)) * np.cos(3 * t), (2 + np.cos(2 * t)) * np.sin(3 * t), np.sin(4 * t)], axis=1)


@pytest.mark.parametrize(
    ("points", "determinant"),
    [
        (torus_knot(2, 3), 3),
        (torus_knot(3, 2), 3),
        (torus_knot(2, 5), 5),
        (torus_knot(2, 7), 7),
        (torus_knot(3, 4), 3),
        # its determinant is 1, like a circle's: the other places show it
        (torus_knot(3, 5), 1),
        (figure_eight_knot(), 5),
    ],
)
@given(motion=rigid_motions())
@settings(max_examples=5)
def test_knots_have_their_determinants_from_every_side(points, determinant, motion) -> None:
    for turned in (motion(points), motion(points)[::-1], motion(points * [1, 1, -1])):
        assert knot_determinant(turned) == pytest.approx(determinant, abs=1e-6)


def test_curves_of_the_gallery_are_no_knots() -> None:
    for curve in (gallery.twisted_circle(), gallery.tennis_seam(0.75), gallery.ellipse(8.0)):
        assert knot_determinant(curve.sample(100).points) is None
