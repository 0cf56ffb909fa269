"""Levenberg-Marquardt for complex-valued networks: p and q are distilled, then the distance from Γ is polished.

p and q are holomorphic in the network's parameters, so their Jacobian J at m points is an m × k complex matrix, k the
number of parameters. A damped step is Jᴴu with (J Jᴴ + μ)u the residual: the dual form, a system of m equations
however large the network is, in which J itself never appears; see `Linearisation`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar, Literal, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Inexact
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP, Linearisation, disk_around
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network.discretisation import interpolate_matching
from spinor_geom.plateau.network.gauss_newton import normals_of
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.training.boundary import BoundaryNodes, Placed, as_boundary_curve, diagonal_of, move_to
from spinor_geom.training.result import Trained, TrainingStep

# damping at the start, as a share of the mean diagonal entry of J Jᴴ: near to what is sought, and from random numbers
_NEAR, _FAR = 1e-6, 1e-1
# points between the nodes at which the distance is told, and how many times larger than at the nodes it may be
_POINTS_PER_NODE, _BETWEEN = 4, 3.0
_MOST_NODES = 512
# deeper networks that start from random parameters are calmer at first: their gain is this over the depth
_DEEP, _GAIN_ALONE = 3, 8.0
# shares of the tolerance at which distillation (r is quadratic in p and q, so errors double) and polishing stop
_DISTILLED, _POLISHED = 0.1, 0.2
_LESS, _MORE = 0.2, 4.0  # change of the damping after a good and a bad step
_LEAST_DAMPING = 1e-16  # as a share like those at the start: below it rounding decides
_PATIENCE, _GAIN = 12, 0.1  # so many steps have to lessen the distance by a tenth together, else it stands still


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
    takes_start: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Raises OptionError for values out of range."""
        if self.nodes < 8 or self.distillation_steps < 0 or self.polishing_steps < 0 or not self.tolerance > 0:
            raise OptionError(
                "nodes must be at least 8, numbers of steps not negative and the tolerance positive, got "
                f"{self.nodes}, {self.distillation_steps}, {self.polishing_steps} and {self.tolerance}"
            )

    def disk(
        self, curve: BoundaryCurve, *, start: PlateauSolution | None, device: torch.device, steps: Steps
    ) -> RouteResult:
        """A minimal disk over a curve at unit size; see `plateau.options.Trainer`."""
        unit = None
        if start is not None:
            loop = start.loop
            unit = start.surface.transform(scale=1 / loop.diagonal, translation=-loop.centroid / loop.diagonal)
        trained = train_by_levenberg_marquardt(
            curve,
            start=unit,
            matching=None if start is None else start.matching,
            options=self,
            device=device,
            on_step=lambda step: steps.take(step.method, step.loss),
        )
        return trained.as_disk(curve)


def train_by_levenberg_marquardt(
    curve: BoundaryCurve | ClosedCurve,
    *,
    start: SpinorSurface | None = None,
    matching: Float[np.ndarray, "n 2"] | None = None,
    options: LevenbergMarquardt | None = None,
    device: str | torch.device = "cpu",
    on_step: Callable[[TrainingStep], None] | None = None,
) -> Trained:
    """A network whose surface has its boundary on a curve Γ, from p and q of another one or from random parameters.

    The start is a surface near to the one that is sought, with a matching, (n, 2), increasing pairs (t, s) of
    parameters of its ∂Ω and of Γ, or s = t; without a start parameters are random, on the unit disk. The surface is
    returned on the device that the linear algebra runs on; `on_step` is called after each step.

    Returns:
        The surface, with its largest distance from Γ at four points a node; pieces of Γ that it passes over count.

    Raises:
        CurveError: the formulas are not those of a smooth closed curve.

    Source: Sun & Chern (2026) for the network; Levenberg (1944) and Marquardt (1963) for the steps.
    """
    with one_thread():
        training = _Training(as_boundary_curve(curve), start, options or LevenbergMarquardt(), device, on_step)
        return training.run(np.zeros((1, 2)) if matching is None else np.asarray(matching))


