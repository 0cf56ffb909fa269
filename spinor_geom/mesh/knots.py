"""Detection of knotted polygons by the Alexander polynomial."""

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.mesh.boundary_loop import turning_angles
from spinor_geom.mesh.intersections import is_star
from spinor_geom.mesh.near_edges import Numbers, near_edges

Passed = Float[np.ndarray, " c"]  # positions of crossings: edge number plus share of the edge

# Where |Δ| is evaluated: Δ is defined up to powers of t, which have modulus 1 on the unit circle.
PLACES = (-1.0 + 0.0j, np.exp(1.0j), np.exp(2.0j))
ROUNDING = 1e-5  # of log |Δ|
MOST_CROSSINGS = 1500  # the determinants take cubic time
VIEW = (0.2357, -0.4142, 0.8790)  # direction of the projection, generic with respect to the axes


def knot_determinant(points: Float[np.ndarray, "m 3"]) -> float | None:
    """|Δ(−1)| of a simple closed polygon's Alexander polynomial Δ if Δ shows that the polygon is knotted, else None.

    A polygon of total curvature at most 4π is not knotted (Fáry and Milnor), nor is one with a projection of fewer than
    three crossings. Otherwise it is knotted if |Δ| differs from 1 at one of three points of the unit circle. Knots with
    Δ = 1, which have at least 11 crossings, and polygons with more than 1,500 crossings are not detected.

    Source: Alexander, "Topological invariants of knots and links", Trans. AMS 30 (1928); Milnor, "On the total
    curvature of knots", Ann. of Math. 52 (1950).
    """
    if np.nansum(turning_angles(points)) <= 4 * np.pi or is_star(points):
        return None
    across, _ = np.linalg.qr(np.column_stack([VIEW, [1.0, 0.3, 0.0], [0.0, 1.0, 0.2]]))
    turned = (points - points.mean(axis=0)) @ across[:, [1, 2, 0]]
    over, under, signs = _crossings(turned / np.abs(turned).max())
    if not 3 <= len(over) <= MOST_CROSSINGS:
        return None
    values = np.array([_alexander(over, under, signs, t) for t in PLACES])
    with np.errstate(divide="ignore"):
        shown = (np.abs(np.log(values)) > ROUNDING).any()
    return float(values[0]) if shown else None


def _crossings(points: Float[np.ndarray, "m 3"]) -> tuple[Passed, Passed, Int[np.ndarray, " c"]]:
    """Positions of the over- and undercrossings in the projection along the third axis, and their signs."""
    flat = points * [1, 1, 0]
    z = flat @ [1, 1j, 0]
    along = np.roll(z, -1) - z

    def places_of(first: Numbers, second: Numbers) -> tuple[Passed, Passed, Passed]:
        """Where two edges meet, as shares of both, and the sine of their angle times their lengths."""
        u, v, w = along[first], along[second], z[second] - z[first]
        turn = (u.conj() * v).imag
        with np.errstate(divide="ignore", invalid="ignore"):
            return (w.conj() * v).imag / turn, (w.conj() * u).imag / turn, turn

    def cross_each_other(first: Numbers, second: Numbers) -> Bool[np.ndarray, " k"]:
        s, t, turn = places_of(first, second)
        apart = (second - first > 1) & (second - first < len(points) - 1)
        return np.asarray(apart & (s >= 0) & (s < 1) & (t >= 0) & (t < 1) & (turn != 0))

    ends = np.roll(flat, -1, axis=0)
    first, second = near_edges(flat, ends, 0.0, cross_each_other, enough=MOST_CROSSINGS + 1).T
    s, t, turn = places_of(first, second)
    rise = np.roll(points[:, 2], -1) - points[:, 2]
    above = points[first, 2] + s * rise[first] > points[second, 2] + t * rise[second]
    places = np.stack([first + s, second + t])
    over, under = np.where(above, places, places[::-1])
    return over, under, np.where(above, np.sign(turn), -np.sign(turn)).astype(np.int64)


def _alexander(over: Passed, under: Passed, signs: Int[np.ndarray, " c"], t: complex) -> float:
    """|Δ(t)|, a minor of the matrix with a row per crossing and a column per arc between undercrossings."""
    count = len(over)
    ends = np.sort(under)
    arc_over, arc_in = (np.searchsorted(ends, passed) % count for passed in (over, under))
    arc_out = (arc_in + 1) % count
    matrix = np.zeros((count, count), dtype=complex)
    row = np.arange(count)
    before, after = np.where(signs > 0, arc_in, arc_out), np.where(signs > 0, arc_out, arc_in)
    np.add.at(matrix, (row, arc_over), 1 - t)
    np.add.at(matrix, (row, before), t)
    np.add.at(matrix, (row, after), -1)
    _, logarithm = np.linalg.slogdet(matrix[1:, 1:])
    return float(np.exp(logarithm))
