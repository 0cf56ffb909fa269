"""Plateau's problem for one loop, from the first fill to the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.discrete.minimal_surface import Disk, finer_disk, first_disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import DomainError, OptionError, SingularMatrixError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.corners import CornerPairs
from spinor_geom.plateau.gauss_newton import Fit, gauss_newton
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import Residual, independent_residual
from spinor_geom.plateau.solution import BoundaryResidual, Iteration, PlateauSolution
from spinor_geom.plateau.stability import assess_stability
from spinor_geom.plateau.start import lifted_spinors
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.spinor_surface import SpinorSurface

# Longer loops are thinned to this many points for the first fill, Ω and the poles; Γ still passes through all points.
_LONGEST_RIM = 240
_MAX_ROUNDS = 3
# A fit that is left farther from Γ than this, in mean edges, is tried again from a finer discrete disk.
_POOR = 1e-2
# Quadrature nodes on each piece of a path in Ω, times the number of rounds: each brings poles nearer to ∂Ω.
_PATH_ORDER = 16
# A round ends when a step gains less than this share of the squared residual; the last one goes on longer.
_STALL, _STALL_LAST = 0.2, 0.05
# The fit may go on to this share of the tolerance: while it converges fast, steps cost little and every digit is real.
_BELOW_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Cauchy:
    """Options of the Cauchy network.

    Attributes:
        degree: highest degree of the polynomials; loops of fewer than 20 points take less.
        pole_offset: distance of the poles from ∂Ω, in local edge lengths.
    """

    degree: int = 40
    pole_offset: float = 1.0

    def __post_init__(self) -> None:
        """Checks the options.

        Raises:
            OptionError: a negative degree or an offset that is not positive.
        """
        if self.degree < 1 or not self.pole_offset > 0:
            raise OptionError(f"a Cauchy network needs degree ≥ 1 and pole_offset > 0, got {self}")


def solve_plateau(
    loop: BoundaryLoop,
    *,
    model: Literal["cauchy"] | Cauchy = "cauchy",
    tolerance: float = 1e-3,
    max_iterations: int = 120,
    device: str | torch.device = "cpu",
    on_iteration: Callable[[Iteration], None] | None = None,
) -> PlateauSolution:
    """A minimal disk over a closed curve: exactly minimal, its boundary on Γ as nearly as the model allows.

    A discrete disk over the loop is flattened with its boundary lengths kept, which gives Ω; p and q start from the
    disk's frames along ∂Ω and are fitted by Gauss-Newton with the slide along Γ eliminated, in up to three rounds, each
    with more Cauchy units where the residual is. Γ is the cubic spline through all of the loop's points, with its
    corners kept.

    Args:
        loop: the curve, from a mesh or `BoundaryLoop.from_points`.
        model: "cauchy" for `Cauchy()`, or its options.
        tolerance: RMS distance of the surface's boundary from Γ, in mean loop edges, below which the result counts as
            converged.
        max_iterations: limit on Gauss-Newton steps in all.
        device: where the linear algebra runs; the surface is returned there.
        on_iteration: called after each step.

    Raises:
        OptionError: an unknown model or a value out of range.
        FirstFillError: no discrete disk over the loop was found.
        DomainError: no simple plane domain was found.
        SingularMatrixError: the loop crosses itself or runs along itself.

    Source: Sun & Chern (2026) for the representation.
    """
    options = Cauchy() if model == "cauchy" else model
    if not isinstance(options, Cauchy):
        raise OptionError(f"unknown model {model!r}; choose 'cauchy' or Cauchy(...)")
    if not tolerance > 0 or max_iterations < 1:
        raise OptionError(f"tolerance and max_iterations must be positive, got {tolerance} and {max_iterations}")
    place = torch.device(device)
    with one_thread():
        return _solve(loop, options, tolerance, max_iterations, place, on_iteration)


def _solve(
    loop: BoundaryLoop,
    options: Cauchy,
    tolerance: float,
    max_iterations: int,
    device: torch.device,
    on_iteration: Callable[[Iteration], None] | None,
) -> PlateauSolution:
    clock = _Clock()
    unit = _at_unit_size(loop)
    rim = _rim(unit)
    curve = BoundaryCurve.from_loop(unit)
    budget = _Budget(
        allowed=tolerance * unit.mean_edge_length, max_iterations=max_iterations, on_iteration=on_iteration
    )
    task = _Task(loop=unit, rim=rim, curve=curve, options=options, budget=budget, device=device, clock=clock)
    with clock.stage("first fill"):
        disk = first_disk(unit.points[rim])
    fitted = task.fitted_from(disk, ())
    poor = fitted.residual.rms > max(budget.allowed, _POOR * unit.mean_edge_length)
    if poor and len(fitted.history) < max_iterations:
        fitted = task.improved(fitted, disk)
    with clock.stage("surface"):
        surface = _surface(fitted, loop)
        area = surface.area()
    with clock.stage("stability"):
        stability = assess_stability(surface)
    residual = BoundaryResidual(
        rms=fitted.residual.rms * loop.diagonal,
        max=fitted.residual.max * loop.diagonal,
        mean_edge=loop.mean_edge_length,
        diagonal=loop.diagonal,
    )
    converged = residual.rms_per_edge <= tolerance
    return PlateauSolution(
        surface=surface,
        loop=loop,
        curve=BoundaryCurve.from_loop(loop),
        domain=fitted.stage.domain,
        matching=fitted.stage.matching(fitted.fit),
        boundary_residual=residual,
        area=area,
        history=fitted.history,
        timings=clock.seconds,
        tolerance=tolerance,
        converged=converged,
        reason=_reason(residual, tolerance, fitted, max_iterations),
        stability=stability,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """One loop at unit size, and how it is to be fitted."""

    loop: BoundaryLoop
    rim: Int[np.ndarray, " k"]
    curve: BoundaryCurve
    options: Cauchy
    budget: _Budget
    device: torch.device
    clock: _Clock

    def improved(self, fitted: _Fitted, disk: Disk) -> _Fitted:
        """The better of a fit and one that starts from a finer disk; the fit itself where that disk cannot be made."""
        try:
            with self.clock.stage("first fill"):
                finer = finer_disk(disk, len(self.rim))
            again = self.fitted_from(finer, fitted.history)
        except (DomainError, SingularMatrixError):  # what a second try fails at must not cost the first one's result
            return fitted
        best = again if again.residual.rms < fitted.residual.rms else fitted
        return replace(best, history=again.history)

    def fitted_from(self, disk: Disk, history: tuple[Iteration, ...]) -> _Fitted:
        """The fit that starts from a discrete disk: its flattening gives Ω, its frames p and q."""
        rim, curve, device = self.rim, self.curve, self.device
        with self.clock.stage("flattening"):
            flat = flatten(disk.vertices, disk.faces, len(rim))
            corners = self.loop.corners[rim]
            domain = PlaneDomain.from_boundary(flat.boundary, corners, flat.log_scale)
        with self.clock.stage("features"):
            pairs = CornerPairs(t=domain.boundary.parameters[:-1][corners], s=curve.breaks[rim[corners]])
            stage = Discretisation.first(
                domain,
                CurveTensors.of(curve, device),
                pairs,
                degree=self.options.degree,
                offset=self.options.pole_offset,
                turning=float(np.quantile(turning_angles(self.loop.points), 0.9)),
            )
        with self.clock.stage("fit"):
            spinors = lifted_spinors(disk.vertices, disk.faces, flat.boundary, device)
            edge = np.searchsorted(domain.boundary.parameters, stage.panels.t, side="right") - 1
            readout = stage.readout_of(spinors[torch.as_tensor(edge, device=device)])
            knots = np.append(curve.breaks[rim], curve.breaks[rim[0]] + 1)
            slide = torch.as_tensor(np.interp(stage.panels.t, domain.boundary.parameters, knots), device=device)
            return _fit_and_refine(
                stage,
                readout,
                slide,
                self.budget,
                history,
                points=len(self.loop),
                offset=self.options.pole_offset,
            )


class _Clock:
    """Wall time of named stages; a stage that comes again adds up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def _at_unit_size(loop: BoundaryLoop) -> BoundaryLoop:
    """The loop with its centroid at 0 and diagonal 1, where every tolerance is a ratio."""
    return BoundaryLoop(
        points=(loop.points - loop.centroid) / loop.diagonal, vertex_ids=loop.vertex_ids, corners=loop.corners
    )


