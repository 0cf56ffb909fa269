"""Curves through points: the closed splines and analytic curves, as pieces, and which of them to take."""

from functools import cache
from math import factorial

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.linalg import solve_banded
from scipy.linalg.lapack import dposv, dtrtri

from spinor_geom.mesh.arrays import shared
from spinor_geom.mesh.spacing import are_long, graded_spacing

Vertices = Float[np.ndarray, "m 3"]
Breaks = Float[np.ndarray, " m_plus_1"]  # parameters from 0 to 1
ManyVertices = Float[np.ndarray, "*b m k"]
ManyBreaks = Float[np.ndarray, "*b m_plus_1"]  # of several curves
Pieces = Float[np.ndarray, "d1 m 3"]  # coefficients between the breaks, highest power first

DEGREES = (3, 5, 7)  # tried on loops without corners; higher ones gain nothing that float64 can hold
MIN_POINTS_FOR_HIGH_DEGREE = 16  # fewer do not show how smooth a curve is
GAIN_PER_DEGREE = 2.5  # so many times better a higher one must predict left-out points: on rough curves it only swings
ARC_NODES = 6
# The covariance of neighbouring harmonics of an analytic curve falls to this at the highest that the points show.
# From 1e-6 to 1e-10 points left out are predicted alike; below that the equations lose what they gain.
SPECTRAL_FALL = 1e-8
RIDGE = 1e-13  # added to these equations, per diagonal entry: points that are close together leave them regular
# An analytic curve predicts each point from all others, splines every second from the rest: on noise that is twice as
# bad at least, but for the chance that fewer points than this leave.
SURE_POINTS = 40
ROUNDING = 1e-14  # of coordinates, per extent: what predicts so well cannot be told from what is better
AS_GOOD = 1.1  # so many times worse than arc length equal steps may predict: their equations have a closed solution
NEARLY_EQUAL = 1e-3  # steps so nearly equal, as a share of one, that what is left out changes by their first order
MOST_DENSE = 256  # points beyond which arcs are not tried: dense equations cost their cube, and splines are as near
MOST_UNEVEN = 40.0  # edges of an analytic curve that differ by a larger factor leave it to splines
SAMPLES_OF_LONG_EDGE = 8
ANALYTIC_DEGREE = 11  # of the pieces of an analytic curve


def smooth_curves(points: Float[np.ndarray, "b m 3"]) -> list[tuple[Breaks, Pieces]]:
    """Breaks and polynomials of curves without corners that predict points left out best: see `BoundaryCurve`."""
    breaks, cubics = periodic_cubics(points)
    found = list(zip(breaks, cubics, strict=True))
    if points.shape[1] < MIN_POINTS_FOR_HIGH_DEGREE:
        return found
    arcs = _arc_shares(breaks, cubics)
    degrees, errors = predicting_degree(points, arcs)
    curves = _analytic(points, arcs, errors)
    may_swing = np.asarray(are_long(points).any(axis=1))
    for i, degree in enumerate(degrees.tolist()):
        if i in curves and not (may_swing[i] and _leaves_long_edges(points[i], *curves[i])):
            found[i] = curves[i]
        elif degree > DEGREES[0]:
            spline = make_interp_spline(arcs[i], np.vstack([points[i], points[i, :1]]), k=degree, bc_type="periodic")
            powers = [spline(arcs[i, :-1], nu=k) / factorial(k) for k in range(degree, 0, -1)]
            # the constant terms are the vertices themselves, to the last bit
            curve = arcs[i], np.stack([*powers, points[i]])
            if not (may_swing[i] and _leaves_long_edges(points[i], *curve)):
                found[i] = curve
    return found


def _leaves_long_edges(points: Vertices, breaks: Breaks, pieces: Pieces) -> bool:
    """Whether a curve swings where points are far apart: it leaves a long edge by more than `detect_corners` allows."""
    spacing, edges = graded_spacing(points), np.roll(points, -1, axis=0) - points
    long = np.flatnonzero(np.linalg.norm(edges, axis=1) > spacing)
    share = np.arange(1, SAMPLES_OF_LONG_EDGE)[:, None] / SAMPLES_OF_LONG_EDGE
    step = (share * np.diff(breaks)[long])[..., None]
    away = np.zeros((*step.shape[:2], 3))
    for power in pieces[:-1, long]:
        away = (away + power) * step
    away -= share[..., None] * edges[long]
    return bool((np.linalg.norm(away, axis=2) > spacing[long] / 4).any())


