"""One loop to be spanned by a minimal disk: the loop and Γ at unit size, and what all routes to the disk share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from spinor_geom.errors import OptionError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.intersections import require_simple
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_fit import Fit
from spinor_geom.plateau.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network_route import Budget, NetworkSolver, rim_indices
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.solution import BoundaryResidual, Iteration, PlateauSolution, RimMatch
from spinor_geom.plateau.solutions import Rim
from spinor_geom.plateau.steps import Steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A loop, Γ through it, and how the disk is asked for.

    Attributes:
        loop: as it was given.
        unit: the loop with its centroid at 0 and diagonal 1, where every tolerance is a ratio.
        curve: Γ, at unit size.
        options: of the call.
        steps: of all routes.
        clock: of their stages.
        on_disk: the fit on the unit disk, where it was made together with those of other loops.
    """

    loop: BoundaryLoop
    unit: BoundaryLoop
    curve: BoundaryCurve
    options: Options
    steps: Steps
    clock: Clock = field(default_factory=Clock)
    on_disk: Fit | None = None

    @classmethod
    def of(
        cls,
        given: BoundaryLoop | ClosedCurve,
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> Task:
        """The task of a loop or a curve in formulas.

        Raises:
            OptionError: a model for two loops.
            SelfCrossingLoopError: the loop crosses or touches itself.
            RepeatedPointError: two neighbouring points of the loop are equal.
            CurveError: the formulas are not those of a smooth closed curve.
        """
        if options.laurent is not None:
            raise OptionError("Laurent series span two loops; use model='auto' or 'series' for one")
        loop, formula = (given, None) if isinstance(given, BoundaryLoop) else sampled_formula(given)
        require_simple(loop)
        unit = _at_unit_size(loop)
        curve = BoundaryCurve.from_loop(unit) if formula is None else formula.placed(unit.points, 1 / loop.diagonal)
        steps = Steps(limit=options.max_iterations, on_iteration=on_iteration)
        return cls(loop=loop, unit=unit, curve=curve, options=options, steps=steps)

    @classmethod
    def over(cls, loop: BoundaryLoop, curve: BoundaryCurve, options: Options) -> Task:
        """The task of a loop that is known to be simple, with Γ through it at any size and place."""
        unit = _at_unit_size(loop)
        size = float(np.linalg.norm(np.ptp(curve.coefficients[-1], axis=0)))
        curve = curve.placed(unit.points, unit.diagonal / size)
        return cls(loop=loop, unit=unit, curve=curve, options=options, steps=Steps(limit=options.max_iterations))

    def anew(self) -> Task:
        """The same loop, with no steps and no time taken."""
        return replace(self, steps=replace(self.steps, history=[]), clock=Clock(), on_disk=None)

    @property
    def allowed(self) -> float:
        """RMS distance from Γ that is allowed, at unit size."""
        return self.options.tolerance * self.unit.mean_edge_length

    @property
    def rim(self) -> Rim:
        """The loop with the points that discrete disks over it have."""
        return Rim(loop=self.loop, indices=self.network.rim)

    @cached_property
    def network(self) -> NetworkSolver:
        """Of a Cauchy network."""
        return NetworkSolver(
            loop=self.unit,
            rim=rim_indices(self.unit),
            curve=self.curve,
            options=self.options.cauchy,
            budget=Budget(
                allowed=self.allowed,
                tolerance=self.options.tolerance,
                max_iterations=self.steps.limit,
                on_iteration=self.steps.take,
            ),
            device=self.options.device,
            clock=self.clock,
        )

    @cached_property
    def harmonic(self) -> HarmonicSolver:
        """Of Douglas's slide."""
        return HarmonicSolver(
            loop=self.unit,
            curve=self.curve,
            allowed=self.allowed,
            steps=self.steps,
            device=self.options.device,
            clock=self.clock,
            to_rounding=self.options.is_series,
            begun=self.on_disk,
        )

    def is_met(self, found: Found) -> bool:
        """Whether a disk is as near to Γ as it was asked to be."""
        return found.misfit.excess(allowed=self.allowed, tolerance=self.options.tolerance) <= 1

    def solution(self, found: Found) -> PlateauSolution:
        """A disk in the loop's coordinates."""
        loop = self.loop
        with self.clock.stage("surface"):
            surface = found.surface.transform(scale=loop.diagonal, translation=loop.centroid)
        residual = BoundaryResidual.of(
            found.misfit.enlarged(loop.diagonal), mean_edge=loop.mean_edge_length, diagonal=loop.diagonal
        )
        converged, reason = residual.verdict(self.options.tolerance, steps=len(found.history), limit=found.limit)
        rim = RimMatch(
            loop=loop,
            curve=found.curve.placed(loop.points, loop.diagonal),
            boundary=surface.domain.boundary,
            matching=found.matching,
        )
        return PlateauSolution(
            surface=surface,
            rims=(rim,),
            domain=surface.domain,
            boundary_residual=residual,
            area=found.area * loop.diagonal**2,
            route=found.route,
            history=found.history,
            solve_timings=dict(self.clock.seconds),
            tolerance=self.options.tolerance,
            converged=converged,
            reason=reason,
            # a plane disk is its Ω, whose boundary was found to be simple
            evidence=Evidence(surface=surface, is_plane=found.route == "plane"),
        )


def _at_unit_size(loop: BoundaryLoop) -> BoundaryLoop:
    return BoundaryLoop(
        points=(loop.points - loop.centroid) / loop.diagonal, vertex_ids=loop.vertex_ids, corners=loop.corners
    )


def sampled_formula(given: ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve]:
    """The polynomials of a curve in formulas, and the loop of their ends."""
    curve = BoundaryCurve.from_formula(given)
    return BoundaryLoop.from_points(curve.coefficients[-1], corners=np.flatnonzero(curve.corners)), curve
