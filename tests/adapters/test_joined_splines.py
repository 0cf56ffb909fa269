"""JoinedSplines: arc length, corners and joints of rational splines; NurbsCurve: direction, moved ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters.cad_curves import JoinedSplines
from spinor_geom.errors import CurveError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.rational_splines import NurbsCurve
from tests.strategies import SEEDS, rigid_motions


def full_circle(radius=1.0):
    """A circle of three rational parabolas."""
    angle, is_between = 2 * np.pi * np.arange(7) / 6, np.arange(7) % 2 == 1
    poles = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(7)], axis=1)
    poles[is_between] *= 2
    knots = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 3]) / 3
    return NurbsCurve(knots=knots, control_points=poles, weights=np.where(is_between, 0.5, 1.0))


def line(first, last, degree=1):
    share = np.linspace(0, 1, degree + 1)[:, None]
    knots = np.repeat([0.0, 1.0], degree + 1)
    return NurbsCurve(knots=knots, control_points=(1 - share) * first + share * last, weights=np.ones(degree + 1))


def polygon(*points):
    corners = np.array(points, dtype=float)
    return JoinedSplines.of([line(a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])


def random_spline(seed, degree, spans):
    """An open rational spline with uneven knots and weights."""
    random = np.random.default_rng(seed)
    inner = np.cumsum(random.uniform(0.5, 2, size=spans))
    knots = np.concatenate([np.zeros(degree + 1), inner[:-1] / inner[-1], np.ones(degree + 1)])
    count = spans + degree
    # no bend is much sharper than the splines between two knots are long
    poles = np.cumsum(random.uniform([0.3, -0.7, -0.7], [1.7, 0.7, 0.7], size=(count, 3)), axis=0)
    return NurbsCurve(knots=knots, control_points=poles, weights=random.uniform(0.5, 2, size=count))


def test_circle_has_the_parameter_of_its_angle():
    curve = JoinedSplines.of([full_circle(2.0)]).curve()
    s = np.linspace(0, 1, 101)[:-1]
    exact = 2 * np.stack([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s), np.zeros(100)], axis=1)
    turned = 4 * np.pi * np.stack([-np.sin(2 * np.pi * s), np.cos(2 * np.pi * s), np.zeros(100)], axis=1)
    np.testing.assert_allclose(curve.point(s), exact, atol=1e-13)  # rounding of the inverse of the length
    np.testing.assert_allclose(curve.derivative(s), turned, atol=1e-11)
    np.testing.assert_allclose(curve.second_derivative(s), -4 * np.pi**2 * exact, atol=1e-8)
    assert curve.corners == ()
    assert JoinedSplines.of([full_circle(2.0)]).length == pytest.approx(4 * np.pi, rel=1e-13)


@pytest.mark.parametrize(("turn", "corners"), [(0.0, 2), (5e-4, 2), (2e-3, 3)])
def test_small_turns_are_joints(turn, corners):
    """Imported edges meet with small angles. Those up to SMOOTH_TURN = 1e-3 are no corners."""
    curve = polygon((0, 0, 0), (1, 0, 0), (2, np.tan(turn), 0), (1, 2, 0)).curve()
    assert len(curve.corners) == corners + 1
    fitted = BoundaryCurve.from_formula(curve)
    assert fitted.corners.sum() == corners + 1


@given(seed=SEEDS, degree=st.integers(2, 7), spans=st.integers(1, 6))
def test_random_splines_have_unit_speed_and_pass_their_own_points(seed, degree, spans):
    first = random_spline(seed, degree, spans)
    back = line(first.ends[1], first.ends[0], degree)
    joined = JoinedSplines.of([first, back])
    curve = joined.curve()
    s = np.random.default_rng(seed).random(50)
    # SPEED_ERROR = 1e-12 of the largest speed. The slowest is hundreds of times slower
    np.testing.assert_allclose(np.linalg.norm(curve.derivative(s), axis=1), joined.length, rtol=1e-8)
    fitted = BoundaryCurve.from_formula(curve)  # compares the derivatives with those of the points
    own = first.point(np.linspace(0, 1, 40))
    distance = np.linalg.norm(fitted.point(fitted.nearest(own)) - own, axis=1)
    assert distance.max() < 1e-12 * np.ptp(own)
    np.testing.assert_allclose(fitted.length(), joined.length, rtol=1e-10)


@given(motion=rigid_motions(max_shift=1e4), seed=SEEDS)
def test_curves_move_with_their_poles(motion, seed):
    """Far from the origin too, where coordinates have larger rounding errors."""
    spline = random_spline(seed, 3, 4)
    moved = NurbsCurve(knots=spline.knots, control_points=motion(spline.control_points), weights=spline.weights)
    splines = (JoinedSplines.of([each, line(each.ends[1], each.ends[0], 3)]) for each in (spline, moved))
    one, other = (BoundaryCurve.from_formula(each.curve()) for each in splines)
    s = np.linspace(0, 1, 20)
    np.testing.assert_allclose(other.point(s), motion(one.point(s)), atol=1e-10)  # 1e4 times the rounding error
    np.testing.assert_allclose(spline.reversed().point(s), spline.point(1 - s), atol=1e-13)


def test_moved_ends_keep_straight_lines_straight():
    moved = line(np.zeros(3), np.array([1.0, 0, 0]), 3).between(np.array([[0, 0.1, 0], [1, 0, 0.2]]))
    t = np.linspace(0, 1, 7)[:, None]
    np.testing.assert_allclose(moved.point(t[:, 0]), (1 - t) * [0, 0.1, 0] + t * [1, 0, 0.2], atol=1e-15)
    whole = full_circle().between(full_circle().ends + np.array([[0, 0, 1e-6], [0, 0, 0]]))
    away = np.linalg.norm(whole.point(t[:, 0]) - full_circle().point(t[:, 0]), axis=1)
    assert away.max() <= 1e-6


@pytest.mark.parametrize("at", [1 / 2, 1 / 3])
def test_a_spline_that_turns_back_is_refused(at):
    """A cubic whose derivative is (t - at)(v + wt)."""
    v, w = np.array([1.0, 2, 0]), np.array([1.0, -1, 0])
    steps = np.array([-at * v, (v - at * w) / 2 - at * v, w + v - at * w - at * v])
    poles = np.concatenate([np.zeros((1, 3)), np.cumsum(steps / 3, axis=0)])
    cusp = NurbsCurve(knots=np.repeat([0.0, 1.0], 4), control_points=poles, weights=np.ones(4))
    with pytest.raises(CurveError, match=r"kink|derivative of its spline is 0"):
        BoundaryCurve.from_formula(JoinedSplines.of([cusp, line(cusp.ends[1], cusp.ends[0], 3)]).curve())
