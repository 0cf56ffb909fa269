"""Symmetric sparse systems on a mesh, solved by factors L D Lᵀ: quicker than SuperLU for those of the bending."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array

from spinor_geom.errors import SingularMatrixError
from spinor_geom.kernel import call
from spinor_geom.mesh.operators import require_time_to_factor


@dataclass(frozen=True, kw_only=True, eq=False)
class Elimination:
    """The order in which the columns of a matrix are eliminated, by its pattern, and the pattern of the factors."""

    order: Int[np.ndarray, " n"]
    parent: Int[np.ndarray, " n"]  # of each column, in that order, in the elimination tree; −1 for none
    starts: Int[np.ndarray, " n1"]  # of the columns of L

    @classmethod
    def of(cls, matrix: csc_array) -> Elimination:
        """The elimination of a symmetric matrix, of which both halves are given."""
        n = matrix.shape[0]
        order, parent, starts = (np.empty(size, dtype=np.int64) for size in (n, n, n + 1))
        call("eliminate", n, matrix.indptr, matrix.indices, order, parent, starts)
        return cls(order=order, parent=parent, starts=starts)

    def factored(self, matrix: csc_array) -> Factors:
        """The factors of a matrix of this pattern.

        Raises:
            SingularMatrixError: a pivot is 0 or not finite; there is no pivoting.
            OutOfTimeError: the estimated time is longer than what is left of the time limit.
        """
        require_time_to_factor(matrix)
        n, filled = matrix.shape[0], int(self.starts[-1])
        rows, values, diagonal = np.empty(filled, dtype=np.int32), np.empty(filled), np.empty(n)
        pattern = self.order, self.parent, self.starts
        call("factor", n, matrix.indptr, matrix.indices, matrix.data, *pattern, rows, values, diagonal)
        if not (np.isfinite(diagonal).all() and diagonal.all()):
            raise SingularMatrixError(size=n)
        return Factors(elimination=self, rows=rows, values=values, diagonal=diagonal)


@dataclass(frozen=True, kw_only=True, eq=False)
class Factors:
    """The factors L, with a diagonal of 1, and D of a matrix."""

    elimination: Elimination
    rows: Int[np.ndarray, " e"]  # of the entries of L below the diagonal, column by column
    values: Float[np.ndarray, " e"]
    diagonal: Float[np.ndarray, " n"]  # of D

    def solve(self, sides: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """The solution for one right-hand side, or for several as columns."""
        solved = np.array(sides.T, dtype=np.float64, order="C")
        own = self.elimination
        size, count = len(self.diagonal), solved.size // max(len(self.diagonal), 1)
        call("solve_factored", size, own.order, own.starts, self.rows, self.values, self.diagonal, count, solved)
        return np.asarray(solved.T)
