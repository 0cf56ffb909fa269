"""The smooth boundary curve Γ through all vertices of a loop, with its corners kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import factorial
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.spatial import cKDTree

from spinor_geom.errors import CurveError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours

LENGTH_NODES = 16
SAMPLES_PER_PIECE = 8
NEAREST_SAMPLES = 2
MAX_NEWTON_STEPS = 30
NEWTON_STEP_TOLERANCE = 1e-15
# Degrees tried on loops without corners; higher ones gain nothing that float64 can hold.
DEGREES = (3, 5, 7)
# Fewer points do not show how smooth a curve is.
MIN_POINTS_FOR_HIGH_DEGREE = 16
# A higher degree must predict left-out points this many times better: on rough curves it only swings.
GAIN_PER_DEGREE = 2.5
ARC_NODES = 6
# The spectrum of points that lie on an analytic curve at equal steps of its parameter falls off: what is left of it in
# its last fifth is at most this share of what its last half holds, or of the error of splines, or rounding error as a
# share of the extent.
SPECTRAL_FALL, SPECTRAL_ROUNDING = 1e-2, 1e-14
# Edges of such a curve that differ by a larger factor leave it to splines by arcs, whose parameter is the length.
MOST_UNEVEN = 40.0
# Polynomials of a formula: their degree, the error that is allowed, as a share of the curve's extent, where it is
# looked for on each piece, and the numbers of pieces that are tried. Derivatives of the formula may differ by more.
FORMULA_DEGREE, FORMULA_ERROR = 11, 1e-14
FORMULA_CHECKS = np.array([0.11, 0.31, 0.57, 0.83])
FEWEST_PIECES, MOST_PIECES = 64, 4096
# Largest gap between the end of a piece and the start of the next, as a share of the extent.
CLOSING_ERROR = 1e-12
DERIVATIVE_ERROR = 1e-5
KINK = "has a jump or a kink that corners= does not name"


CurveFunction: TypeAlias = Callable[[Float[np.ndarray, "*pts"]], Float[np.ndarray, "*pts 3"]]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryCurve:
    """A closed curve Γ(s) in space, s in [0, 1), of M polynomial pieces; piece i starts at vertex i of its loop.

    s is taken mod 1 everywhere. Within piece i, Γ(s) = Σ_k coefficients[k, i] (s − breaks[i])^(d − k), d the degree.

    Attributes:
        breaks: (M + 1,) parameters of the vertices, from 0 to 1: share of the length up to the vertex, by chords for
            degree 3, by arcs of the cubic spline for degrees 5 and 7 (chords would spoil their order); equal steps for
            a trigonometric polynomial or a formula.
        coefficients: (d + 1, M, 3) of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
        corners: (M,) bool, at which vertices Γ′ jumps; elsewhere splines are d − 1 times continuously differentiable,
            other curves analytic but for rounding errors.
        slopes: coefficients of Γ′ where that comes from a formula: differentiated polynomials lose three digits.
    """

    breaks: Float[np.ndarray, " m_plus_1"]
    coefficients: Float[np.ndarray, "d_plus_1 m 3"]
    corners: Bool[np.ndarray, " m"]
    slopes: Float[np.ndarray, "d_plus_1 m 3"] | None = None

    @classmethod
    def from_loop(cls, loop: BoundaryLoop) -> BoundaryCurve:
        """The interpolating curve through all vertices of a loop.

        Where the vertices sample an analytic curve at equal steps of its parameter, as a falling spectrum shows, it is
        the trigonometric polynomial through them, which converges faster than any order. Otherwise it is a spline.
        Without corners that is periodic, of the degree 3, 5 or 7 that predicts every second vertex best from as many of
        the others to either side: smooth loops get the high orders, noisy ones the cubic. With corners it is one cubic
        not-a-knot spline from each corner to the next (from a single corner back to itself); a side of two or one edges
        is a parabola or a straight line.

        Raises:
            RepeatedPointError: two neighbouring points of the loop are equal.

        Source: Floater & Surazhsky, "Parameterization for curve interpolation" (2006), for the parameters.
        """
        require_distinct_neighbours(loop.points)
        if not loop.corners.any() and len(loop) >= MIN_POINTS_FOR_HIGH_DEGREE:
            breaks = _by_arcs(loop.points)
            degree, error = _predicting_degree(loop.points, breaks)
            if _is_trigonometric(loop.points, error):
                even = np.arange(len(loop) + 1) / len(loop)
                return cls(breaks=even, coefficients=_trigonometric_coefficients(loop.points), corners=loop.corners)
            if degree > DEGREES[0]:
                spline = _smooth_spline(loop.points, breaks, degree)
                return cls(breaks=breaks, coefficients=spline, corners=loop.corners)
        breaks, coefficients = piecewise_cubic(loop.points, loop.corners)
        return cls(breaks=breaks, coefficients=coefficients, corners=loop.corners)

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
                worst = float(between.flat[int(error.argmax())])
                raise CurveError(reason=KINK, parameter=worst)
        ends, slopes, _ = fitted._horner(np.arange(len(corners)), np.diff(breaks))
        gap = np.linalg.norm(ends - np.roll(fitted.coefficients[-1], -1, axis=0), axis=1)
        if gap.max() > CLOSING_ERROR * extent:
            raise CurveError(reason="is not closed or has a jump", parameter=float(breaks[1:][gap.argmax()]))
        turn = np.linalg.norm(slopes - np.roll(fitted.coefficients[-2], -1, axis=0), axis=1)
        turn[np.roll(corners, -1)] = 0
        if turn.max() > DERIVATIVE_ERROR * np.abs(slopes).max():
            raise CurveError(reason=KINK, parameter=float(breaks[1:][turn.argmax()]))
        _require_own_derivatives(fitted, curve, between)
        return replace(fitted, slopes=_formula_coefficients(curve.derivative, breaks))

    def reversed(self) -> BoundaryCurve:
        """The same curve run the other way, from the same vertex."""
        widths = np.diff(self.breaks)
        first = np.concatenate([[0], np.arange(len(widths) - 1, 0, -1)])
        coefficients = _from_the_end(self.coefficients, widths)
        coefficients[-1] = self.coefficients[-1][first]
        return BoundaryCurve(
            breaks=1 - self.breaks[::-1],
            coefficients=coefficients,
            corners=self.corners[first],
            slopes=None if self.slopes is None else -_from_the_end(self.slopes, widths),
        )

    def smoothed(self, width: float) -> BoundaryCurve:
        """The cubic spline with the same breaks through vertices averaged along Γ, without corners.

        Args:
            width: standard deviation of the Gaussian weights, as a share of the whole curve.
        """
        count = len(self.breaks) - 1
        n = SAMPLES_PER_PIECE * count
        spectrum = np.fft.rfft(self.point(np.arange(n) / n), axis=0)
        spectrum *= np.exp(-0.5 * (2 * np.pi * width * np.arange(len(spectrum))) ** 2)[:, None]
        samples = np.fft.irfft(spectrum, n=n, axis=0)
        vertices = CubicSpline(np.arange(n + 1) / n, np.vstack([samples, samples[:1]]), bc_type="periodic")(self.breaks)
        return BoundaryCurve(
            breaks=self.breaks,
            coefficients=CubicSpline(self.breaks, vertices, bc_type="periodic").c,
            corners=np.zeros(count, dtype=bool),
        )

    def towards(self, other: BoundaryCurve, share: float) -> BoundaryCurve:
        """The curve (1 − share)·self + share·other of two curves with the same breaks; corners are those of `other`."""
        degree = max(self.degree, other.degree)
        first, last = (
            np.concatenate([np.zeros((degree - c.degree, *c.coefficients.shape[1:])), c.coefficients])
            for c in (self, other)
        )
        return BoundaryCurve(breaks=self.breaks, coefficients=(1 - share) * first + share * last, corners=other.corners)

    def placed(self, points: Float[np.ndarray, "m 3"], scale: float) -> BoundaryCurve:
        """The curve enlarged and moved so that it goes through given points, to the last bit.

        Args:
            points: its vertices enlarged and moved.
            scale: ratio of enlargement.
        """
        coefficients = scale * self.coefficients
        coefficients[-1] = points
        slopes = None if self.slopes is None else scale * self.slopes
        return replace(self, coefficients=coefficients, slopes=slopes)

    @property
    def corner_parameters(self) -> Float[np.ndarray, " c"]:
        """Parameters of the corners, ascending."""
        parameters: Float[np.ndarray, " c"] = self.breaks[:-1][self.corners]
        return parameters

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

    def length(self) -> float:
        """Length of Γ in mesh units, by 16-point Gauss–Legendre quadrature on every piece."""
        nodes, weights = _gauss_nodes(LENGTH_NODES)
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

    def _horner(
        self, piece: Int[np.ndarray, "*pts"], local: Float[np.ndarray, "*pts"]
    ) -> tuple[Float[np.ndarray, "*pts 3"], Float[np.ndarray, "*pts 3"], Float[np.ndarray, "*pts 3"]]:
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
        self,
        points: Float[np.ndarray, "n 1 3"],
        piece: Int[np.ndarray, "n c"],
        low: Float[np.ndarray, "n c"],
        high: Float[np.ndarray, "n c"],
    ) -> Float[np.ndarray, "n c"]:
        """Local parameter between `low` and `high` where the distance to a point is least, by Newton's method."""
        local: Float[np.ndarray, "n c"] = (low + high) / 2
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


