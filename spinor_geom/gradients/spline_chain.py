"""The chain rule of interpolating splines: from values of a curve to its points and the widths of its pieces.

On piece i, of width h_i, a spline of degree d is Γ = P_i + Σ_r a_ir u^r, r = 1 … d, with u in [0, 1]. The a_ir solve a
linear system K(h) a = b: each piece ends at the next point. Derivatives agree where two pieces of a side meet. The ends
of a side are not-a-knot or natural, or have the slope of a line beside them. K depends on ratios of neighbouring widths
only. The derivatives by P and h follow from one solve with the transpose of K. It is a band matrix with pieces ordered
from both ends of the curve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dgbsv
from scipy.special import comb

from spinor_geom.mesh.interpolation import DEGREES

_BINOMIALS = comb(np.arange(max(DEGREES) + 1), np.arange(max(DEGREES) + 1)[:, None])  # rows are orders


class _Jumps(NamedTuple):
    """Equations: the derivatives of order r agree at the end of piece i. `row` is the number of the equation."""

    piece: Int[np.ndarray, " k"]
    order: Int[np.ndarray, " k"]
    row: Int[np.ndarray, " k"]


class _Entries(NamedTuple):
    """Entries of K that do not depend on the widths."""

    row: Int[np.ndarray, " k"]
    column: Int[np.ndarray, " k"]
    value: Float[np.ndarray, " k"]


class _Equations(NamedTuple):
    """The equations K a = b: `near` is for each row the piece whose unknowns it constrains."""

    jumps: _Jumps
    entries: _Entries
    near: Int[np.ndarray, " k"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SplineSystem:
    """The equations of a closed interpolating spline of M pieces."""

    widths: Float[np.ndarray, " m"]  # h, up to a factor for each side
    powers: Float[np.ndarray, "d m 3"]  # a_ir, lowest power first
    corners: Bool[np.ndarray, " m"]  # whether a side begins at the start of each piece
    degrees: Int[np.ndarray, " m"]  # degrees of the pieces: odd, at least 3, and equal on a side
    natural: Bool[np.ndarray, " m"]  # whether the second derivative of a piece is 0 at the end of a side
    clamped: Bool[np.ndarray, "2 m"]  # whether a cubic begins with the slope of the side before it, ends with the next

    def by_points(
        self, by_powers: Float[np.ndarray, "d m 3"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the logarithms of the widths, from that in the a_ir.

        Derivatives through the first terms P_i are not included.
        """
        d, m, _ = by_powers.shape
        multipliers = self._adjoint(by_powers)
        by_steps = multipliers[::d]
        piece, order, row = self._equations.jumps
        column, ratio = self._after
        unknowns = self.powers.transpose(1, 0, 2).reshape(m * d, 3)
        by_ratio = order * ratio * (multipliers[row] * unknowns[column]).sum(axis=1)
        by_piece = np.zeros(m)
        np.add.at(by_piece, piece, by_ratio)
        return np.roll(by_steps, 1, axis=0) - by_steps, by_piece - np.roll(by_piece, 1)

    def _adjoint(self, by_powers: Float[np.ndarray, "d m 3"]) -> Float[np.ndarray, "md 3"]:
        """The solution of the transposed equations, a multiplier for each row of K. A singular K is a LinAlgError."""
        d, m, _ = by_powers.shape
        jumps, (row, column, value), near = self._equations
        after, ratio = self._after
        # 0, 2, 4, … 5, 3, 1: the first and the last piece are neighbours
        place = np.minimum(2 * np.arange(m), 2 * np.arange(m)[::-1] + 1)
        unknown = (place[:, None] * d + np.arange(d)).ravel()
        number = np.empty(m * d, dtype=np.int64)
        number[np.argsort(place[near], kind="stable")] = np.arange(m * d)
        row = number[np.append(row, jumps.row)]
        below = unknown[np.append(column, after)] - row
        lower, upper = int(below.max()), int(-below.min())
        bands = np.zeros((m * d, 2 * lower + upper + 1))  # LAPACK's, of the transpose
        bands[row, lower + upper + below] = np.append(value, -ratio)
        right = np.empty((m * d, 3), order="F")
        right[unknown] = by_powers.transpose(1, 0, 2).reshape(m * d, 3)
        *_, multipliers, is_singular = dgbsv(lower, upper, bands.T, right, overwrite_ab=True, overwrite_b=True)
        if is_singular:
            raise np.linalg.LinAlgError("the equations of a spline are singular")
        return np.asarray(multipliers[number])

    @cached_property
    def _equations(self) -> _Equations:
        """The equations, piece by piece: first that for the position at its end, then those for derivatives there."""
        d, m, _ = self.powers.shape
        piece, order = np.arange(m)[:, None], np.arange(1, d + 1)
        unknown = piece * d + order - 1
        degrees, ends = self.degrees[:, None], np.roll(self.corners, -1)[:, None]
        smooth, beyond = (order < degrees) & ~ends, order > degrees
        at, power = smooth.nonzero()
        jumps = [_Jumps(at, power + 1, unknown[smooth] + 1)]
        entries = [
            _Entries(np.repeat(d * np.arange(m), d), unknown.ravel(), np.ones(m * d)),
            _Entries(unknown[beyond], unknown[beyond], np.ones(np.count_nonzero(beyond))),
        ]
        near = np.repeat(piece, d, axis=1)
        if self.corners.any():
            first, odd = np.flatnonzero(self.corners)[:, None], np.arange(1, d, 2)
            last = np.roll(first, -1, axis=0) - 1
            # these rows have the conditions at the start of a side
            near[last, odd] = np.where(odd < self.degrees[last], first, last % m)
            for k in range((d - 1) // 2):
                for some, fixed in self._ends_of_sides(k):
                    jumps.append(some)
                    entries += fixed
        jump = _Jumps(*map(np.concatenate, zip(*jumps, strict=True)))
        # derivatives over r! at the end of piece i
        own = unknown[jump.piece]
        entries.append(_Entries(np.repeat(jump.row, d), own.ravel(), _BINOMIALS[jump.order, 1 : d + 1].ravel()))
        return _Equations(jump, _Entries(*map(np.concatenate, zip(*entries, strict=True))), near.ravel())

    def _ends_of_sides(self, k: int) -> Iterator[tuple[_Jumps, list[_Entries]]]:
        """The k-th condition at both ends of sides whose degree needs it: not-a-knot, natural or clamped.

        A side of one piece is straight, one of two pieces without natural ends is a parabola.
        """
        d, m, _ = self.powers.shape
        first = np.flatnonzero(self.corners)
        count = np.diff(np.append(first, first[:1] + m))
        has = self.degrees[first] >= 2 * k + 3
        first, count = first[has], count[has]
        last = first + count - 1
        are_clamped = np.stack([self.clamped[0, first], self.clamped[1, last % m]])
        is_line, is_parabola = np.equal.outer([1, 2], count) & ~are_clamped.any(axis=0)
        is_parabola &= ~self.natural[first] & ~self.natural[last % m]
        for is_end, piece, inner in ((False, first, first + k), (True, last % m, last - 1 - k)):
            # after the equation for the position at the end of the last piece
            row = last % m * d + 1 + 2 * k + is_end
            clamped = are_clamped[int(is_end)]
            natural = self.natural[piece] & ~is_line & ~clamped
            knots = ~(is_line | is_parabola | natural)
            vanishing = np.where(is_parabola | (is_line & is_end), 3, 2)[~knots]
            fixed = [_Entries(row[~knots], piece[~knots] * d + vanishing - 1, np.ones(len(vanishing)))]
            if is_end:
                # the second derivative at the end of a piece
                fixed += [
                    _Entries(row[natural], piece[natural] * d + power - 1, np.full(natural.sum(), comb(power, 2)))
                    for power in range(3, d + 1)
                ]
            inner = np.where(clamped, piece if is_end else piece - 1, inner)[knots] % m
            yield _Jumps(inner, np.where(clamped[knots], 1, self.degrees[inner]), row[knots]), fixed

    @cached_property
    def _after(self) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """For each jump the unknown at the start of the next piece, and its factor (h_i/h_{i+1})^r."""
        d, m, _ = self.powers.shape
        piece, order, _ = self._equations.jumps
        after = (piece + 1) % m
        return after * d + order - 1, (self.widths[piece] / self.widths[after]) ** order
