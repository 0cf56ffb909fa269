"""All critical points of Douglas's energy over two rims: the zeros of dE*/d log m.

E*(m), the least energy over the slides, is a function of one variable that tells all: its minima are annuli that no
change of the modulus makes smaller, its maxima are unstable ones, and where it only falls there is no annulus: the
surface degenerates to two disks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.douglas_rims import MOST_MODULUS, RimsProblem
from spinor_geom.plateau.rim_starts import LEAST_MODULUS
from spinor_geom.plateau.rims_energy import HarmonicSurface

# Steps of the logarithm of the modulus in the search for sign changes of dE*/d log m.
_STEP = 0.3
# A slide of one modulus is a start for the next to this gradient; two digits more decide on a sign.
_COARSE, _FINE = 1e-5, 1e-9
# Interval of log m, and steps, at which the search for the place where E* falls least ends.
_NARROW, _MOST_HALVINGS = 1e-6, 60
_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ModuliSearch:
    """The critical points over two rims.

    Attributes:
        problem: of the two rims.
        start: a surface between them.
    """

    problem: RimsProblem
    start: HarmonicSurface

    def all_critical(self) -> tuple[HarmonicSurface, ...]:
        """All annuli that a grid of moduli shows as zeros of dE*/d log m, by modulus; none where E* only falls.

        Raises:
            SurfaceError: the nodes crowd, or E* rises from the least modulus on that n nodes resolve: annuli of lower
                ones may exist.
        """
        found: list[HarmonicSurface] = []
        traced = self._traced()
        if any(surface.crowded for surface in traced):
            raise SurfaceError(
                "the nodes crowd on the rims: the gap between them is too long or too uneven for a round annulus, and "
                "none was found"
            )
        if traced[0].slope > 0:
            raise SurfaceError(
                f"the gap between the rims is too narrow for their length: {self.start.slides.shape[1]} nodes on each "
                "do not resolve it, and no annulus was found; divide the gap by a few edges between the rims and fill "
                "the holes that result"
            )
        for before, after in pairwise(traced):
            if before.slope * after.slope <= 0:
                found.append(self._between(before, after))
        for left, middle, right in zip(traced, traced[1:], traced[2:], strict=False):
            if max(left.slope, middle.slope, right.slope) < 0 and middle.slope >= max(left.slope, right.slope):
                found += self._near_fold(left, middle, right)
        return tuple(sorted(found, key=lambda surface: surface.log_modulus))

    def _traced(self) -> list[HarmonicSurface]:
        """The least energy for one modulus after the other, from the least whose rims n nodes resolve.

        The way goes down and up from the start. Below it, where the energy rises, rims that are far apart may collapse
        to points of them; there is no annulus beyond.
        """
        least = max(math.log(LEAST_MODULUS), math.log(2 * math.pi / self.start.slides.shape[1]))
        most = math.log(MOST_MODULUS)
        middle = self._fixed(self.start, min(max(self.start.log_modulus, least), most))
        below, above = [middle], [middle]
        while (log := below[-1].log_modulus - _STEP) >= least:
            surface = self._fixed(below[-1], log)
            if surface.crowded and surface.slope < 0 and not middle.crowded:
                break
            below.append(surface)
        while (log := above[-1].log_modulus + _STEP) <= most:
            above.append(self._fixed(above[-1], log))
        return [*below[:0:-1], *above]

    def _fixed(self, near: HarmonicSurface, log_modulus: float, tolerance: float = _COARSE) -> HarmonicSurface:
        ring = CircularDomain.annulus(math.exp(log_modulus), near.slides.device)
        start = self.problem.at(near.slides, ring)
        surface = self.problem.descended(start, tolerance=tolerance, fixed=True)
        assert surface is not None  # a modulus that stays does not run away
        return surface

    def _between(self, before: HarmonicSurface, after: HarmonicSurface) -> HarmonicSurface:
        """The critical point between two moduli with slopes of different signs."""
        low, high = before, after
        for _ in range(_MOST_HALVINGS):
            share = low.slope / (low.slope - high.slope)
            share = min(max(share, 0.1), 0.9)
            middle = self._fixed(low, low.log_modulus + share * (high.log_modulus - low.log_modulus), _FINE)
            if middle.slope * low.slope > 0:
                low = middle
            else:
                high = middle
            exact = self.problem.critical(middle)
            width = high.log_modulus - low.log_modulus
            inside = low.log_modulus - width <= exact.log_modulus <= high.log_modulus + width
            if (inside and max(exact.gradient, abs(exact.slope)) < _FINE) or width < _NARROW:
                return exact
        return exact

    def _near_fold(
        self, left: HarmonicSurface, middle: HarmonicSurface, right: HarmonicSurface
    ) -> list[HarmonicSurface]:
        """Two critical points between moduli with negative slopes, where the largest slope between them is positive."""
        low, high = left.log_modulus, right.log_modulus
        a, b = (self._fixed(middle, low + share * (high - low), _FINE) for share in (1 - _GOLDEN, _GOLDEN))
        while high - low > _NARROW:
            best = max(a, b, key=lambda surface: surface.slope)
            if best.slope > 0:
                return [self._between(left, best), self._between(best, right)]
            if a.slope > b.slope:
                high, b = b.log_modulus, a
                a = self._fixed(b, high - _GOLDEN * (high - low), _FINE)
            else:
                low, a = a.log_modulus, b
                b = self._fixed(a, low + _GOLDEN * (high - low), _FINE)
        return []
