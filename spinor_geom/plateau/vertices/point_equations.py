"""Newton's equations for integrals of φ along paths, and their damped solutions of least norm.

Since δr = Re ∫ (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq)) dz, the derivatives of all integrals follow from two complex
matrices, ∫ 2pf dz and ∫ 2qf dz for all features f.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import (
    Array,
    add_to_diagonal,
    cholesky_solve,
    complex_of,
    definite_cholesky,
    gram,
    namespace,
    zeros,
)

# Damping, as a share of the mean of the Gram matrix's diagonal, because equations may have no solution. For n paths
# it multiplies |x|² and n·|D x|², with the differences D along a rim, as for errors of points between the paths. With
# 4e-10 57 instead of 59 of sixty rims cut along triangles converge.
_DAMPING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class PointEquations:
    """Linearised integrals Re ∫ φ dz along n paths, as functions of orthonormal read-outs."""

    rows: Complex[Array, "k n2"]  # conjugates of ∫ 2pf dz along each path for all features f, then of ∫ 2qf dz
    factor: Float[Array, "n3 n3"]  # of the damped Gram matrix of the 3n functions

    @classmethod
    def of(
        cls, by_p: Complex[Array, "k n"], by_q: Complex[Array, "k n"], before: Int[np.ndarray, " n"] | None = None
    ) -> PointEquations:
        """The equations with their factor. `before` has the path that ends where each one starts, by default none."""
        n, xp = by_p.shape[1], namespace(by_p)
        rows = xp.concat([by_p, by_q], axis=1)
        matrix = _gram_of_integrals(rows)
        own = np.arange(3 * n)
        damping = _DAMPING * float(matrix[own, own].mean())
        before = np.arange(n) if before is None else before
        path, other = (n * np.arange(3)[:, None] + index for index in (np.arange(n), before))
        for pair in ((path, other), (other, path)):
            matrix[pair] -= n * damping
        add_to_diagonal(matrix, (2 * n + 1) * damping)
        return cls(rows=rows, factor=definite_cholesky(matrix))

    def step(self, error: Float[Array, "n 3"], away: Complex[Array, "k 2"] | None) -> Complex[Array, "k 2"]:
        """The change of least norm of the read-outs that removes an error.

        With `away`, the difference of the read-outs from given ones, the new read-outs are the nearest to those.
        """
        right = error.mT if away is None else error.mT - self._along(away)
        weights = cholesky_solve(self.factor, right.reshape(-1, 1)).reshape(3, -1)
        change = -self._across(weights)
        return change if away is None else change - away

    def _along(self, change: Complex[Array, "k 2"]) -> Float[Array, "3 n"]:
        """The changes of the integrals with the read-outs."""
        # conjugates of the few changes instead of those of the matrix
        products = (change.mT.conj() @ self.rows).conj()
        n = self.rows.shape[1] // 2
        (pp, qp), (pq, qq) = products[:, :n], products[:, n:]
        return namespace(change).stack([(pp - qq).real, (pp + qq).imag, (pq + qp).real])

    def _across(self, weights: Float[Array, "3 n"]) -> Complex[Array, "k 2"]:
        """The adjoint of `_along`."""
        x, y, z = weights
        xp, xy, z = namespace(x), complex_of(x, y), z + 0j
        return self.rows @ xp.stack([xp.concat([xy, z]), xp.concat([z, -xy.conj()])], axis=1)


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
