"""Curves in formulas as polynomials: to rounding error, corners kept, wrong formulas refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, make_interp_spline

from spinor_geom import gallery
from spinor_geom.errors import CurveError
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve

CURVES = [gallery.twisted_circle(), gallery.tennis_seam(0.75), gallery.ellipse(32.0), gallery.scherk(2.5)]
CURVES += [gallery.schwarz_d_hexagon(), gallery.l_shape(0.3)]


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
@given(s=st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=20))
def test_polynomials_are_the_formula(curve, s):
    s = np.array(s)
    # beside a corner rounding decides which side is meant
    s = s[np.abs(s[:, None] - np.array([*curve.corners, 2.0])).min(axis=1) > 1e-12]
    fitted = BoundaryCurve.from_formula(curve)
    for own, formula, error in (
        (fitted.point, curve.point, 1e-14),
        (fitted.derivative, curve.derivative, 1e-13),
        (fitted.second_derivative, curve.second_derivative, 1e-10),
    ):
        scale = max(np.abs(formula(np.arange(500) / 500)).max(), 1.0)
        np.testing.assert_allclose(own(s), formula(s), rtol=0, atol=error * scale)


def test_a_moved_curve_keeps_its_derivatives():
    fitted = BoundaryCurve.from_formula(gallery.tennis_seam(0.8))
    moved = fitted.placed(3 * fitted.coefficients[-1] + [1, 2, 3], 3.0)
    s = np.linspace(0, 1, 77)
    np.testing.assert_allclose(moved.point(s), 3 * fitted.point(s) + [1, 2, 3], rtol=0, atol=1e-14)
    np.testing.assert_allclose(moved.derivative(s), 3 * fitted.derivative(s), rtol=0, atol=1e-13)


def circle(**changes) -> ClosedCurve:
    def turned(order):
        def value(s):
            angle = 2 * np.pi * np.asarray(s) + order * np.pi / 2
            return (2 * np.pi) ** order * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)

        return value

    return replace(ClosedCurve(point=turned(0), derivative=turned(1), second_derivative=turned(2)), **changes)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (circle(derivative=circle().second_derivative), "a derivative that differs from derivative="),
        (circle(second_derivative=circle().derivative), "a derivative that differs from second_derivative="),
        (circle(point=lambda s: circle().point(s / 2)), "not closed or has a jump"),
        (circle(point=lambda s: np.abs(circle().point(s))), "a jump or a kink that corners= does not contain"),
        (circle(point=lambda s: circle().point(s) / np.where(np.abs(s - 0.5) < 0.01, 0, 1)[..., None]), "not finite"),
        (circle(point=lambda s: circle().point(s)[..., :2]), "gives arrays of shape"),
    ],
    ids=["derivative", "second", "open", "kink", "infinite", "plane"],
)
def test_wrong_formulas_are_refused_with_the_parameter(wrong, reason):
    with np.errstate(divide="ignore", invalid="ignore"), pytest.raises(CurveError, match=reason) as error:
        BoundaryCurve.from_formula(wrong)
    assert 0 <= error.value.parameter <= 1


@pytest.mark.parametrize("away", [5e6, 1e9])
def test_a_curve_far_from_the_origin_is_that_at_the_origin(away):
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0.5], [0, 1.5, 0]])
    for curve in (gallery.polygon, lambda points: moved(gallery.tennis_seam(0.8), points[0])):
        near, far = (BoundaryCurve.from_formula(curve(corners + offset)) for offset in (0.0, away))
        assert far.length() == pytest.approx(near.length(), rel=1e-15 * away)


def moved(curve: ClosedCurve, by: np.ndarray) -> ClosedCurve:
    return replace(curve, point=lambda s: curve.point(s) + by)


def ellipse_run(depth: float, start: float) -> ClosedCurve:
    """An ellipse run through at the speed 1 − depth·cos 2π(s − start), in shares of the mean."""

    def angles(s):
        turn = 2 * np.pi * (np.asarray(s) - start)
        angle, rate = 2 * np.pi * np.asarray(s) - depth * np.sin(turn), 2 * np.pi * (1 - depth * np.cos(turn))
        return angle, rate, 4 * np.pi**2 * depth * np.sin(turn)

    def point(s):
        a, _, _ = angles(s)
        return np.stack([2 * np.cos(a), np.sin(a), 0 * a], axis=-1)

    def derivative(s):
        a, b, _ = angles(s)
        return np.stack([-2 * np.sin(a) * b, np.cos(a) * b, 0 * a], axis=-1)

    def second_derivative(s):
        a, b, c = angles(s)
        return np.stack([-2 * np.cos(a) * b**2 - 2 * np.sin(a) * c, -np.sin(a) * b**2 + np.cos(a) * c, 0 * a], axis=-1)

    return ClosedCurve(point=point, derivative=derivative, second_derivative=second_derivative)


@pytest.mark.parametrize("start", [0.0, 0.1234567, 0.7])
def test_a_curve_of_zero_speed_is_refused_with_the_parameter(start):
    with pytest.raises(CurveError, match="derivative of 0") as caught:
        BoundaryCurve.from_formula(ellipse_run(1.0, start))
    assert abs((caught.value.fields["parameter"] - start + 0.5) % 1 - 0.5) < 1e-4
    assert BoundaryCurve.from_formula(ellipse_run(0.999, start)).length() == pytest.approx(9.68844822054768, rel=1e-9)


def of_spline(spline: BSpline, joints: tuple[float, ...]) -> ClosedCurve:
    first, second = spline.derivative(), spline.derivative(2)
    return ClosedCurve(point=spline, derivative=first, second_derivative=second, joints=joints)


def test_splines_are_exact_between_their_joints() -> None:
    """The third derivative of a cubic spline jumps at each knot; polynomials across a knot approximate it slowly."""
    t = np.linspace(0, 1, 13)
    points = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), 0.2 * np.cos(4 * np.pi * t)], axis=1)
    points[-1] = points[0]
    spline = make_interp_spline(t, points, k=3, bc_type="periodic")
    fitted = BoundaryCurve.from_formula(of_spline(spline, tuple(t[:-1])))
    s = np.linspace(0, 1, 1000, endpoint=False)
    assert np.abs(fitted.point(s) - spline(s)).max() < 1e-14
    assert len(fitted.corners) < 100
    assert not fitted.corners.any()
    with pytest.raises(CurveError, match="kink"):
        BoundaryCurve.from_formula(of_spline(spline, ()))
