"""∫ φ dz along smooth boundaries and on quadrilaterals, of functions with known integrals."""

import numpy as np
import pytest

from spinor_geom.domain.plane_domain import FourierBoundary, SplineBoundary
from spinor_geom.nurbs.samples import CANDIDATES, CHECKS, QuadPolynomials
from spinor_geom.nurbs.smooth_primitive import SmoothPrimitive
from spinor_geom.surface.interior import RimPrimitive

BOUNDARY = FourierBoundary(np.array([0.2, 0.0, 0.0, 1.0, 0.1j]), 32)
POLE = 1.6 + 0.3j


def phi(z: np.ndarray) -> np.ndarray:
    return np.stack([np.exp(z), 3 * z**2, 1 / (z - POLE) ** 2], axis=-1)


def integral(z: np.ndarray) -> np.ndarray:
    return np.stack([np.exp(z), z**3, -1 / (z - POLE)], axis=-1)


def along(accuracy: float) -> SmoothPrimitive:
    found = SmoothPrimitive.along(BOUNDARY, phi, accuracy)
    assert found is not None
    return found


def test_values_are_the_integral_up_to_the_boundary() -> None:
    rng, primitive = np.random.default_rng(0), along(1e-10)
    start = BOUNDARY.point(np.zeros(()))
    # Ω is star-shaped about 0
    z = np.append(np.full(50, 1 - 1e-9), rng.random(50)) * BOUNDARY.point(rng.random(100))
    assert np.abs(primitive.inside(z) - (integral(z) - integral(start))).max() < 1e-9
    t = rng.random(30)
    moved, velocity = primitive.at(t)
    assert np.abs(moved - (integral(BOUNDARY.point(t)) - integral(start)).real).max() < 1e-9
    exact = (phi(BOUNDARY.point(t)) * BOUNDARY.derivative(t)[:, None]).real
    assert np.abs(velocity - exact).max() < 1e-6  # the derivative of a spline of degree 7


def test_panels_have_the_same_values_and_derivatives() -> None:
    t = np.random.default_rng(1).random(30)
    panels = RimPrimitive.along(BOUNDARY, phi, 16)
    for found, expected in zip(panels.at(t), along(1e-12).at(t), strict=True):
        assert np.abs(found - expected).max() < 1e-6
    corners = SplineBoundary.through(np.array([0, 1, 1 + 1j, 1j]), np.ones(4, dtype=bool))
    moved, velocity = RimPrimitive.along(corners, phi, 16).at(np.array([0.0, 0.125, 1.0]))
    assert np.abs(moved - (integral(np.array([0, 0.5, 0])) - integral(np.array(0.0))).real).max() < 1e-12
    assert np.abs(velocity[1] - 4 * phi(np.array(0.5)).real).max() < 1e-9


def test_nodes_follow_the_accuracy() -> None:
    def close(z: np.ndarray) -> np.ndarray:
        return (1 / (z - 1.23) ** 2)[:, None] * np.ones(3)  # Ω ends at x = 1.21

    found = [SmoothPrimitive.along(BOUNDARY, close, accuracy) for accuracy in (1e-3, 1e-10)]
    rough, fine = (len(each.z) for each in found if each is not None)
    assert rough < fine
    assert SmoothPrimitive.along(BOUNDARY, lambda z: np.sign(z.imag)[:, None] * np.ones(3), 1e-10) is None


def test_polynomials_on_quadrilaterals() -> None:
    corners = np.array([[0, 1, 1 + 0.5j, 0.2 + 0.5j], [1, 1.598 + 0.3j, 1.5 + 0.4j, 1 + 0.5j]])
    steps = np.roll(corners, -1, axis=1) - corners
    outlines = [(corners[..., None] + steps[..., None] * u).reshape(2, -1) for u in (CANDIDATES, CHECKS)]
    found = QuadPolynomials.through(integral, *outlines, 1e-9)
    assert found.is_accurate.tolist() == [True, False]  # beside the second one is a pole
    z = [np.array([0.5 + 0.3j, 0.9 + 0.01j]), np.array([1.3 + 0.3j])]
    for values, at in zip(found.values([0, 1], z), z, strict=True):
        assert np.abs(values - integral(at)).max() < 1e-9
    assert found.values([1], z[1:])[0] == pytest.approx(integral(z[1]), abs=1e-15)