class _Training:
    def __init__(
        self,
        curve: BoundaryCurve,
        start: SpinorSurface | None,
        options: LevenbergMarquardt,
        device: str | torch.device,
        on_step: Callable[[TrainingStep], None] | None,
    ) -> None:
        self.begin = time.perf_counter()
        self.start, self.options, self.on_step = start, options, on_step
        self.device = torch.device(device)
        self.domain = PlaneDomain.disk() if start is None else start.domain
        center, radius = disk_around(self.domain)
        self.network = ComplexMLP(
            center=center,
            radius=radius,
            depth=options.depth,
            width=options.width,
            activation=options.activation,
            gain=_GAIN_ALONE / options.depth if start is None and options.depth > _DEEP else None,
            generator=torch.Generator().manual_seed(options.seed),
        ).to(self.device)
        # Γ at the size of Ω: p and q of size 1 whatever its own size
        self.diagonal = diagonal_of(curve)
        self.scale = self.domain.diameter / self.diagonal
        self.curve = CurveTensors.of(curve.placed(self.scale * curve.coefficients[-1], self.scale), self.device)
        self.history: list[TrainingStep] = []

    def run(self, matching: Float[np.ndarray, "n 2"]) -> Trained:
        """Distils, polishes, and doubles the nodes while the boundary leaves Γ between them."""
        count = self.options.nodes
        while True:
            nodes = BoundaryNodes.on(self.domain, count, self.device)
            slide = self._slide(matching, nodes)
            if self.start is not None:
                self._distil(nodes, self.start)
            elif count == self.options.nodes:
                self._polish(nodes, slide, held=True)
            near = self._polish(nodes, slide, held=False).near
            matching = np.column_stack([nodes.t.cpu().numpy(), near.slide.cpu().numpy()])
            misfit = self._misfit(matching, len(nodes.t))
            met = misfit.max <= self.options.tolerance * self.domain.diameter
            swings = misfit.max > _BETWEEN * float(near.error.norm(dim=1).max())
            if met or not swings or 2 * count > _MOST_NODES:
                break
            count *= 2
        to_space = torch.eye(2, dtype=torch.complex128, device=self.device) / self.scale**0.5
        surface = SpinorSurface(self.network, self.domain, spinor_map=to_space).to(self.device)
        move_to(surface, nodes.z, near.position / self.scale)
        limit = "within the tolerance" if met else "more steps help no more; a wider network, or other nodes, may"
        return Trained(
            surface=surface,
            matching=matching,
            misfit=misfit.enlarged(1 / self.scale),
            diagonal=self.diagonal,
            history=tuple(self.history),
            status="converged" if met else "stopped",
            reason=f"largest distance from the curve {misfit.max / self.domain.diameter:.1e} of its diagonal after "
            f"{len(self.history)} steps: {limit}",
            seconds=time.perf_counter() - self.begin,
        )

    def _distil(self, nodes: BoundaryNodes, start: SpinorSurface) -> None:
        values = torch.as_tensor(start.spinors(nodes.z.cpu().numpy()), device=self.device) * self.scale**0.5
        descend(
            self.network,
            nodes.z,
            Distillation(linear=self.network.linearised(nodes.z), values=values),
            damping=_NEAR,
            tolerance=_DISTILLED * self.options.tolerance,
            max_steps=self.options.distillation_steps,
            on_step=partial(self._hear, "distillation"),
        )

    def _polish(self, nodes: BoundaryNodes, slide: Float[Tensor, " n"], *, held: bool) -> Polish:
        linear = self.network.linearised(nodes.z)
        return descend(
            self.network,
            nodes.z,
            Polish(linear=linear, nodes=nodes, curve=self.curve, slide=slide, held=held),
            damping=_FAR if held else _NEAR,
            tolerance=_POLISHED * self.options.tolerance * self.domain.diameter,
            max_steps=self.options.polishing_steps,
            on_step=partial(self._hear, "polishing"),
        )

    def _slide(self, matching: Float[np.ndarray, "n 2"], nodes: BoundaryNodes) -> Float[Tensor, " n"]:
        return torch.as_tensor(interpolate_matching(matching, nodes.t.cpu().numpy()), device=self.device)

    def _misfit(self, matching: Float[np.ndarray, "n 2"], count: int) -> Misfit:
        """The distance between the nodes, both ways: what of Γ the boundary passes over counts too."""
        dense = BoundaryNodes.on(self.domain, _POINTS_PER_NODE * count, self.device)
        with torch.no_grad():
            near = dense.placed(self.network.value(dense.z), self._slide(matching, dense), self.curve)
        return Misfit.of(near.position, near.slide, self.curve)

    def _hear(self, method: Literal["distillation", "polishing"], loss: float) -> None:
        index, seconds = len(self.history) + 1, time.perf_counter() - self.begin
        loss = loss if method == "distillation" else loss / self.scale
        step = TrainingStep(index=index, method=method, loss=loss, boundary_error=None, seconds=seconds)
        self.history.append(step)
        if self.on_step is not None:
            self.on_step(step)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distillation:
    """The distance of the network's p and q from given ones."""

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

    The distance of a node counts only in the two directions normal to Γ, and the node's point of Γ is the nearest one,
    looked for from the slide on. Where the slide is `held` the distance from its points counts in all directions: the
    way from random parameters, whose surface is far from Γ everywhere. The real parts of complex rows make a real dual
    system of two equations a node.
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
        return self.nodes.placed(self.linear.value, self.slide, self.curve, held=self.held)

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
    """Lessens a distance by damped steps of a network's parameters, in place, and returns it where it was left.

    The damping is that at the start, as a share of the mean diagonal entry of J Jᴴ; `on_step` is called with the
    distance after each step.
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
    kernel: Inexact[Tensor, "*batch n n"], damping: Float[Tensor, "*#batch"], right: Inexact[Tensor, "*batch n"]
) -> Tensor:
    """The solution of (kernel + μ) u = right, μ the damping as a share of the kernel's mean diagonal entry."""
    share = damping * kernel.diagonal(dim1=-2, dim2=-1).real.mean(-1)
    damped = kernel + share[..., None, None] * torch.eye(kernel.shape[-1], dtype=kernel.dtype, device=kernel.device)
    factor, failed = torch.linalg.cholesky_ex(damped)
    solution = torch.cholesky_solve(right[..., None], factor)[..., 0]
    return torch.where(failed[..., None] == 0, solution, torch.nan)
