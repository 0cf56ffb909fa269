"""Levenberg-Marquardt for complex-valued networks: p and q are distilled, then the distance from Γ is polished."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network import interpolate_matching
from spinor_geom.plateau.solution import Iteration, PlateauSolution
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.training.boundary import BoundaryNodes, Placed, placed, with_constant
from spinor_geom.training.curve import ClosedCurve, CurveAsTensors
from spinor_geom.training.distillation import distil
from spinor_geom.training.polishing import polish
from spinor_geom.training.result import Status, Trained, TrainingStep, continuing

# points between the nodes at which the distance is told, and how many times larger than at the nodes it may be
_POINTS_PER_NODE, _BETWEEN = 4, 3.0
_MOST_NODES = 512
# deeper networks that start from random parameters are calmer at first: their gain is this over the depth
_DEEP, _GAIN_ALONE = 3, 8.0
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
    takes_start: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Raises OptionError for values out of range."""
        if self.nodes < 8 or self.distillation_steps < 0 or self.polishing_steps < 0 or not self.tolerance > 0:
            raise OptionError(
                "nodes must be at least 8, numbers of steps not negative and the tolerance positive, got "
                f"{self.nodes}, {self.distillation_steps}, {self.polishing_steps} and {self.tolerance}"
            )

    def disk(
        self,
        curve: BoundaryCurve,
        *,
        start: PlateauSolution | None,
        device: torch.device,
        on_iteration: Callable[[Iteration], None] | None,
    ) -> Found:
        """A minimal disk over a curve at unit size; see `plateau.trained_route.Trainer`."""
        history = [] if start is None else list(start.history)
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
            on_step=continuing(history, on_iteration),
        )
        return trained.as_disk(curve, history)


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
        The surface, with its largest distance from Γ at four points a node; pieces of Γ that it passes over count.

    Source: Sun & Chern (2026) for the network; Levenberg (1944) and Marquardt (1963) for the steps.
    """
    with one_thread():
        training = _Training.of(curve, start, options or LevenbergMarquardt(), torch.device(device), on_step=on_step)
        pairs = np.array([[0.0, 0.0]]) if matching is None else np.asarray(matching)
        return training.run(start, pairs)


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
            gain=_GAIN_ALONE / options.depth if start is None and options.depth > _DEEP else None,
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
            told = self._told(matching, len(nodes.t))
            swings = told.max > _BETWEEN * near.max
            if told.max <= allowed or not swings or 2 * count > _MOST_NODES:
                return self._trained(nodes, near, told, matching)
            count *= 2

    def _slide(self, matching: Float[np.ndarray, "n 2"], nodes: BoundaryNodes) -> Float[Tensor, " n"]:
        return torch.as_tensor(interpolate_matching(matching, nodes.t.cpu().numpy()), device=self.device)

    def _told(self, matching: Float[np.ndarray, "n 2"], count: int) -> Misfit:
        """The boundary between the nodes, both ways: what of Γ it passes over counts too."""
        dense = BoundaryNodes.on(self.domain, _POINTS_PER_NODE * count, self.device)
        with torch.no_grad():
            near = placed(dense, self.network.value(dense.z), self._slide(matching, dense), self.curve)
        return Misfit.of(near.position, near.slide, self.curve)

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

    def _trained(self, nodes: BoundaryNodes, near: Placed, told: Misfit, matching: Float[np.ndarray, "n 2"]) -> Trained:
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
            misfit=told.enlarged(1 / scale),
            diagonal=self.curve.diagonal / scale,
            history=tuple(self.history),
            status=status,
            reason=f"largest distance from the curve {largest:.1e} of its diagonal after {len(self.history)} steps: "
            f"{limit}",
            seconds=time.perf_counter() - self.begin,
        )
