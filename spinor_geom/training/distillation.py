"""Given p and q distilled into a network.

p and q are holomorphic in the network's parameters, so their Jacobian J at m points is an m × k complex matrix, k the
number of parameters. A damped step is Jᴴu with (J Jᴴ + μ)u the residual: the dual form, a system of m equations
however large the network is, in which J itself never appears; see `Linearisation`.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.training.steps import (
    DAMPING,
    LEAST_DAMPING,
    LESS,
    MORE,
    MOST_DAMPING,
    Patience,
    add_changes,
    damped_solution,
    parameters_of,
    restore_where,
)


def distil(
    network: ComplexMLP,
    z: Complex[Tensor, " n"],
    values: Complex[Tensor, "n 2"],
    *,
    tolerance: float,
    max_steps: int,
    on_step: Callable[[float], None] | None = None,
) -> float:
    """Fits a network, in place, to given values of p and q at some points, p and q side by side.

    Args:
        network: where it starts.
        z: points, usually on ∂Ω.
        values: p and q there.
        tolerance: RMS error at which it stops.
        max_steps: most steps.
        on_step: called with the RMS error after each step.

    Returns:
        RMS error of p and q at the points.
    """
    linear = network.linearised(z)
    kernel = linear.kernel()
    residual = values - linear.value
    loss = residual.abs().square().mean(0)
    scale = kernel.diagonal(dim1=1, dim2=2).real.mean(1)
    damping = torch.full_like(scale, DAMPING)
    watch = Patience(float(loss.sum().sqrt()))
    for _ in range(max_steps):
        if is_out_of_time() or watch.is_over or watch.best <= tolerance:
            break
        u = damped_solution(kernel, damping * scale, residual.mT)
        before = parameters_of(network)
        add_changes(network, linear.pulled_back(u.mT))
        trial = (values - network.value(z).detach()).abs().square().mean(0)
        better = trial < loss
        restore_where(network, before, where=~better)
        damping = (damping * torch.where(better, LESS, MORE)).clamp(LEAST_DAMPING, MOST_DAMPING)
        if bool(better.any()):
            linear = network.linearised(z)
            kernel, residual = linear.kernel(), values - linear.value
            loss = residual.abs().square().mean(0)
            scale = kernel.diagonal(dim1=1, dim2=2).real.mean(1)
        watch.see(float(loss.sum().sqrt()))
        if on_step is not None:
            on_step(watch.last)
    return watch.last
