"""The paper's Algorithm 1: alternating RMSprop for the surface and for the homeomorphism of its boundary."""

import copy
import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from spinor_geom.arrays import NUMPY, Place
from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import RuleName, rule
from spinor_geom.errors import OptionError, require_count, require_positive
from spinor_geom.holomorphic.mlp import ActivationName, ComplexMLP
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Steps
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface
from spinor_geom.torch_extra import Tensor, torch
from spinor_geom.training.boundary import FORMS, RayBoundary, as_boundary_curve, diagonal_of, move_to
from spinor_geom.training.trained import Status, Trained, TrainingStep

_GROWTH = 1e3  # training has diverged if the loss exceeds that of the first epoch by this factor
_BOUNDARY_POINTS, _CURVE_POINTS = 512, 8192  # points of ∂Ω for the boundary error, and of Γ for its centre
_DIAGONAL = 2 * math.sqrt(2)  # of the unit circle. The solver's curves are scaled to it to suit the learning rate
PointsAndVelocities: TypeAlias = tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]  # of a closed curve
_SIZES, _PIECES = (1, 64, 64, 32, 1), 512  # layers of ρ, and pieces of [0, 1] on which it is interpolated linearly


@dataclass(frozen=True, kw_only=True)
class RMSprop:
    """Options of the paper's Algorithm 1. The defaults are its settings.

    Attributes:
        representation: "spinor" for p and q, or "weierstrass-enneper" for f and g, the paper's baseline.
        depth: hidden layers of each of the two networks.
        width: units in each layer.
        activation: an entire function.
        gain: of the initial networks, see `ComplexMLP`. The paper does not give its initialisation.
        learning_rate: of RMSprop.
        batch: samples of [0, 1] in each update.
        points: samples in each epoch, for the surface and for the homeomorphism.
        epochs: number of epochs. The paper takes 800, and 2,000 or 4,000 for prescribed surfaces.
        tangent_weight: λ of the loss, see `boundary_loss`.
        quadrature: rule on the ray from 0 to a point.
        order: number of its intervals ("trapezoid", "simpson") or nodes ("gauss").
        seed: of all random numbers.
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
    seed: int = 0
    takes_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Raises OptionError for values out of range."""
        rule(self.quadrature, self.order)
        require_count(depth=self.depth, width=self.width, batch=self.batch)
        require_count(0, epochs=self.epochs)
        require_count(self.batch, points=self.points)
        require_positive("learning_rate", self.learning_rate)
        if self.tangent_weight != 0:
            require_positive("tangent_weight", self.tangent_weight, instead="0 or ")
        if self.representation not in FORMS:
            raise OptionError(f"unknown representation {self.representation!r}; choose one of: {', '.join(FORMS)}")

    def disk(
        self, curve: BoundaryCurve, *, start: PlateauSolution | None, device: str | torch.device, steps: Steps
    ) -> RouteResult:
        """A minimal disk over a curve at unit size, from random parameters, as of `plateau.options.Trainer`."""
        assert start is None
        larger = curve.placed(_DIAGONAL * curve.coefficients[-1], _DIAGONAL)
        trained = train_by_rmsprop(larger, options=self, device=device, on_epoch=lambda s: steps.take(s.method, s.loss))
        return trained.as_disk(curve, scale=1 / _DIAGONAL)


def train_by_rmsprop(
    curve: BoundaryCurve | ClosedCurve,
    *,
    options: RMSprop | None = None,
    device: str | torch.device = "cpu",
    on_epoch: Callable[[TrainingStep], None] | None = None,
) -> Trained:
    """A minimal surface over the unit disk with a boundary close to Γ, by the paper's Algorithm 1.

    Each epoch draws samples of [0, 1]. For each batch RMSprop makes one step of the networks and the constant c for the
    loss between r(e^{2πit}) and Γ(Ψ⁻¹(t)), then one of the homeomorphism Ψ (`CircleHomeomorphism`) with that between
    r(e^{2πiΨ(t)}) and Γ(t). c starts at the centre of Γ. With the paper's learning rate each parameter changes by a few
    hundredths in 800 epochs, which suits curves of size 1. `on_epoch` is called after each epoch.

    Returns:
        The surface, a `WeierstrassSurface` for the baseline, and the history. Divergence is a `status`, not an error.

    Raises:
        CurveError: the formulas are not those of a smooth closed curve.

    Source: Sun & Chern (2026), Algorithm 1.
    """
    return _Training(as_boundary_curve(curve), options or RMSprop(), torch.device(device)).run(on_epoch)


