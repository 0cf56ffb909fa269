"""All critical points of Douglas's energy: along a path on which the rims are pulled together or apart.

Rims that are moved by τ in a direction of their own each, at right angles to space, bound surfaces of energy E + τ²T/2,
with T the sum of the rims' capacities, a conformal and symmetric function of the moduli alone. The critical points of
E − λT, λ of either sign, are a curve that T parametrises, or the mean modulus M = 2πm/T; where λ is 0 on it there is a
minimal surface over the rims, of whatever index. Over two rims the path is the least energy of each modulus.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import torch
from jaxtyping import Float
from scipy.optimize import brentq
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.circles import DirichletForm
from spinor_geom.plateau.douglas_rims import RimsProblem, is_apart
from spinor_geom.plateau.newton import MOST_STEPS
from spinor_geom.plateau.rims_energy import HarmonicSurface, Moduli

# Steps of log M: the largest, and the least before the path is lost.
_STEP, _LEAST_STEP = 0.5, 0.002
# Gradient and slopes of a point of the path: λ changes its sign where it does, and Newton's method goes on from there.
_ON_PATH = 1e-6


def mean_modulus(domain: CircularDomain, n: int = 64) -> float:
    """M = 2πm/T, with T the sum of the capacities of m circles against all others: the modulus where there are two."""
    return _Capacity(form=DirichletForm.of(domain, n)).mean_modulus


def all_on_path(problem: RimsProblem, surface: HarmonicSurface | None) -> list[HarmonicSurface]:
    """The critical points on the path of a surface whose slides are stationary, if there is one, by mean modulus.

    Raises:
        SurfaceError: the energy rises from the least mean modulus on that the nodes resolve, or the nodes crowd: other
            critical points may exist.
    """
    path = _Path(problem=problem)
    here = None if surface is None else path.at(_OnPath.near(surface), None)
    if here is None or here.here.crowded:
        raise SurfaceError(
            "the nodes crowd on the rims: the gap between them is too long or too uneven for round circles, and no "
            "surface was found"
        )
    points = [*path.followed(here, -1)[::-1], here, *path.followed(here, 1)]
    if here.here.domain.rims == 2 and points[0].multiplier < 0:
        raise SurfaceError(
            f"the gap between the rims is too narrow for their length: {here.here.form.steps} nodes on each do not "
            "resolve it, and no annulus was found; divide the gap by a few edges between the rims and fill the holes "
            "that result"
        )
    return path.critical(points)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Capacity:
    """T with its derivatives by the moduli."""

    form: DirichletForm

    @cached_property
    def _indicators(self) -> Float[Tensor, "m n m"]:
        m = self.form.domain.rims
        return torch.eye(m, dtype=self.form.own.dtype, device=self.form.own.device)[:, None].repeat(
            1, self.form.steps, 1
        )

    @cached_property
    def _normal(self) -> Float[Tensor, "m n m"]:
        return self.form(self._indicators)

    @property
    def mean_modulus(self) -> float:
        return self.form.domain.rims * self.form.steps / float((self._indicators * self._normal).sum())

    @cached_property
    def moduli(self) -> Moduli:
        """The derivatives of T/2, as sums over the nodes."""
        return Moduli.of(self.form, self._indicators, self._normal)


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnPath:
    here: HarmonicSurface
    multiplier: float  # λ

    @classmethod
    def near(cls, here: HarmonicSurface) -> _OnPath:
        """With the multiplier that suits the moduli's slopes."""
        free = cls(here=here, multiplier=0.0)
        pull = free.capacity.moduli.slopes
        return replace(free, multiplier=float(here.moduli.slopes @ pull / (pull @ pull)))

    @cached_property
    def capacity(self) -> _Capacity:
        return _Capacity(form=self.here.form)

    @property
    def is_resolved(self) -> bool:
        """Whether the highest frequency of the nodes decays across the narrowest gap, by e^π at least."""
        return -math.log(self.here.domain.nearness) >= 2 * math.pi / self.here.form.steps

    @property
    def log_modulus(self) -> float:
        return math.log(self.capacity.mean_modulus)

    @cached_property
    def by_log_modulus(self) -> Float[Tensor, " k"]:
        """The derivative of log M."""
        slopes = self.capacity.moduli.slopes * (-2 * self.capacity.mean_modulus)
        slopes = slopes / (self.here.domain.rims * self.here.form.steps)
        return torch.cat([torch.zeros_like(self.here.by_slides), slopes])

    @cached_property
    def _gradient(self) -> Float[Tensor, " k"]:
        """Of E − λT."""
        gradient, slopes = self.here.gradient(), self.capacity.moduli.slopes
        gradient[-len(slopes) :] -= self.multiplier * slopes
        return gradient

    def defect(self, log_modulus: float) -> float:
        """How far this is from the path at a given log M."""
        count = len(self.here.by_slides)
        slides, moduli = self._gradient[:count], self._gradient[count:]
        along = slides.square().mean().sqrt() / self.here.normal.square().sum(-1).mean().sqrt()
        return max(float(along), float(moduli.abs().max()) / self.here.energy, abs(self.log_modulus - log_modulus))

    @cached_property
    def _steps(self) -> Float[Tensor, "2 k"]:
        """Newton's step at this λ, and the step for each unit of λ."""
        hessian, count = self.here.hessian(), len(self.here.by_slides)
        hessian[count:, count:] -= self.multiplier * self.capacity.moduli.hessian
        # the derivative of log M is −(2/T) that of T/2
        pull = torch.cat([torch.zeros_like(self.here.by_slides), self.capacity.moduli.slopes])
        steps: Tensor = torch.linalg.solve(hessian, torch.stack([-self._gradient, pull], dim=1)).T
        return steps

    @cached_property
    def rise(self) -> float:
        """The derivative of λ by log M along the path."""
        return 1 / float(self.by_log_modulus @ self._steps[1])

    def corrected(self, log_modulus: float) -> _OnPath:
        """After one Newton step to the path at a given log M."""
        step, by_multiplier = self._steps
        change = (log_modulus - self.log_modulus - float(self.by_log_modulus @ step)) * self.rise
        return _OnPath(here=self.here.stepped(step + change * by_multiplier), multiplier=self.multiplier + change)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    problem: RimsProblem

    def followed(self, start: _OnPath, way: int) -> list[_OnPath]:
        """The points on one side, as far as circles are apart and the nodes resolve the gaps between them."""
        found, here, step = [], start, _STEP
        while step >= _LEAST_STEP:
            require_time()
            there = self.at(here, here.log_modulus + way * step)
            if there is None:
                step /= 2
                continue
            if is_apart(there.here.domain) or there.here.crowded or not there.is_resolved:
                break
            found.append(there)
            here, step = there, min(2 * step, _STEP)
        return found

    def critical(self, points: list[_OnPath]) -> list[HarmonicSurface]:
        """Where λ changes its sign, or does so twice between two of its steps."""
        for low, high in pairwise(points):
            sign = math.copysign(1, low.multiplier)
            if low.multiplier * high.multiplier > 0 and sign * low.rise < 0 < sign * high.rise:
                points = sorted([*points, self._least(low, high)], key=lambda point: point.log_modulus)
        return [
            self._zero(before, after)
            for before, after in pairwise(points)
            if before.multiplier * after.multiplier < 0 or after.multiplier == 0
        ]

    def _least(self, low: _OnPath, high: _OnPath) -> _OnPath:
        """Where |λ| is least between two points."""
        ends = low, high
        log = brentq(lambda log: self._nearby(ends, log).rise, low.log_modulus, high.log_modulus, xtol=_LEAST_STEP)
        return self._nearby(ends, log)

    def _zero(self, low: _OnPath, high: _OnPath) -> HarmonicSurface:
        """The critical point between two points: Newton's method from where λ is about 0, if it stays between them."""
        while True:
            share = low.multiplier / (low.multiplier - high.multiplier)
            width = high.log_modulus - low.log_modulus
            middle = self._nearby((low, high), low.log_modulus + min(max(share, 0.1), 0.9) * width)
            found = self.problem.critical(middle.here)
            log = _OnPath.near(found).log_modulus
            if (
                middle in (low, high)
                or width < _LEAST_STEP
                or (found.size < _ON_PATH and low.log_modulus <= log <= high.log_modulus)
            ):
                return found
            low, high = (middle, high) if middle.multiplier * low.multiplier > 0 else (low, middle)

    def _nearby(self, points: Sequence[_OnPath], log_modulus: float) -> _OnPath:
        """The point with a given log M from the nearest of points; that one itself where the way is lost."""
        nearest = min(points, key=lambda point: abs(point.log_modulus - log_modulus))
        return self.at(nearest, log_modulus) or nearest

    @staticmethod
    def at(near: _OnPath, log_modulus: float | None) -> _OnPath | None:
        """The point with a given log M, or that of a point; None where Newton's method does not come to it."""
        goal = near.log_modulus if log_modulus is None else log_modulus
        before = math.inf
        for _ in range(MOST_STEPS):
            size = near.defect(goal)
            if size < _ON_PATH:
                return near
            if not size < before:
                return None
            near, before = near.corrected(goal), size
        return None
