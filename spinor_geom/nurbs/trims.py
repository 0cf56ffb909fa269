"""Splines through given curves, the edges of plane faces."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import interpolating_spline
from spinor_geom.mesh.rational_splines import NurbsCurve, spline_nodes

_FEWEST, _MOST = 8, 20_000  # numbers of pieces
_DEGREE = 5
_STRAIGHT = 1e-12  # largest distance of a straight side from a line of constant speed, relative to its length
_JUMP = 1e-6  # jump of the second derivative that ends a spline, relative to its largest value. Rounding is 1e-10


def splines_along(curve: BoundaryCurve, allowed: float) -> tuple[tuple[NurbsCurve, ...], float]:
    """A spline for each smooth part of a curve, and their largest distance from it at equal parameters.

    Parts end at corners and where the curvature jumps, as between a line and an arc: a spline across would need knots
    so dense there that CAD programs integrate along it inaccurately. A curve without either is one closed part. Pieces
    with an error above the allowed one, in mesh units, are halved.
    """
    start = curve.breaks[:-1]
    after, before = curve.second_derivative(start), curve.second_derivative(np.nextafter(curve.breaks[1:], 0.0))
    jumps = np.linalg.norm(after - np.roll(before, 1, axis=0), axis=1)
    found = start[curve.corners | (jumps > _JUMP * np.linalg.norm(after, axis=1).max())]
    ends = np.append(found, found[0] + 1) if len(found) else np.array([0.0, 1.0])
    sides = [_spline(curve, (first, last), allowed) for first, last in pairwise(ends)]
    return tuple(side for side, _ in sides), max(error for _, error in sides)


def area_inside(rims: Sequence[Sequence[NurbsCurve]], normal: Float[np.ndarray, "3"]) -> float:
    """Area of the part of a plane on the left of splines, seen from the tip of its unit normal: ½ ∮ n·(r × dr)."""
    start = rims[0][0].control_points[0]
    total = 0.0
    for curve in (curve for rim in rims for curve in rim):
        spline = BSpline(curve.knots, curve.control_points - start, curve.degree)
        at, weights = spline_nodes(curve.knots, curve.degree, curve.degree)
        total += float(weights @ np.cross(spline(at), spline.derivative()(at)) @ normal) / 2
    return total


def _spline(curve: BoundaryCurve, ends: tuple[float, float], allowed: float) -> tuple[NurbsCurve, float]:
    def point(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        return curve.point((1 - x) * ends[0] + x * ends[1])

    x = np.linspace(0, 1, _FEWEST + 1)
    points = point(x)
    missed = np.abs(points - points[0] - x[:, None] * (points[-1] - points[0])).max()
    if missed <= _STRAIGHT * np.abs(points[-1] - points[0]).max():
        return NurbsCurve(
            control_points=points[[0, -1]], weights=np.ones(2), knots=np.array([0.0, 0.0, 1.0, 1.0])
        ), missed
    while True:
        spline, middle = interpolating_spline(x, points, _DEGREE), (x[1:] + x[:-1]) / 2
        new = point(middle)
        errors = np.linalg.norm(spline(middle) - new, axis=1)
        lengths = np.pad(np.diff(x), 1, mode="edge")
        # neighbouring pieces have lengths of a ratio up to 2
        chosen = (errors > allowed) | (lengths[1:-1] > 2.1 * np.minimum(lengths[:-2], lengths[2:]))
        if not chosen.any() or len(x) + chosen.sum() > _MOST:
            break
        order = np.argsort(np.append(x, middle[chosen]))
        x, points = np.append(x, middle[chosen])[order], np.append(points, new[chosen], axis=0)[order]
    net = np.asarray(spline.c)
    net[[0, -1]] = points[[0, -1]]
    return NurbsCurve(control_points=net, weights=np.ones(len(net)), knots=spline.t), float(errors.max())
