"""The closed curve Γ through all points of a boundary loop, or given by a formula."""

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
from scipy.interpolate import CubicSpline, PPoly

from spinor_geom.arrays import TINY, backwards, modulo_one, norm, shifted
from spinor_geom.errors import CurveError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours, straight_edges
from spinor_geom.mesh.interpolation import CurveKind, Pieces, between_corners, quintic_curve, smooth_curves
from spinor_geom.mesh.piece_polynomials import gauss_nodes, piece_places, reversed_pieces, through

LENGTH_NODES = 16
SAMPLES_PER_PIECE = 8
MAX_NEWTON_STEPS = 30
NEWTON_STEP_TOLERANCE = 1e-15
# Tolerances of the polynomials of a formula: error in pieces and gap between them, per extent, and error of
# derivatives, per size.
FORMULA_ERROR, CLOSING_ERROR, DERIVATIVE_ERROR = 1e-14, 1e-12, 1e-5
FORMULA_CHECKS = np.array([0.11, 0.31, 0.57, 0.83])  # where on each piece the error is measured
FEWEST_PIECES, MOST_PIECES = 64, 4096
# Zeros of Γ′ are searched where |Γ′| is below the first share of its maximum. Below the second it counts as zero.
SLOW, STANDSTILL = 0.1, 1e-9
# In radians. A turn of 1e-3 in a smooth curve moves it by less than 1e-3 of the distance between two nodes of a solver.
SMOOTH_TURN = 1e-3
KINK = "has a jump or a kink that corners= does not contain"