def piecewise_cubic(
    points: Float[np.ndarray, "m k"], corners: Bool[np.ndarray, " m"]
) -> tuple[Breaks, Float[np.ndarray, "4 m k"]]:
    """The closed interpolating cubic spline through points of any dimension, by chord length, with kinks at corners.

    As breaks from 0 to 1, and coefficients of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
    """
    if not corners.any():
        return periodic_cubics(points)
    breaks, count, places = _by_chords(points), len(points), np.flatnonzero(corners)
    coefficients = np.empty((4, *points.shape))
    # not-a-knot would extrapolate the bends of short edges over a long one at the end of a side
    ends = np.where(are_long(points), "natural", "not-a-knot").tolist()
    # separate splines between consecutive corners
    for first, last in zip(places, np.append(places[1:], places[0] + count), strict=True):
        vertices = np.arange(first, last + 1)
        parameters = breaks[vertices % count] + vertices // count
        conditions = ends[first], ends[(last - 1) % count]
        coefficients[:, vertices[:-1] % count] = CubicSpline(parameters, points[vertices % count], bc_type=conditions).c
    return breaks, coefficients


def between_corners(points: Vertices, corners: Bool[np.ndarray, " m"]) -> tuple[Breaks, Pieces]:
    """Breaks and polynomials of a closed curve with corners: cubics, splines of higher degree on sides that show it."""
    breaks, cubics = piecewise_cubic(points, corners)
    count, places, highest = len(points), np.flatnonzero(corners), min(DEGREES)
    coefficients = np.concatenate([np.zeros((max(DEGREES) - highest, *points.shape)), cubics])
    widths, is_long = np.diff(breaks), are_long(points)
    for first, last in zip(places, np.append(places[1:], places[0] + count), strict=True):
        side, vertices = np.arange(first, last) % count, points[np.arange(first, last + 1) % count]
        if len(vertices) < MIN_POINTS_FOR_HIGH_DEGREE or is_long[side].any():
            continue
        arcs = _arc_shares(np.append(0.0, np.cumsum(widths[side])), cubics[:, side])
        degree = int(predicting_degree(vertices, arcs, is_closed=False)[0])
        if degree > min(DEGREES):
            highest, length = max(highest, degree), widths[side].sum()
            spline = make_interp_spline(arcs, vertices, k=degree)
            for k in range(1, degree + 1):
                coefficients[-1 - k, side] = spline(arcs[:-1], nu=k) / (factorial(k) * length**k)
            breaks[side] = (breaks[first] + length * arcs[:-1]) % 1.0
    # the first point may be amid a side
    breaks[:-1] = (breaks[:-1] - breaks[0]) % 1.0
    return breaks, coefficients[max(DEGREES) - highest :]


def periodic_cubics(points: ManyVertices) -> tuple[ManyBreaks, Float[np.ndarray, "*b 4 m k"]]:
    """The same of several closed curves of as many points each, without corners."""
    breaks = _by_chords(points)
    width = np.diff(breaks)[..., None]
    secant = (np.roll(points, -1, axis=-2) - points) / width
    slope = _periodic_slopes(width[..., 0], secant)
    excess = (slope + np.roll(slope, -1, axis=-2) - 2 * secant) / width
    return breaks, np.stack([excess / width, (secant - slope) / width - excess, slope, points], axis=-3)


def _by_chords(points: ManyVertices) -> ManyBreaks:
    return _shares(np.linalg.norm(np.roll(points, -1, axis=-2) - points, axis=-1))


def _shares(lengths: Float[np.ndarray, "*b m"]) -> ManyBreaks:
    """Shares of the sum of lengths up to each."""
    shares = np.zeros((*lengths.shape[:-1], lengths.shape[-1] + 1))
    shares[..., 1:] = np.cumsum(lengths, axis=-1) / lengths.sum(axis=-1, keepdims=True)
    shares[..., -1] = 1.0
    return shares