class _Training:
    def __init__(self, curve: BoundaryCurve, options: RMSprop, device: torch.device) -> None:
        self.options, self.device = options, device
        self.random = torch.Generator().manual_seed(options.seed)
        network = ComplexMLP(
            depth=options.depth,
            width=options.width,
            activation=options.activation,
            gain=options.gain,
            generator=self.random,
        )
        self.homeomorphism = CircleHomeomorphism(generator=self.random).to(device)
        self.gamma, self.measured = curve, CurveTensors.of(curve, NUMPY)
        centre = curve.point(np.arange(_CURVE_POINTS) / _CURVE_POINTS).mean(axis=0)
        ray = rule(options.quadrature, options.order)
        self.boundary = RayBoundary(network, centre, options.representation, ray).to(device)
        self.diagonal = diagonal_of(curve)
        self.curve = CurveTensors.of(curve, Place(device))
        self.modules = torch.nn.ModuleDict({"surface": self.boundary, "homeomorphism": self.homeomorphism})
        self.optimizers = {
            name: torch.optim.RMSprop(module.parameters(), lr=options.learning_rate)
            for name, module in self.modules.items()
        }
        self.history: list[TrainingStep] = []
        self.even = torch.arange(_BOUNDARY_POINTS, dtype=torch.float64, device=device) / _BOUNDARY_POINTS

    def run(self, on_epoch: Callable[[TrainingStep], None] | None) -> Trained:
        """Trains until the last epoch, the time limit or divergence."""
        options = self.options
        seconds = 0.0
        for index in range(1, options.epochs + 1):
            if is_out_of_time():
                return self._result("stopped", "the time limit was reached", seconds)
            begin = time.perf_counter()
            before = copy.deepcopy(self.modules.state_dict())
            loss = self._epoch()
            seconds += time.perf_counter() - begin
            if self._diverged(loss):
                self.modules.load_state_dict(before)
                reason = "the loss became infinite, NaN or far larger than at first; use a smaller learning rate"
                return self._result("diverged", f"{reason} (the surface is that of the epoch before)", seconds)
            error = self._misfit().max
            step = TrainingStep(index=index, method="RMSprop", loss=loss, boundary_error=error, seconds=seconds)
            self.history.append(step)
            if on_epoch is not None:
                on_epoch(step)
        return self._result("finished", "all epochs were done", seconds)

    def _epoch(self) -> float:
        """Trains with new samples. Returns the mean loss of the surface."""
        options = self.options
        # different samples for the two updates
        drawn = torch.rand(2, options.points, dtype=torch.float64, generator=self.random).to(self.device)
        losses = []
        for t, s in zip(*(torch.split(row, options.batch) for row in drawn), strict=True):
            with torch.no_grad():
                target = self.curve.point_and_derivative(self.homeomorphism.inverse(t))
            losses.append(self._update("surface", self.boundary.point_and_velocity(t), target))
            boundary = self.boundary.differentiable_point_and_velocity(self.homeomorphism(s))
            self._update("homeomorphism", boundary, self.curve.point_and_derivative(s))
        return float(torch.stack(losses).mean())

    def _update(self, name: str, boundary: PointsAndVelocities, target: PointsAndVelocities) -> Float[Tensor, ""]:
        loss = boundary_loss(boundary, target, tangent_weight=self.options.tangent_weight)
        self.optimizers[name].zero_grad()
        loss.backward()  # type: ignore[no-untyped-call] # torch leaves it untyped
        self.optimizers[name].step()
        return loss.detach()

    def _diverged(self, loss: float) -> bool:
        finite = all(bool(parameter.isfinite().all()) for parameter in self.modules.parameters())
        first = self.history[0].loss if self.history else math.inf
        return not finite or not math.isfinite(loss) or loss > _GROWTH * first

    def _misfit(self) -> Misfit:
        """The larger of the distances of the boundary from Γ and of Γ from the boundary."""
        with torch.no_grad():
            r = self.boundary.point_and_velocity(self.even)[0].cpu().numpy()
        if not np.isfinite(r).all():
            return Misfit(rms=math.inf, max=math.inf, max_per_local_edge=math.inf, length=math.nan)
        slide = np.unwrap(self.gamma.nearest(r), period=1.0)
        return Misfit.of(r, slide, self.measured)

    def _result(self, status: Status, reason: str, seconds: float) -> Trained:
        boundary, domain = self.boundary, PlaneDomain.disk()
        surface: SpinorSurface | WeierstrassSurface
        if self.options.representation == "spinor":
            surface = SpinorSurface(boundary.network, domain).to(self.device)
            move_to(surface, torch.zeros(1, dtype=torch.complex128), boundary.constant[None])
        else:
            surface = WeierstrassSurface(boundary.network, domain, boundary.constant)
        misfit = self._misfit()
        with torch.no_grad():
            slide = self.homeomorphism.inverse(self.even)
        return Trained(
            surface=surface,
            matching=torch.stack([self.even, slide], dim=-1).cpu().numpy(),
            misfit=misfit,
            diagonal=self.diagonal,
            history=tuple(self.history),
            status=status,
            reason=f"{reason}; largest distance from the curve {misfit.max / self.diagonal:.1e} of its diagonal after "
            f"{len(self.history)} epochs",
            seconds=seconds,
        )


