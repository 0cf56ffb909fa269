"""The fit of harmonic disks to their curves with as many nodes as the tolerance asks for, of several loops at once."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, minimise_dirichlet_energies, resampled
from spinor_geom.plateau.lift import WORTHWHILE, Lift, lifted_together
from spinor_geom.plateau.newton import MOST_STEPS
from spinor_geom.plateau.problem import CurveTensors

if TYPE_CHECKING:
    from spinor_geom.plateau.harmonic_route import HarmonicSolver

# Nodes of the loops that are fitted as one batch, 64 short ones: half as many take an eighth longer.
_BATCH_NODES = 16384


@dataclass(kw_only=True, eq=False)
class Fit:
    """One loop's fit on an Ω, on its way.

    Attributes:
        solver: of the loop.
        form: of Ω.
        slide: to start from, then the last one that was found.
        nodes: to begin with, then those that are tried next.
        best: the nearest surface so far, and the harmonic disk that it was lifted from.
        limit: why it is over, as the end of a sentence; "" while it is not.
        attempt: number of those before.
    """

    solver: HarmonicSolver
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
        # without a lift more nodes may tell the sheets apart
        is_better = self.attempt == 0 or (lift is not None and lift.misfit.rms < WORTHWHILE * before)
        if lift is not None and lift.misfit.rms < before:
            self.best = lift, disk
        if not is_better or (self.best is not None and self.solver.is_enough(self.best[0].misfit)):
            self.limit = "more nodes on the domain's boundary do not help"
        elif self.nodes >= self.solver.most_nodes:
            self.limit = f"{self.nodes} nodes are the most that are tried"
        elif self.solver.task.steps.are_spent:
            self.limit = "the limit on steps or on time was reached"
        else:
            self.attempt += 1
            self.nodes = even(min(self.solver.most_nodes, 2 * self.nodes))

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
            together = max(1, _BATCH_NODES // group[0].nodes)
            for start in range(0, len(group), together):
                _advance(group[start : start + together])


def _advance(fits: Sequence[Fit]) -> None:
    """One more attempt of fits that ask for as many nodes on one Ω."""
    begin = time.perf_counter()
    form, nodes = fits[0].form, fits[0].nodes
    curves = CurveTensors.batch([fit.solver.exact for fit in fits])
    disks = minimise_dirichlet_energies(
        curves,
        form,
        torch.stack([resampled(fit.slide, nodes) for fit in fits]),
        tolerances=[fit.solver.fine_gradient for fit in fits],
        max_steps=[min(MOST_STEPS, fit.solver.task.steps.left) for fit in fits],
        near=fits[0].is_near,
        negligible=[fit.solver.negligible_energy for fit in fits],
        on_step=[fit.solver.take for fit in fits],
    )
    middle = time.perf_counter()
    whole = [i for i, disk in enumerate(disks) if not disk.crowded]
    lifts: dict[int, Lift | None] = {}
    if whole:
        of_whole = curves if len(whole) == len(fits) else CurveTensors.batch([fits[i].solver.exact for i in whole])
        found = lifted_together(
            [disks[i] for i in whole], form, of_whole, allowed=[fits[i].solver.task.allowed for i in whole]
        )
        lifts = dict(zip(whole, found, strict=True))
    end = time.perf_counter()
    for i, (fit, disk) in enumerate(zip(fits, disks, strict=True)):
        fit.solver.task.clock.add("slide", (middle - begin) / len(fits))
        fit.solver.task.clock.add("lift", (end - middle) / len(fits))
        fit.take(disk, lifts.get(i))


def even(nodes: int) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
