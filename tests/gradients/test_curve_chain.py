"""Derivatives of curves by their points, against differences, for every kind of curve."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.errors import NotDifferentiableError
from spinor_geom.gradients.curve_chain import by_points
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from tests.gradients.cases import QUADRILATERAL, arched, wavy

ROUGH = 0.02 * np.random.default_rng(3).normal(size=(60, 3))
# points, corners, kind and degree of the curve
CURVES = {
    "trigonometric": (wavy(64), (), "analytic", 11),
    "trigonometric, odd": (wavy(33), (), "analytic", 11),
    "Poisson kernels": (wavy(40, uneven=1), (), "analytic", 11),
    "spline of degree 7": (wavy(300, uneven=1), (), "spline", 7),
    "few points": (wavy(12, uneven=1), (), "cubic", 3),
    "rough": (wavy(60, uneven=1) + ROUGH, (), "cubic", 3),
    "polygon": (QUADRILATERAL, (0, 1, 2, 3), "cubic", 3),
    "parabolas": (arched(2), range(0, 8, 2), "cubic", 3),
    "short sides": (arched(3), range(0, 12, 3), "cubic", 3),
    "sides": (arched(6), range(0, 24, 6), "cubic", 3),
    "sides of degree 5": (arched(20), range(0, 80, 20), "spline", 5),
    "first point inside a side": (np.roll(arched(20), 7, axis=0), range(7, 87, 20), "spline", 5),
    "a straight side": (np.concatenate([arched(20)[:60], QUADRILATERAL[3:]]), (0, 20, 40, 60), "spline", 5),
    "one corner": (wavy(30, uneven=1), (7,), "cubic", 3),
    "a long edge": (np.concatenate([arched(12)[:36], QUADRILATERAL[3:] + 0.1]), (0, 12), "cubic", 3),
}


def stadium(arc):
    """Two straight lines of six edges and two half circles."""
    half = np.exp(1j * np.pi * (np.arange(arc) / arc - 0.5)) + 1
    z = np.concatenate([half, np.arange(6) / -3 + 1 + 1j])
    return np.array([[w.real, w.imag, 0] for w in (*z, *-z)])


CURVES |= {
    "lines and arcs": (stadium(9), (), "cubic", 3),
    "lines and an arc of one edge": (np.delete(stadium(9), range(1, 9), axis=0), (), "cubic", 3),
    "lines and a corner": (stadium(8), (3,), "cubic", 3),
}
QUINTIC = {
    "uniform": (wavy(64), (), 5),
    "rough": (wavy(60, uneven=1) + ROUGH, (), 5),
    "few points": (wavy(12, uneven=1), (), 3),
    "sides": (arched(20), range(0, 80, 20), 5),
    "short sides": (arched(6), range(0, 24, 6), 3),
    "straight sides": (np.concatenate([arched(20)[:20], np.linspace(*QUADRILATERAL[[1, 0]], 20)[:-1]]), (0, 20), 5),
}
CURVES |= {f"quintic, {name}": (points, at, "quintic", degree) for name, (points, at, degree) in QUINTIC.items()}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("is_back", [False, True])
def test_chain_rule_equals_differences(name, is_back):
    points, corners, kind, degree = CURVES[name]
    m, rng = len(points), np.random.default_rng(1)

    def curve(moved):
        loop = BoundaryLoop.from_points(moved, corners=list(corners))
        found = BoundaryCurve.from_loop(loop, quintic=kind == "quintic")
        assert (found.kind, found.degree) == (kind, degree)
        return found.reversed() if is_back else found

    here = curve(points)
    piece, u = np.repeat(np.arange(m), 3), np.tile([0.1, 0.5, 0.8], m)

    def places(one):
        return one.breaks[piece] + u * np.diff(one.breaks)[piece]

    tangent, weight = here.derivative(places(here)), rng.normal(size=(3 * m, 3))
    weight -= (weight * tangent).sum(axis=1, keepdims=True) / (tangent**2).sum(axis=1, keepdims=True) * tangent
    # smooth, so that the choice of the curve stays the same
    move = np.sin(2 * points + 1) @ rng.normal(size=(3, 3))
    step = 1e-5 if "line" in name else 1e-4  # straight lines stay straight within rounding to float32

    def value(size):
        there = curve(points + size * step * move)
        return (weight * there.point(places(there))).sum()

    difference = (8 * (value(1) - value(-1)) - (value(2) - value(-2))) / (12 * step)
    gradient = by_points(here, places(here), weight)
    if is_back:
        gradient = np.concatenate([gradient[:1], gradient[:0:-1]])
    # weights and displacements are of size 1; rounding of the differences, for Poisson kernels of condition 1e8
    assert abs((gradient * move).sum() - difference) < 3e-8 * m**0.5


def test_curve_without_points_is_not_differentiable():
    formula = BoundaryCurve.from_formula(gallery.tennis_seam())
    with pytest.raises(NotDifferentiableError, match="formula"):
        by_points(formula, np.zeros(1), np.zeros((1, 3)))


@settings(max_examples=6)
@given(
    count=st.integers(4, 60),
    corners=st.sets(st.integers(0, 59), max_size=6),
    noise=st.sampled_from([0.0, 0.01, 0.1]),
    seed=st.integers(0, 99),
)
def test_similarities_move_the_curve_with_its_points(count, corners, noise, seed):
    rng = np.random.default_rng(seed)
    points = wavy(count, uneven=1, seed=seed) + noise * rng.normal(size=(count, 3))
    loop = BoundaryLoop.from_points(points, corners=sorted(corner % count for corner in corners))
    curve = BoundaryCurve.from_loop(loop)
    s, weight = rng.uniform(size=200), rng.normal(size=(200, 3))
    gradient, values = by_points(curve, s, weight), curve.point(s)
    size = np.abs(weight).sum() * curve.bulge() + np.abs(weight).sum()
    # rounding errors, of Poisson kernels of condition 1e8
    assert np.abs(gradient.sum(axis=0) - weight.sum(axis=0)).max() < 1e-8 * size
    assert abs((gradient * points).sum() - (weight * values).sum()) < 1e-8 * size
    torques = np.cross(points, gradient).sum(axis=0), np.cross(values, weight).sum(axis=0)
    assert np.abs(torques[0] - torques[1]).max() < 1e-8 * size


def test_parameters_just_below_the_first_point_belong_to_it():
    curve = BoundaryCurve.from_loop(BoundaryLoop.from_points(QUADRILATERAL, corners=[0, 1, 2, 3]))
    by_values = np.array([[1.0, 2.0, 3.0]])
    below, at = (by_points(curve, np.array([s]), by_values) for s in (-1e-17, 0.0))
    np.testing.assert_array_equal(below, at)
    np.testing.assert_array_equal(curve.derivative(np.array(-1e-17)), curve.derivative(np.array(0.0)))
