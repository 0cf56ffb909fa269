"""What n points tell of their curve: the error that no solver can be blamed for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, make_interp_spline

from spinor_geom.bench.cases import Case
from spinor_geom.errors import SpinorGeomError
from spinor_geom.gallery.curves import harmonics
from spinor_geom.mesh.curve import ClosedCurve, CurveFunction
from spinor_geom.mesh.interpolation import by_arcs
from spinor_geom.plateau.solve import solve_plateau

_ROUNDING = 1e-12  # nothing comes nearer that matters


def points_limit(case: Case, n: int) -> float | None:
    """Least relative error of the area of minimal surfaces over usual interpolants of a smooth case's points.

    The interpolants know nothing but the points: the trigonometric polynomial where the points are equal steps of a
    parameter, and the periodic splines of degree 5 and 7 by arc length. Each is solved as a curve in formulas, by power
    series to rounding; which of them comes nearest is known only to who knows the answer, and that one counts.

    Returns:
        None where no interpolant is solved.
    """
    points = case.loop(n).points
    least: float | None = None
    for curve in _interpolants(points, equal_steps=case.sampling != "uneven"):
        try:
            error = abs(solve_plateau(curve, model="series").area / case.area - 1)
        except SpinorGeomError:  # it winds too much between the points
            continue
        least = error if least is None else min(least, error)
        if least < _ROUNDING:
            break
    return least


def _interpolants(points: Float[np.ndarray, "n 3"], *, equal_steps: bool) -> Iterator[ClosedCurve]:
    if equal_steps:
        series = 2 * np.fft.rfft(points, axis=0) / len(points)
        series[[0] if len(points) % 2 else [0, -1]] /= 2
        yield harmonics(series)
    around = np.vstack([points, points[:1]])
    for degree in (7, 5):
        spline = make_interp_spline(by_arcs(points), around, k=degree, bc_type="periodic")
        point, derivative, second_derivative = (_periodic(spline, order) for order in range(3))
        yield ClosedCurve(point=point, derivative=derivative, second_derivative=second_derivative)


def _periodic(spline: BSpline, order: int) -> CurveFunction:
    derivative = spline.derivative(order) if order else spline
    return lambda s: derivative(np.mod(s, 1.0))
