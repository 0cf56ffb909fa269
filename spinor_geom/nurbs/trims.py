"""Splines through given curves, the edges of plane faces."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.rational_splines import NurbsCurve, spline_nodes
from spinor_geom.nurbs.spline_space import SplineSpace
from spinor_geom.nurbs.strips import DEGREE, ROUNDS, halved

_STRAIGHT = 1e-12  # largest distance of a straight side from a line of constant speed, relative to its length


def splines_along(curve: BoundaryCurve, allowed: float) -> tuple[tuple[NurbsCurve, ...], float]:
    """A spline for each side between corners of a curve, and their largest distance from it at equal parameters.

    A curve without corners is one closed side. Pieces with an error above the allowed one, in mesh units, are halved.
    """
    corners = curve.breaks[:-1][curve.corners]
    ends = np.append(corners, corners[0] + 1) if len(corners) else np.array([0.0, 1.0])
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

    breaks: tuple[float, ...] = (0.0, 1.0)
    for _ in range(ROUNDS):
        space = SplineSpace.on(DEGREE, breaks)
        points = point(space.nodes)
        line = points[0] + space.nodes[:, None] * (points[-1] - points[0])
        missed = np.abs(points - line).max()
        if missed <= _STRAIGHT * np.abs(points[-1] - points[0]).max():
            return _curve(SplineSpace.on(1, (0.0, 1.0)), points[[0, -1]]), float(missed)
        errors = np.linalg.norm(space.to_between @ points - point(space.between), axis=1)
        chosen = np.isin(np.arange(len(breaks) - 1), space.pieces[errors > allowed])
        if not chosen.any():
            break
        breaks = halved(breaks, chosen)
    net = space.interpolation @ points
    net[[0, -1]] = points[[0, -1]]
    return _curve(space, net), float(errors.max())


def _curve(space: SplineSpace, net: Float[np.ndarray, "k 3"]) -> NurbsCurve:
    return NurbsCurve(control_points=net, weights=np.ones(len(net)), knots=space.knots)