def _periodic_slopes(width: Float[np.ndarray, "*b m"], secant: ManyVertices) -> ManyVertices:
    """Slopes at the knots of periodic cubic splines, of which widths and slopes of the secants of the pieces are known.

    All curves are one tridiagonal system, whose corners a change of rank one of each curve's part stands for.
    """
    before = np.roll(width, 1, axis=-1)
    right = 3 * (width[..., None] * np.roll(secant, 1, axis=-2) + before[..., None] * secant)
    lower, diagonal, upper = width.copy(), 2 * (before + width), before.copy()
    corner, last = lower[..., 0] / -diagonal[..., 0], before[..., -1].copy()
    unit = np.zeros_like(width)
    unit[..., 0], unit[..., -1] = -diagonal[..., 0], last
    diagonal[..., 0] *= 2
    diagonal[..., -1] -= last * corner
    lower[..., 0] = upper[..., -1] = 0
    bands = np.stack([np.roll(upper.ravel(), 1), diagonal.ravel(), np.roll(lower.ravel(), -1)])
    both = np.concatenate([right, unit[..., None]], axis=-1)
    solved = solve_banded((1, 1), bands, both.reshape(-1, both.shape[-1])).reshape(both.shape)
    ends = solved[..., 0, :] + corner[..., None] * solved[..., -1, :]
    share = ends[..., :-1] / (1 + ends[..., -1:])
    return np.asarray(solved[..., :-1] - solved[..., -1:] * share[..., None, :])


def predicting_degree(
    points: Float[np.ndarray, "*b m 3"], breaks: ManyBreaks, *, is_closed: bool = True
) -> tuple[Int[np.ndarray, "*b"], Float[np.ndarray, "*b"]]:
    """The degrees of the local polynomials that predict every second point of each curve best from its others.

    Also the RMS error that a curve without a degree must stay below to be better: theirs, less a gain for each degree.
    At the ends of an open curve, of which all breaks have a point, more of the others lie to one side.
    """
    m = points.shape[-2]
    # an odd number of points leaves two neighbours next to each other, or an end by itself; nothing is lost by that
    kept, left_out = np.arange(0, m - is_closed, 2), np.arange(1, m - 1 + is_closed, 2)
    errors = []
    for degree in DEGREES:
        # as many kept points to either side: the one before point 2i + 1 is the i-th
        first = np.arange(len(left_out)) - degree // 2
        near = (first if is_closed else first.clip(0, len(kept) - degree - 1))[:, None] + np.arange(degree + 1)
        places = kept[near % len(kept)]
        nodes = breaks[..., places] + near // len(kept) - breaks[..., left_out, None]
        # the polynomials that are 1 at one node and 0 at the others, here
        own = np.eye(degree + 1, dtype=bool)
        differences = np.where(own, 1.0, nodes[..., None, :] - nodes[..., :, None])
        weights = np.where(own, 1.0, nodes[..., None, :] / differences).prod(axis=-1)
        predicted = (weights[..., None] * points[..., places, :]).sum(axis=-2)
        errors.append(np.sqrt(np.mean((predicted - points[..., left_out, :]) ** 2, axis=(-2, -1))))
    best, least = np.zeros(points.shape[:-2], dtype=np.int64), errors[0]
    for higher in range(1, len(DEGREES)):
        better = GAIN_PER_DEGREE * errors[higher] < least
        best, least = np.where(better, higher, best), np.where(better, errors[higher], least)
    return np.array(DEGREES)[best], least / GAIN_PER_DEGREE**best


def by_arcs(points: Float[np.ndarray, "m k"]) -> Breaks:
    """The parameters of points as shares of the arc length of the periodic cubic spline through them."""
    return _arc_shares(*periodic_cubics(points))


def _arc_shares(breaks: ManyBreaks, coefficients: Float[np.ndarray, "*b d_plus_1 m k"]) -> ManyBreaks:
    """Shares of the length of curves of polynomial pieces up to their ends."""
    nodes, weights = gauss_nodes(ARC_NODES)
    width, degree = np.diff(breaks), coefficients.shape[-3] - 1
    h = (width[..., None] * (nodes + 1) / 2)[..., None]
    derivative = np.zeros(())
    for place in range(degree):
        derivative = derivative * h + (degree - place) * coefficients[..., place, :, None, :]
    return _shares(width * (np.linalg.norm(derivative, axis=-1) * weights).sum(axis=-1))


