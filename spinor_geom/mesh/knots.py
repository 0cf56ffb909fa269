"""Knots: which closed polygons can be told from a circle by their Alexander polynomial."""

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.boundary_loop import turning_angles
from spinor_geom.mesh.boxes import edges_with_near_boxes
from spinor_geom.mesh.intersections import is_star

Passed = Float[np.ndarray, " c"]  # where a polygon passes its crossings: edge number plus share of the edge

# Where |Δ| is taken, on the unit circle: powers of t, by which Δ is not determined, have modulus 1 there.
PLACES = (-1.0 + 0.0j, np.exp(1.0j), np.exp(2.0j))
SHOWS = 1e-5  # |log |Δ|| that rounding errors do not reach
MOST_CROSSINGS = 1500  # the determinants take the third power of it
VIEW = (0.2357, -0.4142, 0.8790)  # a direction to look from, off the axes that loops are made along


def knot_determinant(points: Float[np.ndarray, "m 3"]) -> float | None:
    """|Δ(−1)| of a closed polygon's Alexander polynomial Δ if Δ shows that the polygon is knotted, else None.

    A knot whose total curvature is at most 4π is none (Fáry and Milnor), and so is one that has a view with fewer than
    three crossings. A polygon that passes these tests, and does not cross itself, is knotted if |Δ| differs from 1 at
    one of three places on the unit circle. Some knots have Δ = 1, the simplest of them with 11 crossings: they are not
    found; nor are polygons with more than 1,500 crossings in the view that is taken examined.

    Source: Alexander, "Topological invariants of knots and links", Trans. AMS 30 (1928); Milnor, "On the total
    curvature of knots", Ann. of Math. 52 (1950).
    """
    if np.nansum(turning_angles(points)) <= 4 * np.pi or is_star(points):
        return None
    # seen along the third axis, at unit size
    across, _ = np.linalg.qr(np.column_stack([VIEW, [1.0, 0.3, 0.0], [0.0, 1.0, 0.2]]))
    turned = (points - points.mean(axis=0)) @ across[:, [1, 2, 0]]
    over, under, signs = _crossings(turned / np.abs(turned).max())
    if not 3 <= len(over) <= MOST_CROSSINGS:
        return None
    values = np.array([_alexander(over, under, signs, t) for t in PLACES])
    with np.errstate(divide="ignore"):
        shown = (np.abs(np.log(values)) > SHOWS).any()
    return float(values[0]) if shown else None


def _crossings(points: Float[np.ndarray, "m 3"]) -> tuple[Passed, Passed, Int[np.ndarray, " c"]]:
    """Where a polygon passes over and under itself, and each crossing's sign."""
    flat = points * [1, 1, 0]
    first, second = edges_with_near_boxes(flat, np.roll(flat, -1, axis=0), 0.0)
    z = flat @ [1, 1j, 0]
    along = np.roll(z, -1) - z
    u, v, w = along[first], along[second], z[second] - z[first]
    turn = (u.conj() * v).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (w.conj() * v).imag / turn, (w.conj() * u).imag / turn
    meet = (s >= 0) & (s < 1) & (t >= 0) & (t < 1) & (turn != 0)
    # neighbours share a point in every view
    meet &= (second - first > 1) & (second - first < len(points) - 1)
    first, second, s, t, turn = first[meet], second[meet], s[meet], t[meet], turn[meet]
    rise = np.roll(points[:, 2], -1) - points[:, 2]
    above = points[first, 2] + s * rise[first] > points[second, 2] + t * rise[second]
    places = np.stack([first + s, second + t])
    over, under = np.where(above, places, places[::-1])
    return over, under, np.where(above, np.sign(turn), -np.sign(turn)).astype(np.int64)


def _alexander(over: Passed, under: Passed, signs: Int[np.ndarray, " c"], t: complex) -> float:
    """|Δ(t)|: a minor of the matrix with a row for each crossing and a column for each arc between undercrossings."""
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
