"""Critical points of Douglas's energy E in the moduli of m rims, by continuation.

T is the sum of the capacities of the rims, each against all others: a conformal invariant, symmetric in the rims. The
critical points of E − λT form a path, parametrised by the mean modulus M = 2πm/T. Points of the path with λ = 0 are
minimal surfaces over the rims, of any Morse index. For two rims the path has the least energy for each modulus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from spinor_geom.arrays import Array, namespace, place_of, square
from spinor_geom.deadline import require_time
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm
from spinor_geom.plateau.harmonic.harmonic_route import even
from spinor_geom.plateau.newton import MOST_STEPS, SMALL
from spinor_geom.plateau.rims.energy import DENSE, LARGEST_STEP, HarmonicSurface, Moduli, RimsProblem


def mean_modulus(domain: CircularDomain) -> float:
    """The mean modulus M = 2πm/T of m circles, T the sum of the capacities of each against the others."""
    return _capacity(CirclesForm.of(domain, even(DENSE // domain.rims)))[0]


def _capacity(form: CirclesForm) -> tuple[float, Moduli]:
    """M, and the derivatives of T/2 with respect to the moduli, as sums over the nodes."""
    m = form.domain.rims
    indicators = place_of(form.own).put(np.repeat(np.eye(m)[:, None], form.steps, axis=1))
    normal = form(indicators)
    return m * form.steps / float((indicators * normal).sum()), Moduli.of(form, indicators, normal)


def all_on_path(problem: RimsProblem, surface: HarmonicSurface | None) -> list[HarmonicSurface]:
    """The critical points on the path of a surface with stationary slides, sorted by mean modulus.

    Raises:
        SurfaceError: the nodes crowd, or the energy of two rims increases at the least resolved modulus, so that there
            may be critical points below it.
    """
    near = None if surface is None else _OnPath.near(replace(surface, fixed_moduli=False))
    here = None if near is None else near.at(near.log_modulus)
    crowded = SurfaceError(
        "the nodes on the rims are too crowded: the gap between the rims is too long or too uneven for round "
        "circles, and no surface was found"
    )
    if here is None or here.here.crowded:
        raise crowded
    (below, to_least), (above, to_most) = (_followed(here, sign) for sign in (-1, 1))
    points = [*below[::-1], here, *above]
    if here.here.domain.rims == 2 and points[0].multiplier < 0:
        raise SurfaceError(
            f"the gap between the rims is too narrow for their length: {here.here.form.steps} nodes on each do not "
            "resolve it, and no annulus was found; divide the gap by a few edges between the rims and fill the holes "
            "that result"
        )
    for low, high in pairwise(points):
        sign = math.copysign(1, low.multiplier)
        if low.multiplier * high.multiplier > 0 and sign * low.rise < 0 < sign * high.rise:
            # λ may have two zeros between these steps
            points = sorted([*points, _least(low, high)], key=lambda point: point.log_modulus)
    found = [
        _zero(problem, before, after)
        for before, after in pairwise(points)
        if before.multiplier * after.multiplier < 0 or after.multiplier == 0
    ]
    if not (found or (to_least and to_most)):
        raise crowded
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnPath:
    """A harmonic surface on or near the path."""

    here: HarmonicSurface
    multiplier: float  # λ

    @classmethod
    def near(cls, here: HarmonicSurface) -> _OnPath:
        """A surface, with λ by least squares."""
        free = cls(here=here, multiplier=0.0)
        pull = free._capacity[1].slopes
        return replace(free, multiplier=float(here.moduli.slopes @ pull / (pull @ pull)))

    @cached_property
    def _capacity(self) -> tuple[float, Moduli]:
        return _capacity(self.here.form)

    @property
    def log_modulus(self) -> float:
        return math.log(self._capacity[0])

    @cached_property
    def _pull(self) -> Float[Array, " k"]:
        """The gradient of T/2 with respect to arc length (0) and the moduli."""
        return namespace(self.here.slides).concat([0 * self.here.by_slides, self._capacity[1].slopes])

    @cached_property
    def _by_log_modulus(self) -> Float[Array, " k"]:
        """The gradient of log M."""
        return self._pull * (-2 * self._capacity[0] / self.here.count)

    @cached_property
    def _gradient(self) -> Float[Array, " k"]:
        """The gradient of E − λT."""
        return self.here.gradient[0] - self.multiplier * self._pull

    def _residual(self, log_modulus: float) -> float:
        """Residual of the equations of the path at a given log M."""
        slides, moduli = self._gradient[: self.here.count], self._gradient[self.here.count :]
        along = math.sqrt(square(slides).mean() / square(self.here.normal).sum(-1).mean())
        return max(along, float(abs(moduli).max() / self.here.energy[0]), abs(self.log_modulus - log_modulus))

    @cached_property
    def _steps(self) -> Float[Array, "2 k"]:
        """Newton's step at fixed λ, and the derivative of the step with respect to λ."""
        matrix, count = self.here.matrix(), self.here.count
        matrix[count:, count:] -= self.multiplier * self._capacity[1].hessian
        xp = namespace(matrix)
        return xp.linalg.solve(matrix, xp.stack([-self._gradient, self._pull], axis=1)).mT

    @cached_property
    def rise(self) -> float:
        """dλ/d log M along the path."""
        return 1 / float(self._by_log_modulus @ self._steps[1])

    def at(self, log_modulus: float) -> _OnPath | None:
        """The point at a given log M, by Newton's method, or None if that does not converge."""
        near, before = self, math.inf
        for _ in range(MOST_STEPS):
            size = near._residual(log_modulus)
            if size < SMALL:
                return near
            # slower convergence is not Newton's
            if not size < before / 2:
                break
            before = size
            step, by_multiplier = near._steps
            change = (log_modulus - near.log_modulus - float(near._by_log_modulus @ step)) * near.rise
            there = near.here.stepped((step + change * by_multiplier)[None])
            near = _OnPath(here=there, multiplier=near.multiplier + change)
        return None


