"""Training of complex-valued networks by the Levenberg-Marquardt method.

Distillation fits p and q to those of another surface. Polishing reduces the distance of the boundary from Γ. p and q
are holomorphic in the network's parameters, so their Jacobian J at m points is a complex matrix with m rows. A damped
step is Jᴴu with (J Jᴴ + μ)u the residual: m equations, whatever the number of parameters, see `Linearisation`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact

from spinor_geom.arrays import Place
from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import require_count, require_positive
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP, Linearisation, disk_around
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.curve_tensors import CurveTensors, normals_of
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network.discretisation import interpolate_matching
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.torch_extra import Tensor, torch
from spinor_geom.training.boundary import BoundaryNodes, MatchedBoundary, as_boundary_curve, diagonal_of, move_to
from spinor_geom.training.trained import Trained, TrainingStep

# initial damping relative to the mean diagonal entry of J Jᴴ, close to the solution and far from it, and least damping
_NEAR, _FAR, _LEAST_DAMPING = 1e-6, 1e-1, 1e-16
_LESS, _MORE = 0.2, 4.0  # factors of the damping after a good and a bad step
_PATIENCE, _GAIN = 12, 0.1  # the distance stagnates if this number of steps reduces it by less than this share
# points per node at which the distance is measured. Their number is doubled if the largest distance is more than this
# multiple of the largest one at the nodes
_POINTS_PER_NODE, _MOST_BETWEEN_NODES = 4, 3.0
_MOST_NODES = 512
# networks deeper than this that start from random parameters have the gain _RANDOM_GAIN/depth
_DEEP, _RANDOM_GAIN = 3, 8.0
# shares of the tolerance at which distillation (r is quadratic in p and q) and polishing stop
_DISTILLED, _POLISHED = 0.1, 0.2


@dataclass(frozen=True, kw_only=True)
class LevenbergMarquardt:
    """Second-order training of a `ComplexMLP`.

    Attributes:
        depth: number of hidden layers, 10 in the paper's network.
        width: units in each layer, 20 in the paper's network.
        activation: an entire function.
        seed: of the initial parameters.
        nodes: initial number of nodes on ∂Ω.
        tolerance: largest distance from Γ, in diagonals of its bounding box.
        distillation_steps: largest number of steps to fit p and q of a given surface.
        polishing_steps: largest number of steps to reduce the distance from Γ, for each number of nodes.
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
        require_count(depth=self.depth, width=self.width)
        require_count(8, nodes=self.nodes)
        require_count(0, distillation_steps=self.distillation_steps, polishing_steps=self.polishing_steps)
        require_positive("tolerance", self.tolerance, finite=False)

    def disk(
        self, curve: BoundaryCurve, *, start: PlateauSolution | None, device: str | torch.device, steps: Steps
    ) -> RouteResult:
        """A minimal disk over a curve at unit size, as of `plateau.options.Trainer`."""
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
    """A surface with a network for p and q and its boundary near a curve Γ, trained by Levenberg-Marquardt.

    Args:
        curve: Γ.
        start: a surface with a boundary near Γ. By default training starts from random parameters on the unit disk.
        matching: (n, 2), increasing pairs (t, s) of parameters of the ∂Ω of `start` and of Γ, by default s = t.
        options: of the network and the training.
        device: for the linear algebra and the returned surface.
        on_step: called after each step.

    Returns:
        The surface and its distance from Γ, measured at four points a node.

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
            gain=_RANDOM_GAIN / options.depth if start is None and options.depth > _DEEP else None,
            generator=torch.Generator().manual_seed(options.seed),
        ).to(self.device)
        # Γ is scaled to the size of Ω, so that p and q are of size 1
        self.diagonal = diagonal_of(curve)
        self.scale = self.domain.diameter / self.diagonal
        self.curve = CurveTensors.of(curve.placed(self.scale * curve.coefficients[-1], self.scale), Place(self.device))
        self.history: list[TrainingStep] = []

    def run(self, matching: Float[np.ndarray, "n 2"]) -> Trained:
        """Distils and polishes. Doubles the nodes while the distance from Γ is much larger between nodes."""
        count = self.options.nodes
        while True:
            nodes = BoundaryNodes.on(self.domain, count, self.device)
            slide = self._slide(matching, nodes)
            if self.start is not None:
                self._distil(nodes, self.start)
            elif count == self.options.nodes:
                self._polish(nodes, slide, held=True)
            before = len(self.history)
            boundary = self._polish(nodes, slide, held=False)
            polished = len(self.history) - before
            matching = np.column_stack([nodes.t.cpu().numpy(), boundary.slide.cpu().numpy()])
            misfit = self._misfit(matching, len(nodes.t))
            converged = misfit.max <= self.options.tolerance * self.domain.diameter
            larger_between = misfit.max > _MOST_BETWEEN_NODES * float(boundary.error.norm(dim=1).max())
            if converged or not larger_between or 2 * count > _MOST_NODES:
                break
            count *= 2
        to_space = torch.eye(2, dtype=torch.complex128, device=self.device) / self.scale**0.5
        surface = SpinorSurface(self.network, self.domain, spinor_map=to_space).to(self.device)
        move_to(surface, nodes.z, boundary.position / self.scale)
        return Trained(
            surface=surface,
            matching=matching,
            misfit=misfit.enlarged(1 / self.scale),
            diagonal=self.diagonal,
            history=tuple(self.history),
            status="converged" if converged else "stopped",
            reason=f"largest distance from the curve {misfit.max / self.domain.diameter:.1e} of its diagonal after "
            f"{len(self.history)} steps: {'within the tolerance' if converged else self._limit(polished)}",
            seconds=time.perf_counter() - self.begin,
        )

    def _limit(self, polished: int) -> str:
        """The reason why polishing ended after this number of steps, as the end of a sentence."""
        if is_out_of_time():
            return "the time limit was reached"
        if polished == self.options.polishing_steps:
            return f"the limit of {polished} polishing steps was reached"
        return "more steps do not reduce it; try a wider network or more nodes"

    def _distil(self, nodes: BoundaryNodes, start: SpinorSurface) -> None:
        values = torch.as_tensor(start.spinors(nodes.z.cpu().numpy()), device=self.device) * self.scale**0.5
        fit = Distillation(linear=self.network.linearised(nodes.z), values=values)
        tolerance = _DISTILLED * self.options.tolerance
        steps, record = self.options.distillation_steps, partial(self._record, "distillation")
        descend(self.network, nodes.z, fit, damping=_NEAR, tolerance=tolerance, max_steps=steps, on_step=record)

    def _polish(self, nodes: BoundaryNodes, slide: Float[Tensor, " n"], *, held: bool) -> MatchedBoundary:
        linear, damping = self.network.linearised(nodes.z), _FAR if held else _NEAR
        fit = Polish(linear=linear, nodes=nodes, curve=self.curve, slide=slide, held=held)
        tolerance = _POLISHED * self.options.tolerance * self.domain.diameter
        steps, record = self.options.polishing_steps, partial(self._record, "polishing")
        return descend(
            self.network, nodes.z, fit, damping=damping, tolerance=tolerance, max_steps=steps, on_step=record
        ).boundary

    def _slide(self, matching: Float[np.ndarray, "n 2"], nodes: BoundaryNodes) -> Float[Tensor, " k"]:
        return torch.as_tensor(interpolate_matching(matching, nodes.t.cpu().numpy()), device=self.device)

    def _misfit(self, matching: Float[np.ndarray, "n 2"], count: int) -> Misfit:
        """The distance of the boundary from Γ at points between the nodes."""
        dense = BoundaryNodes.on(self.domain, _POINTS_PER_NODE * count, self.device)
        with torch.no_grad():
            boundary = dense.matched(self.network.value(dense.z), self._slide(matching, dense), self.curve)
        return Misfit.of(boundary.position, boundary.slide, self.curve)

    def _record(self, method: Literal["distillation", "polishing"], loss: float) -> None:
        index, seconds = len(self.history) + 1, time.perf_counter() - self.begin
        loss = loss if method == "distillation" else loss / self.scale
        step = TrainingStep(index=index, method=method, loss=loss, boundary_error=None, seconds=seconds)
        self.history.append(step)
        if self.on_step is not None:
            self.on_step(step)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distillation:
    """The least-squares problem of fitting p and q to given values."""

    linear: Linearisation
    values: Complex[Tensor, "n 2"]

    def at(self, linear: Linearisation) -> Distillation:
        """The problem at other parameters. Losses are NaN if the network overflows."""
        return replace(self, linear=linear)

    @property
    def _residual(self) -> Complex[Tensor, "n 2"]:
        return self.values - self.linear.value

    @cached_property
    def losses(self) -> Float[Tensor, "2"]:
        """The mean squared errors of p and of q."""
        return self._residual.abs().square().mean(0)

    @cached_property
    def _kernel(self) -> Complex[Tensor, "2 n n"]:
        return self.linear.kernel()

    def step(self, damping: Float[Tensor, " k"]) -> Complex[Tensor, "n 2"]:
        """The v for which Jᴴ v is the damped step, by one system for p and one for q, NaN if it is indefinite."""
        return _damped_solution(self._kernel, damping, self._residual.mT).mT


@dataclass(frozen=True, kw_only=True, eq=False)
class Polish:
    """The least-squares problem of the distance between a surface's boundary and Γ.

    The residual of a node is its distance from the nearest point of Γ, in the two directions normal to Γ. With `held`,
    it is the distance from the point of Γ at the parameter in `slide`, in all three directions. Surfaces with random
    parameters, which are far from Γ, start in this way. The dual system is real.
    """

    linear: Linearisation
    nodes: BoundaryNodes
    curve: CurveTensors
    slide: Float[Tensor, " n"]
    held: bool

    def at(self, linear: Linearisation) -> Polish:
        """The problem at other parameters."""
        return replace(self, linear=linear, slide=self.boundary.slide)

    @cached_property
    def boundary(self) -> MatchedBoundary:
        """The boundary and the corresponding points of Γ."""
        return self.nodes.matched(self.linear.value, self.slide, self.curve, held=self.held)

    @property
    def losses(self) -> Float[Tensor, "1"]:
        """The mean squared distance."""
        return self.nodes.weights @ self.boundary.error.square().sum(1, keepdim=True)

    @cached_property
    def _system(self) -> tuple[Complex[Tensor, "2 m n"], Float[Tensor, "m m"], Float[Tensor, " m"]]:
        """Derivatives of the residuals in p and q at the nodes (real parts), the kernel, and the negative residuals."""
        nodes, (p, q) = self.nodes, self.linear.value.unbind(-1)
        # derivatives of φ dz/dt with respect to p and q
        by = torch.stack([torch.stack([2 * p, -2j * p, 2 * q], dim=-1), torch.stack([-2 * q, -2j * q, 2 * p], dim=-1)])
        by = by * nodes.dz[:, None]
        tangent = self.curve.point_and_derivative(self.boundary.slide)[1]
        directions = [*normals_of(tangent), *([torch.nn.functional.normalize(tangent, dim=1)] if self.held else [])]
        e = nodes.weights.sqrt()[:, None] * torch.stack(directions)
        # the mean of r is fixed by its constant
        mean_free = nodes.integral - nodes.weights @ nodes.integral
        rows = torch.einsum("aid,ij,kjd->kaij", e.to(by.dtype), mean_free.to(by.dtype), by).flatten(1, 2)
        kernel = (rows @ self.linear.kernel() @ rows.mH).real.sum(0)
        # translations are nearly free, since the constant is recomputed after each step
        e = e.flatten(0, 1)
        kernel = kernel + kernel.diagonal().mean() / e.square().sum(1).mean() * (e @ e.mT)
        return rows, kernel, -(e * self.boundary.error.repeat(len(directions), 1)).sum(1)

    def step(self, damping: Float[Tensor, " k"]) -> Complex[Tensor, "n 2"]:
        """The v for which Jᴴ v is the damped step, by one real system for p and q."""
        rows, kernel, right = self._system
        return (rows.mH @ _damped_solution(kernel, damping[0], right).to(rows.dtype)).mT


Fit = TypeVar("Fit", Distillation, Polish)


def descend(
    network: ComplexMLP,
    z: Complex[Tensor, " n"],
    fit: Fit,
    *,
    damping: float,
    tolerance: float,
    max_steps: int,
    on_step: Callable[[float], None] | None = None,
) -> Fit:
    """Solves a least-squares problem by damped steps of a network's parameters, which change in place.

    Returns the problem at the final parameters. The initial damping is relative to the mean diagonal entry of J Jᴴ.
    `on_step` receives the RMS residual after each step.
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
            # p, q, or both return to the parameters before the step
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
    """The root of the sum of the losses."""
    return float(fit.losses.sum().sqrt())


def _move(
    network: ComplexMLP, before: Sequence[Tensor], changes: Sequence[Tensor], *, where: Bool[Tensor, " k"]
) -> None:
    """Sets the parameters to `before`, plus the changes for p, q or both."""
    with torch.no_grad():
        for parameter, old, change in zip(network.parameters(), before, changes, strict=True):
            parameter.copy_(torch.where(where.reshape(-1, *[1] * (old.ndim - 1)), old + change, old))


def _damped_solution(
    kernel: Inexact[Tensor, "*batch n n"], damping: Float[Tensor, "*#batch"], right: Inexact[Tensor, "*batch n"]
) -> Tensor:
    """The solution of (kernel + μ) u = right, with μ the damping times the mean diagonal entry of the kernel."""
    share = damping * kernel.diagonal(dim1=-2, dim2=-1).real.mean(-1)
    damped = kernel + share[..., None, None] * torch.eye(kernel.shape[-1], dtype=kernel.dtype, device=kernel.device)
    factor, failed = torch.linalg.cholesky_ex(damped)
    solution = torch.cholesky_solve(right[..., None], factor)[..., 0]
    return torch.where(failed[..., None] == 0, solution, torch.nan)