def _from_the_end(
    coefficients: Float[np.ndarray, "d_plus_1 m 3"], widths: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "d_plus_1 m 3"]:
    """Polynomials of pieces in the reversed order, by the distance from each one's end."""
    moved = coefficients.copy()
    # repeated synthetic division: about the pieces' ends
    for last in range(len(moved), 1, -1):
        for k in range(1, last):
            moved[k] += moved[k - 1] * widths[:, None]
    sign = (-1.0) ** np.arange(len(moved) - 1, -1, -1)
    return np.asarray(moved[:, ::-1] * sign[:, None, None])


def _formula_breaks(
    corners: Sequence[float], pieces: int
) -> tuple[Float[np.ndarray, " m_plus_1"], Bool[np.ndarray, " m"]]:
    """Ends of so many pieces or some more, 0 among them, and which of them are corners."""
    ends = np.unique(np.mod([0.0, *corners], 1.0))
    sides = np.diff(np.append(ends, 1.0))
    count = np.ceil(sides * pieces).astype(np.int64)
    first = np.repeat(np.cumsum(count) - count, count)
    inside = (np.arange(count.sum()) - first) / np.repeat(count, count)
    breaks = np.append(np.repeat(ends, count) + inside * np.repeat(sides, count), 1.0)
    flags = np.zeros(len(breaks) - 1, dtype=bool)
    flags[(np.cumsum(count) - count)[np.isin(ends, np.mod(corners, 1.0))]] = True
    return breaks, flags


