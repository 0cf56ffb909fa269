"""The distance between a boundary and Γ is defined equally for all routes, and covers all of both curves."""

import numpy as np
import pytest

from spinor_geom.arrays import NUMPY
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.misfit import BoundaryResidual, Misfit

OFF = 1e-3


def circle(points: int, radius: float = 1.0, fingers: int = 0) -> np.ndarray:
    """Points of a circle; between the first two a half ellipse of so many points, an edge wide and two high."""
    t = 2 * np.pi * np.arange(points) / points
    c = radius * np.column_stack([np.cos(t), np.sin(t), 0 * t])
    angle = np.pi * (np.arange(fingers) + 1) / (fingers + 1)
    half = (c[0] - c[1]) / 2 * 0.9
    finger = (c[0] + c[1]) / 2 + np.outer(np.cos(angle), half) + np.outer(np.sin(angle), [4 * np.pi / points, 0, 0])
    return np.concatenate([c[:1], finger, c[1:]])


def tensors(points: np.ndarray) -> CurveTensors:
    return CurveTensors.of(BoundaryCurve.from_loop(BoundaryLoop.from_points(points, corners=())), NUMPY)


def misfit(boundary: np.ndarray, slide: np.ndarray, curve: CurveTensors) -> Misfit:
    return Misfit.of(np.array(boundary), np.array(slide), curve)


@pytest.mark.parametrize("bend", [0.0, 0.9])
def test_rms_is_a_mean_by_arc_length_however_the_boundary_is_sampled(bend):
    curve = tensors(circle(40))
    t = np.arange(400) / 400
    s = t + bend * np.sin(2 * np.pi * t) / (2 * np.pi)  # steps between a tenth and nearly two of the mean one
    off = OFF * (1 + np.cos(2 * np.pi * s))
    boundary = (1 + off)[:, None] * curve.point_and_derivative(np.array(s))[0]
    measured = misfit(boundary, s, curve)
    assert measured.rms == pytest.approx(OFF * 1.5**0.5, rel=5e-3)
    assert measured.max == pytest.approx(2 * OFF, rel=1e-9)
    assert measured.max_per_local_edge == pytest.approx(2 * OFF / (2 * np.sin(np.pi / 40)), rel=1e-9)
    assert measured.length == pytest.approx(2 * np.pi, rel=1e-4)


def test_a_finger_that_is_passed_over_is_missed_by_many_of_its_edges():
    points = circle(200, fingers=12)
    curve = tensors(points)
    breaks = curve.breaks[:-1]
    chord = 2 * np.pi / 200
    near = np.concatenate([[0], np.arange(13, len(points))])
    measured = misfit(points[near], breaks[near], curve)
    assert measured.max == pytest.approx(2 * chord, rel=0.1)
    assert measured.max_per_local_edge > 6
    assert 0.1 * chord < measured.rms < chord
    assert misfit(points, breaks, curve).max < 0.05 * measured.max


def test_a_boundary_at_one_point_of_the_curve_is_far():
    points = circle(40)
    assert misfit(1e16 * points, np.full(40, 1e16), tensors(points)).rms > 1e16  # as of a fit that diverged


def test_a_boundary_that_runs_off_is_far():
    curve = tensors(circle(40))
    t = np.arange(400) / 400
    boundary = curve.point_and_derivative(np.array(t))[0]
    # out to a distance of 1 and back while the nearest point of Γ stays
    out = np.interp(np.arange(50), [0, 25, 49], [0, 1, 0])
    spike = np.outer(1 + out, boundary[0])
    measured = misfit(np.concatenate([spike, boundary[1:]]), np.concatenate([1e-9 * np.arange(50), t[1:]]), curve)
    assert measured.max == pytest.approx(1, rel=1e-12)
    # ∫ x² over both ways, over the length of Γ
    assert measured.rms == pytest.approx((2 / 3 / (2 * np.pi)) ** 0.5, rel=0.02)


def test_rims_are_weighed_by_their_lengths():
    near = Misfit(rms=1.0, max=2.0, max_per_local_edge=3.0, length=3.0)
    far = Misfit(rms=3.0, max=4.0, max_per_local_edge=1.0, length=1.0)
    assert Misfit.together([near, far]) == Misfit(rms=3**0.5, max=4.0, max_per_local_edge=3.0, length=4.0)


def test_a_local_miss_is_no_convergence_and_is_given_as_the_reason():
    residual = BoundaryResidual(rms=9e-4, max=0.041, max_per_local_edge=2.0, mean_edge=1.0, diagonal=64.0)
    converged, reason = residual.verdict(1e-3, steps=7, limit="more units bring it no nearer")
    assert not converged
    assert "the largest distance is 2.0e+00 of the edges there, above 1.0e-01: more units bring it no nearer" in reason
    everywhere = BoundaryResidual(rms=9e-4, max=0.041, max_per_local_edge=0.05, mean_edge=1.0, diagonal=64.0)
    assert everywhere.verdict(1e-3, steps=7, limit="") == (True, "residual 9.0e-04 of the mean edge after 7 steps")
    assert "above the tolerance 1.0e-04" in everywhere.verdict(1e-4, steps=7, limit="")[1]
