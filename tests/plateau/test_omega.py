"""Domains made for a loop: the parameter of their boundary, and its smoothness."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.arrays import NUMPY
from spinor_geom.deadline import time_limit
from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.domain import FourierBoundary
from spinor_geom.domain.polygons import is_simple
from spinor_geom.errors import DomainError, OutOfTimeError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm
from spinor_geom.plateau.harmonic.smooth_domain import (
    DomainShape,
    NodeDensity,
    _is_wide,
    resolved_form,
    rounded_boundary,
)
from tests.loops import noisy_ellipse, planar
from tests.plateau.slides import PEANUT, ellipse
from tests.strategies import rough_loops, smooth_loops

POINTS, STEPS, WIDTH = 128, 512, 0.35 / 128
EVEN = np.arange(POINTS) / POINTS
LOOPS = {
    "tennis seam": gallery.tennis_seam(0.8).sample(128),
    "Enneper": gallery.enneper(0.8).rim(96),
    "ellipse 4:1": gallery.ellipse(4.0).sample(128),
    "saddle 8:1": gallery.ellipse(8.0, 0.3).sample(128),
    "noisy": noisy_ellipse(120, amount=0.15),
}
every_loop = pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS.keys())


def density_of(loop):
    return NodeDensity(BoundaryCurve.from_loop(loop), POINTS)


def shape_of(loop, width=WIDTH, count=None):
    return DomainShape(density=density_of(loop), count=count or len(loop), steps=STEPS, width=width)


def unfolded(loop):
    """∂Ω from the unfolded least-area triangulation."""
    curve, density = BoundaryCurve.from_loop(loop), density_of(loop)
    polygon = unfolded_loop(curve.point(density.slide(EVEN)))
    return polygon, rounded_boundary(polygon, EVEN, shape_of(loop))


# --- density of the nodes ---------------------------------------------------------------------------------------------


@given(points=st.one_of(smooth_loops(), rough_loops()), seed=st.integers(0, 1000))
def test_parameter_and_slide_increase_and_are_inverse_to_each_other(points, seed):
    density = density_of(BoundaryLoop.from_points(points, corners=()))
    x = np.sort(np.random.default_rng(seed).uniform(-2, 3, size=500))
    for forth, back in ((density.parameter, density.slide), (density.slide, density.parameter)):
        assert (np.diff(forth(x)) > 0).all()
        np.testing.assert_allclose(back(forth(x)), x, atol=1e-13)
        np.testing.assert_allclose(forth(x + 1), forth(x) + 1, atol=1e-13)


def test_steps_are_shorter_at_bends_and_among_many_vertices():
    tips = density_of(LOOPS["saddle 8:1"])
    width = np.diff(tips.curve.length_share(tips.slide(np.linspace(0, 1, 257))))
    # the ellipse's tips are at s = 0 and ½. A third of the nodes follow the turning
    assert width[[0, 127, 128, 255]].max() < 0.3 * width[[64, 192]].min()
    t = 2 * np.pi * np.concatenate([np.arange(20) / 40, 0.5 + np.arange(100) / 200])
    uneven = density_of(BoundaryLoop.from_points(np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), corners=()))
    width = np.diff(uneven.slide(np.linspace(0, 1, 257)))
    # 0.7 + 0.3·(1/3) against 0.7 + 0.3·(5/3)
    assert np.median(width[width > width.mean()]) / np.median(width[width < width.mean()]) == pytest.approx(1.5, 0.1)


# --- rounded domains --------------------------------------------------------------------------------------------------


@every_loop
def test_rounded_boundary_is_simple_and_stays_near_its_polygon(loop):
    polygon, boundary = unfolded(loop)
    fine = boundary.grid(STEPS)[0]
    assert is_simple(fine)
    assert 0.5 * (np.conj(fine) * np.roll(fine, -1)).imag.sum() > 0
    # the Gaussian is a third of a point wide
    assert np.abs(boundary.point(EVEN) - polygon).max() < 0.2 * np.abs(np.diff(polygon)).max()
    assert len(boundary.vertices) == len(loop)
    assert len(boundary.coefficients) == 2 * (STEPS // 4) + 1
    assert resolved_form(boundary, STEPS, NUMPY).error < 1e-4


def test_rounding_leaves_an_ellipse_an_ellipse_and_rounds_a_square_off():
    exact = ellipse(2.0).point(EVEN)
    round_ = rounded_boundary(exact, EVEN, shape_of(LOOPS["Enneper"], 0.02, 64))
    expected = ellipse(2.0).coefficients * np.exp(-0.5 * (2 * np.pi * np.array([-1, 0, 1]) * 0.02) ** 2)
    # what is left of a cubic spline's error
    np.testing.assert_allclose(round_.point(EVEN), FourierBoundary(expected, 64).point(EVEN), atol=1e-7)
    square = planar(((0, 0), (1, 0), (1, 1), (0, 1)), 128).points @ np.array([1, 1j, 0])
    gaps = []
    for width in (0.01, 0.02, 0.04):
        boundary = rounded_boundary(square, EVEN, shape_of(LOOPS["Enneper"], width, 64))
        gaps.append(np.abs(boundary.point(EVEN) - square).max())
        assert is_simple(boundary.grid(STEPS)[0])
    # the corner is cut off by the width times 4 sides times 2^½ times the mean of |x|/2 of a Gaussian
    np.testing.assert_allclose(gaps, 4 * 2**0.5 * np.array([0.01, 0.02, 0.04]) / (2 * np.pi) ** 0.5, rtol=0.1)


def test_domains_that_cross_themselves_or_are_too_narrow_are_refused():
    eight = FourierBoundary(np.array([0.8, 0, 0, 1, 0]), 64)
    # Λ of an ellipse is symmetric however few steps there are
    for rim, steps, reason in ((eight, 256, "crosses itself"), (PEANUT, 64, "narrow"), (ellipse(8.0), 32, "narrow")):
        with pytest.raises(DomainError, match=reason):
            resolved_form(rim, steps, NUMPY)
    assert resolved_form(PEANUT, 256, NUMPY).error < 1e-5
    with time_limit(0.0), pytest.raises(OutOfTimeError):
        resolved_form(PEANUT, 256, NUMPY)


# far too narrow, and what a slit of 400 to 1 asks for
@pytest.mark.parametrize(("ratio", "steps", "reason"), [(100.0, 128, "too narrow"), (400.0, 7160, "at most 4096")])
def test_hopeless_domains_are_refused_before_their_form_is_made(ratio, steps, reason, monkeypatch):
    monkeypatch.setattr(DirichletForm, "of", None)
    with pytest.raises(DomainError, match=reason):
        resolved_form(ellipse(ratio), steps, NUMPY)


@pytest.mark.parametrize("width", [0.5, 1.9, 2.1, 8.0])
def test_a_strip_is_wide_from_two_edges_on(width):
    strip = planar(((0, 0), (600, 0), (600, width), (0, width)), 1200).points @ np.array([1, 1j, 0])
    assert _is_wide(strip) == (width > 2)