def _formula_coefficients(function: CurveFunction, breaks: Float[np.ndarray, " m1"]) -> Float[np.ndarray, "d1 m 3"]:
    """Polynomials through the values of Γ or Γ′ at Chebyshev's points inside each piece and at its start."""
    x, width = _places_in_piece(), np.diff(breaks)
    values = np.asarray(function(breaks[:-1, None] + width[:, None] * x), dtype=np.float64)
    if values.shape != (len(width), len(x), 3):
        raise CurveError(reason=f"gives arrays of shape {values.shape} for {len(width), len(x)} points", parameter=0.0)
    return _through(np.moveaxis(values, 1, 0), width)


def _places_in_piece() -> Float[np.ndarray, " d1"]:
    """Chebyshev's points of a piece of length 1, without its end: at a corner that is the next side's."""
    return np.asarray((1 - np.cos(np.pi * np.arange(FORMULA_DEGREE + 1) / (FORMULA_DEGREE + 0.5))) / 2)


def _through(values: Float[np.ndarray, "d1 m 3"], width: Float[np.ndarray, " m"]) -> Float[np.ndarray, "d1 m 3"]:
    """Polynomials with given values at those places of pieces of given widths."""
    x = _places_in_piece()
    powers = np.linalg.solve(np.vander(x), values.reshape(len(x), -1)).reshape(values.shape)
    coefficients = powers / width[:, None] ** np.arange(FORMULA_DEGREE, -1, -1)[:, None, None]
    coefficients[-1] = values[0]
    return np.asarray(coefficients)


