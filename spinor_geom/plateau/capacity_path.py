"""Unstable surfaces over three rims and more: along a path on which the rims are pulled together or apart.

Rims that are moved by τ in a direction of their own each, at right angles to space, bound surfaces of energy E + τ²T/2,
with T the sum of the rims' capacities, a conformal and symmetric function of the moduli alone. The critical points of
E − λT, λ of either sign, are a curve that T parametrises, or the mean modulus M = 2πm/T; where λ is 0 on it there is a
minimal surface over the rims, of whatever index.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.circles import DirichletForm
from spinor_geom.plateau.douglas_rims import RimsProblem
from spinor_geom.plateau.rims_energy import EnergyPoint, HarmonicSurface, Moduli

# Steps of log M: the first and least, the largest, and how they grow; and how far M goes, as a ratio.
_LEAST_STEP, _STEP, _GROWTH, _FARTHEST = 0.002, 0.15, 1.5, 60.0
# Newton steps back to the path, and the gradient that is on it.
_MOST_STEPS, _ON_PATH = 8, 1e-7
# Gradient and slopes of a critical point.
_CRITICAL = 1e-9


def mean_modulus(domain: CircularDomain, n: int = 64) -> float:
    """M = 2πm/T, with T the sum of the capacities of m circles against all others: the modulus where there are two."""
    return _Capacity(form=DirichletForm.of(domain, n)).mean_modulus


def all_on_path(problem: RimsProblem, surface: HarmonicSurface) -> list[HarmonicSurface]:
    """The critical points on both sides of a stable surface on its path, itself among them, by mean modulus."""
    found = [surface]
    for way in (1, -1):
        found += _Path(problem=problem, way=way).critical(surface)
    return sorted(found, key=lambda one: mean_modulus(one.domain))


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
    here: EnergyPoint
    multiplier: float  # λ

    @cached_property
    def capacity(self) -> _Capacity:
        return _Capacity(form=self.here.form)

    @property
    def log_modulus(self) -> float:
        return math.log(self.capacity.mean_modulus)

    @cached_property
    def by_log_modulus(self) -> Float[Tensor, " k"]:
        """The derivative of log M."""
        slopes = self.capacity.moduli.slopes * (-2 * self.capacity.mean_modulus)
        slopes = slopes / (self.here.domain.rims * self.here.form.steps)
        return torch.cat([torch.zeros_like(self.here.by_slides), slopes])

    def corrected(self, log_modulus: float) -> tuple[_OnPath, float]:
        """One Newton step to the path at a given log M, and the size of the defect before it."""
        here, count = self.here, len(self.here.by_slides)
        gradient = here.gradient()
        gradient[count:] -= self.multiplier * self.capacity.moduli.slopes
        hessian = here.hessian()
        hessian[count:, count:] -= self.multiplier * self.capacity.moduli.hessian
        # the derivative of log M is −(2/T) that of T/2
        pull = torch.cat([torch.zeros_like(here.by_slides), self.capacity.moduli.slopes])
        normal = self.by_log_modulus
        gap = self.log_modulus - log_modulus
        both = torch.linalg.solve(hessian, torch.stack([-gradient, pull], dim=1))
        change = (-gap - normal @ both[:, 0]) / (normal @ both[:, 1])
        step = both[:, 0] + change * both[:, 1]
        slides = gradient[:count].square().mean().sqrt() / here.normal.square().sum(-1).mean().sqrt()
        size = max(float(slides), float(gradient[count:].abs().max()) / here.energy, abs(gap))
        return _OnPath(here=here.stepped(step), multiplier=self.multiplier + float(change)), size


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    problem: RimsProblem
    way: int  # of log M

    def critical(self, surface: HarmonicSurface) -> list[HarmonicSurface]:
        """The critical points that the path meets after a given one."""
        here = _OnPath(here=self.problem.point(surface), multiplier=0.0)
        start, found, step = here.log_modulus, [], _LEAST_STEP
        while abs(here.log_modulus - start) < math.log(_FARTHEST) and step >= _LEAST_STEP:
            require_time()
            there = self._at(here, here.log_modulus + self.way * step)
            if there is None:
                step /= 2
                continue
            if here.multiplier * there.multiplier < 0:
                share = here.multiplier / (here.multiplier - there.multiplier)
                between = self._at(here, here.log_modulus + share * (there.log_modulus - here.log_modulus))
                exact = self.problem.critical(between.here.surface) if between is not None else None
                if exact is not None and exact.size < _CRITICAL:
                    found.append(exact)
            here, step = there, min(_GROWTH * step, _STEP)
        return found

    @staticmethod
    def _at(near: _OnPath, log_modulus: float) -> _OnPath | None:
        """The point of the path with a given log M; None where Newton's method does not come to it."""
        before = math.inf
        for _ in range(_MOST_STEPS):
            there, size = near.corrected(log_modulus)
            if size < _ON_PATH:
                return near
            if not size < 4 * before:
                return None
            near, before = there, size
        return None
