"""The paper's training: Algorithm 1, alternating RMSprop on the surface and on the homeomorphism of its boundary."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import RuleName, rule
from spinor_geom.errors import OptionError, StorageError
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import Iteration, PlateauSolution
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface
from spinor_geom.training.checkpoint import read_checkpoint, write_checkpoint
from spinor_geom.training.curve import ClosedCurve, CurveAsTensors
from spinor_geom.training.homeomorphism import CircleHomeomorphism
from spinor_geom.training.losses import boundary_loss
from spinor_geom.training.rays import FORMS, RayBoundary
from spinor_geom.training.result import Status, Trained, TrainingStep, continuing

# a loss so many times that of the first epoch is no training any more
_GROWTH = 1e3
# an epoch helps where its loss is below the best by this share
_GAIN = 1e-3
# points of ∂Ω and of Γ between which the boundary error is measured
_BOUNDARY_POINTS, _CURVE_POINTS = 512, 8192
# its rates suit curves of the paper's size: a solver's Γ gets the diagonal of the unit circle's bounding box
_DIAGONAL = 2 * math.sqrt(2)
_DTYPES = {"double": torch.complex128, "single": torch.complex64}
# points of the curve that its centre is taken from
_CENTER_POINTS = 1024
# points by which a checkpoint knows its curve, and the largest distance, in diagonals, between those of the same one
_COMPARED_POINTS, _SAME_CURVE = 32, 1e-9
# options that a checkpoint goes on from whatever they were
_FREE = ("epochs", "patience", "checkpoint", "checkpoint_every")


@dataclass(frozen=True, kw_only=True)
class RMSprop:
    """The paper's training; its settings are the defaults.

    Attributes:
        representation: "spinor" for p and q; "weierstrass-enneper" for f and g, the paper's baseline.
        depth: hidden layers of each of the two networks.
        width: units in each.
        activation: an entire function.
        gain: of the networks' start, see `ComplexMLP`; the paper does not say how it starts.
        learning_rate: of RMSprop.
        batch: samples of [0, 1] in each update.
        points: samples drawn for each epoch, anew for the surface and for the homeomorphism.
        epochs: most of them; the paper takes 800, and 2,000 and 4,000 for prescribed surfaces.
        tangent_weight: λ.
        quadrature: rule on the ray from 0 to a point.
        order: its intervals ("trapezoid", "simpson") or nodes ("gauss").
        homeomorphism: what ρ parametrises: "inverse", Γ's parameter to that of ∂Ω, which needs no derivative of Γ (its
            own inverse is found by bisection), or "direct", that of ∂Ω to Γ's, for a differentiable Γ.
        patience: epochs without a better loss after which training stops; none never stops early.
        precision: of the networks' parameters.
        seed: of all random numbers.
        checkpoint: file that holds the state; where it exists training goes on from there, on a CPU bit for bit as if
            it had never stopped.
        checkpoint_every: epochs between two writes of it; the last one is written too.
    """

    representation: Literal["spinor", "weierstrass-enneper"] = "spinor"
    depth: int = 10
    width: int = 20
    activation: ActivationName = "exp"
    gain: float = 0.5
    learning_rate: float = 1e-5
    batch: int = 128
    points: int = 1024
    epochs: int = 800
    tangent_weight: float = 0.5
    quadrature: RuleName = "trapezoid"
    order: int = 100
    homeomorphism: Literal["inverse", "direct"] = "inverse"
    patience: int | None = None
    precision: Literal["double", "single"] = "double"
    seed: int = 0
    checkpoint: str | os.PathLike[str] | None = None
    checkpoint_every: int = 10
    takes_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Raises OptionError for values out of range."""
        rule(self.quadrature, self.order)
        patience = 1 if self.patience is None else self.patience
        if min(self.batch, self.epochs, patience, self.checkpoint_every) < 1 or self.points < self.batch:
            raise OptionError(
                "batch, epochs, patience and checkpoint_every must be at least 1, and points at least one batch, got "
                f"{self.batch}, {self.epochs}, {self.patience}, {self.checkpoint_every} and {self.points}"
            )
        if not self.learning_rate > 0 or not self.tangent_weight >= 0:
            raise OptionError(
                f"the learning rate must be positive and the tangents' weight not negative, got {self.learning_rate} "
                f"and {self.tangent_weight}"
            )
        for name, value, choices in (
            ("representation", self.representation, FORMS),
            ("homeomorphism", self.homeomorphism, ("inverse", "direct")),
            ("precision", self.precision, _DTYPES),
        ):
            if value not in choices:
                raise OptionError(f"unknown {name} {value!r}; choose one of: {', '.join(choices)}")

    def disk(
        self,
        curve: BoundaryCurve,
        *,
        start: PlateauSolution | None,
        device: torch.device,
        on_iteration: Callable[[Iteration], None] | None,
    ) -> Found:
        """A minimal disk over a curve at unit size, from random parameters; see `plateau.trained_route.Trainer`."""
        assert start is None
        history: list[Iteration] = []
        larger = curve.placed(_DIAGONAL * curve.coefficients[-1], _DIAGONAL)
        trained = train_by_rmsprop(larger, options=self, device=device, on_epoch=continuing(history, on_iteration))
        return trained.as_disk(curve, history, scale=1 / _DIAGONAL)


