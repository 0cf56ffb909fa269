"""A request with the solvers of its routes, which several routes share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from spinor_geom.discrete.area_descent import Disk
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.harmonic_fit import Fit
from spinor_geom.plateau.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network_route import NetworkSolver, rim_indices
from spinor_geom.plateau.request import Request
from spinor_geom.plateau.rims import RimsSolver
from spinor_geom.plateau.solutions import Rim


@dataclass(frozen=True, kw_only=True, eq=False)
class Task(Request):
    """Loops to be spanned."""

    on_disk: Fit | None = None  # the fit on the unit disk, where it was made together with those of other loops
    first_disk: Disk | None = None  # the first discrete disk, likewise

    def anew(self) -> Task:
        """The same loops, with no steps and no time taken."""
        return replace(self, steps=replace(self.steps, history=[]), clock=Clock(), on_disk=None)

    @property
    def rim(self) -> Rim:
        """The loop of a disk with the points that discrete disks over it have."""
        return Rim(loop=self.loop, indices=rim_indices(self.unit))

    @cached_property
    def network(self) -> NetworkSolver:
        """Of one loop's or two loops' Cauchy network."""
        return NetworkSolver(request=self)

    @cached_property
    def harmonic(self) -> HarmonicSolver:
        """Of Douglas's slide of one loop."""
        return HarmonicSolver(request=self)

    @cached_property
    def rims(self) -> RimsSolver:
        """Of several loops."""
        return RimsSolver(
            loops=self.units,
            curves=self.curves,
            options=self.options,
            allowed=self.allowed,
            steps=self.steps,
            clock=self.clock,
        )
