"""Douglas's variational problem for two rims and more: their slides and the moduli of Ω, by Newton's method."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF
from spinor_geom.plateau.douglas import resampled, smoothed
from spinor_geom.plateau.newton import MOST_STEPS, minimised
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.rims_energy import HarmonicSurface

# Modulus beyond which all but the distance of the rims' means has decayed to 1e-9 of itself: there is no surface.
MOST_MODULUS = 20.0
# Damping of the first step, in units of the metric, and the factor by which it grows and falls.
_DAMPING, _FACTOR = 1e-2, 4.0
# Share of the energy that is added to the metric of each modulus: the search stays in shallow valleys.
_STIFF_MODULUS = 0.1
HELD = 1e26
# Gradients, dampings and falls of the energy at which nothing but rounding errors is left.
ROUNDING = 1e-13
# A step of Newton's method at a critical point lowers the gradient at least to this share.
_GAIN = 0.5
# Curvatures of the energy by the moduli below this share of it are raised to that.
_FLAT_MODULUS = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class RimsProblem:
    """Douglas's problem for curves that run as the boundary of Ω does, the outer one first."""

    curves: CurveTensors  # two or more, as a batch
    negligible: float = ROUND_OFF  # as for `DirichletForm.of`
    on_step: Callable[[float], None] | None = None  # is called with the gradient at each Newton step; None for silence

    def descended(
        self, start: HarmonicSurface, *, tolerance: float, stiffness: float = _STIFF_MODULUS
    ) -> HarmonicSurface | None:
        """The surface that the energy falls to, by damped Newton steps; None where it falls apart.

        A modulus runs away then, or a rim shrinks to a point of it; `HELD` stiffness keeps them. `minimised`, which
        factors nothing, is no way to here: its steps are not held back in the moduli, so that it leaves shallow valleys
        (the 5-noid's falls apart), and along splines it takes three times as long.
        """
        here, damping = start, _DAMPING
        for _ in range(MOST_STEPS):
            require_time()
            if self.on_step is not None:
                self.on_step(here.size)
            if here.size <= tolerance:
                break
            hessian, gradient, count = here.hessian(), here.gradient(), len(here.by_slides)
            metric = here.stiffness * torch.ones_like(gradient)
            metric[count:] = hessian.diagonal()[count:].abs() + stiffness * here.energy
            there = None
            while damping < 1 / ROUNDING:
                damped = hessian.clone()
                damped.diagonal().add_(metric, alpha=damping)
                factor, info = torch.linalg.cholesky_ex(damped)
                if int(info) == 0:
                    step = torch.cholesky_solve(-gradient[:, None], factor)[:, 0]
                    there = here.stepped(step)
                    if there.energy <= here.energy * (1 + ROUNDING):
                        break
                    there = None
                damping = _FACTOR * damping
            if there is None:
                break
            stays = here.energy - there.energy < ROUNDING * here.energy
            if stays and not there.size < _GAIN * here.size:
                break
            here, damping = there, max(damping / _FACTOR, ROUNDING)
            if here.crowded or is_apart(here.domain):
                return None
        return here

    def critical(self, near: HarmonicSurface, *, tolerance: float = ROUNDING) -> HarmonicSurface:
        """The critical point next to a surface, a minimum or not, by plain Newton steps while the gradient falls."""
        here = near
        for _ in range(MOST_STEPS):
            if self.on_step is not None:
                self.on_step(here.size)
            if here.size <= tolerance:
                break
            step = torch.linalg.solve(here.hessian(), -here.gradient())
            there = here.stepped(step)
            if not there.size < _GAIN * here.size:
                break
            here = there
        return here

    def refined(self, surface: HarmonicSurface, n: int) -> HarmonicSurface:
        """The critical point with n nodes on each rim."""
        return self.critical(self.resampled(surface, n))

    def resampled(self, surface: HarmonicSurface, n: int) -> HarmonicSurface:
        """The harmonic surface of the same slides at n nodes on each rim."""
        return HarmonicSurface.of(self.curves, resampled(surface.slides, n), surface.domain, self.negligible)

    def settled(
        self, surface: HarmonicSurface, n: int, *, tolerance: float, max_steps: int, near: bool, negligible: float = 0.0
    ) -> HarmonicSurface:
        """The surface of less energy with n nodes on each rim, by `minimised`: for rims that take many."""
        start = _AsBatch(here=self.resampled(surface, n))
        ((_, found, _),) = minimised(
            start,
            tolerances=[tolerance],
            max_steps=[max_steps],
            negligible=[negligible * n / (2 * math.pi)],
            near=near,
            on_step=[] if self.on_step is None else [self.on_step],
        )
        return found.here


