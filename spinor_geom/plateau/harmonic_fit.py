"""The fit of harmonic disks to their curves with as many nodes as the tolerance asks for, of several loops at once."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, minimise_dirichlet_energies, resampled
from spinor_geom.plateau.lift import WORTHWHILE, Lift, lifted_together
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.newton import MOST_STEPS
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.request import Request
from spinor_geom.plateau.roughness import ROUGH_GRADIENT, is_rough, negligible_energy

# Nodes of the loops that are fitted as one batch, and held in memory: half as many take an eighth longer.
BATCH_NODES = 16384
# Most nodes for each edge: beyond rough loops take minutes, and smooth ones gain nothing.
_MOST_PER_EDGE = 64
# Nodes for each edge of rough loops below which chance decides how near a surface comes.
_TELLING_PER_EDGE = 4
# Nodes of short loops on the disk: many loops have as many nodes, and are fitted together.
FEWEST_NODES = 256
# Gradient of the energy, relative to its factors, at which a coarse solve stops, and that is rounding error. Between
# them a solve goes on to a share of the tolerance, on smooth loops as small a one: each step doubles the digits.
COARSE, _ROUNDING = 1e-4, 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class Aims:
    """What the slides over one loop go on to."""

    request: Request

    @cached_property
    def exact(self) -> CurveTensors:
        """Γ."""
        return CurveTensors.of(self.request.curve, self.request.options.device)

    @cached_property
    def is_rough(self) -> bool:
        """Whether the loop is."""
        return is_rough(self.request.unit, self.request.curve)

    @property
    def fine_gradient(self) -> float:
        """At which a slide along Γ itself stops."""
        if self.request.options.is_series:
            return _ROUNDING
        share = ROUGH_GRADIENT if self.is_rough else COARSE
        return float(np.clip(share * self.request.options.tolerance, _ROUNDING, COARSE))

    @property
    def most_nodes(self) -> int:
        """That are tried."""
        return even(max(4 * FEWEST_NODES, _MOST_PER_EDGE * len(self.request.unit)))

    def is_enough(self, misfit: Misfit) -> bool:
        """Whether more nodes are not tried; rounding error is asked for where the curve itself has no other."""
        allowed = self.request.allowed
        if self.request.options.is_series and self.request.curve.degree > max(DEGREES):
            allowed = min(allowed, _ROUNDING)
        return misfit.excess(allowed=allowed, tolerance=allowed / self.request.unit.mean_edge_length) <= 1

    @property
    def negligible_energy(self) -> float:
        """At a fall below which a slide stops, too."""
        return negligible_energy(len(self.request.unit), self.request.allowed) if self.is_rough else 0.0

    def take(self, gradient: float) -> None:
        """Takes down a step."""
        self.request.steps.take("Douglas-Newton", gradient)


@dataclass(kw_only=True, eq=False)
class Fit:
    """One loop's fit on an Ω, on its way.

    Attributes:
        aims: of the loop.
        form: of Ω.
        slide: to start from, then the last one that was found.
        nodes: to begin with, then those that are tried next.
        best: the nearest surface so far, and the harmonic disk that it was lifted from.
        limit: why it is over, as the end of a sentence; "" while it is not.
        attempt: number of those before.
    """

    aims: Aims
    form: DirichletForm
    slide: Float[Tensor, " n"]
    nodes: int
    best: tuple[Lift, HarmonicDisk] | None = None
    limit: str = ""
    attempt: int = 0

    def take(self, disk: HarmonicDisk, lift: Lift | None) -> None:
        """Takes the disk that was found with the nodes that were asked for, and its lift, if it has one."""
        if disk.crowded:
            self.limit = "the nodes crowd on the domain's boundary"
            return
        self.slide = disk.slide
        before = math.inf if self.best is None else self.best[0].misfit.rms
        share = WORTHWHILE
        if self.aims.is_rough:
            share = 1.0 if self.nodes >= _TELLING_PER_EDGE * len(self.aims.request.unit) else math.inf
        # without a lift more nodes may tell the sheets apart
        may_lift = self.attempt == 0 or self.aims.is_rough
        is_better = may_lift if lift is None else lift.misfit.rms < share * before
        if lift is not None and lift.misfit.rms < before:
            self.best = lift, disk
        if not is_better or (self.best is not None and self.aims.is_enough(self.best[0].misfit)):
            self.limit = "more nodes on the domain's boundary do not help"
        elif self.nodes >= self.aims.most_nodes:
            self.limit = f"{self.nodes} nodes are the most that are tried"
        elif self.aims.request.steps.are_spent:
            self.limit = "the limit on steps or on time was reached"
        else:
            self.attempt += 1
            self.nodes = even(min(self.aims.most_nodes, 2 * self.nodes))

    @property
    def near_enough(self) -> float:
        """Distance from Γ that its lift need not lessen: to smooth loops more nodes bring it far nearer, and sooner."""
        return math.inf if self.attempt == 0 and not self.aims.is_rough else self.aims.request.allowed

    @property
    def is_near(self) -> bool:
        """Whether its slide is near to a solution."""
        return self.attempt > 0


def fit_together(fits: Sequence[Fit]) -> None:
    """Goes on with fits until they are over, those on the unit disk with as many nodes as one batch.

    Args:
        fits: they do not know of each other.
    """
    left = list(fits)
    while left := [fit for fit in left if not fit.limit]:
        alike: dict[tuple[object, ...], list[Fit]] = defaultdict(list)
        for fit in left:
            alike["disk" if fit.form.is_disk else id(fit.form), fit.nodes, fit.is_near].append(fit)
        for group in alike.values():
            together = max(1, BATCH_NODES // group[0].nodes)
            for start in range(0, len(group), together):
                _advance(group[start : start + together])


def _advance(fits: Sequence[Fit]) -> None:
    """One more attempt of fits that ask for as many nodes on one Ω."""
    begin = time.perf_counter()
    form, nodes = fits[0].form, fits[0].nodes
    curves = CurveTensors.batch([fit.aims.exact for fit in fits])
    disks = minimise_dirichlet_energies(
        curves,
        form,
        torch.stack([resampled(fit.slide, nodes) for fit in fits]),
        tolerances=[fit.aims.fine_gradient for fit in fits],
        max_steps=[min(MOST_STEPS, fit.aims.request.steps.left) for fit in fits],
        near=fits[0].is_near,
        negligible=[fit.aims.negligible_energy for fit in fits],
        on_step=[fit.aims.take for fit in fits],
    )
    middle = time.perf_counter()
    whole = [i for i, disk in enumerate(disks) if not disk.crowded]
    lifts: dict[int, Lift | None] = {}
    if whole:
        of_whole = curves if len(whole) == len(fits) else CurveTensors.batch([fits[i].aims.exact for i in whole])
        found = lifted_together([disks[i] for i in whole], form, of_whole, allowed=[fits[i].near_enough for i in whole])
        lifts = dict(zip(whole, found, strict=True))
    end = time.perf_counter()
    for i, (fit, disk) in enumerate(zip(fits, disks, strict=True)):
        fit.aims.request.clock.add("slide", (middle - begin) / len(fits))
        fit.aims.request.clock.add("lift", (end - middle) / len(fits))
        fit.take(disk, lifts.get(i))


def even(nodes: int) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
