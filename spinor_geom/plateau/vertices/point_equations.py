"""Newton's equations for integrals of φ along paths, and their damped solutions of least norm.

Since δr = Re ∫ (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq)) dz, the derivatives of all integrals follow from two complex
matrices, ∫ 2pf dz and ∫ 2qf dz for all features f.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import (
    Array,
    add_to_diagonal,
    as_dtype,
    cholesky,
    cholesky_solve,
    complex_of,
    definite_cholesky,
    gram,
    namespace,
    square,
    zeros,
)
from spinor_geom.plateau.newton import MOST_STEPS

# Damping, as a share of the mean of the Gram matrix's diagonal, because equations may have no solution. For n paths
# it multiplies |x|² and n·|D x|², with the differences D along a rim, as for errors of points between the paths. With
# 4e-10 the residual is 5e-3 edges on one of sixty rims cut along triangles, and 5e-1 on teeth of 20°. With 1e-8
# solves take twice as long on 1,200 points with 30 % noise.
_DAMPING = 1e-9
# Up to _MANY paths factors in double precision are fast enough. In single precision the diagonal gets more, in these
# steps until the matrix is definite, and solutions are corrected until the equations hold to _ACCURACY. Newton's method
# takes the same steps with 1e-4, and more with 1e-2.
_MANY, _SINGLE_DAMPINGS, _ACCURACY = 400, (3e-7, 3e-6, 3e-5), 1e-3


class _Direction(NamedTuple):
    """A direction, conjugate to others and of norm 1 in the matrix of some equations, and its product with it."""

    own: Float[Array, "3 n"]
    image: Float[Array, "3 n"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PointEquations:
    """Linearised integrals Re ∫ φ dz along n paths, as functions of orthonormal read-outs.

    Equations for many paths are factored in single precision. Solutions are then corrected in double precision.
    """

    rows: Complex[Array, "k n2"]  # conjugates of ∫ 2pf dz along each path for all features f, then of ∫ 2qf dz
    before: Int[np.ndarray, " n"]  # the path that ends where each one starts, or itself
    damping: float
    factor: Float[Array, "n3 n3"]  # of the damped Gram matrix of the 3n functions, in single precision for many paths
    directions: list[_Direction] = field(default_factory=list)  # of earlier solutions

    @classmethod
    def of(
        cls, by_p: Complex[Array, "k n"], by_q: Complex[Array, "k n"], before: Int[np.ndarray, " n"] | None = None
    ) -> PointEquations:
        """The equations with their factor. `before` has the path that ends where each one starts, by default none."""
        n, xp = by_p.shape[1], namespace(by_p)
        rows, is_single = xp.concat([by_p, by_q], axis=1), n > _MANY
        matrix = _gram_of_integrals(as_dtype(rows, xp.complex64) if is_single else rows)
        own = np.arange(3 * n)
        mean = float(matrix[own, own].mean())
        damping = _DAMPING * mean
        before = np.arange(n) if before is None else before
        path, other = (n * np.arange(3)[:, None] + index for index in (np.arange(n), before))
        for pair in ((path, other), (other, path)):
            matrix[pair] -= n * damping
        add_to_diagonal(matrix, (2 * n + 1) * damping)
        factor = None
        for more in _SINGLE_DAMPINGS if is_single else ():
            add_to_diagonal(matrix, more * mean)
            if (factor := cholesky(matrix)) is not None:
                break
        factor = definite_cholesky(matrix) if factor is None else factor
        return cls(rows=rows, before=before, damping=damping, factor=factor)

    def step(self, error: Float[Array, "n 3"], away: Complex[Array, "k 2"] | None) -> Complex[Array, "k 2"]:
        """The change of least norm of the read-outs that removes an error.

        With `away`, the difference of the read-outs from given ones, the new read-outs are the nearest to those.
        """
        right = error.mT if away is None else error.mT - self._along(away)
        change = -self._across(self._solution(right))
        return change if away is None else change - away

    def _along(self, change: Complex[Array, "k 2"]) -> Float[Array, "3 n"]:
        """The changes of the integrals with the read-outs."""
        # conjugates of the few changes instead of those of the matrix
        products = (change.mT.conj() @ self.rows).conj()
        n = len(self.before)
        (pp, qp), (pq, qq) = products[:, :n], products[:, n:]
        return namespace(change).stack([(pp - qq).real, (pp + qq).imag, (pq + qp).real])

    def _across(self, weights: Float[Array, "3 n"]) -> Complex[Array, "k 2"]:
        """The adjoint of `_along`."""
        x, y, z = weights
        xp, xy, z = namespace(x), complex_of(x, y), z + 0j
        return self.rows @ xp.stack([xp.concat([xy, z]), xp.concat([z, -xy.conj()])], axis=1)

    def _solution(self, right: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """The solution for a right side: with a factor in single precision by conjugate directions.

        The few directions that this factor does not resolve are those of earlier solutions too, which are kept.
        """
        if self.factor.dtype == right.dtype:
            return self._approximate(right)
        solution, wanted = zeros(right.shape, right), _ACCURACY**2 * float(square(right).sum())
        for each in self.directions:
            share = (each.own * right).sum()
            solution, right = solution + share * each.own, right - share * each.image
        for _ in range(MOST_STEPS):  # usual numbers are 3 to 10
            if float(square(right).sum()) <= wanted:
                break
            own = self._approximate(right)
            for each in self.directions:
                own = own - (each.image * own).sum() * each.own
            image = self._along(self._across(own)) + self._damped(own)
            size = (own * image).sum() ** 0.5
            own, image = own / size, image / size
            share = (own * right).sum()
            solution, right = solution + share * own, right - share * image
            self.directions.append(_Direction(own=own, image=image))
        return solution

    def _damped(self, weights: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """The product with the damping matrix, which limits the read-outs by squared errors of the paths' ends."""
        n = len(self.before)
        total = (2 * n + 1) * weights - n * weights[:, self.before]
        total[:, self.before] -= n * weights
        return self.damping * total

    def _approximate(self, right: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """The solution with the factor, in its precision."""
        column = as_dtype(right.reshape(-1, 1), self.factor.dtype)
        return as_dtype(cholesky_solve(self.factor, column).reshape(3, -1), right.dtype)


def _gram_of_integrals(rows: Complex[Array, "k n2"]) -> Float[Array, "n3 n3"]:
    """Lower triangle of the Gram matrix of the coordinates of n integrals, all x first."""
    n, xp = rows.shape[1] // 2, namespace(rows)
    lower = gram(rows)
    pp, qp, qq = lower[:n, :n], lower[n:, :n], lower[n:, n:]
    matrix = zeros((3 * n, 3 * n), lower.real)
    for k in range(3):
        matrix[k * n : (k + 1) * n, k * n : (k + 1) * n] = (pp + qq).real
    difference = xp.tril((pp - qq).imag)
    matrix[n : 2 * n, :n] = difference - difference.mT
    matrix[2 * n :, :n] = (qp - qp.mT.conj()).real
    matrix[2 * n :, n : 2 * n] = -(qp + qp.mT.conj()).imag
    return matrix
