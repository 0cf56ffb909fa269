"""Quadrature rules on [0, 1], by name."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from spinor_geom.errors import OptionError

RuleName = Literal["trapezoid", "simpson", "gauss"]


class Rule(NamedTuple):
    """Nodes and weights on [0, 1]; the weights sum to 1."""

    nodes: Float[np.ndarray, " n"]
    weights: Float[np.ndarray, " n"]


@lru_cache(maxsize=64)
def rule(name: RuleName, n: int) -> Rule:
    """Quadrature rule on [0, 1].

    Args:
        name: "trapezoid" (n intervals, n + 1 nodes, error O(n⁻²)), "simpson" (n intervals, n even, error O(n⁻⁴)) or
            "gauss" (Gauss-Legendre with n nodes, exact for polynomials of degree 2n - 1).
        n: number of intervals, or of nodes for "gauss".

    Raises:
        OptionError: unknown name, n < 1, or an odd n for "simpson".
    """
    if n < 1:
        raise OptionError(f"a quadrature rule needs n of at least 1, got {n}")
    if name not in get_args(RuleName):
        raise OptionError(f"unknown quadrature rule {name!r}; choose 'trapezoid', 'simpson' or 'gauss'")
    if name == "gauss":
        x, w = np.polynomial.legendre.leggauss(n)
        return Rule(_frozen((x + 1) / 2), _frozen(w / 2))
    weights = np.full(n + 1, 1.0 / n)
    if name == "simpson":
        if n % 2:
            raise OptionError(f"Simpson's rule needs an even number of intervals, got {n}")
        weights = np.full(n + 1, 2.0 / (3 * n))
        weights[1::2] *= 2
    weights[[0, -1]] /= 2
    return Rule(_frozen(np.linspace(0.0, 1.0, n + 1)), _frozen(weights))


@lru_cache(maxsize=32)
def cumulative_matrix(order: int, ends: tuple[float, ...] | None = None) -> Float[np.ndarray, "h g"]:
    """Matrix S: (S f)_i is the integral from 0 to end i of the polynomial through the values f at so many Gauss nodes.

    The ends are in [0, 1]; the nodes themselves by default.
    """
    nodes, _ = np.polynomial.legendre.leggauss(order)
    x = nodes if ends is None else 2 * np.asarray(ends) - 1
    values = np.polynomial.legendre.legvander(nodes, order - 1)
    integrals = np.stack(
        [np.polynomial.legendre.legval(x, np.polynomial.legendre.legint(unit, lbnd=-1)) for unit in np.eye(order)],
        axis=1,
    )
    return _frozen(integrals @ np.linalg.inv(values) / 2)


def _frozen(array: np.ndarray) -> np.ndarray:
    """The array itself, which may be shared because it can no longer be written to."""
    array.setflags(write=False)
    return array
