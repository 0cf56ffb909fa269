"""Levenberg-Marquardt on the parameters of complex-valued networks: towards given p and q, and towards Γ.

p and q are holomorphic in the network's parameters, so their Jacobian J at m points is an m × k complex matrix, k the
number of parameters. A damped step is Jᴴu with (J Jᴴ + μ)u the residual: the dual form, a system of m equations
however large the network is, in which J itself never appears; see `Linearisation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.holomorphic.mlp import ComplexMLP, Linearisation
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.training.boundary import BoundaryNodes, Placed, placed

# change of the damping after a good and a bad step
_LESS, _MORE = 0.2, 4.0
# least damping as a share of the mean diagonal entry of J Jᴴ: below it rounding decides
_LEAST_DAMPING = 1e-16
# so many steps have to lessen the distance by a tenth together, else it stands still
_PATIENCE, _GAIN = 12, 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Distillation:
    """The distance of p and q from given ones.

    Attributes:
        linear: the network.
        values: p and q as they should be.
    """

    linear: Linearisation
    values: Complex[Tensor, "n 2"]

    def at(self, linear: Linearisation) -> Distillation:
        """That of other parameters; its losses are NaN where the network overflows."""
        return replace(self, linear=linear)

    @property
    def _residual(self) -> Complex[Tensor, "n 2"]:
        return self.values - self.linear.value

    @cached_property
    def losses(self) -> Float[Tensor, "2"]:
        """The mean |difference|² of p and that of q."""
        return self._residual.abs().square().mean(0)

    @cached_property
    def _kernel(self) -> Complex[Tensor, "2 n n"]:
        return self.linear.kernel()

    def step(self, damping: Float[Tensor, " k"]) -> Complex[Tensor, "n 2"]:
        """The v whose Jᴴ v is the change of the parameters, NaN where the system is indefinite; of each a system."""
        return _damped_solution(self._kernel, damping, self._residual.mT).mT


@dataclass(frozen=True, kw_only=True, eq=False)
class Polish:
    """The distance of a surface's boundary from Γ, the slide along Γ eliminated.

    The distance of a node counts only in the two directions normal to Γ, and the node's point of Γ is the nearest one.
    The real parts of complex rows make a real dual system of two equations a node.

    Attributes:
        linear: the network.
        nodes: on ∂Ω.
        curve: Γ.
        slide: parameter of the point of Γ near each node, where the nearest are looked for.
        held: whether the slide is kept, and the distance from its points counts in all directions: the way from random
            parameters, whose surface is far from Γ everywhere.
    """

    linear: Linearisation
    nodes: BoundaryNodes
    curve: CurveTensors
    slide: Float[Tensor, " n"]
    held: bool

    def at(self, linear: Linearisation) -> Polish:
        """That of other parameters."""
        return replace(self, linear=linear, slide=self.near.slide)

    @cached_property
    def near(self) -> Placed:
        """The boundary next to Γ."""
        return placed(self.nodes, self.linear.value, self.slide, self.curve, held=self.held)

    @property
    def losses(self) -> Float[Tensor, "1"]:
        """The mean squared distance."""
        return self.nodes.weights @ self.near.error.square().sum(1, keepdim=True)

    @cached_property
    def _system(self) -> tuple[Complex[Tensor, "2 m n"], Float[Tensor, "m m"], Float[Tensor, " m"]]:
        """Derivatives of the distances by p and by q at the nodes, of which the real parts count; kernel; distances."""
        nodes, (p, q) = self.nodes, self.linear.value.unbind(-1)
        # φ by p and by q, along the path
        by = torch.stack([torch.stack([2 * p, -2j * p, 2 * q], dim=-1), torch.stack([-2 * q, -2j * q, 2 * p], dim=-1)])
        by = by * nodes.dz[:, None]
        tangent = self.curve.point_and_derivative(self.near.slide)[1]
        directions = [*normals_of(tangent), *([torch.nn.functional.normalize(tangent, dim=1)] if self.held else [])]
        e = nodes.weights.sqrt()[:, None] * torch.stack(directions)
        # the constant of r follows the mean
        mean_free = nodes.integral - nodes.weights @ nodes.integral
        rows = torch.einsum("aid,ij,kjd->kaij", e.to(by.dtype), mean_free.to(by.dtype), by).flatten(1, 2)
        kernel = (rows @ self.linear.kernel() @ rows.mH).real.sum(0)
        # what a constant can do is nearly free: it is found anew after each step
        e = e.flatten(0, 1)
        kernel = kernel + kernel.diagonal().mean() / e.square().sum(1).mean() * (e @ e.mT)
        return rows, kernel, -(e * self.near.error.repeat(len(directions), 1)).sum(1)

    def step(self, damping: Float[Tensor, " k"]) -> Complex[Tensor, "n 2"]:
        """One real system for p and q together."""
        rows, kernel, right = self._system
        return (rows.mH @ _damped_solution(kernel, damping[0], right).to(rows.dtype)).mT


SomeFit = TypeVar("SomeFit", Distillation, Polish)


def descend(
    network: ComplexMLP,
    z: Complex[Tensor, " n"],
    fit: SomeFit,
    *,
    damping: float,
    tolerance: float,
    max_steps: int,
    on_step: Callable[[float], None] | None = None,
) -> SomeFit:
    """Lessens a distance by damped steps of a network's parameters, in place.

    Args:
        network: where it starts.
        z: points, on ∂Ω.
        fit: the distance at the start.
        damping: at the start, as a share of the mean diagonal entry of J Jᴴ.
        tolerance: distance at which it stops.
        max_steps: most steps.
        on_step: called with the distance after each step.

    Returns:
        The distance where it was left.
    """
    reference, since = rms(fit), 0
    shares = torch.full_like(fit.losses, damping)
    for _ in range(max_steps):
        if is_out_of_time() or since == _PATIENCE or rms(fit) <= tolerance:
            break
        before = [parameter.detach().clone() for parameter in network.parameters()]
        changes = fit.linear.pulled_back(fit.step(shares))
        _move(network, before, changes, where=torch.ones_like(shares, dtype=torch.bool))
        trial = fit.at(network.linearised(z))
        better = trial.losses < fit.losses
        if not bool(better.all()):
            # p, q, or both go back
            _move(network, before, changes, where=better)
            trial = fit.at(network.linearised(z)) if bool(better.any()) else fit
        fit = trial
        shares = (shares * torch.where(better, _LESS, _MORE)).clamp(min=_LEAST_DAMPING)
        since += 1
        if rms(fit) < (1 - _GAIN) * reference:
            reference, since = rms(fit), 0
        if on_step is not None:
            on_step(rms(fit))
    return fit


def rms(fit: Distillation | Polish) -> float:
    """The distance, p and q together."""
    return float(fit.losses.sum().sqrt())


def _move(
    network: ComplexMLP, before: Sequence[Tensor], changes: Sequence[Tensor], *, where: Bool[Tensor, " k"]
) -> None:
    """Sets the parameters to what they were, and changes those of p, of q, or of both."""
    with torch.no_grad():
        for parameter, old, change in zip(network.parameters(), before, changes, strict=True):
            parameter.copy_(torch.where(where.reshape(-1, *[1] * (old.ndim - 1)), old + change, old))


def _damped_solution(
    kernel: Float[Tensor, "*batch n n"] | Complex[Tensor, "*batch n n"],
    damping: Float[Tensor, "*#batch"],
    right: Float[Tensor, "*batch n"] | Complex[Tensor, "*batch n"],
) -> Tensor:
    """The solution of (kernel + μ) u = right, μ the damping as a share of the kernel's mean diagonal entry."""
    share = damping * kernel.diagonal(dim1=-2, dim2=-1).real.mean(-1)
    damped = kernel + share[..., None, None] * torch.eye(kernel.shape[-1], dtype=kernel.dtype, device=kernel.device)
    factor, failed = torch.linalg.cholesky_ex(damped)
    solution = torch.cholesky_solve(right[..., None], factor)[..., 0]
    return torch.where(failed[..., None] == 0, solution, torch.nan)
