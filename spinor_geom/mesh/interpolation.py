"""Piecewise polynomial interpolation of closed curves: splines, analytic curves, selection by cross-validation."""

import warnings
from math import factorial
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.interpolate import BSpline, CubicSpline, PPoly, make_interp_spline
from scipy.linalg import LinAlgWarning, solve_banded
from scipy.linalg.lapack import dposv, dtrtri

from spinor_geom.arrays import EPS, norm, shifted
from spinor_geom.mesh.piece_polynomials import gauss_nodes, piece_places, through
from spinor_geom.mesh.spacing import are_long, edge_lengths, graded_spacing

Vertices = Float[np.ndarray, "m 3"]
Breaks = Float[np.ndarray, " m_plus_1"]  # parameters from 0 to 1
Coefficients = Float[np.ndarray, "d1 m 3"]  # of the pieces between the breaks, highest power first
ManyVertices = Float[np.ndarray, "*b m k"]
ManyBreaks = Float[np.ndarray, "*b m_plus_1"]
CurveKind: TypeAlias = Literal["cubic", "spline", "quintic", "analytic"]

DEGREES = (3, 5, 7)  # of splines. Higher ones gain nothing in float64
MIN_POINTS_FOR_HIGH_DEGREE = 16  # too few points to estimate the smoothness otherwise
GAIN_PER_DEGREE = 2.5  # least reduction of the error by a higher degree, which may oscillate on rough curves
ARC_NODES = 6
# Ratio of the highest harmonic that the points resolve to the lowest, in the prior of an analytic curve. From 1e-6 to
# 1e-10 the predictions are equally good. Below, the equations become too ill-conditioned.
SPECTRAL_FALL = 1e-8
RIDGE = 1e-13  # relative regularisation of these equations, for points that are close together
# Errors of analytic curves are estimated by leaving out one point, those of splines by leaving out every second one.
# For fewer points than this, the error of an analytic curve must be smaller in proportion.
SURE_POINTS = 40
ROUNDING = 1e-14  # relative to the extent: smaller errors count as equal
AS_GOOD = 1.1  # factor by which the error for uniform parameters, which take less time, may exceed that for arc length
EQUAL = 1e-9  # deviation from uniform parameters, in steps, that counts as rounding
MOST_DENSE = 256  # most points for arc length, which needs a dense solve. For more points splines are as accurate
MOST_UNEVEN = 40.0  # largest ratio of two edges of an analytic curve
SAMPLES_OF_LONG_EDGE = 8


class Pieces(NamedTuple):
    """The polynomial pieces of one closed curve. See the attributes of `BoundaryCurve`."""

    kind: CurveKind
    breaks: Breaks
    coefficients: Coefficients


def smooth_curves(points: Float[np.ndarray, "b m 3"]) -> list[Pieces]:
    """For each closed polygon the curve without corners of least cross-validation error: see `BoundaryCurve`."""
    breaks, cubics = periodic_cubics(points)
    chosen = [Pieces("cubic", *each) for each in zip(breaks, cubics, strict=True)]
    if points.shape[1] < MIN_POINTS_FOR_HIGH_DEGREE:
        return chosen
    arcs = _arc_shares(breaks, cubics)
    degrees, errors = predicting_degree(points, arcs)
    analytic = _analytic(points, arcs, errors)
    may_oscillate = np.asarray(are_long(points).any(axis=1))

    def follows_edges(i: int, curve: Pieces) -> bool:
        return not (may_oscillate[i] and _leaves_long_edges(points[i], curve))

    for i, degree in enumerate(degrees.tolist()):
        if i in analytic and follows_edges(i, analytic[i]):
            chosen[i] = analytic[i]
        elif degree > min(DEGREES):
            curve = Pieces("spline", arcs[i], _periodic_spline(points[i], arcs[i], degree))
            if follows_edges(i, curve):
                chosen[i] = curve
    return chosen


