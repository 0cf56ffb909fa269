"""Quadrature rules on [0, 1], and Gauss-Legendre panels on the boundary of a plane domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.plane_domain import TOWARDS_CORNER, Boundary, PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.mesh.array_checks import shared

RuleName = Literal["trapezoid", "simpson", "gauss"]
LARGEST_ORDER = 1000  # the time for the nodes of "gauss" grows with its cube


class Rule(NamedTuple):
    """Nodes and weights on [0, 1]. The weights sum to 1."""

    nodes: Float[np.ndarray, " n"]
    weights: Float[np.ndarray, " n"]


@lru_cache(maxsize=64)
def rule(name: RuleName, n: int) -> Rule:
    """Quadrature rule on [0, 1]: n intervals of "trapezoid" or "simpson", or n nodes of "gauss".

    The error is O(n⁻²), O(n⁻⁴), or 0 for polynomials of degree 2n − 1, respectively.

    Raises:
        OptionError: the name is unknown, n is not from 1 to `LARGEST_ORDER`, or odd for "simpson".
    """
    if not 1 <= n <= LARGEST_ORDER:
        raise OptionError(f"a quadrature rule needs n from 1 to {LARGEST_ORDER}, got {n}")
    if name not in get_args(RuleName):
        raise OptionError(f"unknown quadrature rule {name!r}; choose 'trapezoid', 'simpson' or 'gauss'")
    if name == "gauss":
        x, w = np.polynomial.legendre.leggauss(n)
        return Rule(shared((x + 1) / 2), shared(w / 2))
    weights = np.full(n + 1, 1.0 / n)
    if name == "simpson":
        if n % 2:
            raise OptionError(f"Simpson's rule needs an even number of intervals, got {n}")
        weights = np.full(n + 1, 2.0 / (3 * n))
        weights[1::2] *= 2
    weights[[0, -1]] /= 2
    return Rule(shared(np.linspace(0.0, 1.0, n + 1)), shared(weights))


@lru_cache(maxsize=32)
def cumulative_matrix(order: int, ends: tuple[float, ...] | None = None) -> Float[np.ndarray, "h g"]:
    """Matrix S of integrals from 0 to each of the ends, by default the Gauss nodes on [0, 1] themselves.

    (S f)_i is the integral to end i of the polynomial through the values f at the `order` Gauss nodes.
    """
    x = rule("gauss", order).nodes if ends is None else np.asarray(ends)
    return shared(through_gauss_nodes(order, x)[1])


def through_gauss_nodes(
    order: int, x: Float[np.ndarray, " h"]
) -> tuple[Float[np.ndarray, "h g"], Float[np.ndarray, "h g"]]:
    """Matrices from values at the `order` Gauss nodes on [0, 1] to values of the polynomial through them.

    The first has its values at x, the second its integrals from 0 to x.
    """
    basis = np.polynomial.legendre.legvander(2 * x - 1, order)
    to_values, to_integrals = _legendre_coefficients(order)
    return basis[:, :-1] @ to_values, basis @ to_integrals


@lru_cache(maxsize=32)
def _legendre_coefficients(order: int) -> tuple[Float[np.ndarray, "g g"], Float[np.ndarray, "g1 g"]]:
    """Matrices from values at the Gauss nodes to the Legendre coefficients of the polynomial and of its integral."""
    nodes, _ = np.polynomial.legendre.leggauss(order)
    inverse = np.linalg.inv(np.polynomial.legendre.legvander(nodes, order - 1))
    integral = np.polynomial.legendre.legint(np.eye(order), lbnd=-1)
    return shared(inverse), shared(integral @ inverse / 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Panels:
    """Composite Gauss-Legendre rule along ∂Ω: P panels of G nodes each."""

    order: int  # G
    breaks: Float[np.ndarray, " b"]  # panel ends in the parameter t of `PlaneDomain`
    t: Float[np.ndarray, " n"]  # parameters of the nodes, increasing
    z: Complex[np.ndarray, " n"]  # nodes on ∂Ω
    dz: Complex[np.ndarray, " n"]  # derivative dz/dt at the nodes
    weights: Float[np.ndarray, " n"]  # quadrature weights in t, so that Σ f·dz·weights = ∮ f dz

    @classmethod
    def around(cls, domain: PlaneDomain, breaks: Sequence[Float[np.ndarray, " _"]], order: int) -> Panels:
        """Panels on all of ∂Ω. `breaks` are the panel ends from 0 to 1 on each of its boundaries."""
        parts = [cls.on(boundary, ends, order) for boundary, ends in zip(domain.boundaries, breaks, strict=True)]
        return cls(
            order=order,
            breaks=np.concatenate([part.breaks + 2.0 * number for number, part in enumerate(parts)]),
            t=np.concatenate([part.t + 2.0 * number for number, part in enumerate(parts)]),
            z=np.concatenate([part.z for part in parts]),
            dz=np.concatenate([part.dz for part in parts]),
            weights=np.concatenate([part.weights for part in parts]),
        )

    @cached_property
    def ends(self) -> Float[np.ndarray, "p 2"]:
        """Both ends of each panel in t."""
        pairs = np.stack([self.breaks[:-1], self.breaks[1:]], axis=1)
        return np.asarray(pairs[pairs[:, 0] % 2 < 1])

    @cached_property
    def rims(self) -> tuple[int, ...]:
        """Number of panels on each boundary."""
        return tuple(np.bincount((self.ends[:, 0] // 2).astype(np.int64)).tolist())

    @cached_property
    def widths(self) -> Float[np.ndarray, " p"]:
        """Lengths of the panels in t."""
        return np.asarray(self.ends[:, 1] - self.ends[:, 0])

    @property
    def own_parameters(self) -> tuple[Float[np.ndarray, " _"], ...]:
        """The parameters in [0, 1] of the nodes on each boundary."""
        counts = np.cumsum(self.rims)[:-1] * self.order
        return tuple(part - 2 * number for number, part in enumerate(np.split(self.t, counts)))

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
        """Matrix of integrals from the start of a panel of length 1 to each of its nodes."""
        return cumulative_matrix(self.order)

    @property
    def arc_weights(self) -> Float[np.ndarray, " n"]:
        """Weights of integrals over arc length: Σ f·arc_weights = ∮ f |dz|."""
        return np.asarray(self.weights * np.abs(self.dz))


def path_to(
    domain: PlaneDomain, vertex: int, order: int
) -> tuple[Complex[np.ndarray, " w"], Complex[np.ndarray, " w"]]:
    """Quadrature nodes and weights dz on a path through Ω from its root to a vertex of its triangulation."""
    path = [vertex]
    while path[-1] != domain.root:
        path.append(int(domain.parents[path[-1]]))
    corners = domain.triangulation.points[path[::-1]]
    if domain.corners[vertex]:
        before, end = corners[-2:]
        corners = np.concatenate([corners[:-1], end + (before - end) * TOWARDS_CORNER, [end]])
    nodes, weights = rule("gauss", order)
    step = np.diff(corners)[:, None]
    return (corners[:-1, None] + step * nodes).ravel(), (step * weights).ravel()