def _trigonometric_coefficients(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "d1 m 3"]:
    """Polynomials of the trigonometric polynomial through points at equal steps, a piece from each to the next."""
    m = len(points)
    spectrum = np.fft.rfft(points, axis=0)
    frequency = np.arange(len(spectrum))
    turn = np.exp(2j * np.pi / m * frequency * _places_in_piece()[:, None])
    values = np.fft.irfft(turn[:, :, None] * spectrum, n=m, axis=1)
    values[0] = points
    return _through(values, np.full(m, 1 / m))


def _is_trigonometric(points: Float[np.ndarray, "m 3"], error: float) -> bool:
    """Whether a trigonometric polynomial through points at equal steps is nearer to their curve than splines.

    Args:
        points: of a closed curve.
        error: expected of the best spline.
    """
    edges = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    if edges.max() > MOST_UNEVEN * edges.min():
        return False
    m = len(points)
    power = (np.abs(np.fft.rfft(points, axis=0) / m) ** 2).sum(axis=1)
    frequency = np.arange(len(power))
    upper, last = (float(np.sqrt(2 * power[frequency > share * m / 2].sum())) for share in (0.5, 0.8))
    rounding = SPECTRAL_ROUNDING * np.ptp(points, axis=0).max()
    return bool(last <= max(SPECTRAL_FALL * max(upper, error), rounding) and last < max(error, rounding))


def _require_own_derivatives(fitted: BoundaryCurve, curve: ClosedCurve, s: Float[np.ndarray, "m k"]) -> None:
    """Checks the derivatives of a formula against those of the polynomials."""
    extent = np.ptp(fitted.coefficients[-1], axis=0).max()
    for name, own, given in (
        ("derivative", fitted.derivative(s), curve.derivative(s)),
        ("second_derivative", fitted.second_derivative(s), curve.second_derivative(s)),
    ):
        error = np.linalg.norm(own - given, axis=2)
        if not error.max() <= DERIVATIVE_ERROR * max(np.abs(own).max(), extent):
            worst = float(s.flat[int(np.nan_to_num(error, nan=np.inf).argmax())])
            raise CurveError(reason=f"has another derivative than {name}= says", parameter=worst)


def piecewise_cubic(
    points: Float[np.ndarray, "m k"], corners: Bool[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " m_plus_1"], Float[np.ndarray, "4 m k"]]:
    """The closed interpolating cubic spline through points of any dimension, by chord length, with kinks at corners.

    Returns:
        Breaks from 0 to 1, and coefficients of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
    """
    closed = np.vstack([points, points[:1]])
    chord = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    breaks = np.append(0.0, np.cumsum(chord) / chord.sum())
    breaks[-1] = 1.0
    if corners.any():
        coefficients = _sides(breaks, closed, np.flatnonzero(corners))
    else:
        coefficients = CubicSpline(breaks, closed, bc_type="periodic").c
    return breaks, np.ascontiguousarray(coefficients)