def quintic_curve(points: Vertices, corners: Bool[np.ndarray, " m"]) -> Pieces:
    """The spline of `quintic_degrees`, a differentiable function of the points."""
    degrees = quintic_degrees(corners)
    if corners.any():
        return between_corners(points, corners, degrees)
    breaks, cubics = periodic_cubics(points)
    if degrees[0] == min(DEGREES):
        return Pieces("quintic", breaks, cubics)
    arcs = _arc_shares(breaks, cubics)
    return Pieces("quintic", arcs, _periodic_spline(points, arcs, int(degrees[0])))


def quintic_degrees(corners: Bool[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Degrees of the pieces of a closed spline: 5 over arc lengths, and 3 over chord lengths on sides of few points."""
    if not corners.any():
        return np.full(len(corners), 3 if len(corners) < MIN_POINTS_FOR_HIGH_DEGREE else 5)
    degrees = np.full(len(corners), 3)
    for side in _sides(corners):
        degrees[side] = 3 if len(side) + 1 < MIN_POINTS_FOR_HIGH_DEGREE else 5
    return degrees


def _periodic_spline(points: Vertices, arcs: Breaks, degree: int) -> Coefficients:
    spline = interpolating_spline(arcs, np.vstack([points, points[:1]]), degree, bc_type="periodic")
    powers = [spline(arcs[:-1], nu=k) / factorial(k) for k in range(degree, 0, -1)]
    # the constant terms are the vertices, bit for bit
    return np.stack([*powers, points])


def interpolating_spline(x: Float[np.ndarray, " n"], y: Shaped[np.ndarray, "n k"], degree: int, **ends: Any) -> BSpline:
    """The spline of scipy's `make_interp_spline`, without its warning about points that nearly coincide.

    The distance of a surface from the points shows how exact it is.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)
        return make_interp_spline(x, y, k=degree, **ends)


def _leaves_long_edges(points: Vertices, curve: Pieces) -> bool:
    """Whether a curve deviates from a long edge by more than `detect_corners` allows."""
    length = edge_lengths(points)
    spacing = graded_spacing(length)
    long = np.flatnonzero(length > spacing)
    share = np.arange(1, SAMPLES_OF_LONG_EDGE)[:, None] / SAMPLES_OF_LONG_EDGE
    edge = (shifted(points, -1, axis=0) - points)[long]
    on_curve = PPoly(curve.coefficients, curve.breaks)(curve.breaks[long] + share * np.diff(curve.breaks)[long])
    distance = norm(on_curve - points[long] - share[..., None] * edge)
    return bool((distance > spacing[long] / 4).any())


def piecewise_cubic(
    points: Float[np.ndarray, "m k"],
    corners: Bool[np.ndarray, " m"],
    lines: Bool[np.ndarray, " m"] | None = None,
    *,
    has_natural_ends: bool = True,
) -> tuple[Breaks, Float[np.ndarray, "4 m k"]]:
    """Breaks and coefficients of the closed interpolating cubic spline with chord-length parameters and corners.

    Points have any dimension. Breaks run from 0 to 1. Coefficients are as in `scipy.interpolate.PPoly`. The
    ends of sides are not-a-knot, or with `has_natural_ends` natural on long edges. At the ends of `lines`, a mask of
    edges, curves have the slopes of these, and another curvature.
    """
    lines = np.zeros(len(points), dtype=bool) if lines is None else lines
    joints = ends_of_lines(lines, corners)
    if not (corners | joints).any():
        return periodic_cubics(points)
    breaks = _shares(edge_lengths(points))
    coefficients = np.empty((4, *points.shape))
    # not-a-knot would extrapolate the curvature at short edges over a long edge at the end of a side
    ends = np.where(has_natural_ends & are_long(points), "natural", "not-a-knot").tolist()
    slopes = dict[int, Float[np.ndarray, " k"]]()
    for side in sorted(_sides(corners | joints), key=lambda side: not lines[side[0]]):
        t = np.append(breaks[side], breaks[side[-1] + 1])
        t[1:] += t[1:] <= t[0]  # the side may wrap around the end of the parameter
        first, last = int(side[0]), int(side[-1] + 1) % len(points)
        conditions: Any = tuple(
            (1, slopes[point]) if point in slopes and not lines[first] else ends[edge]
            for point, edge in ((first, first), (last, side[-1]))
        )
        spline = CubicSpline(t, points[np.append(side, last)], bc_type=conditions)
        coefficients[:, side] = spline.c
        if lines[first]:
            slopes |= {point: spline(at, 1) for point, at in ((first, t[0]), (last, t[-1])) if joints[point]}
    return breaks, coefficients


def ends_of_lines(lines: Bool[np.ndarray, " m"], corners: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Points where straight lines, given as a mask of edges, go over into curves without corners."""
    return np.asarray((lines ^ shifted(lines, 1)) & ~corners)


def _sides(corners: Bool[np.ndarray, " m"]) -> list[Int[np.ndarray, " _"]]:
    """The edges between each corner and the next."""
    first, edges = np.flatnonzero(corners), np.arange(len(corners))
    return np.split(shifted(edges, -first[0]), np.flatnonzero(shifted(corners, -first[0]))[1:])


def between_corners(
    points: Vertices,
    corners: Bool[np.ndarray, " m"],
    degrees: Int[np.ndarray, " m"] | None = None,
    lines: Bool[np.ndarray, " m"] | None = None,
) -> Pieces:
    """The curve of a closed polygon with corners, or with straight lines (a mask of edges) between curves.

    Its sides have given degrees, or are cubic, and between corners of higher degree where that is better.
    """
    breaks, cubics = piecewise_cubic(points, corners, lines, has_natural_ends=degrees is None)
    joints = np.zeros_like(corners) if lines is None else ends_of_lines(lines, corners)
    padding, highest = max(DEGREES) - min(DEGREES), min(DEGREES)
    coefficients = np.concatenate([np.zeros((padding, *points.shape)), cubics])
    widths, is_long = np.diff(breaks), are_long(points)
    for side in _sides(corners | joints):
        last = (side[-1] + 1) % len(points)
        is_short = len(side) + 1 < MIN_POINTS_FOR_HIGH_DEGREE
        if is_short or joints[[side[0], last]].any() or (degrees is None and is_long[side].any()):
            continue
        vertices = points[np.append(side, last)]
        arcs = _arc_shares(np.append(0.0, np.cumsum(widths[side])), cubics[:, side])
        degree = int(predicting_degree(vertices, arcs, is_closed=False)[0] if degrees is None else degrees[side[0]])
        if degree > min(DEGREES):
            highest, length = max(highest, degree), widths[side].sum()
            spline = interpolating_spline(arcs, vertices, degree)
            for k in range(1, degree + 1):
                coefficients[-1 - k, side] = spline(arcs[:-1], nu=k) / (factorial(k) * length**k)
            breaks[side] = (breaks[side[0]] + length * arcs[:-1]) % 1.0
    # the first point may be inside a side
    breaks[:-1] = (breaks[:-1] - breaks[0]) % 1.0
    kind: CurveKind = "quintic" if degrees is not None else "cubic" if highest == min(DEGREES) else "spline"
    return Pieces(kind, breaks, coefficients[max(DEGREES) - highest :])


def periodic_cubics(points: ManyVertices) -> tuple[ManyBreaks, Float[np.ndarray, "*b 4 m k"]]:
    """`piecewise_cubic` of several closed curves without corners and with equally many points."""
    breaks = _shares(edge_lengths(points))
    width = np.diff(breaks)[..., None]
    secant = (shifted(points, -1, axis=-2) - points) / width
    slope = _periodic_slopes(width[..., 0], secant)
    excess = (slope + shifted(slope, -1, axis=-2) - 2 * secant) / width
    return breaks, np.stack([excess / width, (secant - slope) / width - excess, slope, points], axis=-3)


def _shares(lengths: Float[np.ndarray, "*b m"]) -> ManyBreaks:
    """Normalised cumulative sums of lengths, from 0 to 1."""
    shares = np.zeros((*lengths.shape[:-1], lengths.shape[-1] + 1))
    shares[..., 1:] = np.cumsum(lengths, axis=-1) / lengths.sum(axis=-1, keepdims=True)
    shares[..., -1] = 1.0
    return shares


def _periodic_slopes(width: Float[np.ndarray, "*b m"], secant: ManyVertices) -> ManyVertices:
    """Slopes at the knots of periodic cubic splines, from the widths and secant slopes of their pieces.

    All curves are solved as one tridiagonal system. A rank-one update for each adds the corner entries.
    """
    before = shifted(width, 1)
    right = 3 * (width[..., None] * shifted(secant, 1, axis=-2) + before[..., None] * secant)
    lower, diagonal, upper = width.copy(), 2 * (before + width), before.copy()
    corner, last = lower[..., 0] / -diagonal[..., 0], before[..., -1].copy()
    unit = np.zeros_like(width)
    unit[..., 0], unit[..., -1] = -diagonal[..., 0], last
    diagonal[..., 0] *= 2
    diagonal[..., -1] -= last * corner
    lower[..., 0] = upper[..., -1] = 0
    bands = np.stack([shifted(upper.ravel(), 1), diagonal.ravel(), shifted(lower.ravel(), -1)])
    both = np.concatenate([right, unit[..., None]], axis=-1)
    solved = solve_banded((1, 1), bands, both.reshape(-1, both.shape[-1])).reshape(both.shape)
    ends = solved[..., 0, :] + corner[..., None] * solved[..., -1, :]
    share = ends[..., :-1] / (1 + ends[..., -1:])
    return np.asarray(solved[..., :-1] - solved[..., -1:] * share[..., None, :])


def predicting_degree(
    points: Float[np.ndarray, "*b m 3"], breaks: ManyBreaks, *, is_closed: bool = True
) -> tuple[Int[np.ndarray, "*b"], Float[np.ndarray, "*b"]]:
    """The degree of local polynomials that predict every second point of each curve best from the other points.

    Also returns the RMS error below which an analytic curve is preferred. An open curve has a point at
    every break. Near its ends the stencils are one-sided.
    """
    m = points.shape[-2]
    kept, left_out = np.arange(0, m - is_closed, 2), np.arange(1, m - 1 + is_closed, 2)
    errors = []
    for degree in DEGREES:
        # equally many kept points on both sides. Left-out point 2i + 1 follows kept point i
        first = np.arange(len(left_out)) - degree // 2
        near = (first if is_closed else first.clip(0, len(kept) - degree - 1))[:, None] + np.arange(degree + 1)
        turns, places = np.divmod(near, len(kept))
        places = kept[places]
        weights = lagrange_at_0(breaks[..., places] + turns - breaks[..., left_out, None])
        predicted = (weights[..., None, :] @ points[..., places, :])[..., 0, :]
        errors.append(np.sqrt(((predicted - points[..., left_out, :]) ** 2).mean(axis=(-2, -1))))
    best, least = np.zeros(points.shape[:-2], dtype=np.int64), errors[0]
    for higher in range(1, len(DEGREES)):
        better = GAIN_PER_DEGREE * errors[higher] < least
        best, least = np.where(better, higher, best), np.where(better, errors[higher], least)
    return np.asarray(np.array(DEGREES)[best]), np.asarray(least / GAIN_PER_DEGREE**best)


def lagrange_at_0(nodes: Float[np.ndarray, "*b k"]) -> Float[np.ndarray, "*b k"]:
    """Values at 0 of Lagrange's polynomials for given nodes."""
    own = np.eye(nodes.shape[-1], dtype=bool)
    factors = nodes[..., None, :] / (nodes[..., None, :] - nodes[..., :, None] + own)
    factors[..., own] = 1.0
    return np.asarray(factors.prod(axis=-1))


def missed(points: Float[np.ndarray, "m k"], reach: int) -> Float[np.ndarray, " m"]:
    """Distance of each point of a closed polygon from the polynomial through `reach` neighbours on each side.

    The polynomials are over chord lengths, of which none is below rounding.
    """
    around = np.concatenate([np.arange(-reach, 0), np.arange(1, reach + 1)])
    turns, near = np.divmod(np.arange(len(points))[:, None] + around, len(points))
    lengths = edge_lengths(points)
    along = np.append(0.0, np.cumsum(np.maximum(lengths, 4 * EPS * lengths.sum())))
    weights = lagrange_at_0(along[near] + turns * along[-1] - along[:-1, None])
    return np.asarray(norm((weights[:, None] @ points[near])[:, 0] - points))


def by_arcs(points: Float[np.ndarray, "m k"]) -> Breaks:
    """Parameters of points by arc length of the periodic cubic spline through them, from 0 to 1."""
    return _arc_shares(*periodic_cubics(points))


def _arc_shares(breaks: ManyBreaks, coefficients: Float[np.ndarray, "*b d_plus_1 m k"]) -> ManyBreaks:
    """Normalised arc lengths of polynomial curves up to their breaks."""
    nodes, weights = gauss_nodes(ARC_NODES)
    width, degree = np.diff(breaks), coefficients.shape[-3] - 1
    h = (width[..., None] * (nodes + 1) / 2)[..., None]
    derivative = np.zeros(())
    for place in range(degree):
        derivative = derivative * h + (degree - place) * coefficients[..., place, :, None, :]
    return _shares(width * (norm(derivative) * weights).sum(axis=-1))


def trigonometric_coefficients(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b d1 m 3"]:
    """Coefficients of the pieces of trigonometric polynomials through points at uniform parameters."""
    m = points.shape[-2]
    # along the last axis, which takes half the time
    spectrum = np.fft.rfft(points.swapaxes(-1, -2))[..., None, :, :]
    turn = np.exp(2j * np.pi / m * np.arange(spectrum.shape[-1]) * piece_places()[:, None, None])
    values = np.fft.irfft(turn * spectrum, n=m).swapaxes(-1, -2)
    values[..., 0, :, :] = points
    return through(values, np.full(m, 1 / m))


def _analytic(
    points: Float[np.ndarray, "b m 3"], arcs: ManyBreaks, errors: Float[np.ndarray, " b"]
) -> dict[int, Pieces]:
    """The analytic curves, by index, whose leave-one-out RMS error is less than `errors`.

    For uniform samples of an analytic curve it is the trigonometric polynomial. Otherwise, with arc-length parameters,
    it is the interpolant of least norm in the Hilbert space of the Poisson kernel, whose harmonics decay geometrically.
    It is close to the trigonometric polynomial if points are almost evenly spaced, and does not oscillate if they are
    not.

    Source: Dubrule, "Cross validation of kriging in a unique neighborhood" (1983), for the points left out.
    """
    m = points.shape[1]
    edges = edge_lengths(points)
    rounding = ROUNDING * np.ptp(points, axis=1).max(axis=1)
    allowed = np.maximum(min(1, m / SURE_POINTS) * errors, rounding)
    allowed[edges.max(axis=1) > MOST_UNEVEN * edges.min(axis=1)] = 0
    even = _left_out_at_equal_steps(points)
    is_uneven = np.abs(m * arcs[:, :-1] - np.arange(m)).max(axis=1) > EQUAL
    found = {}
    for i in np.flatnonzero(is_uneven & (allowed > 0) & (even > rounding)).tolist() if m <= MOST_DENSE else ():
        weights, factor = _poisson(points[i], arcs[i])
        if _left_out(weights, factor) < min(allowed[i], even[i] / AS_GOOD):
            # the arc lengths of this curve are more accurate than those of the cubic spline
            own = _arc_shares(arcs[i], _poisson_coefficients(points[i], arcs[i], weights))
            weights, _ = _poisson(points[i], own)
            found[i] = Pieces("analytic", own, _poisson_coefficients(points[i], own, weights))
    equal = [i for i in np.flatnonzero(even < allowed).tolist() if i not in found]
    for i, coefficients in zip(equal, trigonometric_coefficients(points[equal]), strict=True):
        found[i] = Pieces("analytic", np.arange(m + 1) / m, coefficients)
    return found


def _left_out_at_equal_steps(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b"]:
    """Leave-one-out RMS error at uniform parameters, the smaller of Poisson kernel and least squares."""
    m = points.shape[-2]
    k = np.arange(1, m)
    # eigenvalues of the circulant matrix, up to a factor
    kernel = 1 / (SPECTRAL_FALL ** (2 * k / m) + SPECTRAL_FALL ** (2 * (m - k) / m))
    # the residual of least squares by the lower two thirds of the harmonics
    upper = (np.minimum(k, m - k) > m / 3).astype(float)
    spectrum = np.abs(np.fft.fft(points, axis=-2)[..., 1:, :] / m)
    squares = (spectrum**2).sum(axis=-1)
    errors = [np.sqrt((squares * w**2).sum(axis=-1) / 3) / w.mean() for w in (kernel, upper)]
    return np.asarray(np.minimum(*errors))


def poisson_kernels(
    t: Float[np.ndarray, "*pts"], places: Float[np.ndarray, " j"], m: int, order: int = 0
) -> list[Float[np.ndarray, "*pts j"]]:
    """The Poisson kernel Σ_k q^|k| exp 2πik(t − s) at t for places s, q^(m/2) = `SPECTRAL_FALL`, and its derivatives.

    `order`, at most 2, is the number of derivatives in t.
    """
    q = SPECTRAL_FALL ** (2 / m)
    here, there = (np.stack([np.cos(2 * np.pi * x), np.sin(2 * np.pi * x)], axis=-1) for x in (t, places))
    # cos(t − s) and sin(t − s) by the addition theorem, with far fewer cosines
    cosine = here @ there.T
    below = 1 + q * q - 2 * q * cosine
    found = [(1 - q * q) / below]
    if order:
        factor = 4 * np.pi * q / below
        sine = here @ np.stack([-there[:, 1], there[:, 0]])
        found.append(-factor * sine * found[0])
        if order > 1:
            found.append(factor * (2 * factor * sine**2 - 2 * np.pi * cosine) * found[0])
    return found


def _poisson(points: Vertices, breaks: Breaks) -> tuple[Vertices, Float[np.ndarray, "m m"] | None]:
    """Weights of the kernels that interpolate points at given parameters.

    Also the upper Cholesky factor of their matrix, None if the matrix is singular to rounding.
    """
    m, t = len(points), breaks[:-1]
    (matrix,) = poisson_kernels(t, t, m)
    matrix.flat[:: m + 1] *= 1 + RIDGE
    # LAPACK directly, because the checks of scipy.linalg take as long as the computation
    factor, weights, is_singular = dposv(matrix, points - points.mean(axis=0))
    return weights, None if is_singular else factor


def _left_out(weights: Vertices, factor: Float[np.ndarray, "m m"] | None) -> float:
    """The leave-one-out RMS error of the weights and factor of `_poisson`."""
    if factor is None:
        return np.inf
    # only the diagonal of the inverse
    root = dtrtri(factor)[0]
    diagonal = np.einsum("ij,ij,ji->i", root, root, np.tri(len(factor)))
    return float(np.sqrt(np.mean((weights / diagonal[:, None]) ** 2)))


def _poisson_coefficients(points: Vertices, breaks: Breaks, weights: Vertices) -> Coefficients:
    """Coefficients of the pieces of a sum of weighted kernels."""
    width = np.diff(breaks)
    t = breaks[:-1] + width * piece_places()[:, None]
    values = points.mean(axis=0) + poisson_kernels(t, breaks[:-1], len(points))[0] @ weights
    values[0] = points
    return through(values, width)
