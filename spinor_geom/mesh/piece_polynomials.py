"""Polynomial pieces of curves: from values, in the opposite direction, and nodes of quadrature on them."""

from functools import cache

import numpy as np
from jaxtyping import Float, Inexact

from spinor_geom.mesh.array_checks import shared

ANALYTIC_DEGREE = 11  # of the pieces of an analytic curve


@cache
def gauss_nodes(count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights of Gauss-Legendre quadrature on [−1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return shared(nodes), shared(weights)


def piece_places() -> Float[np.ndarray, " d1"]:
    """Chebyshev–Radau points on [0, 1): with the start of a piece, without its end, which may be a corner."""
    return np.asarray((1 - np.cos(np.pi * np.arange(ANALYTIC_DEGREE + 1) / (ANALYTIC_DEGREE + 0.5))) / 2)


@cache
def _from_values() -> tuple[Float[np.ndarray, "d1 d1"], Float[np.ndarray, "d1 d1"]]:
    """Matrices from values at `piece_places` to Chebyshev coefficients, and from these to powers."""
    k, count = np.arange(ANALYTIC_DEGREE + 1), ANALYTIC_DEGREE + 1
    cosines = np.cos(np.pi * k[:, None] * k / (ANALYTIC_DEGREE + 0.5))
    halves = np.where(k == 0, 1, 2)
    powers = np.zeros((count, count))  # of 1 − 2x, by column, highest first
    powers[-1, 0], powers[-2:, 1] = 1, (-2, 1)
    for i in range(2, count):
        powers[:, i] = 2 * powers[:, i - 1] - 4 * np.roll(powers[:, i - 1], -1) - powers[:, i - 2]
    return halves[:, None] * halves * cosines / (2 * ANALYTIC_DEGREE + 1), powers


def through(values: Float[np.ndarray, "*b d1 m k"], width: Float[np.ndarray, " m"]) -> Float[np.ndarray, "*b d1 m k"]:
    """Coefficients of the polynomials with given values at the `piece_places` of pieces of given widths."""
    to_chebyshev, to_powers = _from_values()
    local = (values - values[..., :1, :, :]).reshape(*values.shape[:-2], values.shape[-1] * len(width))
    # in two steps, because the product of the matrices has larger rounding errors
    powers = to_powers @ (to_chebyshev @ local)
    scale = width[:, None] ** np.arange(ANALYTIC_DEGREE, -1, -1)[:, None, None]
    coefficients = powers.reshape(values.shape) / scale
    coefficients[..., -1, :, :] = values[..., 0, :, :]
    return np.asarray(coefficients)


def reversed_pieces(
    coefficients: Inexact[np.ndarray, "d1 m k"], breaks: Float[np.ndarray, " m1"]
) -> Inexact[np.ndarray, "d1 m k"]:
    """Coefficients of polynomial pieces with the opposite direction, in reversed order."""
    moved, widths = coefficients.copy(), np.diff(breaks)[:, None]
    # Taylor shift to the end of each piece by synthetic division. SciPy's BPoly loses three more digits
    for last in range(len(moved), 1, -1):
        for k in range(1, last):
            moved[k] += moved[k - 1] * widths
    sign = (-1.0) ** np.arange(len(moved) - 1, -1, -1)
    return np.asarray(moved[:, ::-1] * sign[:, None, None])
