"""Splines of one variable on [0, 1], and their interpolation at Chebyshev-Demko points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import BSpline

# search for the extrema: rounds, after which nodes move by less than a sample, and samples per extremum
_ROUNDS, _SAMPLES = 6, 24


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Splines of degree d with simple inner knots, d − 1 times continuously differentiable."""

    degree: int
    breaks: tuple[float, ...]  # the knots from 0 to 1, each once

    @classmethod
    @lru_cache(maxsize=256)
    def on(cls, degree: int, breaks: tuple[float, ...]) -> SplineSpace:
        """The space. For equal arguments the same object, so that its nodes and matrices are computed once."""
        return cls(degree, breaks)

    @property
    def dimension(self) -> int:
        """Number k of control points."""
        return len(self.breaks) - 1 + self.degree

    @cached_property
    def knots(self) -> Float[np.ndarray, " m"]:
        """The knot vector: both ends are repeated d + 1 times."""
        return np.concatenate([np.zeros(self.degree), self.breaks, np.ones(self.degree)])

    def basis(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n k"]:
        """The B-splines at points."""
        return np.asarray(BSpline(self.knots, np.eye(self.dimension), self.degree)(x))

    @cached_property
    def nodes(self) -> Float[np.ndarray, " k"]:
        """The Chebyshev-Demko points, at which interpolation is well conditioned. The ends are among them.

        They are the extrema of the spline that alternates k times between −1 and 1.

        Source: de Boor, "A Practical Guide to Splines" (2001), chapter XIII.
        """
        k = self.dimension
        signs = (-1.0) ** np.arange(k)
        around = _SAMPLES * np.arange(1, k - 1)[:, None] + np.arange(-_SAMPLES // 2, _SAMPLES // 2 + 1)
        nodes = np.array([self.knots[i + 1 : i + 1 + self.degree].mean() for i in range(k)])
        for _ in range(_ROUNDS):
            x = np.interp(np.arange(_SAMPLES * (k - 1) + 1) / _SAMPLES, np.arange(k), nodes)
            values = self.basis(x) @ np.linalg.solve(self.basis(nodes), signs)
            highest = (signs[1:-1, None] * values[around]).argmax(axis=1)
            nodes[1:-1] = x[around[np.arange(k - 2), highest]]
        return nodes

    @cached_property
    def interpolation(self) -> Float[np.ndarray, "k k"]:
        """The matrix from values at the nodes to control points."""
        return np.asarray(np.linalg.inv(self.basis(self.nodes)))

    @cached_property
    def between(self) -> Float[np.ndarray, " k_1"]:
        """Midpoints between nodes, where the error of an interpolant is measured."""
        return np.asarray((self.nodes[1:] + self.nodes[:-1]) / 2)

    @cached_property
    def to_between(self) -> Float[np.ndarray, "k_1 k"]:
        """The matrix from values at the nodes to values of the interpolant at `between`."""
        return np.asarray(self.basis(self.between) @ self.interpolation)

    @cached_property
    def pieces(self) -> Int[np.ndarray, " k_1"]:
        """The pieces in which the points `between` lie."""
        return np.asarray(np.searchsorted(self.breaks, self.between, side="right") - 1)
