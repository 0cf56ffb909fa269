"""The smooth boundary curve Γ through all vertices of a loop, with its corners kept."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from spinor_geom.errors import CurveError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours
from spinor_geom.mesh.interpolation import DEGREES, between_corners, gauss_nodes, piece_places, smooth_curves, through

LENGTH_NODES = 16
SAMPLES_PER_PIECE = 8
NEAREST_SAMPLES = 2
MAX_NEWTON_STEPS = 30
NEWTON_STEP_TOLERANCE = 1e-15
# Errors allowed in the polynomials of a formula: inside pieces and between them per extent, of derivatives per size.
FORMULA_ERROR, CLOSING_ERROR, DERIVATIVE_ERROR = 1e-14, 1e-12, 1e-5
FORMULA_CHECKS = np.array([0.11, 0.31, 0.57, 0.83])  # where on each piece they are looked for
FEWEST_PIECES, MOST_PIECES = 64, 4096
# Where Γ is slower than this share of its largest speed it may stand still, and below that it does.
SLOW, STANDSTILL = 0.1, 1e-9
KINK = "has a jump or a kink that corners= does not name"

Breaks = Float[np.ndarray, " m_plus_1"]
Coefficients = Float[np.ndarray, "d_plus_1 m 3"]
Places = Float[np.ndarray, "n c"]
Points = Float[np.ndarray, "*pts 3"]
CurveFunction: TypeAlias = Callable[[Float[np.ndarray, "*pts"]], Points]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedCurve:
    """A closed curve Γ(s), s in [0, 1), in formulas.

    Attributes:
        point: Γ, in any units of length; takes arrays of any shape.
        derivative: Γ′.
        second_derivative: Γ″.
        corners: parameters of its corners, increasing; Γ′ jumps there, from the left-hand to the right-hand side.
    """

    point: CurveFunction
    derivative: CurveFunction
    second_derivative: CurveFunction
    corners: tuple[float, ...] = ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.corners)} corners)"


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryCurve:
    """A closed curve Γ(s) in space, s in [0, 1), of M polynomial pieces; piece i starts at point i of its loop.

    s is taken mod 1 everywhere. Within piece i, Γ(s) = Σ_k coefficients[k, i] (s − breaks[i])^(d − k), d the degree.

    Attributes:
        breaks: (M + 1,) parameters of the vertices, from 0 to 1: share of the length up to the vertex, by chords for
            degree 3, by arcs of the cubic spline for degrees 5 and 7 (chords would spoil their order); by
            its own arcs or equal steps for an analytic curve, equal steps for a formula.
        coefficients: (d + 1, M, 3) of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
        corners: (M,) bool, at which vertices Γ′ jumps; elsewhere splines are d − 1 times continuously differentiable,
            other curves analytic but for rounding errors.
        at_points: (M,) bool, which pieces start at points of the loop, where some do not: these divide long edges.
        slopes: coefficients of Γ′ where that comes from a formula: differentiated polynomials lose three digits.
    """

    breaks: Breaks
    coefficients: Coefficients
    corners: Bool[np.ndarray, " m"]
    slopes: Coefficients | None = None
    at_points: Bool[np.ndarray, " m"] | None = None

    def __repr__(self) -> str:
        degree, pieces, _ = self.coefficients.shape
        return f"BoundaryCurve({pieces} pieces of degree {degree - 1}, {int(self.corners.sum())} corners)"

    @classmethod
    def from_loop(cls, loop: BoundaryLoop) -> BoundaryCurve:
        """The interpolating curve through all vertices of a loop.

        Without corners it is the candidate that predicts left-out vertices best. Analytic curves converge faster than
        any order: the trigonometric polynomial where the vertices are equal steps of an analytic parameter, and of up
        to 256 vertices its like by arc length, wherever they lie. Otherwise it is a periodic spline, of the degree 3, 5
        or 7 that predicts every second vertex best from as many of the others to either side: smooth loops get the high
        orders, noisy ones the cubic. With corners it is one not-a-knot spline from each corner to the next (from a
        single corner back to itself), cubic but for sides of 16 points and more that show a higher degree in the same
        way; a side of two or one edges is a parabola or a straight line. A RepeatedPointError tells that two
        neighbouring points of the loop are equal.

        Source: Floater & Surazhsky, "Parameterization for curve interpolation" (2006), for the parameters.
        """
        require_distinct_neighbours(loop)
        (curve,) = cls.from_loops([loop])
        return curve

    @classmethod
    def from_loops(cls, loops: Sequence[BoundaryLoop]) -> list[BoundaryCurve]:
        """`from_loop` of several, made together where they have as many points; neighbours are known to be apart."""
        found: dict[int, tuple[Breaks, Coefficients]] = {}
        alike: dict[int, list[int]] = defaultdict(list)
        for i, loop in enumerate(loops):
            if loop.corners.any():
                found[i] = between_corners(loop.points, loop.corners)
            else:
                alike[len(loop)].append(i)
        for group in alike.values():
            found.update(zip(group, smooth_curves(np.stack([loops[i].points for i in group])), strict=True))
        return [cls(breaks=found[i][0], coefficients=found[i][1], corners=loop.corners) for i, loop in enumerate(loops)]

    @classmethod
    def from_formula(cls, curve: ClosedCurve) -> BoundaryCurve:
        """A curve that is given by formulas, by polynomials of degree 11 to 1e-14 of its extent.

        Each side between two corners is divided into equal pieces, 64 of them or more all around.

        Raises:
            CurveError: Γ does not close, has a value that is not finite, is not as smooth as it should be, or the
                derivatives are not its own.
        """
        pieces = FEWEST_PIECES
        while True:
            breaks, corners = _formula_breaks(curve.corners, pieces)
            fitted = cls(breaks=breaks, coefficients=_formula_coefficients(curve.point, breaks), corners=corners)
            between = breaks[:-1, None] + np.diff(breaks)[:, None] * FORMULA_CHECKS
            extent = np.ptp(fitted.coefficients[-1], axis=0).max()
            error = np.linalg.norm(fitted.point(between) - curve.point(between), axis=2)
            if not np.isfinite(error).all():
                raise CurveError(reason="is not finite", parameter=float(between[~np.isfinite(error)][0]))
            if error.max() <= FORMULA_ERROR * extent:
                break
            pieces *= 2
            if pieces > MOST_PIECES:
                raise CurveError(reason=KINK, parameter=float(between.flat[int(error.argmax())]))
        ends, slopes, _ = fitted._horner(np.arange(len(corners)), np.diff(breaks))
        gap, turn = np.roll(fitted.coefficients[[-1, -2]], -1, axis=1) - [ends, slopes]
        turn[np.roll(corners, -1)] = 0
        checks = [
            ("is not closed or has a jump", breaks[1:], gap, CLOSING_ERROR * extent),
            (KINK, breaks[1:], turn, DERIVATIVE_ERROR * np.abs(slopes).max()),
        ]
        for name in ("derivative", "second_derivative"):
            own, given = getattr(fitted, name)(between), getattr(curve, name)(between)
            allowed = DERIVATIVE_ERROR * max(np.abs(own).max(), extent)
            checks.append((f"has another derivative than {name}= says", between, own - given, allowed))
        for reason, at, difference, allowed in checks:
            error = np.nan_to_num(np.linalg.norm(difference, axis=-1), nan=np.inf)
            if error.max() > allowed:
                raise CurveError(reason=reason, parameter=float(at.flat[int(error.argmax())]))
        fitted = replace(fitted, slopes=_formula_coefficients(curve.derivative, breaks))
        _require_speed(fitted, between)
        return fitted

    def reversed(self) -> BoundaryCurve:
        """The same curve run the other way, from the same vertex."""
        widths = np.diff(self.breaks)
        first = np.concatenate([[0], np.arange(len(widths) - 1, 0, -1)])
        coefficients = _from_the_end(self.coefficients, widths)
        coefficients[-1] = self.coefficients[-1][first]
        slopes = None if self.slopes is None else -_from_the_end(self.slopes, widths)
        return BoundaryCurve(
            breaks=1 - self.breaks[::-1],
            coefficients=coefficients,
            corners=self.corners[first],
            slopes=slopes,
            at_points=None if self.at_points is None else self.at_points[first],
        )

    def smoothed(self, width: float) -> BoundaryCurve:
        """The cubic spline with the same breaks through vertices averaged along Γ, without corners.

        The weights are Gaussian; their standard deviation is `width`, a share of the whole curve.
        """
        count = len(self.breaks) - 1
        n = SAMPLES_PER_PIECE * count
        spectrum = np.fft.rfft(self.point(np.arange(n) / n), axis=0)
        spectrum *= np.exp(-0.5 * (2 * np.pi * width * np.arange(len(spectrum))) ** 2)[:, None]
        samples = np.fft.irfft(spectrum, n=n, axis=0)
        vertices = CubicSpline(np.arange(n + 1) / n, np.vstack([samples, samples[:1]]), bc_type="periodic")(self.breaks)
        spline = CubicSpline(self.breaks, vertices, bc_type="periodic")
        return BoundaryCurve(breaks=self.breaks, coefficients=spline.c, corners=np.zeros(count, dtype=bool))

    def towards(self, other: BoundaryCurve, share: float) -> BoundaryCurve:
        """The curve (1 − share)·self + share·other of two curves with the same breaks; corners are those of `other`."""
        degree = max(self.degree, other.degree)
        first, last = (
            np.concatenate([np.zeros((degree - c.degree, *c.coefficients.shape[1:])), c.coefficients])
            for c in (self, other)
        )
        return BoundaryCurve(breaks=self.breaks, coefficients=(1 - share) * first + share * last, corners=other.corners)

    def placed(self, points: Float[np.ndarray, "m 3"], scale: float) -> BoundaryCurve:
        """The curve enlarged by `scale` and moved so that it goes through its loop's points, to the last bit."""
        coefficients, own = scale * self.coefficients, slice(None) if self.at_points is None else self.at_points
        coefficients[-1] += points[0] - coefficients[-1][own][0]
        coefficients[-1, own] = points
        slopes = None if self.slopes is None else scale * self.slopes
        return replace(self, coefficients=coefficients, slopes=slopes)

    @property
    def at_loop(self) -> Float[np.ndarray, " n"]:
        """Parameters of the loop's points."""
        starts = self.breaks[:-1]
        return starts if self.at_points is None else starts[self.at_points]

    @property
    def degree(self) -> int:
        """Degree d of the pieces."""
        return len(self.coefficients) - 1

    def point(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ(s), in mesh units; at the parameter of a vertex it is that vertex, to the last bit."""
        return self._horner(*self._local(s))[0]

    def derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ′(s), in mesh units per unit of s; at a corner the side that starts there counts."""
        return self._horner(*self._local(s))[1]

    def second_derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ″(s), in mesh units per squared unit of s; at a corner the side that starts there counts."""
        return self._horner(*self._local(s))[2]

    def bulge(self) -> float:
        """Largest distance of a piece from the straight edge between its vertices, in the curve's units of length."""
        share = np.arange(1, 2 * SAMPLES_PER_PIECE) / (2 * SAMPLES_PER_PIECE)
        vertices = self.coefficients[-1]
        edge = np.roll(vertices, -1, axis=0) - vertices
        away = self.point(self.breaks[:-1] + share[:, None] * np.diff(self.breaks)) - vertices
        along = np.clip((away * edge).sum(axis=2) / (edge**2).sum(axis=1), 0, 1)
        return float(np.linalg.norm(away - along[:, :, None] * edge, axis=2).max())

    def length(self) -> float:
        """Length of Γ in mesh units, by 16-point Gauss–Legendre quadrature on every piece."""
        nodes, weights = gauss_nodes(LENGTH_NODES)
        widths = np.diff(self.breaks)[:, None]
        s = self.breaks[:-1, None] + widths * (nodes + 1) / 2
        speed = np.linalg.norm(self.derivative(s), axis=-1)
        return float((speed * weights * widths).sum() / 2)

    def length_share(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """Share of the length of Γ up to Γ(s), one more after each turn; the parameter of a spline is that, about."""
        if self.degree <= max(DEGREES):
            return s
        whole = np.floor(s)
        return np.asarray(self._shares(s - whole) + whole)

    @cached_property
    def _shares(self) -> CubicSpline:
        n = SAMPLES_PER_PIECE * (len(self.breaks) - 1)
        grid = np.arange(n + 1) / n
        length = CubicSpline(grid, np.linalg.norm(self.derivative(grid), axis=1)).antiderivative()(grid)
        return CubicSpline(grid, length / length[-1])

    def nearest(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Parameter in [0, 1) of the point of Γ nearest to each point, (N,).

        The two nearest of 8 samples a piece are found first; on the parts of Γ to both sides of them the distance is
        then minimised by Newton's method to round-off. Where two parts of Γ are equally near to within the spacing of
        the samples, either may be chosen.
        """
        tree, parameters = self._samples
        _, found = tree.query(points, k=NEAREST_SAMPLES)
        starts = np.stack([found, found - 1], axis=-1).reshape(len(points), 2 * NEAREST_SAMPLES) % len(parameters)
        piece = starts // SAMPLES_PER_PIECE
        low = parameters[starts] - self.breaks[piece]
        high = np.append(parameters, 1.0)[starts + 1] - self.breaks[piece]
        local = self._minimise_distance(points[:, None, :], piece, low, high)
        distance = np.linalg.norm(self._horner(piece, local)[0] - points[:, None, :], axis=-1)
        best = np.argmin(distance, axis=1)[:, None]
        s = np.take_along_axis(self.breaks[piece] + local, best, axis=1)[:, 0]
        return np.where(s < 1.0, s, 0.0)

    @cached_property
    def _samples(self) -> tuple[cKDTree, Float[np.ndarray, " k"]]:
        fractions = np.arange(SAMPLES_PER_PIECE) / SAMPLES_PER_PIECE
        parameters = (self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * fractions).reshape(-1)
        return cKDTree(self.point(parameters)), parameters

    def _local(self, s: Float[np.ndarray, "*pts"]) -> tuple[Int[np.ndarray, "*pts"], Float[np.ndarray, "*pts"]]:
        """The piece of each parameter and its local parameter there."""
        wrapped = np.mod(s, 1.0)
        piece = np.clip(np.searchsorted(self.breaks, wrapped, side="right") - 1, 0, len(self.breaks) - 2)
        return piece, wrapped - self.breaks[piece]

    def _horner(self, piece: Int[np.ndarray, "*pts"], local: Float[np.ndarray, "*pts"]) -> tuple[Points, ...]:
        """Γ, Γ′ and Γ″ at local parameters of given pieces, their right ends included."""
        h = local[..., None]
        value = self.coefficients[0][piece]
        first = second = np.zeros_like(value)
        for coefficient in self.coefficients[1:]:
            second = second * h + first
            first = first * h + value
            value = value * h + coefficient[piece]
        if self.slopes is None:
            return value, first, 2 * second
        first, second = self.slopes[0][piece], np.zeros_like(value)
        for coefficient in self.slopes[1:]:
            second = second * h + first
            first = first * h + coefficient[piece]
        return value, first, second

    def _minimise_distance(
        self, points: Float[np.ndarray, "n 1 3"], piece: Int[np.ndarray, "n c"], low: Places, high: Places
    ) -> Places:
        """Local parameter between `low` and `high` where the distance to a point is least, by Newton's method."""
        local: Places = (low + high) / 2
        for _ in range(MAX_NEWTON_STEPS):
            value, first, second = self._horner(piece, local)
            offset = value - points
            slope = (offset * first).sum(axis=-1)
            speed = (first * first).sum(axis=-1)
            bend = speed + (offset * second).sum(axis=-1)
            # where the squared distance is not convex, the Gauss–Newton step still goes downhill
            curvature = np.where(bend > 0.1 * speed, bend, speed)
            step = np.divide(slope, curvature, out=np.zeros_like(slope), where=curvature > 0)
            new = np.clip(local - step, low, high)
            moved = np.abs(new - local).max(initial=0.0)
            local = new
            if moved <= NEWTON_STEP_TOLERANCE:
                break
        return local


def _from_the_end(coefficients: Coefficients, widths: Float[np.ndarray, " m"]) -> Coefficients:
    """Polynomials of pieces in the reversed order, by the distance from each one's end."""
    moved = coefficients.copy()
    # repeated synthetic division: about the pieces' ends
    for last in range(len(moved), 1, -1):
        for k in range(1, last):
            moved[k] += moved[k - 1] * widths[:, None]
    sign = (-1.0) ** np.arange(len(moved) - 1, -1, -1)
    return np.asarray(moved[:, ::-1] * sign[:, None, None])


def _formula_breaks(corners: Sequence[float], pieces: int) -> tuple[Breaks, Bool[np.ndarray, " m"]]:
    """Ends of so many pieces or some more, 0 among them, and which of them are corners."""
    ends = np.unique(np.mod([0.0, *corners], 1.0))
    sides = pairwise([*ends.tolist(), 1.0])
    starts = [np.linspace(a, b, math.ceil((b - a) * pieces), endpoint=False) for a, b in sides]
    breaks = np.concatenate([*starts, [1.0]])
    return breaks, np.isin(breaks[:-1], np.mod(corners, 1.0))


def _formula_coefficients(function: CurveFunction, breaks: Breaks) -> Coefficients:
    """Polynomials through the values of Γ or Γ′ at Chebyshev's points inside each piece and at its start."""
    x, width = piece_places(), np.diff(breaks)
    values = np.asarray(function(breaks[:-1, None] + width[:, None] * x), dtype=np.float64)
    if values.shape != (len(width), len(x), 3):
        raise CurveError(reason=f"gives arrays of shape {values.shape} for {len(width), len(x)} points", parameter=0.0)
    return through(np.moveaxis(values, 1, 0), width)


def _require_speed(curve: BoundaryCurve, s: Float[np.ndarray, "m k"]) -> None:
    """Checks that Γ′ is 0 nowhere: where it is, the curve has no tangent."""
    s = np.concatenate([curve.breaks[:-1], s.ravel()])
    speed = np.linalg.norm(curve.derivative(s), axis=1)
    largest, reach = speed.max(), np.diff(curve.breaks).max()
    s = s[speed < SLOW * largest]
    start = s
    # to where |Γ′|² is least, by Gauss-Newton steps: near a zero Γ′ is about Γ″ times the distance to it
    for _ in range(MAX_NEWTON_STEPS if len(s) else 0):
        slope, bend = curve.derivative(s), curve.second_derivative(s)
        size = np.maximum((bend * bend).sum(axis=1), np.finfo(np.float64).tiny)
        s = np.clip(s - (slope * bend).sum(axis=1) / size, start - reach, start + reach)
    speed = np.linalg.norm(curve.derivative(s), axis=1)
    if (speed < STANDSTILL * largest).any():
        raise CurveError(reason="stands still, its derivative is 0", parameter=float(s[speed.argmin()] % 1.0))
