"""Levenberg-Marquardt for complex-valued networks: given p and q are distilled, then the distance from Γ is polished.

p and q are holomorphic in the network's parameters, so their Jacobian J at m points is an m × k complex matrix, k the
number of parameters. A damped step is Jᴴu with (J Jᴴ + μ)u the residual: the dual form, a system of m equations
however large the network is, in which J itself never appears; see `Linearisation`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP, Linearisation
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.plateau.network import interpolate_matching
from spinor_geom.plateau.threads import one_thread
from spinor_geom.plateau.training.boundary import BoundaryNodes, Placed, placed, with_constant
from spinor_geom.plateau.training.curve import ClosedCurve, CurveAsTensors
from spinor_geom.plateau.training.result import Status, Trained, TrainingStep
from spinor_geom.surface.spinor_surface import SpinorSurface

# damping at the start as a share of the mean diagonal entry of J Jᴴ, and its change after a good and a bad step
_DAMPING, _LESS, _MORE = 1e-6, 0.2, 4.0
# damping at the start from random parameters
_FAR_DAMPING = 1e-1
# least and largest damping as such shares: below it rounding decides, above it steps are no steps
_LEAST_DAMPING, _MOST_DAMPING = 1e-16, 1e4
# steps that together must lessen the loss by a share, else it stands still
_PATIENCE, _GAIN = 12, 0.1
# points between the nodes at which the distance is told, and how many times larger than at the nodes it may be
_POINTS_PER_NODE, _BETWEEN = 4, 3.0
_MOST_NODES = 512
# shares of the tolerance at which distillation (r is quadratic in p and q, so errors double) and polishing stop
_DISTILLED, _POLISHED = 0.1, 0.2


@dataclass(frozen=True, kw_only=True)
class LevenbergMarquardt:
    """Second-order training of a `ComplexMLP`.

    Attributes:
        depth: hidden layers; 10 for the paper's network.
        width: units in each; 20 for the paper's network.
        activation: an entire function.
        seed: of the network's first parameters.
        nodes: on ∂Ω at first; where the boundary leaves Γ between them they are doubled.
        tolerance: largest distance from Γ, in diagonals of its bounding box, at which training stops.
        distillation_steps: most steps towards given p and q.
        polishing_steps: most steps on the distance from Γ itself, for each number of nodes.
    """

    depth: int = 3
    width: int = 20
    activation: ActivationName = "exp"
    seed: int = 0
    nodes: int = 128
    tolerance: float = 1e-6
    distillation_steps: int = 100
    polishing_steps: int = 100

    def __post_init__(self) -> None:
        """Raises OptionError for values out of range."""
        if self.nodes < 8 or self.distillation_steps < 0 or self.polishing_steps < 0 or not self.tolerance > 0:
            raise OptionError(
                "nodes must be at least 8, numbers of steps not negative and the tolerance positive, got "
                f"{self.nodes}, {self.distillation_steps}, {self.polishing_steps} and {self.tolerance}"
            )


def train_by_levenberg_marquardt(
    curve: ClosedCurve,
    *,
    start: SpinorSurface | None = None,
    matching: Float[np.ndarray, "n 2"] | None = None,
    options: LevenbergMarquardt | None = None,
    device: str | torch.device = "cpu",
    on_step: Callable[[TrainingStep], None] | None = None,
) -> Trained:
    """A network whose surface has its boundary on Γ, from p and q of another surface or from random parameters.

    Args:
        curve: Γ.
        start: a surface near to the one that is sought; none starts from random parameters on the unit disk.
        matching: (n, 2), increasing pairs (t, s) of parameters of ∂Ω and of Γ for the start; none takes s = t.
        options: of the network and its training.
        device: where the linear algebra runs; the surface is returned there.
        on_step: called after each step.

    Returns:
        The surface, with its largest distance from Γ at four points a node.

    Source: Sun & Chern (2026) for the network; Levenberg (1944) and Marquardt (1963) for the steps.
    """
    with one_thread():
        training = _Training.of(curve, start, options or LevenbergMarquardt(), torch.device(device), on_step=on_step)
        pairs = np.array([[0.0, 0.0]]) if matching is None else np.asarray(matching)
        return training.run(start, pairs)


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
    damping = torch.full_like(scale, _DAMPING)
    watch = _Patience(float(loss.sum().sqrt()))
    for _ in range(max_steps):
        if watch.is_over or watch.best <= tolerance:
            break
        u = _solved(kernel, damping * scale, residual.mT)
        before = _parameters(network)
        _add(network, linear.pulled_back(u.mT))
        trial = (values - network.value(z).detach()).abs().square().mean(0)
        better = trial < loss
        _restore(network, before, where=~better)
        damping = (damping * torch.where(better, _LESS, _MORE)).clamp(_LEAST_DAMPING, _MOST_DAMPING)
        if bool(better.any()):
            linear = network.linearised(z)
            kernel, residual = linear.kernel(), values - linear.value
            loss = residual.abs().square().mean(0)
            scale = kernel.diagonal(dim1=1, dim2=2).real.mean(1)
        watch.see(float(loss.sum().sqrt()))
        if on_step is not None:
            on_step(watch.last)
    return watch.last


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
    damping, watch = _FAR_DAMPING if held else _DAMPING, _Patience(best.rms)
    both = torch.ones(2, dtype=torch.bool, device=slide.device)
    system: _NormalSystem | None = None
    for _ in range(max_steps):
        if watch.is_over or best.rms <= tolerance:
            break
        system = system or _NormalSystem.of(linear, nodes, best, curve, held=held)
        before = _parameters(network)
        _add(network, linear.pulled_back(system.step(damping)))
        trial_linear = network.linearised(nodes.z)
        trial = placed(nodes, trial_linear.value, best.slide, curve, held=held)
        if trial.rms < best.rms:
            linear, best, system = trial_linear, trial, None
            damping = max(damping * _LESS, _LEAST_DAMPING)
        else:
            _restore(network, before, where=both)
            damping = min(damping * _MORE, _MOST_DAMPING)
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
        u = _solved(self.kernel, damping * scale, self.right)
        return (self.rows.mH @ u.to(self.rows.dtype)).mT


class _Patience:
    """Whether a loss stands still: less than a share of gain in so many steps."""

    def __init__(self, loss: float) -> None:
        self.last = self.best = loss
        self._reference, self._since = loss, 0

    def see(self, loss: float) -> None:
        self.last, self.best = loss, min(self.best, loss)
        self._since += 1
        if self.best < (1 - _GAIN) * self._reference:
            self._reference, self._since = self.best, 0

    @property
    def is_over(self) -> bool:
        return self._since >= _PATIENCE


@dataclass(frozen=True, kw_only=True, eq=False)
class _Training:
    """One curve, its network, and the steps so far."""

    curve: CurveAsTensors  # at the scale of the network: p and q of size 1 whatever the size of Γ
    network: ComplexMLP
    domain: PlaneDomain
    options: LevenbergMarquardt
    device: torch.device
    on_step: Callable[[TrainingStep], None] | None
    begin: float
    history: list[TrainingStep] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        curve: ClosedCurve,
        start: SpinorSurface | None,
        options: LevenbergMarquardt,
        device: torch.device,
        *,
        on_step: Callable[[TrainingStep], None] | None,
    ) -> _Training:
        begin = time.perf_counter()
        domain = PlaneDomain.disk() if start is None else start.domain
        network = ComplexMLP.on(
            domain,
            depth=options.depth,
            width=options.width,
            activation=options.activation,
            generator=torch.Generator().manual_seed(options.seed),
            device=device,
        )
        own = CurveAsTensors.of(curve)
        return cls(
            curve=own.scaled(domain.diameter / own.diagonal),
            network=network,
            domain=domain,
            options=options,
            device=device,
            on_step=on_step,
            begin=begin,
        )

    def run(self, start: SpinorSurface | None, matching: Float[np.ndarray, "n 2"]) -> Trained:
        """Distils, polishes, and doubles the nodes while the boundary leaves Γ between them."""
        options, allowed = self.options, self.options.tolerance * self.curve.diagonal
        count = options.nodes
        while True:
            nodes = BoundaryNodes.on(self.domain, count, self.device)
            if start is not None:
                distil(
                    self.network,
                    nodes.z,
                    torch.as_tensor(start.spinors(nodes.z.cpu().numpy()), device=self.device) * self.curve.scale**0.5,
                    tolerance=_DISTILLED * options.tolerance,
                    max_steps=options.distillation_steps,
                    on_step=partial(self._hear, "distillation"),
                )
            slide = self._slide(matching, nodes)
            if start is None and count == options.nodes:
                polish(
                    self.network,
                    nodes,
                    slide,
                    self.curve,
                    tolerance=_POLISHED * allowed,
                    max_steps=options.polishing_steps,
                    held=True,
                    on_step=partial(self._hear, "polishing"),
                )
            near = polish(
                self.network,
                nodes,
                slide,
                self.curve,
                tolerance=_POLISHED * allowed,
                max_steps=options.polishing_steps,
                on_step=partial(self._hear, "polishing"),
            )
            matching = np.column_stack([nodes.t.cpu().numpy(), near.slide.cpu().numpy()])
            told = self._told(matching, count)
            swings = told.max > _BETWEEN * near.max
            if told.max <= allowed or not swings or 2 * count > _MOST_NODES:
                return self._trained(nodes, near, told, matching)
            count *= 2

    def _slide(self, matching: Float[np.ndarray, "n 2"], nodes: BoundaryNodes) -> Float[Tensor, " n"]:
        return torch.as_tensor(interpolate_matching(matching, nodes.t.cpu().numpy()), device=self.device)

    def _told(self, matching: Float[np.ndarray, "n 2"], count: int) -> Placed:
        """The boundary between the nodes."""
        dense = BoundaryNodes.on(self.domain, _POINTS_PER_NODE * count, self.device)
        with torch.no_grad():
            return placed(dense, self.network.value(dense.z), self._slide(matching, dense), self.curve)

    def _hear(self, method: Literal["distillation", "polishing"], loss: float) -> None:
        step = TrainingStep(
            index=len(self.history) + 1,
            method=method,
            loss=loss if method == "distillation" else loss / self.curve.scale,
            boundary_error=None,
            seconds=time.perf_counter() - self.begin,
        )
        self.history.append(step)
        if self.on_step is not None:
            self.on_step(step)

    def _trained(self, nodes: BoundaryNodes, near: Placed, told: Placed, matching: Float[np.ndarray, "n 2"]) -> Trained:
        scale = self.curve.scale
        to_space = torch.eye(2, dtype=torch.complex128, device=self.device) / scale**0.5
        surface = SpinorSurface(self.network, self.domain, spinor_map=to_space).to(self.device)
        with_constant(surface, nodes, near.position / scale)
        largest = told.max / self.curve.diagonal
        met = largest <= self.options.tolerance
        status: Status = "converged" if met else "stopped"
        limit = "within the tolerance" if met else "more steps help no more; a wider network, or other nodes, may"
        return Trained(
            surface=surface,
            matching=matching,
            rms=told.rms / scale,
            max=told.max / scale,
            diagonal=self.curve.diagonal / scale,
            history=tuple(self.history),
            status=status,
            reason=f"largest distance from the curve {largest:.1e} of its diagonal after {len(self.history)} steps: "
            f"{limit}",
            seconds=time.perf_counter() - self.begin,
        )


def _solved(
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


def _parameters(network: ComplexMLP) -> list[Tensor]:
    return [parameter.detach().clone() for parameter in (*network.weights, *network.biases)]


def _add(network: ComplexMLP, changes: Sequence[tuple[Tensor, Tensor]]) -> None:
    with torch.no_grad():
        for weight, bias, (by_weight, by_bias) in zip(network.weights, network.biases, changes, strict=True):
            weight.add_(by_weight)
            bias.add_(by_bias)


def _restore(network: ComplexMLP, before: Sequence[Tensor], where: Bool[Tensor, "2"]) -> None:
    """Takes back the changes of p, of q, or of both."""
    with torch.no_grad():
        for parameter, old in zip((*network.weights, *network.biases), before, strict=True):
            parameter.copy_(torch.where(where.reshape(-1, *[1] * (old.ndim - 1)), old, parameter))
