"""The gallery's curves: closed, with correct derivatives, sampled with their corners."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.errors import OptionError
from spinor_geom.gallery.known import sample_parameters

CURVES = [gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.ellipse(8.0, 0.3), gallery.scherk(2.5)]
CURVES += [gallery.schwarz_d_quadrilateral(), gallery.schwarz_d_hexagon()]
CURVES += [gallery.schwarz_p_quadrilateral(), gallery.schwarz_p_hexagon()]
CURVES += [gallery.random_curve(3), gallery.l_shape(rise=0.25), gallery.slit(bend=1.0), gallery.horseshoe()]
by_name = pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)


@by_name
def test_derivatives_are_those_of_the_point(curve):
    t = (np.arange(37) + 0.3) / 37  # no corner among them
    step = 1e-5
    first = (curve.point(t + step) - curve.point(t - step)) / (2 * step)
    second = (curve.derivative(t + step) - curve.derivative(t - step)) / (2 * step)
    size = np.abs(curve.derivative(t)).max()
    # central differences: error of order step² and round-off/step
    np.testing.assert_allclose(curve.derivative(t), first, atol=1e-6 * size)
    np.testing.assert_allclose(curve.second_derivative(t), second, atol=1e-5 * max(size, 1) ** 2)


@by_name
def test_curve_is_closed_and_continuous(curve):
    t = np.arange(2000) / 2000
    points = curve.point(t)
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    assert steps.max() < 1.01 * np.linalg.norm(curve.derivative(t), axis=1).max() / 2000
    np.testing.assert_allclose(curve.point(t + 1), points, atol=1e-13)


@by_name
def test_samples_hold_the_corners(curve):
    loop = curve.sample(50)
    assert len(loop) == 50
    assert loop.corners.sum() == len(curve.corners)
    expected = curve.point(np.array(curve.corners)).reshape(-1, 3)
    np.testing.assert_allclose(loop.points[loop.corners], expected, atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_random_curve_has_three_to_six_harmonics_and_is_repeatable(seed):
    t = np.arange(64) / 64
    points = gallery.random_curve(seed).point(t)
    np.testing.assert_array_equal(points, gallery.random_curve(seed).point(t))
    size = np.abs(np.fft.rfft(points, axis=0)).max(axis=1) / 64
    harmonics = np.flatnonzero(size > 1e-12)
    assert harmonics[0] == 1
    assert harmonics[-1] in (3, 4, 5, 6)
    assert (np.diff(harmonics) == 1).all()


@pytest.mark.parametrize(
    "bad",
    [
        lambda: gallery.tennis_seam(1.0),
        lambda: gallery.scherk(3.2),
        lambda: gallery.polygon(np.eye(2)),
        lambda: gallery.twisted_circle(np.inf),
        lambda: gallery.ellipse(np.nan),
        lambda: gallery.slit(length=0.0),
        lambda: gallery.slit(length=np.inf),
        lambda: gallery.slit(bend=7.0),
        lambda: gallery.horseshoe(half_width=1.0),
        lambda: gallery.horseshoe(turn=2 * np.pi),
    ],
)
def test_impossible_curves_are_refused(bad):
    with pytest.raises(OptionError):
        bad()


@given(st.lists(st.integers(0, 999), max_size=8, unique=True).map(sorted), st.integers(8, 60))
def test_sampled_parameters_are_increasing_and_hold_the_corners(corners, n):
    corners = [c / 1000 for c in corners]
    t, index = sample_parameters(n, corners)
    assert len(t) == n
    np.testing.assert_allclose(t[index], corners, atol=1e-15)
    turned = np.mod(t - t[0], 1.0)
    assert (np.diff(turned) > 0).all()
