"""A holomorphic function on quadrilaterals of Ω, approximated by one polynomial on each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex

from spinor_geom.holomorphic.arnoldi import barycentric_weights, leja_points
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums

Function = Callable[[Complex[np.ndarray, " k"]], Complex[np.ndarray, "k 3"]]

# Points per side: candidates for nodes, of which half are used, and points where the error is measured. The error is
# 1e-12 on most quadrilaterals.
CANDIDATES, CHECKS = ((1 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / 2 for n in (32, 13))


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadPolynomials:
    """Polynomials of z that interpolate a holomorphic function on quadrilaterals."""

    function: Function  # with values of three components
    nodes: Complex[np.ndarray, "q m"]  # points of interpolation, on the outline of each quadrilateral
    strengths: Complex[np.ndarray, "q m 4"]  # weights of the barycentric formula times the values, and the weights
    # whether the error is small enough on the outline, where it is largest by the maximum principle
    is_accurate: Bool[np.ndarray, " q"]

    @classmethod
    def through(
        cls,
        function: Function,
        candidates: Complex[np.ndarray, "q n"],
        checks: Complex[np.ndarray, "q c"],
        accuracy: float,
    ) -> QuadPolynomials:
        """Interpolants at half of the candidates, compared with the function at other points of the outlines.

        The accuracy is relative to the largest difference of values.
        """
        nodes = leja_points(candidates, candidates.shape[1] // 2)
        values = function(np.concatenate([nodes, checks], axis=1).ravel()).reshape(len(nodes), -1, 3)
        at_nodes, at_checks = np.split(values, [nodes.shape[1]], axis=1)
        strengths = np.concatenate([at_nodes, np.ones_like(at_nodes[..., :1])], axis=2)
        strengths *= barycentric_weights(nodes)[..., None]
        found = np.array([_interpolated(*row) for row in zip(nodes, strengths, checks, strict=True)])
        errors = np.abs(found - at_checks).max(axis=(1, 2))
        is_accurate = errors <= accuracy * np.abs(values - values[0, 0]).max()
        return cls(function=function, nodes=nodes, strengths=strengths, is_accurate=is_accurate)

    def values(self, quads: Sequence[int], z: Sequence[Complex[np.ndarray, " _"]]) -> list[Complex[np.ndarray, "_ 3"]]:
        """Values at points of quadrilaterals, of the function itself where the polynomials are not accurate."""
        rest = [points for quad, points in zip(quads, z, strict=True) if not self.is_accurate[quad]]
        ends = np.cumsum([len(points) for points in rest])[:-1]
        exact = iter(np.split(self.function(np.concatenate(rest)), ends) if rest else [])
        return [
            _interpolated(self.nodes[quad], self.strengths[quad], points) if self.is_accurate[quad] else next(exact)
            for quad, points in zip(quads, z, strict=True)
        ]


def _interpolated(
    nodes: Complex[np.ndarray, " m"], strengths: Complex[np.ndarray, "m 4"], z: Complex[np.ndarray, " k"]
) -> Complex[np.ndarray, "k 3"]:
    sums = cauchy_sums(nodes, strengths, z)
    return np.asarray(sums[:, :3] / sums[:, 3:])