def boundary_loss(
    boundary: PointsAndVelocities, target: PointsAndVelocities, *, tangent_weight: float
) -> Float[Tensor, ""]:
    """L_distance + λ L_tangent, the mean of |x − y|² + λ(1 − v·w/(|v||w|)) over samples of two closed curves.

    Source: Sun & Chern (2026), losses of the boundary.
    """
    (x, v), (y, w) = boundary, target
    distance = (x - y).square().sum(-1).mean()
    return distance + tangent_weight * (1 - torch.nn.functional.cosine_similarity(v, w, dim=-1)).mean()


class CircleHomeomorphism(torch.nn.Module):
    """The homeomorphism Ψ(t) = ∫₀ᵗ ρ/∫₀¹ ρ + b of the circle, with a positive ρ and a learnable shift b.

    ρ is a real network [1, 64, 64, 32, 1] with ReLU units and an exponential output. Initially it is nearly constant,
    and Ψ nearly the identity. Ψ(t + 1) = Ψ(t) + 1.

    Source: Sun & Chern (2026), reparametrisations on S¹.
    """

    def __init__(self, *, generator: torch.Generator | None = None) -> None:
        """Random parameters, uniform in ±1/√fan-in, on the CPU, and b = 0."""
        super().__init__()
        pairs = itertools.pairwise(_SIZES)
        # created without initialisation, which would use torch's global generator
        linear = [torch.nn.Linear(*pair, dtype=torch.float64, device="meta").to_empty(device="cpu") for pair in pairs]
        for name in ("weight", "bias"):
            for layer in linear:
                bound = layer.in_features**-0.5
                torch.nn.init.uniform_(getattr(layer, name), -bound, bound, generator=generator)
        following = (part for layer in linear[1:] for part in (torch.nn.ReLU(), layer))
        self.layers = torch.nn.Sequential(linear[0], *following)
        self.shift = torch.nn.Parameter(torch.zeros((), dtype=torch.float64))

    def density(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """ρ(t) for t in [0, 1]."""
        output: Tensor = self.layers(t[:, None])
        return output[:, 0].exp()

    def forward(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Ψ(t), differentiable with respect to t and the parameters."""
        slopes, values = self._table()
        turns = t.detach().floor()
        piece = ((t.detach() - turns) * _PIECES).long().clamp(0, _PIECES - 1)
        part = (t - turns) * _PIECES - piece
        left, right = slopes[piece], slopes[piece + 1]
        return turns + values[piece] + part * (left + (right - left) * part / 2) / _PIECES + self.shift

    def inverse(self, s: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Ψ⁻¹(s), the root of a quadratic equation, differentiable with respect to s and the parameters."""
        slopes, values = self._table()
        wanted = s - self.shift
        turns = wanted.detach().floor()
        rest = wanted - turns
        piece = (torch.searchsorted(values.detach(), rest.detach(), right=True) - 1).clamp(0, _PIECES - 1)
        left, right = slopes[piece], slopes[piece + 1]
        above = (rest - values[piece]) * _PIECES
        part = 2 * above / (left + (left**2 + 2 * (right - left) * above).sqrt())
        return turns + (piece + part) / _PIECES

    def _table(self) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"]]:
        """Ψ′ and Ψ − b at the ends of all pieces."""
        ends = torch.linspace(0, 1, _PIECES + 1, dtype=torch.float64, device=self.shift.device)
        density = self.density(ends)
        integral = torch.cumulative_trapezoid(density, dx=1 / _PIECES)
        values = torch.nn.functional.pad(integral / integral[-1], (1, 0))
        return density / integral[-1], values