def is_apart(domain: CircularDomain) -> bool:
    """Whether a modulus has run away."""
    _, modulus = domain.room
    return float(modulus.max()) > MOST_MODULUS


@dataclass(frozen=True, kw_only=True, eq=False)
class _AsBatch:
    """One surface's energy as a batch of one, as `newton.Energies`; it is over where n nodes do not resolve a step."""

    here: HarmonicSurface
    is_unresolved: bool = False

    @property
    def energy(self) -> Float[Tensor, "1"]:
        return self.here.slides.new_tensor([self.here.energy])

    @property
    def gradient(self) -> Float[Tensor, "1 k"]:
        return self.here.gradient()[None]

    @property
    def size(self) -> Float[Tensor, "1"]:
        return self.here.slides.new_tensor([self.here.size])

    @property
    def is_over(self) -> Bool[Tensor, "1"]:
        return torch.tensor([self.is_unresolved], device=self.here.slides.device)

    def at(self, which: Int[Tensor, " _"]) -> _AsBatch:
        return self

    def replaced(self, which: Int[Tensor, " _"], other: _AsBatch) -> _AsBatch:
        return other if len(which) else self

    @cached_property
    def _by_moduli(self) -> Float[Tensor, "p p"]:
        """The second derivative by the moduli, without what bends downwards."""
        values, vectors = torch.linalg.eigh(self.here.moduli.hessian)
        raised: Tensor = (vectors * values.clamp(min=_FLAT_MODULUS * self.here.energy)) @ vectors.T
        return raised

    @cached_property
    def _inverse(self) -> Float[Tensor, "p p"]:
        inverse: Tensor = torch.linalg.inv(self._by_moduli)
        return inverse

    def hessian(self, reflection: Float[Tensor, "1"]) -> Callable[[Float[Tensor, "1 k"]], Float[Tensor, "1 k"]]:
        here, count = self.here, self.here.slides.numel()
        bends = here.bends + 2 * reflection * (-here.bends).clamp(min=0)

        def applied(rows: Float[Tensor, "1 k"]) -> Float[Tensor, "1 k"]:
            (x,) = rows
            u = x[:count].reshape(here.slides.shape)
            image = (here.unit * here.form(here.unit * u[..., None])).sum(-1) + bends * u
            slides = image.flatten() + here.mixed.T @ x[count:]
            whole = torch.cat([slides, here.mixed @ x[:count] + self._by_moduli @ x[count:]])
            held: Tensor = whole + here.stiffness * (here.rotation @ x) * here.rotation
            return held[None]

        return applied

    def precondition(self, u: Float[Tensor, "1 k"]) -> Float[Tensor, "1 k"]:
        count = self.here.slides.numel()
        smooth = smoothed(u[0, :count].reshape(self.here.slides.shape))
        return torch.cat([smooth.flatten(), self._inverse @ u[0, count:]])[None]

    def stepped(self, direction: Float[Tensor, "1 k"], length: float) -> _AsBatch:
        there = self.here.stepped(direction[0] * length)
        return _AsBatch(here=there, is_unresolved=there is self.here)
