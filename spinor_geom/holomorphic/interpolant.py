"""Rational interpolation at nodes on ∂Ω by the barycentric form of Cauchy's integral formula."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Complex

from spinor_geom.arrays import TINY, Array, is_numpy, namespace, square
from spinor_geom.holomorphic.array_model import ArrayModel, blank
from spinor_geom.holomorphic.blocks import in_blocks, require_complex
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums

Nodes = Complex[Array, " n"]
Values = Complex[Array, "n 2"]  # of p and q at the nodes


@dataclass(frozen=True, eq=False, repr=False)
class CauchyInterpolant(ArrayModel):
    """p and q as rational functions with given values at nodes on ∂Ω.

    f(z) = Σ_j w_j f_j/(ζ_j − z) / Σ_j w_j/(ζ_j − z) with w_j = dz/dt at the node: the trapezoidal rule for Cauchy's
    integral of f divided by that of 1. Near ∂Ω their errors cancel. f is holomorphic in Ω and on ∂Ω, interpolates the
    values f_j, and is as accurate near ∂Ω as in the middle of Ω.

    Shape:
        nodes: (n,), ζ_j, in order, at equal steps of an analytic parameter t of ∂Ω.
        weights: (n,), dz/dt there.
        values: (n, 2), complex. Column 0 is p, column 1 is q.

    Source: Ioakimidis, Papadakis & Perdios, "Numerical evaluation of analytic functions by Cauchy's theorem", BIT 31
    (1991).
    """

    kind: ClassVar[str] = "cauchy-interpolant"
    trained: ClassVar[tuple[str, ...]] = ("values",)
    fixed: ClassVar[tuple[str, ...]] = ("nodes", "weights")

    nodes: Nodes
    weights: Nodes
    values: Values

    def __post_init__(self) -> None:
        """Raises DtypeError if an array is not complex."""
        require_complex(nodes=self.nodes, weights=self.weights, values=self.values)

    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z)), at many points of numpy by the fast multipole method, to 1e-12."""
        data = self.nodes, self.weights, self.values
        if is_numpy(z) and np.isfinite(z).all():
            return interpolated(z.reshape(-1), *data).reshape(*z.shape, 2)
        return in_blocks(lambda some: interpolated(some, *data), z, width=len(self.nodes))

    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""
        data = self.nodes, self.weights, self.values
        return in_blocks(lambda some: interpolated_slope(some, *data), z, width=len(self.nodes))

    def config(self) -> dict[str, Any]:
        """Number of nodes."""
        return {"nodes": len(self.nodes)}

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> CauchyInterpolant:
        """An interpolant of zeros with the given size."""
        zeros = blank(int(config["nodes"]), 4)
        return cls(zeros[:, 0], zeros[:, 1], zeros[:, 2:])


def interpolated(z: Complex[Array, " m"], nodes: Nodes, weights: Nodes, values: Values) -> Complex[Array, "m 2"]:
    """Σ_j w_j f_j/(ζ_j − z) / Σ_j w_j/(ζ_j − z) for two functions with values f_j at the nodes ζ_j."""
    strengths, xp = _strengths(weights, values), namespace(z)
    if is_numpy(z):
        sums = cauchy_sums(nodes, strengths, z)
        with np.errstate(all="ignore"):  # the quotient is undefined at nodes, and overflows far outside Ω
            found = sums[:, :2] / sums[:, 2:]
        lost = np.flatnonzero(~np.isfinite(found).all(axis=1))
        if len(lost):
            distance = np.abs(nodes - z[lost, None])
            near = distance.argmin(axis=1)
            at_node = distance[np.arange(len(lost)), near] < TINY**0.5
            found[lost[at_node]] = values[near[at_node]]
        return found
    inverse, hit = _inverse_differences(z, nodes)
    sums = inverse @ strengths
    elsewhere = sums[:, :2] / sums[:, 2:]
    at_node = xp.take(values, xp.argmax(1 * hit, axis=-1), axis=0)
    return xp.where(hit.any(-1)[:, None], at_node, elsewhere)


def interpolated_slope(z: Complex[Array, " m"], nodes: Nodes, weights: Nodes, values: Values) -> Complex[Array, "m 2"]:
    """Derivatives of the functions of `interpolated`."""
    # with N = Σ w f/(ζ − z), D = Σ w/(ζ − z): (N/D)' = (Σ w f/(ζ − z)² − (N/D) Σ w/(ζ − z)²)/D
    inverse, hit = _inverse_differences(z, nodes)
    strengths = _strengths(weights, values)
    sums, slopes = inverse @ strengths, (inverse * inverse) @ strengths
    with np.errstate(all="ignore"):
        elsewhere = (slopes[:, :2] - sums[:, :2] / sums[:, 2:] * slopes[:, 2:]) / sums[:, 2:]
    if is_numpy(z) and not hit.any():
        return elsewhere
    # the limit at a node ζ_k is Σ_{j≠k} w_j (f_k − f_j)/(ζ_j − ζ_k)/w_k
    xp = namespace(z)
    node = xp.argmax(1 * hit, axis=-1)
    own, weight = xp.take(values, node, axis=0), xp.take(weights, node, axis=0)[:, None]
    return xp.where(hit.any(-1)[:, None], (own * sums[:, 2:] - sums[:, :2]) / weight, elsewhere)


def _strengths(weights: Nodes, values: Values) -> Complex[Array, "n 3"]:
    """Numerators of the sums: w f for both functions, and w."""
    xp = namespace(values)
    return xp.concat([values, xp.ones_like(values[:, :1])], axis=-1) * weights[:, None]


def _inverse_differences(z: Complex[Array, " m"], nodes: Nodes) -> tuple[Complex[Array, "m n"], Bool[Array, "m n"]]:
    """1/(ζ_j − z), or 0 where z is the node ζ_j, and the mask of these entries."""
    difference = nodes - z[:, None]
    size = square(difference)
    hit = size < TINY
    # faster than complex division
    return difference.conj() * (1 / namespace(z).where(hit, np.inf, size)), hit
