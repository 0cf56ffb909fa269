"""Panels on ∂Ω integrate along it to round-off."""

import numpy as np
import pytest

from spinor_geom.domain import FourierBoundary, SplineBoundary
from spinor_geom.domain.quadrature import Panels

ANGLES = 2 * np.pi * np.arange(40) / 40
ELLIPSE = SplineBoundary.through(3 * np.cos(ANGLES) + 1j * np.sin(ANGLES))
SQUARE = SplineBoundary.through(np.array([0, 1, 2, 2 + 1j, 2 + 2j, 1 + 2j, 2j, 1j]), np.arange(8) % 2 == 0)
CIRCLE = FourierBoundary.circle(2.0, 16)
boundaries = pytest.mark.parametrize("boundary", [ELLIPSE, SQUARE, CIRCLE], ids=["ellipse", "square", "circle"])


@boundaries
def test_cumulative_integral_of_one_is_the_way_from_the_panels_start(boundary):
    panels = Panels.on(boundary, boundary.parameters, 10)
    h = np.diff(panels.breaks)[:, None]
    way = h * (panels.dz.reshape(len(h), -1) @ panels.cumulative.T)
    # a polynomial on every piece of a spline; on the circle the tenth order is enough for 16 panels
    expected = panels.z.reshape(len(h), -1) - boundary.point(panels.breaks[:-1])[:, None]
    np.testing.assert_allclose(way, expected, atol=1e-13)


def test_quadrature_between_a_pole_and_the_boundary_converges_geometrically():
    """∮ dz/(z − ζ) = 0 for a pole outside: the error falls by a constant factor with each order."""
    pole = 2.4
    errors = []
    for order in (2, 4, 6, 8):
        panels = Panels.on(CIRCLE, CIRCLE.parameters, order)
        errors.append(abs((panels.dz * panels.weights / (panels.z - pole)).sum()))
    assert (np.diff(np.log(errors)) < -1).all()
