"""The distance of a network's surface from Γ, lessened by its own parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.holomorphic.mlp import ComplexMLP, Linearisation
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.training.boundary import BoundaryNodes, Placed, placed
from spinor_geom.training.curve import CurveAsTensors
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

# damping at the start from random parameters
_FAR_DAMPING = 1e-1


def polish(
    network: ComplexMLP,
    nodes: BoundaryNodes,
    slide: Float[Tensor, " n"],
    curve: CurveAsTensors,
    *,
    tolerance: float,
    max_steps: int,
    held: bool = False,
    on_step: Callable[[float], None] | None = None,
) -> Placed:
    """Brings the boundary of a network's surface nearer to Γ, in place, the slide along Γ eliminated.

    The distance of a node from Γ counts only in the two directions normal to Γ; after each step the node's point of Γ
    is the nearest one. The real parts of complex rows make a real dual system of two equations a node.

    Args:
        network: where it starts.
        nodes: on ∂Ω.
        slide: parameter of the point of Γ near each node.
        curve: Γ.
        tolerance: RMS distance at which it stops.
        max_steps: most steps.
        held: keep the slide, and count the distance from its points in all directions: the way from random parameters,
            whose surface is far from Γ everywhere.
        on_step: called with the RMS distance after each step.

    Returns:
        The boundary where it was left.
    """
    linear = network.linearised(nodes.z)
    best = placed(nodes, linear.value, slide, curve, held=held)
    damping, watch = _FAR_DAMPING if held else DAMPING, Patience(best.rms)
    both = torch.ones(2, dtype=torch.bool, device=slide.device)
    system: _NormalSystem | None = None
    for _ in range(max_steps):
        if is_out_of_time() or watch.is_over or best.rms <= tolerance:
            break
        system = system or _NormalSystem.of(linear, nodes, best, curve, held=held)
        before = parameters_of(network)
        add_changes(network, linear.pulled_back(system.step(damping)))
        trial_linear = network.linearised(nodes.z)
        # a step that is far too long overflows: there is no point of Γ near it
        finite = bool(trial_linear.value.isfinite().all())
        trial = placed(nodes, trial_linear.value, best.slide, curve, held=held) if finite else None
        if trial is not None and trial.rms < best.rms:
            linear, best, system = trial_linear, trial, None
            damping = max(damping * LESS, LEAST_DAMPING)
        else:
            restore_where(network, before, where=both)
            damping = min(damping * MORE, MOST_DAMPING)
        watch.see(best.rms)
        if on_step is not None:
            on_step(best.rms)
    return best


@dataclass(frozen=True, kw_only=True, eq=False)
class _NormalSystem:
    """The distances normal to Γ (or in all directions), linearised: 2n (or 3n) real equations in dual form."""

    rows: Complex[Tensor, "2 m n"]  # derivative by p and by q at the nodes; its real part counts
    kernel: Float[Tensor, "m m"]
    right: Float[Tensor, " m"]

    @classmethod
    def of(
        cls, linear: Linearisation, nodes: BoundaryNodes, near: Placed, curve: CurveAsTensors, *, held: bool
    ) -> _NormalSystem:
        p, q = linear.value.unbind(-1)
        # φ by p and by q, along the path
        by = torch.stack([torch.stack([2 * p, -2j * p, 2 * q], dim=-1), torch.stack([-2 * q, -2j * q, 2 * p], dim=-1)])
        by = by * nodes.dz[:, None]
        _, tangent = curve.point_and_derivative(near.slide)
        root = nodes.weights.sqrt()[:, None]
        # the constant of r follows the mean
        mean_free = nodes.integral - nodes.weights @ nodes.integral
        directions = [root * normal for normal in normals_of(tangent)]
        if held:
            directions.append(root * torch.nn.functional.normalize(tangent, dim=1))
        rows, right = [], []
        for e in directions:
            rows.append(torch.einsum("id,ij,kjd->kij", e.to(by.dtype), mean_free.to(by.dtype), by))
            right.append((e * near.error).sum(1))
        matrix = torch.cat(rows, dim=1)
        kernel = (matrix @ linear.kernel() @ matrix.mH).real.sum(0)
        # what a constant can do is nearly free: it is found anew after each step
        e = torch.cat(directions)
        kernel = kernel + kernel.diagonal().mean() / e.square().sum(1).mean() * (e @ e.T)
        return cls(rows=matrix, kernel=kernel, right=-torch.cat(right))

    def step(self, damping: float) -> Complex[Tensor, "n 2"]:
        """The v whose Jᴴ v is the change of the parameters."""
        scale = self.kernel.diagonal().mean()
        u = damped_solution(self.kernel, damping * scale, self.right)
        return (self.rows.mH @ u.to(self.rows.dtype)).mT
