"""The fit of harmonic disks to their curves with as many nodes as the tolerance asks for, of several loops at once."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, minimise_dirichlet_energies, resampled
from spinor_geom.plateau.lift import WORTHWHILE, Lift, lifted_together
from spinor_geom.plateau.newton import MOST_STEPS
from spinor_geom.plateau.problem import CurveTensors

# Nodes of the loops that are fitted as one batch, 64 short ones: half as many take an eighth longer.
_BATCH_NODES = 16384


@dataclass(kw_only=True, eq=False)
class Fit:
    """One loop's fit on an Ω, on its way.

    Attributes:
        curve: Γ, at unit size.
        form: of Ω.
        slide: to start from.
        nodes: to begin with.
        most_nodes: that are tried.
        is_rough: whether the loop is.
        allowed: RMS distance from Γ to reach.
        enough: RMS distance at which more nodes are not tried.
        mean_edge: of the loop.
        gradient: at which a slide stops.
        negligible: fall of the energy at which it stops, too.
        steps_left: gives the limit on Newton steps.
        on_step: is called with the gradient at each step.
        clock: of the stages.
        best: the nearest surface so far, and the harmonic disk that it was lifted from.
        limit: why it is over, as the end of a sentence; "" while it is not.
    """

    curve: CurveTensors
    form: DirichletForm
    slide: Float[Tensor, " n"]
    nodes: int
    most_nodes: int
    is_rough: bool
    allowed: float
    enough: float
    mean_edge: float
    gradient: float
    negligible: float
    steps_left: Callable[[], int]
    on_step: Callable[[float], None]
    clock: Clock
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
        # without a lift more nodes may tell the sheets apart
        is_better = self.attempt == 0 or (lift is not None and lift.misfit.rms < WORTHWHILE * before)
        if lift is not None and lift.misfit.rms < before:
            self.best = lift, disk
        is_met = self.best is not None and self._excess(self.best[0], self.enough) <= 1
        if is_met or not is_better:
            self.limit = "more nodes on the domain's boundary do not help"
        elif self.nodes >= self.most_nodes:
            self.limit = f"{self.nodes} nodes are the most that are tried"
        elif not self.steps_left() or is_out_of_time():
            self.limit = "the limit on steps or on time was reached"
        else:
            self.attempt += 1
            self.nodes = even(min(self.most_nodes, 2 * self.nodes))

    @property
    def is_near(self) -> bool:
        """Whether its slide is near to a solution."""
        return self.attempt > 0 and not self.is_rough

    def _excess(self, lift: Lift, allowed: float) -> float:
        return lift.misfit.excess(allowed=allowed, tolerance=allowed / self.mean_edge)


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
            together = max(1, _BATCH_NODES // group[0].nodes)
            for start in range(0, len(group), together):
                _advance(group[start : start + together])


def _advance(fits: Sequence[Fit]) -> None:
    """One more attempt of fits that ask for as many nodes on one Ω."""
    begin = time.perf_counter()
    form, nodes = fits[0].form, fits[0].nodes
    curves = CurveTensors.batch([fit.curve for fit in fits])
    disks = minimise_dirichlet_energies(
        curves,
        form,
        torch.stack([resampled(fit.slide, nodes) for fit in fits]),
        tolerances=[fit.gradient for fit in fits],
        max_steps=[min(MOST_STEPS, fit.steps_left()) for fit in fits],
        near=fits[0].is_near,
        negligible=[fit.negligible for fit in fits],
        on_step=[fit.on_step for fit in fits],
    )
    middle = time.perf_counter()
    whole = [i for i, disk in enumerate(disks) if not disk.crowded]
    lifts: dict[int, Lift | None] = {}
    if whole:
        of_whole = curves if len(whole) == len(fits) else CurveTensors.batch([fits[i].curve for i in whole])
        found = lifted_together([disks[i] for i in whole], form, of_whole, allowed=[fits[i].allowed for i in whole])
        lifts = dict(zip(whole, found, strict=True))
    end = time.perf_counter()
    for i, (fit, disk) in enumerate(zip(fits, disks, strict=True)):
        fit.clock.add("slide", (middle - begin) / len(fits))
        fit.clock.add("lift", (end - middle) / len(fits))
        fit.take(disk, lifts.get(i))


def even(nodes: int) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
