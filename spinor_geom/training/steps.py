"""What the steps of Levenberg-Marquardt share: damping, its system in dual form, and when to give up."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from spinor_geom.holomorphic.mlp import ComplexMLP

# damping at the start as a share of the mean diagonal entry of J Jᴴ, and its change after a good and a bad step
DAMPING, LESS, MORE = 1e-6, 0.2, 4.0
# least and largest damping as such shares: below it rounding decides, above it steps are no steps
LEAST_DAMPING, MOST_DAMPING = 1e-16, 1e4
# steps that together must lessen the loss by a share, else it stands still
_PATIENCE, _GAIN = 12, 0.1


class Patience:
    """Whether a loss stands still: less than a share of gain in so many steps.

    Attributes:
        last: the last loss.
        best: the least one.
    """

    def __init__(self, loss: float) -> None:
        """Takes the loss before the first step."""
        self.last = self.best = loss
        self._reference, self._since = loss, 0

    def see(self, loss: float) -> None:
        """Takes down the loss after a step."""
        self.last, self.best = loss, min(self.best, loss)
        self._since += 1
        if self.best < (1 - _GAIN) * self._reference:
            self._reference, self._since = self.best, 0

    @property
    def is_over(self) -> bool:
        """Whether too many steps have brought too little."""
        return self._since >= _PATIENCE


def damped_solution(
    kernel: Float[Tensor, "*batch n n"] | Complex[Tensor, "*batch n n"],
    damping: float | Float[Tensor, "*batch"],
    right: Float[Tensor, "*batch n"] | Complex[Tensor, "*batch n"],
) -> Tensor:
    """The solution of (kernel + damping) u = right, by Cholesky; NaN where rounding leaves it indefinite."""
    damped = kernel.clone()
    damped.diagonal(dim1=-2, dim2=-1).add_(torch.as_tensor(damping, device=kernel.device)[..., None])
    factor, failed = torch.linalg.cholesky_ex(damped)
    solution = torch.cholesky_solve(right[..., None], factor)[..., 0]
    return torch.where(failed[..., None] == 0, solution, torch.nan)


def parameters_of(network: ComplexMLP) -> list[Tensor]:
    """A copy of all parameters."""
    return [parameter.detach().clone() for parameter in (*network.weights, *network.biases)]


def add_changes(network: ComplexMLP, changes: Sequence[tuple[Tensor, Tensor]]) -> None:
    """Adds a change of weight and bias to each layer."""
    with torch.no_grad():
        for weight, bias, (by_weight, by_bias) in zip(network.weights, network.biases, changes, strict=True):
            weight.add_(by_weight)
            bias.add_(by_bias)


def restore_where(network: ComplexMLP, before: Sequence[Tensor], where: Bool[Tensor, "2"]) -> None:
    """Takes back the changes of p, of q, or of both."""
    with torch.no_grad():
        for parameter, old in zip((*network.weights, *network.biases), before, strict=True):
            parameter.copy_(torch.where(where.reshape(-1, *[1] * (old.ndim - 1)), old, parameter))