def _rim(loop: BoundaryLoop) -> Int[np.ndarray, " k"]:
    """Indices of the points that stand for the loop in the first fill, in Ω and for the poles; corners stay."""
    if len(loop) <= _LONGEST_RIM:
        return np.arange(len(loop))
    along = np.concatenate([[0.0], np.cumsum(loop.edge_lengths)[:-1]])
    wanted = np.searchsorted(along, np.arange(_LONGEST_RIM) * (loop.perimeter / _LONGEST_RIM))
    return np.unique(np.concatenate([[0], wanted.clip(0, len(loop) - 1), np.flatnonzero(loop.corners)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fitted:
    """The best round: its discretisation, its fit, its residual at unit size, its number, and the steps of all."""

    stage: Discretisation
    fit: Fit
    residual: Residual
    rounds: int
    history: tuple[Iteration, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Budget:
    """What a fit may cost: residual that is allowed at unit size, steps, and who hears of them."""

    allowed: float
    max_iterations: int
    on_iteration: Callable[[Iteration], None] | None

    def fit(
        self,
        stage: Discretisation,
        readout: Complex[Tensor, "n 2"],
        slide: Float[Tensor, " nodes"],
        history: tuple[Iteration, ...],
        *,
        stall: float,
    ) -> Fit:
        return gauss_newton(
            stage.problem,
            readout,
            slide,
            goal=_BELOW_TOLERANCE * self.allowed,
            allowed=self.allowed,
            max_iterations=self.max_iterations - len(history),
            stall=stall,
            first_index=len(history) + 1,
            on_iteration=self.on_iteration,
        )


def _fit_and_refine(
    stage: Discretisation,
    readout: Complex[Tensor, "n 2"],
    slide: Float[Tensor, " nodes"],
    budget: _Budget,
    history: tuple[Iteration, ...],
    *,
    points: int,
    offset: float,
) -> _Fitted:
    """Rounds of Gauss-Newton, each with more units where the residual of the last one was."""
    best: _Fitted | None = None
    for remaining in reversed(range(_MAX_ROUNDS)):
        fit = budget.fit(stage, readout, slide, history, stall=_STALL if remaining else _STALL_LAST)
        history += fit.history
        if best is None and fit.residual > budget.allowed and stage.has_moduli:
            corrected, again, history = _with_right_moduli(stage, readout, slide, history, budget, offset=offset)
            if again.residual < fit.residual:
                stage, fit = corrected, again
        residual = independent_residual(stage, fit, points=points)
        if best is not None and residual.rms >= best.residual.rms:
            return replace(best, history=history)
        best = _Fitted(stage=stage, fit=fit, residual=residual, rounds=_MAX_ROUNDS - remaining, history=history)
        if residual.rms <= budget.allowed or len(history) >= budget.max_iterations:
            break
        finer = stage.refined(residual.energy, budget.allowed)
        if finer is None:
            break
        readout, slide = finer.transferred(stage, fit)
        stage = finer
    assert best is not None
    return best


def _with_right_moduli(
    stage: Discretisation,
    readout: Complex[Tensor, "n 2"],
    slide: Float[Tensor, " nodes"],
    history: tuple[Iteration, ...],
    budget: _Budget,
    *,
    offset: float,
) -> tuple[Discretisation, Fit, tuple[Iteration, ...]]:
    """A fit in which Ω may move, so that its corners can meet Γ's; the moves are made, and it is fitted again."""
    last = np.inf
    while True:
        fit = budget.fit(stage.flexible(), readout, slide, history, stall=_STALL)
        history += fit.history
        if fit.residual > last / 2 or len(history) >= budget.max_iterations:
            break
        last = fit.residual
        try:
            moved = stage.moved(fit, offset=offset)
        except DomainError:  # the move would fold Ω: what is fitted so far stands
            break
        readout, slide = moved.transferred(stage, fit)
        stage = moved
    fit = budget.fit(stage, fit.readout, fit.slide, history, stall=_STALL)
    return stage, fit, history + fit.history


def _surface(fitted: _Fitted, loop: BoundaryLoop) -> SpinorSurface:
    """The fitted surface in the loop's coordinates."""
    stage, fit = fitted.stage, fitted.fit
    network, device = stage.network, fit.readout.device
    with torch.no_grad():
        network.readout.copy_(fit.readout * loop.diagonal**0.5)
    surface = SpinorSurface(network, stage.domain, order=_PATH_ORDER * fitted.rounds).to(device)
    # the fit counts positions from the boundary, the surface from its root: compare them at a few boundary points
    some = torch.arange(0, len(stage.panels.t), max(1, len(stage.panels.t) // 16), device=device)
    boundary = (stage.problem.positions(fit.readout) + fit.constant)[some] * loop.diagonal
    with torch.no_grad():
        offset = boundary - surface.position(torch.as_tensor(stage.panels.z, device=device)[some])
        # the median: at a point right beside a pole the path integral has fewer digits
        surface.constant.copy_(offset.median(0).values + torch.as_tensor(loop.centroid, device=device))
    return surface


def _reason(residual: BoundaryResidual, tolerance: float, fitted: _Fitted, max_iterations: int) -> str:
    steps = f"after {len(fitted.history)} Gauss-Newton steps"
    if residual.rms_per_edge <= tolerance:
        return f"residual {residual.rms_per_edge:.1e} of the mean edge {steps}"
    cause = (
        "the limit on steps was reached"
        if len(fitted.history) >= max_iterations
        else f"a network of {fitted.stage.network.mixing.shape[1]} features follows the boundary no better"
    )
    return (
        f"residual {residual.rms_per_edge:.1e} of the mean edge {steps}, above the tolerance {tolerance:.1e}: {cause}"
    )