Breaks = Float[np.ndarray, " m_plus_1"]
Coefficients = Float[np.ndarray, "d_plus_1 m 3"]
CurveFunction: TypeAlias = Callable[[Float[np.ndarray, "*pts"]], Float[np.ndarray, "*pts 3"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedCurve:
    """A closed curve Γ(s), s in [0, 1), given by formulas.

    Attributes:
        point: Γ, in any units of length. It takes arrays of any shape.
        derivative: Γ′.
        second_derivative: Γ″.
        corners: parameters of its corners, increasing. Γ′ jumps there, and `derivative` is the right-hand one.
        joints: parameters where higher derivatives jump, increasing, as at the knots of a spline. Γ turns there by at
            most `SMOOTH_TURN`.
    """

    point: CurveFunction
    derivative: CurveFunction
    second_derivative: CurveFunction
    corners: tuple[float, ...] = ()
    joints: tuple[float, ...] = ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.corners)} corners)"


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryCurve:
    """A closed curve Γ(s) in space, s in [0, 1), of M polynomial pieces. Piece i starts at point i of its loop.

    s is taken mod 1 everywhere. Within piece i, Γ(s) = Σ_k coefficients[k, i] (s − breaks[i])^(d − k), d the degree.

    Attributes:
        kind: "cubic", cubic splines; "spline", splines of which some have degree 5 or 7; "quintic", splines whose
            degrees do not depend on the positions of the points; "analytic", a curve that is analytic between its
            corners, up to rounding errors.
        breaks: (M + 1,) parameters of the vertices, from 0 to 1: normalised chord length for cubics, normalised arc
            length otherwise (chord length would reduce the order); uniform for the trigonometric polynomial and for
            formulas.
        coefficients: (d + 1, M, 3) of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
        corners: (M,) bool, at which vertices Γ′ jumps. Elsewhere splines are d − 1 times continuously differentiable,
            once where straight lines end.
        slopes: coefficients of Γ′ if a formula is given for it, because differentiation would lose three digits.
        at_points: (M,) bool, whether a piece starts at a point of the loop (None: all). The others divide long edges.
    """

    kind: CurveKind
    breaks: Breaks
    coefficients: Coefficients
    corners: Bool[np.ndarray, " m"]
    slopes: Coefficients | None = None
    at_points: Bool[np.ndarray, " m"] | None = None

    def __repr__(self) -> str:
        degree, pieces, _ = self.coefficients.shape
        return f"BoundaryCurve({pieces} pieces of degree {degree - 1}, {int(self.corners.sum())} corners)"

    @classmethod
    def from_loop(cls, loop: BoundaryLoop, *, quintic: bool = False) -> BoundaryCurve:
        """The interpolating curve through all points of a loop.

        Without corners it is one of these, with the least cross-validation error:

        - the trigonometric polynomial, for uniform samples of an analytic curve;
        - an analytic curve with arc-length parameters, for up to 256 points;
        - a periodic spline of degree 3, 5 or 7, for points that are less smooth.

        Straight lines of three and more edges that go over into curves (`straight_edges`) stay straight. The curves are
        cubic, with the slopes of the lines at their ends.

        With corners it is a not-a-knot spline from each corner to the next (from a single corner back to itself),
        cubic, or of degree 5 or 7 on sides of 16 points and more if that predicts points better. A side of two edges is
        a parabola, a side of one edge a straight line.

        With `quintic` it is a differentiable function of the points: the spline of degree 5 over the arc lengths of the
        cubic one, periodic or not-a-knot. Closed curves of fewer than 16 points, and sides of fewer, are cubic over
        chord lengths.

        Raises:
            RepeatedPointError: two neighbouring points of the loop are equal.

        Source: Floater & Surazhsky, "Parameterization for curve interpolation" (2006), for the parameters.
        """
        require_distinct_neighbours(loop)
        (curve,) = cls.from_loops([loop], quintic=quintic)
        return curve

    @classmethod
    def from_loops(cls, loops: Sequence[BoundaryLoop], *, quintic: bool = False) -> list[BoundaryCurve]:
        """`from_loop` of several loops without equal neighbouring points. Loops of equal size are computed together."""
        found: dict[int, Pieces] = {}
        alike: dict[int, list[int]] = defaultdict(list)
        for i, loop in enumerate(loops):
            if quintic:
                found[i] = quintic_curve(loop.points, loop.corners)
            elif (lines := straight_edges(loop.points, loop.corners)).any() or loop.corners.any():
                found[i] = between_corners(loop.points, loop.corners, lines=lines)
            else:
                alike[len(loop)].append(i)
        for group in alike.values():
            found.update(zip(group, smooth_curves(np.stack([loops[i].points for i in group])), strict=True))
        return [cls(**found[i]._asdict(), corners=loop.corners) for i, loop in enumerate(loops)]

    @classmethod
    def from_formula(cls, curve: ClosedCurve) -> BoundaryCurve:
        """Interpolates a curve given by formulas by polynomials of degree 11, to an error of 1e-14 of its coordinates.

        Each side between two corners or joints is divided into equal pieces, in total at least 64.

        Raises:
            CurveError: Γ is not closed, not finite, not smooth between corners, or has a zero derivative, or the given
                derivatives are not those of Γ.
        """
        pieces = FEWEST_PIECES
        while True:
            breaks, corners = _formula_breaks(curve, pieces)
            coefficients = _formula_coefficients(curve.point, breaks)
            fitted = cls(kind="analytic", breaks=breaks, coefficients=coefficients, corners=corners)
            between = breaks[:-1, None] + np.diff(breaks)[:, None] * FORMULA_CHECKS
            extent = np.ptp(coefficients[-1], axis=0).max()
            size = max(extent, np.abs(coefficients[-1]).max())  # far from the origin coordinates have larger errors
            error = norm(fitted.point(between) - curve.point(between))
            if not np.isfinite(error).all():
                raise CurveError(reason="is not finite", parameter=float(between[~np.isfinite(error)][0]))
            if error.max() <= FORMULA_ERROR * size:
                break
            pieces *= 2
            if pieces > MOST_PIECES:
                raise CurveError(reason=KINK, parameter=float(between.flat[int(error.argmax())]))
        ends = np.nextafter(breaks[1:], 0)
        gap, turn = shifted(coefficients[[-1, -2]], -1, axis=1) - [fitted.point(ends), fitted.derivative(ends)]
        turn[shifted(corners, -1)] = 0
        turn[np.isin(breaks[1:], curve.joints)] *= DERIVATIVE_ERROR / SMOOTH_TURN
        rounding = CLOSING_ERROR * size / np.diff(breaks)  # of slopes from the positions
        checks = [
            ("is not closed or has a jump", breaks[1:], gap, CLOSING_ERROR * size),
            (KINK, breaks[1:], turn, DERIVATIVE_ERROR * np.abs(coefficients[-2]).max() + rounding),
        ]
        slopes = fitted.derivative(between)
        fitted = replace(fitted, slopes=_formula_coefficients(curve.derivative, breaks))
        bends = fitted.second_derivative(between)  # from the given slopes, which have less rounding
        for name, own, more in (("derivative", slopes, rounding[:, None]), ("second_derivative", bends, 0.0)):
            allowed = DERIVATIVE_ERROR * max(np.abs(own).max(), extent) + more
            checks.append(
                (f"has a derivative that differs from {name}=", between, own - getattr(curve, name)(between), allowed)
            )
        for reason, at, difference, allowed in checks:
            beyond = np.nan_to_num(norm(difference), nan=np.inf) - allowed
            if beyond.max() > 0:
                raise CurveError(reason=reason, parameter=float(at.flat[int(beyond.argmax())]))
        _require_speed(fitted, between)
        return fitted

    def reversed(self) -> BoundaryCurve:
        """The curve with the opposite direction and the same first vertex."""
        first = backwards(len(self.corners))
        coefficients = reversed_pieces(self.coefficients, self.breaks)
        coefficients[-1] = self.coefficients[-1][first]
        return replace(
            self,
            breaks=1 - self.breaks[::-1],
            coefficients=coefficients,
            corners=self.corners[first],
            slopes=None if self.slopes is None else -reversed_pieces(self.slopes, self.breaks),
            at_points=None if self.at_points is None else self.at_points[first],
        )

    def smoothed(self, width: float) -> BoundaryCurve:
        """The cubic spline with the same breaks through Gaussian-smoothed vertices, without corners.

        `width` is the standard deviation of the Gaussian, in units of s.
        """
        count = len(self.corners)
        n = SAMPLES_PER_PIECE * count
        spectrum = np.fft.rfft(self.point(np.arange(n) / n), axis=0)
        spectrum *= np.exp(-0.5 * (2 * np.pi * width * np.arange(len(spectrum))) ** 2)[:, None]
        samples = np.fft.irfft(spectrum, n=n, axis=0)
        vertices = CubicSpline(np.arange(n + 1) / n, np.vstack([samples, samples[:1]]), bc_type="periodic")(self.breaks)
        spline = CubicSpline(self.breaks, vertices, bc_type="periodic")
        return BoundaryCurve(
            kind="cubic", breaks=self.breaks, coefficients=spline.c, corners=np.zeros(count, dtype=bool)
        )

    def turned(self, matrix: Float[np.ndarray, "3 3"]) -> BoundaryCurve:
        """The curve of the points Γ(s)·matrix."""
        slopes = None if self.slopes is None else self.slopes @ matrix
        return replace(self, coefficients=self.coefficients @ matrix, slopes=slopes)

    def placed(self, points: Float[np.ndarray, "m 3"], scale: float) -> BoundaryCurve:
        """The curve scaled by `scale` and moved so that it passes through its loop's points, bit for bit."""
        coefficients, own = scale * self.coefficients, slice(None) if self.at_points is None else self.at_points
        coefficients[-1] += points[0] - coefficients[-1][own][0]
        coefficients[-1, own] = points
        slopes = None if self.slopes is None else scale * self.slopes
        return replace(self, coefficients=coefficients, slopes=slopes)

    def divided(self, parts: Int[np.ndarray, " m"]) -> BoundaryCurve:
        """The same curve with piece i divided into `parts[i]` pieces of equal length in s."""
        first = np.cumsum(parts) - parts
        step = np.repeat(np.diff(self.breaks) / parts, parts)
        starts = np.repeat(self.breaks[:-1], parts) + step * (np.arange(len(step)) - np.repeat(first, parts))
        corners = np.zeros(len(starts), dtype=bool)
        corners[first] = self.corners

        def expanded(coefficients: Coefficients) -> Float[np.ndarray, "d_plus_1 n 3"]:
            pieces = PPoly(coefficients, self.breaks)
            powers = range(len(coefficients) - 1, -1, -1)
            return np.stack([pieces(starts, nu=power) / math.factorial(power) for power in powers])

        return replace(
            self,
            breaks=np.append(starts, self.breaks[-1]),
            coefficients=expanded(self.coefficients),
            corners=corners,
            slopes=None if self.slopes is None else expanded(self.slopes),
            at_points=None,
        )

    @property
    def is_formula(self) -> bool:
        """Whether Γ is given by formulas, and not only at the points of a loop."""
        return self.slopes is not None

    @property
    def is_of_surface(self) -> bool:
        """Whether Γ between the loop's points is the boundary of a surface through them, with a corner at each."""
        return self.kind == "analytic" and not self.is_formula and bool(self.corners.any())

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
        """Γ(s), in mesh units. At the parameter of a vertex it is that vertex, bit for bit."""
        return np.asarray(self._pieces(modulo_one(s)))

    def derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ′(s), in mesh units per unit of s, at a corner the right-hand one."""
        return np.asarray(self._slopes(modulo_one(s)))

    def second_derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ″(s), in mesh units per squared unit of s, at a corner the right-hand one."""
        return np.asarray(self._slopes(modulo_one(s), nu=1))

    @cached_property
    def _pieces(self) -> PPoly:
        return PPoly(self.coefficients, self.breaks)

    @cached_property
    def _slopes(self) -> PPoly:
        return self._pieces.derivative() if self.slopes is None else PPoly(self.slopes, self.breaks)

    def bulge(self) -> float:
        """Largest distance of a piece from the straight edge between its vertices, in the curve's units of length."""
        share = np.arange(1, 2 * SAMPLES_PER_PIECE) / (2 * SAMPLES_PER_PIECE)
        vertices = self.coefficients[-1]
        edge = shifted(vertices, -1, axis=0) - vertices
        away = self.point(self.breaks[:-1] + share[:, None] * np.diff(self.breaks)) - vertices
        along = np.clip((away * edge).sum(axis=2) / (edge**2).sum(axis=1), 0, 1)
        return float(norm(away - along[:, :, None] * edge).max())

    def length(self) -> float:
        """Length of Γ in mesh units, by 16-point Gauss–Legendre quadrature on every piece."""
        nodes, weights = gauss_nodes(LENGTH_NODES)
        widths = np.diff(self.breaks)[:, None]
        s = self.breaks[:-1, None] + widths * (nodes + 1) / 2
        speed = norm(self.derivative(s))
        return float((speed * weights * widths).sum() / 2)

    def length_share(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """Normalised arc length up to Γ(s), increasing by 1 per turn. It is approximated by s itself for splines."""
        if self.kind != "analytic":
            return s
        whole = np.floor(s)
        return np.asarray(self._length_shares(s - whole) + whole)

    @cached_property
    def _length_shares(self) -> CubicSpline:
        n = SAMPLES_PER_PIECE * len(self.corners)
        grid = np.arange(n + 1) / n
        length = CubicSpline(grid, norm(self.derivative(grid))).antiderivative()(grid)
        return CubicSpline(grid, length / length[-1])

    def nearest(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Parameter in [0, 1) of the point of Γ nearest to each point, (N,).

        Newton's method minimises the distance, to rounding, on the part of Γ whose chord is nearest, of 8 per piece,
        and on its neighbours. If two parts of Γ are equally near, up to their distance from the chords, one of them is
        returned.
        """
        from spinor_geom.mesh.operators import nearest_on_mesh  # imports igl

        fractions = np.arange(SAMPLES_PER_PIECE) / SAMPLES_PER_PIECE
        parameters = (self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * fractions).reshape(-1)
        own = np.arange(len(parameters))
        chords = np.stack([own, shifted(own, -1)], axis=1)
        _, found, _ = nearest_on_mesh(points, self.point(parameters), chords)
        starts = (found[:, None] + np.arange(-1, 2)) % len(parameters)
        # the end of a part is excluded, because at a corner Γ′ is that of the next part
        low, high = parameters[starts], np.nextafter(np.append(parameters[1:], 1.0), 0.0)[starts]
        s = (low + high) / 2
        for _ in range(MAX_NEWTON_STEPS):
            offset, first = self.point(s) - points[:, None, :], self.derivative(s)
            slope, speed = (offset * first).sum(axis=-1), (first * first).sum(axis=-1)
            bend = speed + (offset * self.second_derivative(s)).sum(axis=-1)
            # where the squared distance is not convex, the Gauss–Newton step still descends
            curvature = np.where(bend > 0.1 * speed, bend, speed)
            step = np.divide(slope, curvature, out=np.zeros_like(slope), where=curvature > 0)
            before, s = s, np.clip(s - step, low, high)
            if np.abs(s - before).max(initial=0.0) <= NEWTON_STEP_TOLERANCE:
                break
        best = np.argmin(norm(self.point(s) - points[:, None, :]), axis=1)
        return modulo_one(np.round(s[np.arange(len(s)), best], 15))  # rounded: 1 is 0


def _formula_breaks(curve: ClosedCurve, pieces: int) -> tuple[Breaks, Bool[np.ndarray, " m"]]:
    """Breaks of at least `pieces` pieces, one at each corner and joint, and a mask of the breaks at corners."""
    ends = np.unique(modulo_one(np.array([0.0, *curve.corners, *curve.joints])))
    sides = pairwise([*ends.tolist(), 1.0])
    starts = [np.linspace(a, b, math.ceil((b - a) * pieces), endpoint=False) for a, b in sides]
    breaks = np.concatenate([*starts, [1.0]])
    return breaks, np.isin(breaks[:-1], modulo_one(np.array(curve.corners)))


def _formula_coefficients(function: CurveFunction, breaks: Breaks) -> Coefficients:
    """Coefficients of the polynomials that interpolate Γ or Γ′ at the `piece_places` of each piece."""
    x, width = piece_places(), np.diff(breaks)
    values = np.asarray(function(breaks[:-1, None] + width[:, None] * x), dtype=np.float64)
    if values.shape != (len(width), len(x), 3):
        raise CurveError(reason=f"gives arrays of shape {values.shape} for {len(width), len(x)} points", parameter=0.0)
    return through(np.moveaxis(values, 1, 0), width)


def _require_speed(curve: BoundaryCurve, s: Float[np.ndarray, "m k"]) -> None:
    """Raises a CurveError if Γ′ is 0 somewhere, so that the curve has no tangent there."""
    s = np.concatenate([curve.breaks[:-1], s.ravel()])
    speed = norm(curve.derivative(s))
    largest, reach = speed.max(), np.diff(curve.breaks).max()
    s = s[speed < SLOW * largest]
    start = s
    # minimise |Γ′|² by Gauss-Newton steps
    for _ in range(MAX_NEWTON_STEPS if len(s) else 0):
        slope, bend = curve.derivative(s), curve.second_derivative(s)
        size = np.maximum((bend * bend).sum(axis=1), TINY)
        s = np.clip(s - (slope * bend).sum(axis=1) / size, start - reach, start + reach)
    speed = norm(curve.derivative(s))
    if (speed < STANDSTILL * largest).any():
        raise CurveError(reason="has a derivative of 0", parameter=float(s[speed.argmin()] % 1.0))