def _smooth_spline(
    points: Float[np.ndarray, "m 3"], breaks: Float[np.ndarray, " m_plus_1"], degree: int
) -> Float[np.ndarray, "d_plus_1 m 3"]:
    """The polynomials of the periodic spline of a degree above 3."""
    spline = _periodic(breaks, points, degree)
    powers = [spline(breaks[:-1], nu=k) / factorial(k) for k in range(degree, 0, -1)]
    # the constant terms are the vertices themselves, to the last bit
    return np.stack([*powers, points])


def _predicting_degree(points: Float[np.ndarray, "m 3"], breaks: Float[np.ndarray, " m_plus_1"]) -> tuple[int, float]:
    """The degree of the local polynomials that predict every second point best from the others.

    Also the RMS error to expect of the spline through all points: that of the prediction less what an order gains.
    """
    # an odd number of points leaves two neighbours next to each other; nothing is lost by that
    kept, left_out = np.arange(0, len(points) - 1, 2), np.arange(1, len(points), 2)
    errors = []
    for degree in DEGREES:
        # as many kept points to either side: the one before point 2i + 1 is the i-th
        near = np.arange(len(left_out))[:, None] + np.arange(degree + 1) - degree // 2
        nodes = breaks[kept][near % len(kept)] + near // len(kept) - breaks[left_out, None]
        predicted = np.einsum("nj,njk->nk", _lagrange_at_0(nodes), points[kept][near % len(kept)])
        errors.append(np.sqrt(np.mean((predicted - points[left_out]) ** 2)))
    best = 0
    for higher in range(1, len(DEGREES)):
        if GAIN_PER_DEGREE * errors[higher] < errors[best]:
            best = higher
    return DEGREES[best], float(errors[best]) / 2 ** (DEGREES[best] + 1)


def _lagrange_at_0(nodes: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Values at 0 of the polynomials that are 1 at one of k nodes and 0 at the others."""
    own = np.eye(nodes.shape[1], dtype=bool)
    differences = np.where(own, 1.0, nodes[:, None, :] - nodes[:, :, None])
    return np.asarray(np.where(own, 1.0, nodes[:, None, :] / differences).prod(axis=2))


def _periodic(breaks: Float[np.ndarray, " m_plus_1"], points: Float[np.ndarray, "m k"], degree: int) -> BSpline:
    return make_interp_spline(breaks, np.vstack([points, points[:1]]), k=degree, bc_type="periodic")


def _by_arcs(points: Float[np.ndarray, "m k"]) -> Float[np.ndarray, " m_plus_1"]:
    """The parameters of points as shares of the arc length of the periodic cubic spline through them."""
    breaks, (a, b, c, _) = piecewise_cubic(points, np.zeros(len(points), dtype=bool))
    nodes, weights = _gauss_nodes(ARC_NODES)
    width = np.diff(breaks)
    h = (width[:, None] * (nodes + 1) / 2)[:, :, None]
    speed = np.linalg.norm((3 * a[:, None] * h + 2 * b[:, None]) * h + c[:, None], axis=2)
    arcs = width / 2 * (speed @ weights)
    shares = np.append(0.0, np.cumsum(arcs) / arcs.sum())
    shares[-1] = 1.0
    return shares


@cache
def _gauss_nodes(count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def _sides(
    breaks: Float[np.ndarray, " m_plus_1"], closed: Float[np.ndarray, "m_plus_1 k"], corners: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "4 m k"]:
    """Coefficients of the separate splines between consecutive corners."""
    count = len(breaks) - 1
    coefficients = np.empty((4, count, closed.shape[1]))
    for first, last in zip(corners, np.append(corners[1:], corners[0] + count), strict=True):
        vertices = np.arange(first, last + 1)
        parameters = breaks[vertices % count] + vertices // count
        coefficients[:, vertices[:-1] % count] = CubicSpline(parameters, closed[vertices % count]).c
    return coefficients
