"""Curves through points: the closed splines and the trigonometric polynomial, as pieces, and which of them to take."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

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
# Degree of the pieces of an analytic curve.
ANALYTIC_DEGREE = 11


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


def smooth_spline(
    points: Float[np.ndarray, "m 3"], breaks: Float[np.ndarray, " m_plus_1"], degree: int
) -> Float[np.ndarray, "d_plus_1 m 3"]:
    """The polynomials of the periodic spline of a degree above 3."""
    spline = _periodic(breaks, points, degree)
    powers = [spline(breaks[:-1], nu=k) / factorial(k) for k in range(degree, 0, -1)]
    # the constant terms are the vertices themselves, to the last bit
    return np.stack([*powers, points])


def predicting_degree(points: Float[np.ndarray, "m 3"], breaks: Float[np.ndarray, " m_plus_1"]) -> tuple[int, float]:
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


def by_arcs(points: Float[np.ndarray, "m k"]) -> Float[np.ndarray, " m_plus_1"]:
    """The parameters of points as shares of the arc length of the periodic cubic spline through them."""
    breaks, (a, b, c, _) = piecewise_cubic(points, np.zeros(len(points), dtype=bool))
    nodes, weights = gauss_nodes(ARC_NODES)
    width = np.diff(breaks)
    h = (width[:, None] * (nodes + 1) / 2)[:, :, None]
    speed = np.linalg.norm((3 * a[:, None] * h + 2 * b[:, None]) * h + c[:, None], axis=2)
    arcs = width / 2 * (speed @ weights)
    shares = np.append(0.0, np.cumsum(arcs) / arcs.sum())
    shares[-1] = 1.0
    return shares


@cache
def gauss_nodes(count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights of Gauss-Legendre quadrature on [−1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    for shared in (nodes, weights):
        shared.setflags(write=False)
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


def places_in_piece() -> Float[np.ndarray, " d1"]:
    """Chebyshev's points of a piece of length 1, without its end: at a corner that is the next side's."""
    return np.asarray((1 - np.cos(np.pi * np.arange(ANALYTIC_DEGREE + 1) / (ANALYTIC_DEGREE + 0.5))) / 2)


def through(values: Float[np.ndarray, "d1 m 3"], width: Float[np.ndarray, " m"]) -> Float[np.ndarray, "d1 m 3"]:
    """Polynomials with given values at those places of pieces of given widths."""
    x = places_in_piece()
    powers = np.linalg.solve(np.vander(x), values.reshape(len(x), -1)).reshape(values.shape)
    coefficients = powers / width[:, None] ** np.arange(ANALYTIC_DEGREE, -1, -1)[:, None, None]
    coefficients[-1] = values[0]
    return np.asarray(coefficients)


def trigonometric_coefficients(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "d1 m 3"]:
    """Polynomials of the trigonometric polynomial through points at equal steps, a piece from each to the next."""
    m = len(points)
    spectrum = np.fft.rfft(points, axis=0)
    frequency = np.arange(len(spectrum))
    turn = np.exp(2j * np.pi / m * frequency * places_in_piece()[:, None])
    values = np.fft.irfft(turn[:, :, None] * spectrum, n=m, axis=1)
    values[0] = points
    return through(values, np.full(m, 1 / m))


def is_trigonometric(points: Float[np.ndarray, "m 3"], error: float) -> bool:
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
