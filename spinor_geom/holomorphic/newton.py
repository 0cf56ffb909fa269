"""Polynomials in Newton's form at Leja points: O(degree) a value, stable on the set the points are taken from.

The points lie in a set of capacity about 1 after division by `_capacity`, so that products of differences neither
overflow nor vanish.

Source: Reichel, "Newton interpolation at Leja points", BIT 30 (1990).
"""

from __future__ import annotations

import torch
from jaxtyping import Complex, Float
from torch import Tensor

_MOST_CANDIDATES = 600


def leja_points(z: Complex[Tensor, " n"], count: int) -> Complex[Tensor, " count"]:
    """Leja points from a set: each maximises the product of the distances to those before it."""
    candidates = z[:: max(1, len(z) // _MOST_CANDIDATES)]
    chosen = [candidates[(candidates - candidates.mean()).abs().argmax()]]
    product = torch.zeros(len(candidates), dtype=candidates.real.dtype, device=z.device)
    for _ in range(count - 1):
        product = product + (candidates - chosen[-1]).abs().log()
        chosen.append(candidates[product.argmax()])
    return torch.stack(chosen)


def newton_matrix(points: Complex[Tensor, " k"], values: Complex[Tensor, "k k"]) -> Complex[Tensor, "k k"]:
    """Newton coefficients (row l: of the product of l factors) of the polynomials with given values at the points.

    Args:
        points: interpolation points.
        values: value of polynomial j at point i in row i, column j.
    """
    differences = (points[:, None] - points[:-1]) / _capacity(points)
    products = torch.cat([torch.ones_like(points)[:, None], differences.cumprod(dim=1)], dim=1)
    coefficients: Tensor = torch.linalg.solve_triangular(products.tril(), values, upper=False)
    return coefficients


def newton_value(
    z: Complex[Tensor, "*pts"], points: Complex[Tensor, " k"], coefficients: Complex[Tensor, "k c"]
) -> Complex[Tensor, "*pts c"]:
    """Values of the polynomials with given Newton coefficients, by Horner's rule."""
    step = ((z[..., None] - points) / _capacity(points))[..., None]
    value = coefficients[-1].expand(*z.shape, -1)
    for k in range(len(points) - 2, -1, -1):
        value = value * step[..., k, :] + coefficients[k]
    return value


def newton_derivative(
    z: Complex[Tensor, "*pts"], points: Complex[Tensor, " k"], coefficients: Complex[Tensor, "k c"]
) -> Complex[Tensor, "*pts c"]:
    """Derivatives of the same polynomials."""
    capacity = _capacity(points)
    step = ((z[..., None] - points) / capacity)[..., None]
    value = coefficients[-1].expand(*z.shape, -1)
    slope = torch.zeros_like(value)
    for k in range(len(points) - 2, -1, -1):
        slope = slope * step[..., k, :] + value
        value = value * step[..., k, :] + coefficients[k]
    return slope / capacity


def _capacity(points: Complex[Tensor, " k"]) -> Float[Tensor, ""]:
    """Geometric mean of the distances from the last point to the others: tends to the capacity of the set."""
    if len(points) == 1:
        return torch.ones((), dtype=points.real.dtype, device=points.device)
    return (points[-1] - points[:-1]).abs().log().mean().exp()
