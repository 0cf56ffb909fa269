"""Gauss-Legendre panels on the boundary of a plane domain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.domain.quadrature import cumulative_matrix, rule


@dataclass(frozen=True, kw_only=True, eq=False)
class Panels:
    """Composite Gauss-Legendre rule along ∂Ω: P panels of G nodes each.

    Attributes:
        order: G.
        breaks: panel ends in the boundary parameter t, (P + 1,), from 0 to 1.
        t: parameters of the nodes, (P·G,), increasing.
        z: nodes on ∂Ω.
        dz: derivative dz/dt at the nodes.
        weights: quadrature weights in t, so that Σ f·dz·weights = ∮ f dz.
    """

    order: int
    breaks: Float[np.ndarray, " b"]
    t: Float[np.ndarray, " n"]
    z: Complex[np.ndarray, " n"]
    dz: Complex[np.ndarray, " n"]
    weights: Float[np.ndarray, " n"]

    @classmethod
    def on(cls, boundary: Boundary, breaks: Float[np.ndarray, " b"], order: int) -> Panels:
        """Panels between consecutive breaks (0 = first < … < last = 1), `order` nodes each."""
        x, w = rule("gauss", order)
        h = np.diff(breaks)
        t = (breaks[:-1, None] + h[:, None] * x).ravel()
        return cls(
            order=order,
            breaks=breaks,
            t=t,
            z=boundary.point(t),
            dz=boundary.derivative(t),
            weights=(h[:, None] * w).ravel(),
        )

    @property
    def cumulative(self) -> Float[np.ndarray, "g g"]:
        """Integration matrix of one panel of unit length, from its start to each of its nodes."""
        return cumulative_matrix(self.order)

    @property
    def arc_weights(self) -> Float[np.ndarray, " n"]:
        """Weights of the integral by arc length, Σ f·arc_weights = ∮ f |dz|."""
        return np.asarray(self.weights * np.abs(self.dz))