def train_by_rmsprop(
    curve: ClosedCurve,
    *,
    options: RMSprop | None = None,
    device: str | torch.device = "cpu",
    on_epoch: Callable[[TrainingStep], None] | None = None,
) -> Trained:
    """A minimal surface over the unit disk whose boundary comes near to Γ, by the paper's Algorithm 1.

    Each epoch draws samples of [0, 1] and goes through them in batches. For each batch the surface's networks and the
    constant c take one step of RMSprop on the loss between r(e^{2πit}) and Γ(Φ(t)), then the homeomorphism on that
    between r(e^{2πiΦ⁻¹(t)}) and Γ(t) (or on the same as before where ρ parametrises Φ itself). c starts at the centre
    of Γ. The paper's learning rate moves each parameter by a few hundredths in 800 epochs: with a curve far from size 1
    or off the origin the other settings have to follow.

    Args:
        curve: Γ; Γ′ is needed for tangents, Γ″ only where ρ parametrises Φ and tangents count.
        options: of the training.
        device: where it runs.
        on_epoch: called after each epoch.

    Returns:
        The surface (a `WeierstrassSurface` for the baseline) and what every epoch did; losses that are infinite, NaN or
        grow without end are a `status`, not an error.

    Raises:
        StorageError: the checkpoint cannot be read, or is of a training with other options or on another curve.

    Source: Sun & Chern (2026), Algorithm 1.
    """
    training = _Training.of(curve, options or RMSprop(), torch.device(device))
    if training.path is not None and training.path.exists():
        training.restore(training.path)
    return training.run(on_epoch)