@cache
def gauss_nodes(count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights of Gauss-Legendre quadrature on [−1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return shared(nodes), shared(weights)


def piece_places() -> Float[np.ndarray, " d1"]:
    """Chebyshev's points of a piece of length 1, without its end: at a corner that is the next side's."""
    return np.asarray((1 - np.cos(np.pi * np.arange(ANALYTIC_DEGREE + 1) / (ANALYTIC_DEGREE + 0.5))) / 2)


@cache
def _from_values() -> tuple[Float[np.ndarray, "d1 d1"], Float[np.ndarray, "d1 d1"]]:
    """From values at Chebyshev's points of a piece to factors of Chebyshev's polynomials, and from these to powers."""
    k, count = np.arange(ANALYTIC_DEGREE + 1), ANALYTIC_DEGREE + 1
    cosines = np.cos(np.pi * k[:, None] * k / (ANALYTIC_DEGREE + 0.5))
    halves = np.where(k == 0, 1, 2)
    powers = [np.polynomial.Chebyshev.basis(i, domain=[1, 0]).convert(kind=np.polynomial.Polynomial) for i in k]
    columns = [np.pad(one.coef, (0, count - len(one.coef)))[::-1] for one in powers]
    return halves[:, None] * halves * cosines / (2 * ANALYTIC_DEGREE + 1), np.stack(columns, axis=1)


def through(values: Float[np.ndarray, "*b d1 m 3"], width: Float[np.ndarray, " m"]) -> Float[np.ndarray, "*b d1 m 3"]:
    """Polynomials with given values at those places of pieces of given widths."""
    to_chebyshev, to_powers = _from_values()
    local = (values - values[..., :1, :, :]).reshape(*values.shape[:-2], 3 * len(width))
    # one after the other: their product is not as near
    powers = to_powers @ (to_chebyshev @ local)
    scale = width[:, None] ** np.arange(ANALYTIC_DEGREE, -1, -1)[:, None, None]
    coefficients = powers.reshape(values.shape) / scale
    coefficients[..., -1, :, :] = values[..., 0, :, :]
    return np.asarray(coefficients)


def trigonometric_coefficients(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b d1 m 3"]:
    """Polynomials of the trigonometric polynomials through points at equal steps, a piece from each to the next."""
    m = points.shape[-2]
    # along rows, which takes half the time
    spectrum = np.fft.rfft(points.swapaxes(-1, -2))[..., None, :, :]
    turn = np.exp(2j * np.pi / m * np.arange(spectrum.shape[-1]) * piece_places()[:, None, None])
    values = np.fft.irfft(turn * spectrum, n=m).swapaxes(-1, -2)
    values[..., 0, :, :] = points
    return through(values, np.full(m, 1 / m))


def _analytic(
    points: Float[np.ndarray, "b m 3"], arcs: ManyBreaks, errors: Float[np.ndarray, " b"]
) -> dict[int, tuple[Breaks, Pieces]]:
    """Of some curves by number the analytic one through the points, where no spline predicts points left out better.

    By equal steps of its parameter that is the trigonometric polynomial. By arc length (about `arcs`) it is the curve
    of least norm in the Hilbert space of the Poisson kernel, whose harmonics fall geometrically: it stays near the
    trigonometric polynomial where points are almost evenly spaced, and does not swing where they are not. Points left
    out must be nearer than the RMS `errors` of `predicting_degree`.

    Source: Dubrule, "Cross validation of kriging in a unique neighborhood" (1983), for the points left out.
    """
    m = points.shape[1]
    edges = np.linalg.norm(np.diff(points, axis=1, append=points[:, :1]), axis=2)
    allowed = np.maximum(min(1, m / SURE_POINTS) * errors, ROUNDING * np.ptp(points, axis=1).max(axis=1))
    allowed[edges.max(axis=1) > MOST_UNEVEN * edges.min(axis=1)] = 0
    even = _left_out_at_equal_steps(points)
    off = arcs[:, :-1] - np.arange(m) / m
    # of points at nearly equal steps the closed solution tells of arcs, too: they are moved in place of parameters
    moved = points - off[..., None] * _derivative_at_equal_steps(points)
    may_be_better = (m * np.abs(off).max(axis=1) > NEARLY_EQUAL) | (_left_out_at_equal_steps(moved) < even / AS_GOOD)
    found = {}
    for i in np.flatnonzero(may_be_better & (allowed > 0)).tolist() if m <= MOST_DENSE else ():
        weights, left_out = _poisson(points[i], arcs[i])
        if left_out < min(allowed[i], even[i] / AS_GOOD):
            # the arcs of this curve are nearer to its own than those of the cubic spline
            own = _arc_shares(arcs[i], _poisson_coefficients(points[i], arcs[i], weights))
            found[i] = own, _poisson_coefficients(points[i], own, _poisson(points[i], own)[0])
    equal = [i for i in np.flatnonzero(even < allowed).tolist() if i not in found]
    for i, pieces in zip(equal, trigonometric_coefficients(points[equal]), strict=True):
        found[i] = np.arange(m + 1) / m, pieces
    return found


def _derivative_at_equal_steps(points: Float[np.ndarray, "b m 3"]) -> Float[np.ndarray, "b m 3"]:
    m = points.shape[1]
    k = np.arange(m // 2 + 1)
    return np.fft.irfft(2j * np.pi * (k * (2 * k < m))[:, None] * np.fft.rfft(points, axis=1), n=m, axis=1)


def _left_out_at_equal_steps(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b"]:
    """RMS error of each point as the others predict it by the Poisson kernel at equal steps, or by least squares."""
    m = points.shape[-2]
    k = np.arange(1, m)
    # eigenvalues of the circulant matrix, but for a factor
    kernel = 1 / (SPECTRAL_FALL ** (2 * k / m) + SPECTRAL_FALL ** (2 * (m - k) / m))
    # least squares by the lower two thirds of the harmonics leave the upper ones
    upper = (np.minimum(k, m - k) > m / 3).astype(float)
    spectrum = np.abs(np.fft.fft(points, axis=-2)[..., 1:, :] / m)
    squares = (spectrum**2).sum(axis=-1)
    errors = [np.sqrt((squares * w**2).sum(axis=-1) / 3) / w.mean() for w in (kernel, upper)]
    return np.asarray(np.minimum(*errors))


def _kernel(t: Float[np.ndarray, "*pts"], places: Float[np.ndarray, " j"], m: int) -> Float[np.ndarray, "*pts j"]:
    """Poisson's kernel Σ_k q^|k| exp 2πik(t − s) for places s, where q^(m/2) is the fall."""
    q = SPECTRAL_FALL ** (2 / m)
    here, there = (np.stack([np.cos(2 * np.pi * x), np.sin(2 * np.pi * x)], axis=-1) for x in (t, places))
    # the cosine of a difference: many fewer cosines
    return np.asarray((1 - q * q) / (1 + q * q - 2 * q * (here @ there.T)))


def _poisson(points: Vertices, breaks: Breaks) -> tuple[Vertices, float]:
    """Weights of the kernels at given parameters that sum up to points, and the RMS error of each point left out."""
    m, t = len(points), breaks[:-1]
    matrix = _kernel(t, t, m)
    matrix.flat[:: m + 1] *= 1 + RIDGE
    # not by scipy.linalg, whose checks take as long as the work
    factor, weights, is_singular = dposv(matrix, points - points.mean(axis=0))
    if is_singular:
        return weights, np.inf
    # the diagonal of the inverse: half the cost of all of it
    root = dtrtri(factor)[0]
    diagonal = np.einsum("ij,ij,ji->i", root, root, np.tri(m))
    return weights, float(np.sqrt(np.mean((weights / diagonal[:, None]) ** 2)))


def _poisson_coefficients(points: Vertices, breaks: Breaks, weights: Vertices) -> Pieces:
    """Polynomials of the sum of weighted kernels, a piece from each point to the next."""
    width = np.diff(breaks)
    t = breaks[:-1] + width * piece_places()[:, None]
    values = points.mean(axis=0) + _kernel(t, breaks[:-1], len(points)) @ weights
    values[0] = points
    return through(values, width)