def _followed(start: _OnPath, sign: int) -> tuple[list[_OnPath], bool]:
    """The points on one side, and whether they end there, not because steps are spent.

    They end where the surface degenerates or the nodes do not resolve the gaps between circles.
    """
    found, here, step = [], start, LARGEST_STEP
    for _ in range(MOST_STEPS):
        require_time()
        if step < SMALL:
            break
        there = here.at(here.log_modulus + sign * step)
        if there is None:
            step /= 2
            continue
        # the highest frequency of the nodes decays across the narrowest gap, by e^π at least
        is_resolved = -math.log(there.here.domain.nearness) >= 2 * math.pi / there.here.form.steps
        if there.here.falls_apart or not is_resolved:
            break
        found.append(there)
        here, step = there, min(2 * step, LARGEST_STEP)
    else:
        return found, False
    return found, True


def _least(low: _OnPath, high: _OnPath) -> _OnPath:
    """The point of least |λ| between two points."""
    ends = low, high
    log = brentq(lambda log: _from_nearer(ends, log).rise, low.log_modulus, high.log_modulus, xtol=SMALL)
    return _from_nearer(ends, log)


def _zero(problem: RimsProblem, low: _OnPath, high: _OnPath) -> HarmonicSurface:
    """The critical point of E between two points: Newton's method from an interpolated point, with bisection."""
    while True:
        share = low.multiplier / (low.multiplier - high.multiplier)
        width = high.log_modulus - low.log_modulus
        middle = _from_nearer((low, high), low.log_modulus + min(max(share, 0.1), 0.9) * width)
        found = problem.stationary(middle.here, saddles=True)
        is_between = low.log_modulus <= _OnPath.near(found).log_modulus <= high.log_modulus
        if middle in (low, high) or width < SMALL or (is_between and float(found.size[0]) < SMALL):
            return found
        low, high = (middle, high) if middle.multiplier * low.multiplier > 0 else (low, middle)


def _from_nearer(points: tuple[_OnPath, _OnPath], log_modulus: float) -> _OnPath:
    """The point at a given log M, by Newton's method from the nearer of two points, or that point if it fails."""
    nearest = min(points, key=lambda point: abs(point.log_modulus - log_modulus))
    return nearest.at(log_modulus) or nearest