@dataclass(kw_only=True, eq=False)
class _Training:
    """The networks, their optimisers, the random numbers, and the epochs so far."""

    curve: CurveAsTensors
    options: RMSprop
    device: torch.device
    boundary: RayBoundary
    homeomorphism: CircleHomeomorphism
    optimizers: dict[str, torch.optim.RMSprop]
    random: torch.Generator
    history: list[TrainingStep] = field(default_factory=list)

    @classmethod
    def of(cls, curve: ClosedCurve, options: RMSprop, device: torch.device) -> _Training:
        random = torch.Generator().manual_seed(options.seed)
        network = ComplexMLP(
            depth=options.depth,
            width=options.width,
            activation=options.activation,
            gain=options.gain,
            generator=random,
            dtype=_DTYPES[options.precision],
            device=device,
        )
        homeomorphism = CircleHomeomorphism(generator=random, device=device)
        center = curve.point(np.arange(_CENTER_POINTS) / _CENTER_POINTS).mean(axis=0)
        constant = torch.nn.Parameter(torch.tensor(center, dtype=torch.float64, device=device))
        nodes, weights = (torch.tensor(a, device=device) for a in rule(options.quadrature, options.order))
        return cls(
            curve=CurveAsTensors.of(curve),
            options=options,
            device=device,
            boundary=RayBoundary(
                network=network,
                constant=constant,
                form=FORMS[options.representation],
                nodes=nodes,
                weights=weights,
            ),
            homeomorphism=homeomorphism,
            optimizers={
                "surface": torch.optim.RMSprop([*network.parameters(), constant], lr=options.learning_rate),
                "homeomorphism": torch.optim.RMSprop(homeomorphism.parameters(), lr=options.learning_rate),
            },
            random=random,
        )

    @property
    def path(self) -> Path | None:
        """The file of the state."""
        return None if self.options.checkpoint is None else Path(self.options.checkpoint)

    # --- Algorithm 1 --------------------------------------------------------------------------------------------------

    def run(self, on_epoch: Callable[[TrainingStep], None] | None) -> Trained:
        """Epochs until the last one, no better loss, or a divergence."""
        seconds = self.history[-1].seconds if self.history else 0.0
        status: Status = "finished"
        for index in itertools.count(len(self.history) + 1):
            if self._has_patience_run_out() or is_out_of_time():
                status = "stopped"
                break
            if index > self.options.epochs:
                break
            begin = time.perf_counter()
            state = self._parameters()
            loss = self._epoch()
            # what is only measured or saved is no part of the training
            seconds += time.perf_counter() - begin
            if self._diverged(loss):
                self._set_parameters(state)
                status = "diverged"
                break
            step = TrainingStep(
                index=index,
                method="RMSprop",
                loss=loss,
                boundary_error=self._misfit().max,
                seconds=seconds,
            )
            self.history.append(step)
            if self.path is not None and (index % self.options.checkpoint_every == 0 or index == self.options.epochs):
                self.save(self.path)
            if on_epoch is not None:
                on_epoch(step)
        return self._trained(status, seconds)

    def _epoch(self) -> float:
        """One pass over newly drawn samples; the mean of the surface's losses."""
        options = self.options
        # both updates draw points of their own, as the algorithm says
        drawn = torch.rand(2, options.points, dtype=torch.float64, generator=self.random).to(self.device)
        losses = []
        for surface_points, circle_points in zip(*(torch.split(row, options.batch) for row in drawn), strict=True):
            losses.append(self._update("surface", self._surface_loss(surface_points)))
            self._update("homeomorphism", self._homeomorphism_loss(circle_points))
        return float(torch.stack(losses).mean())

    def _update(self, which: Literal["surface", "homeomorphism"], loss: Float[Tensor, ""]) -> Float[Tensor, ""]:
        optimizer = self.optimizers[which]
        optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call] # torch leaves it untyped
        optimizer.step()
        return loss.detach()

    def _slide(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Φ(t): the parameter of Γ for that of ∂Ω."""
        psi = self.homeomorphism
        return psi.inverse(t) if self.options.homeomorphism == "inverse" else psi(t)

    def _surface_loss(self, t: Float[Tensor, " n"]) -> Float[Tensor, ""]:
        with torch.no_grad():
            point, tangent = self.curve.point_and_derivative(self._slide(t))
        position, velocity = self.boundary.point_and_velocity(t)
        return boundary_loss(position, velocity, point, tangent, tangent_weight=self.options.tangent_weight)

    def _homeomorphism_loss(self, t: Float[Tensor, " n"]) -> Float[Tensor, ""]:
        if self.options.homeomorphism == "inverse":
            with torch.no_grad():
                point, tangent = self.curve.point_and_derivative(t)
            position, velocity = self.boundary.moved_with(self.homeomorphism(t))
        else:
            with torch.no_grad():
                position, velocity = self.boundary.point_and_velocity(t)
            point, tangent = self.curve.point_and_derivative(self.homeomorphism(t))
        return boundary_loss(position, velocity, point, tangent, tangent_weight=self.options.tangent_weight)

    def _diverged(self, loss: float) -> bool:
        first = self.history[0].loss if self.history else math.inf
        finite = all(bool(tensor.isfinite().all()) for tensor in self._parameters().values())
        return not math.isfinite(loss) or not finite or loss > _GROWTH * first

    def _has_patience_run_out(self) -> bool:
        if self.options.patience is None:
            return False
        best, since = math.inf, 0
        for step in self.history:
            since = 0 if step.loss < (1 - _GAIN) * best else since + 1
            best = min(best, step.loss) if since == 0 else best
        return since >= self.options.patience

    def _misfit(self) -> Misfit:
        """Distance between the boundary and Γ, the larger of both ways: neither passes over a part of the other."""
        t = torch.arange(_BOUNDARY_POINTS, dtype=torch.float64, device=self.device) / _BOUNDARY_POINTS
        with torch.no_grad():
            r = self.boundary.point_and_velocity(t)[0].cpu().numpy()
        if not np.isfinite(r).all():
            return Misfit(rms=math.inf, max=math.inf, max_per_local_edge=math.inf, length=math.nan)
        dense = np.arange(_CURVE_POINTS) / _CURVE_POINTS
        gamma = self.curve.curve.point(dense)
        polygon = np.column_stack([np.interp(dense, np.append(t.cpu().numpy(), 1.0), np.append(x, x[0])) for x in r.T])
        arcs = _arcs(gamma)
        length = float(arcs.sum())
        to_curve, nearest = cKDTree(gamma).query(r)
        to_boundary = cKDTree(polygon).query(gamma)[0]
        ways = []
        for way in ((to_curve, dense[nearest], _arcs(r)), (to_boundary, dense, arcs)):
            away, slide, weights = (torch.as_tensor(part) for part in way)
            ways.append(Misfit.from_distances(away, slide, weights, self.curve, length=length))
        return Misfit(
            rms=max(way.rms for way in ways),
            max=max(way.max for way in ways),
            max_per_local_edge=max(way.max_per_local_edge for way in ways),
            length=length,
        )

    # --- state --------------------------------------------------------------------------------------------------------

    def _parameters(self) -> dict[str, Tensor]:
        named = {
            **{f"network/{name}": p for name, p in self.boundary.network.named_parameters()},
            **{f"homeomorphism/{name}": p for name, p in self.homeomorphism.named_parameters()},
            "constant": self.boundary.constant,
        }
        return {name: parameter.detach().clone() for name, parameter in named.items()}

    def _set_parameters(self, state: dict[str, Tensor]) -> None:
        with torch.no_grad():
            for name, parameter in self.boundary.network.named_parameters():
                parameter.copy_(state[f"network/{name}"])
            for name, parameter in self.homeomorphism.named_parameters():
                parameter.copy_(state[f"homeomorphism/{name}"])
            self.boundary.constant.copy_(state["constant"])

    def save(self, path: Path) -> None:
        """Writes parameters, optimisers, random numbers, some points of the curve, options and history."""
        tensors = {**self._parameters(), "random": self.random.get_state(), "curve": self._some_of_curve()}
        for which, optimizer in self.optimizers.items():
            for index, state in optimizer.state_dict()["state"].items():
                tensors |= {f"{which}/{index}/{name}": torch.as_tensor(value) for name, value in state.items()}
        write_checkpoint(
            path, tensors, {"options": self._own_options(), "history": [asdict(step) for step in self.history]}
        )

    def restore(self, path: Path) -> None:
        """Takes the state that `save` wrote.

        Raises:
            StorageError: the file cannot be read, or is of a training with other options or on another curve.
        """
        tensors, description = read_checkpoint(path)
        own, saved = self._own_options(), description["options"]
        different = sorted(name for name in own if own[name] != saved.get(name))
        if different:
            raise StorageError(
                f"{path} is of a training with other options ({', '.join(different)}); remove it to train from the "
                "start",
                path=str(path),
            )
        away = float((tensors["curve"] - self._some_of_curve()).abs().max())
        if away > _SAME_CURVE * self.curve.diagonal:
            raise StorageError(
                f"{path} is of a training on another curve; remove it to train from the start", path=str(path)
            )
        self._set_parameters(tensors)
        self.random.set_state(tensors["random"])
        for which, optimizer in self.optimizers.items():
            state = optimizer.state_dict()
            for name, tensor in tensors.items():
                if name.startswith(f"{which}/") and name.count("/") == 2:
                    _, index, key = name.split("/")
                    if index.isdigit():
                        state["state"].setdefault(int(index), {})[key] = tensor
            optimizer.load_state_dict(state)
        self.history = [TrainingStep(**step) for step in description["history"]]

    def _own_options(self) -> dict[str, Any]:
        """Options that the state depends on: more epochs, or another patience, go on from the same one."""
        return {name: value for name, value in asdict(self.options).items() if name not in _FREE}

    def _some_of_curve(self) -> Float[Tensor, "k 3"]:
        return torch.as_tensor(self.curve.curve.point(np.arange(_COMPARED_POINTS) / _COMPARED_POINTS))

    def _trained(self, status: Status, seconds: float) -> Trained:
        options, boundary = self.options, self.boundary
        domain = PlaneDomain.disk()
        surface: SpinorSurface | WeierstrassSurface
        if options.representation == "spinor":
            surface = SpinorSurface(boundary.network, domain).to(self.device)
            # the constant is r(0), the surface's is at its root
            with torch.no_grad():
                surface.constant.copy_(boundary.constant)
                away = torch.as_tensor(surface.position(np.zeros(1, dtype=np.complex128))[0]).to(boundary.constant)
                surface.constant.add_(boundary.constant - away)
        else:
            surface = WeierstrassSurface(boundary.network, domain, boundary.constant)
        misfit = self._misfit()
        t = torch.arange(_BOUNDARY_POINTS, dtype=torch.float64, device=self.device) / _BOUNDARY_POINTS
        with torch.no_grad():
            slide = self._slide(t)
        reasons = {
            "finished": "all epochs were done",
            "stopped": f"{options.patience} epochs brought no better loss",
            "diverged": "the loss became infinite, NaN or far larger than at first; the surface is that of the epoch "
            "before, take a smaller learning rate",
        }
        return Trained(
            surface=surface,
            matching=np.column_stack([t.cpu().numpy(), slide.cpu().numpy()]),
            misfit=misfit,
            diagonal=self.curve.diagonal,
            history=tuple(self.history),
            status=status,
            reason=f"{reasons[status]}; largest distance from the curve {misfit.max / self.curve.diagonal:.1e} of its "
            f"diagonal after {len(self.history)} epochs",
            seconds=seconds,
        )


def _arcs(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Length of a closed sequence of points around each."""
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return np.asarray((chords + np.roll(chords, 1)) / 2)
