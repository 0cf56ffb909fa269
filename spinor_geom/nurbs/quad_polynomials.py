"""A holomorphic function on quadrilaterals of Ω, as one polynomial on each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.holomorphic.arnoldi import barycentric_weights, leja_points
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums

Function = Callable[[Complex[np.ndarray, " k"]], Complex[np.ndarray, "k 3"]]

# on a side of an outline: points among which nodes are chosen, and those where the error is measured. As many nodes as
# half of the first give errors of 1e-12 on most quadrilaterals.
CANDIDATES, CHECKS = ((1 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / 2 for n in (32, 13))
_ACCURATE = 1e-9  # largest error, as a share of the largest difference of values


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadPolynomials:
    """Polynomials of z that interpolate a holomorphic function on quadrilaterals.

    Attributes:
        function: with values of three components.
        nodes: at which it is interpolated, on the outline of each quadrilateral.
        strengths: weights of the barycentric formula times the values, and the weights.
        errors: the largest ones on the outlines, where those of holomorphic functions are largest, as a share of the
            largest difference of values.
    """

    function: Function
    nodes: Complex[np.ndarray, "q m"]
    strengths: Complex[np.ndarray, "q m 4"]
    errors: Float[np.ndarray, " q"]

    @classmethod
    def through(
        cls, function: Function, candidates: Complex[np.ndarray, "q n"], checks: Complex[np.ndarray, "q c"]
    ) -> QuadPolynomials:
        """Interpolants at half of the candidates, compared with the function at other points of the outlines."""
        nodes = leja_points(candidates, candidates.shape[1] // 2)
        values = function(np.concatenate([nodes, checks], axis=1).ravel()).reshape(len(nodes), -1, 3)
        at_nodes, at_checks = np.split(values, [nodes.shape[1]], axis=1)
        strengths = np.concatenate([at_nodes, np.ones_like(at_nodes[..., :1])], axis=2)
        strengths *= barycentric_weights(nodes)[..., None]
        found = np.array([_interpolated(*row) for row in zip(nodes, strengths, checks, strict=True)])
        errors = np.abs(found - at_checks).max(axis=(1, 2)) / np.abs(values - values[0, 0]).max()
        return cls(function=function, nodes=nodes, strengths=strengths, errors=errors)

    def value(self, quad: int, z: Complex[np.ndarray, " k"]) -> Complex[np.ndarray, "k 3"]:
        """Values at points of a quadrilateral that are no nodes, of the function itself where the error is too large."""
        is_accurate = self.errors[quad] <= _ACCURATE
        return _interpolated(self.nodes[quad], self.strengths[quad], z) if is_accurate else self.function(z)


def _interpolated(
    nodes: Complex[np.ndarray, " m"], strengths: Complex[np.ndarray, "m 4"], z: Complex[np.ndarray, " k"]
) -> Complex[np.ndarray, "k 3"]:
    sums = cauchy_sums(nodes, strengths, z)
    return np.asarray(sums[:, :3] / sums[:, 3:])
