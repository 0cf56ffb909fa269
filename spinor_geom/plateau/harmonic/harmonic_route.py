"""Minimal disks over loops without corners: Douglas's method on a smooth Ω, then the lift to p and q.

Smooth loops take milliseconds. The cost grows as n·log n with the number n of nodes.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len

from spinor_geom.arrays import Array, namespace, to_numpy
from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.minimal_surface import finer_disk, first_disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm
from spinor_geom.plateau.harmonic.douglas import HarmonicDisk, minimise_dirichlet_energies, resampled, slide_downhill
from spinor_geom.plateau.harmonic.lift import WORTHWHILE, Lift, lifted_together
from spinor_geom.plateau.harmonic.lifted_surface import domain_of, surface_of
from spinor_geom.plateau.harmonic.smooth_domain import COARSE, NodeDensity, resolved
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.newton import MOST_STEPS, ROUNDING
from spinor_geom.plateau.problem import PlateauProblem, Route, start_indices
from spinor_geom.plateau.roughness import ROUGH_GRADIENT, is_predicted, is_rough, negligible_energy
from spinor_geom.plateau.route_result import RouteResult, typed_failures
from spinor_geom.plateau.solution import RouteName
from spinor_geom.plateau.steps import SPENT

# Fewest points that define Ω. Solves between rims begin with them. Pairs of rims take a third longer with 16, and a
# sixth longer with 64.
FEWEST_POINTS = 32
BATCH_NODES = 16384  # nodes of all loops in one batch. Half of it takes an eighth longer
# Largest number of nodes per edge. Loops that need more are left to other routes: with 64 noisy ones take a tenth
# longer, and one of sixty random loops converges here.
_MOST_PER_EDGE = 16
# The same where Γ is given between the points, or they are too many for a surface through them: 5,000 noisy points need
# more than 16, and so do formulas with jumps of the curvature, and splines through rims of scans.
_MOST_PER_EDGE_OF_KNOWN = 64
# Nodes of short loops on the disk, so that many loops fit in one batch, and twice the most points that define Ω, for
# which Λ costs O(n³). With half as many ellipses keep 4e-4 of an edge instead of 3e-7, and solves take 6 % more steps.
FEWEST_NODES = 256
# Distance of a coarse surface over a smooth loop, in edges, beyond which a finer disk is flattened. Of 106 random loops
# that have less, all but one converge on the first Ω. Of 31 that have more, 5 do, and 9 on the Ω of the finer disk. A
# finer slide with as many nodes may bring the surface nearer. If it is still beyond, more nodes do not help.
_FAR = 0.01
_NO_HELP = "more nodes on the domain's boundary do not help"
_WOULD_NOT_MEET = "more nodes on the domain's boundary would not meet the tolerance"
Lifted: TypeAlias = tuple[Lift, HarmonicDisk]  # a surface, and the harmonic disk that it was lifted from


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSolver:
    """Finds minimal disks on the unit disk, or on a smooth domain fitted to a flattened discrete disk."""

    problem: PlateauProblem

    def on_unit_disk(self, begun: DiskFit | None = None) -> RouteResult:
        """The minimal disk on the unit disk, from a fit that was run in a batch, or from a new one."""
        refusal = DomainError(
            "power series on the disk do not converge on loops with corners or on long narrow loops; use model='auto'",
            vertices=len(self.problem.unit),
        )
        if self.problem.unit.corners.any():
            raise refusal
        try:
            return self._fitted(begun or self._begin(), "disk")
        except DomainError as error:
            raise refusal from error

    def below_on_disk(self, matching: Float[np.ndarray, "n 2"]) -> RouteResult | None:
        """A minimal disk of less area, by descent from an unstable one on the unit disk, or None if none is found."""
        slide = self.problem.options.place.put(matching[:, 1])
        # `slide_downhill` costs O(n³)
        few = resampled(slide, min(len(slide), 2 * FEWEST_NODES))
        try:
            with typed_failures():
                start = slide_downhill(self.exact, self._unit_disk, few)
            return None if start is None else self._fitted(self._fit(self._unit_disk, start), "disk")
        except (DomainError, SingularMatrixError):
            return None

    def on_flattening(self) -> RouteResult:
        """The minimal disk on a smooth Ω fitted to a flattened discrete disk: the problem's start, or a first fill.

        If the surface on it is far from Γ, a finer discrete disk is flattened.
        """
        disk = self.problem.start
        if disk is not None:
            t = self._density.parameter(self.problem.curve.breaks[start_indices(self.problem.unit)])
            return self._fitted(self._on_flattened(disk, t), "flattened")
        t = np.arange(self._density.points) / self._density.points
        with self.problem.clock.stage("first fill"):
            disk = first_disk(self.problem.curve.point(self._density.slide(t)))
        try:
            fit = self._on_flattened(disk, t)
        except DomainError:
            if self.is_rough:
                raise
            return self._fitted(self._on_finer(disk, t), "flattened")
        if not self.is_rough and self._distance(begun := self._begun(fit)) > _FAR:
            try:
                finer = self._on_finer(disk, t)
                if self._distance(nearer := self._begun(finer)) < self._distance(begun):
                    fit, begun = finer, nearer
            except (DomainError, SingularMatrixError, OutOfTimeError):
                if begun is None:
                    raise
            # the surface through the points takes less time, and Γ between them is not known
            if self._is_unknown and self._distance(begun) > _FAR:
                fit.best, fit.limit = begun, _WOULD_NOT_MEET
        return self._fitted(fit, "flattened")

    def _on_finer(self, disk: Disk, t: Float[np.ndarray, " k"]) -> DiskFit:
        """A fit on a smooth Ω fitted to a flattened finer disk.

        Raises:
            DomainError: its harmonic surface is far from a minimal one, so that p and q do not close up.
        """
        with self.problem.clock.stage("first fill"):
            finer = finer_disk(disk, len(t))
        fit = self._on_flattened(finer, t)
        if self._begun(fit) is None:
            raise DomainError(
                "the domain is too far from conformal for a minimal disk", vertices=len(self.problem.unit)
            )
        return fit

    def _begun(self, fit: DiskFit) -> Lifted | None:
        """The surface of a fit's start, or None if p and q change sign around a branch point."""
        start = HarmonicDisk(slide=fit.slide, points=self.exact.point_and_derivative(fit.slide)[0], crowded=False)
        (lift,) = lifted_together([start], fit.form, CurveTensors.batch([self.exact]), allowed=[math.inf])
        return None if lift is None else (lift, start)

    def _distance(self, begun: Lifted | None) -> float:
        """Distance of a start's surface from Γ, in edges, or infinite if there is none."""
        return math.inf if begun is None else self._in_edges(begun[0].misfit)

    def _on_flattened(self, disk: Disk, t: Float[np.ndarray, " k"]) -> DiskFit:
        """A fit on the smooth Ω fitted to a flattened disk with boundary parameters t, from a coarse slide."""
        unit, place = self.problem.unit, self.problem.options.place
        with self.problem.clock.stage("flattening"):
            polygon = flatten(disk.vertices, disk.faces, len(t)).boundary
            # Ω has at least one point per vertex
            is_fine = self.is_rough and len(unit) <= self._density.points
            shape, form = resolved(
                polygon,
                t,
                self._density,
                is_fine,
                count=points_of_domain(unit),
                most=self.most_nodes,
                place=place,
                is_unknown=self._is_unknown,
            )
        start = place.put(self._density.slide(np.arange(shape.steps) / shape.steps))
        with self.problem.clock.stage("slide"):
            curve = self.exact
            if self.is_rough and not is_fine:
                # smoothed, because Ω has too few nodes to resolve the curvature of Γ
                curve = CurveTensors.of(self.problem.curve.smoothed(1 / self._density.points), place)
            (found,) = minimise_dirichlet_energies(
                CurveTensors.batch([curve]),
                form,
                start[None],
                tolerances=[COARSE],
                max_steps=[self.most_steps],
                negligible=[self.negligible_energy(form)],
                on_step=[self.take],
            )
        if found is None:
            raise OutOfTimeError
        if found.crowded:
            raise DomainError("the nodes crowd on the domain's boundary", vertices=len(unit))
        return self._fit(form, found.slide)

    @cached_property
    def _is_unknown(self) -> bool:
        """Whether Γ between the points of a loop that is not rough is not known, so that it may be free."""
        return self.problem.may_be_free and not self.is_rough and not is_predicted(self.problem.unit)

    @cached_property
    def _density(self) -> NodeDensity:
        return NodeDensity(self.problem.curve, points_of_domain(self.problem.unit))

    @property
    def _unit_disk(self) -> DirichletForm:
        return DirichletForm.of_disk(points_of_domain(self.problem.unit))

    def _begin(self) -> DiskFit:
        """A fit on the unit disk from equal steps. Node counts are rounded up by at most a quarter to share batches."""
        points = max(FEWEST_NODES, len(self.problem.unit))
        step = 1 << ((points - 1).bit_length() - 3)
        n = step * math.ceil(points / step)
        return self._fit(self._unit_disk, self.problem.options.place.put(np.arange(n) / n))

    def _fit(self, form: DirichletForm, slide: Float[Array, " n"]) -> DiskFit:
        """A fit on Ω that starts from a slide."""
        return DiskFit(solver=self, form=form, slide=slide, nodes=even(max(len(slide), len(self.problem.unit))))

    def _fitted(self, fit: DiskFit, route: RouteName) -> RouteResult:
        """The minimal disk of a fit, with enough nodes to meet the tolerance."""
        fit_together([fit])
        if fit.best is None:
            if not fit.limit:
                raise OutOfTimeError
            raise DomainError(f"no minimal disk was found on this domain: {fit.limit}", vertices=len(self.problem.unit))
        lift, disk = fit.best
        with self.problem.clock.stage("surface"):
            domain = domain_of(lift, fit.form.boundary)
        n = len(disk.slide)
        return RouteResult(
            curves=(self.problem.curve,),
            domain=domain,
            surface_at=surface_of(lift, domain),
            matchings=(np.column_stack([np.arange(n) / n, to_numpy(disk.slide)]),),
            misfit=lift.misfit,
            area=lift.area,
            route=route,
            limit=fit.limit or SPENT,
            curvature=lift.curvature,
        )

    @cached_property
    def exact(self) -> CurveTensors:
        """Γ as tensors."""
        return CurveTensors.of(self.problem.curve, self.problem.options.place)

    @cached_property
    def is_rough(self) -> bool:
        """Whether the loop is rough."""
        return is_rough(self.problem.unit, self.problem.curve)

    @property
    def is_analytic(self) -> bool:
        """Whether Γ is analytic: the distance decreases geometrically with the number of nodes."""
        return self.problem.curve.kind == "analytic"

    @property
    def fine_gradient(self) -> float:
        """Relative gradient at which a slide along Γ stops: a share of the tolerance."""
        if self.problem.options.is_series:
            return ROUNDING
        share = ROUGH_GRADIENT if self.is_rough else COARSE
        return min(max(share * self.problem.options.tolerance, ROUNDING), COARSE)

    @property
    def most_nodes(self) -> int:
        """Upper limit on nodes."""
        per_edge = _MOST_PER_EDGE if self.problem.may_be_free else _MOST_PER_EDGE_OF_KNOWN
        return even(max(4 * FEWEST_NODES, per_edge * len(self.problem.unit)))

    def is_enough(self, misfit: Misfit) -> bool:
        """Whether the distance is within the tolerance, or at rounding error for power series over analytic curves."""
        allowed = self.problem.allowed
        if self.problem.options.is_series and self.is_analytic:
            allowed = min(allowed, ROUNDING)
        return misfit.excess(allowed=allowed, tolerance=allowed / self.problem.unit.mean_edge_length) <= 1

    def negligible_energy(self, form: DirichletForm) -> float:
        """Decrease of the energy below which a slide stops, or 0 on the disk for smooth loops, which take few steps."""
        is_quick = form.is_disk and not self.is_rough
        return 0.0 if is_quick else negligible_energy(len(self.problem.unit), self.problem.allowed)

    @property
    def most_steps(self) -> int:
        """Largest number of steps of a slide."""
        return min(MOST_STEPS, self.problem.steps.left)

    def may_meet(self, misfit: Misfit, fit: DiskFit) -> bool:
        """Whether the largest number of nodes would meet the tolerance.

        The distance is extrapolated geometrically from one edge at 0 nodes over smooth loops.
        """
        distance = self._in_edges(misfit)
        if not fit.form.is_disk and distance > (1 if self.is_rough else _FAR):
            return False
        return self.is_rough or bool(distance ** (self.most_nodes / fit.nodes) <= self.problem.options.tolerance)

    def _in_edges(self, misfit: Misfit) -> float:
        return self.problem.excess(misfit) * self.problem.options.tolerance

    def take(self, gradient: float) -> None:
        """Records a step."""
        self.problem.steps.take("Douglas-Newton", gradient)


UNIT_DISK = Route("disk", lambda problem: HarmonicSolver(problem=problem).on_unit_disk())
FLATTENING = Route("flattened", lambda problem: HarmonicSolver(problem=problem).on_flattening())


def begun_on_unit_disk(problems: Sequence[PlateauProblem]) -> list[Route]:
    """A route on the unit disk for each problem. The fits run in batches."""
    fits = [HarmonicSolver(problem=problem)._begin() for problem in problems]
    fit_together(fits)
    return [replace(UNIT_DISK, solve=partial(_finished, fit)) for fit in fits]


def _finished(fit: DiskFit, problem: PlateauProblem) -> RouteResult:
    return HarmonicSolver(problem=problem).on_unit_disk(fit)


def points_of_domain(loop: BoundaryLoop) -> int:
    """Number of points that define Ω, without those added in narrow places."""
    return min(max(len(loop), FEWEST_POINTS), FEWEST_NODES // 2)


@dataclass(kw_only=True, eq=False)
class DiskFit:
    """The attempts to solve for one loop on one Ω, with increasing numbers of nodes."""

    solver: HarmonicSolver
    form: DirichletForm
    slide: Float[Array, " n"]  # the start, then the last slide found
    nodes: int  # number of nodes of the next attempt
    best: Lifted | None = None  # the nearest surface so far, and its harmonic disk
    limit: str = ""  # why the fit has finished, as the end of a sentence, or "" while it runs
    attempt: int = 0  # number of attempts so far

    def take(self, disk: HarmonicDisk, lift: Lift | None) -> None:
        """Records the disk of an attempt and its lift, and sets the nodes of the next attempt, or `limit`."""
        if disk.crowded:
            self.limit = "the nodes crowd on the domain's boundary"
            return
        self.slide = disk.slide
        before = math.inf if self.best is None else self.best[0].misfit.rms
        share = 1.0 if self.solver.is_rough else WORTHWHILE
        # more nodes may give a lift
        may_lift = self.attempt == 0 or self.solver.is_rough
        is_better = may_lift if lift is None else lift.misfit.rms < share * before
        if lift is not None and lift.misfit.rms < before:
            self.best = lift, disk
        if not is_better or (self.best is not None and self.solver.is_enough(self.best[0].misfit)):
            self.limit = _NO_HELP
        elif self.best is not None and not self.solver.may_meet(self.best[0].misfit, self):
            self.limit = _WOULD_NOT_MEET
        elif self.nodes >= self.solver.most_nodes:
            self.limit = f"{self.nodes} nodes are the largest number that is tried"
        elif not self.solver.problem.steps.left:
            self.limit = SPENT
        else:
            self.attempt += 1
            self.nodes = even(min(self.solver.most_nodes, 2 * self.nodes))

    @property
    def near_enough(self) -> float:
        """RMS distance above which the lift is refined, or infinite where more nodes are cheaper."""
        is_smooth = self.solver.is_analytic or (self.attempt == 0 and not self.solver.is_rough)
        return math.inf if is_smooth else self.solver.problem.allowed


def fit_together(fits: Sequence[DiskFit]) -> None:
    """Runs fits until all have finished or time is out. Fits on the same Ω with equal numbers of nodes form a batch."""
    left = list(fits)
    while (left := [fit for fit in left if not fit.limit]) and not is_out_of_time():
        groups: dict[tuple[object, ...], list[DiskFit]] = defaultdict(list)
        for fit in left:
            groups["disk" if fit.form.is_disk else id(fit.form), fit.nodes, fit.attempt > 0].append(fit)
        for group in groups.values():
            together = max(1, BATCH_NODES // group[0].nodes)
            for start in range(0, len(group), together):
                _advance(group[start : start + together])


def _advance(fits: Sequence[DiskFit]) -> None:
    """Runs one attempt of fits on the same Ω with equal numbers of nodes."""
    begin = time.perf_counter()
    form, nodes = fits[0].form, fits[0].nodes
    curves = CurveTensors.batch([fit.solver.exact for fit in fits])
    disks = minimise_dirichlet_energies(
        curves,
        form,
        namespace(fits[0].slide).stack([resampled(fit.slide, nodes) for fit in fits]),
        tolerances=[fit.solver.fine_gradient for fit in fits],
        max_steps=[fit.solver.most_steps for fit in fits],
        near=fits[0].attempt > 0,
        negligible=[fit.solver.negligible_energy(form) for fit in fits],
        on_step=[fit.solver.take for fit in fits],
    )
    middle = time.perf_counter()
    usable = {i: disk for i, disk in enumerate(disks) if disk is not None and not disk.crowded}
    lifts: dict[int, Lift | None] = {}
    if usable:
        if len(usable) < len(fits):
            curves = CurveTensors.batch([fits[i].solver.exact for i in usable])
        found = lifted_together([*usable.values()], form, curves, allowed=[fits[i].near_enough for i in usable])
        lifts = dict(zip(usable, found, strict=True))
    end = time.perf_counter()
    for i, (fit, disk) in enumerate(zip(fits, disks, strict=True)):
        fit.solver.problem.clock.add("slide", (middle - begin) / len(fits))
        fit.solver.problem.clock.add("lift", (end - middle) / len(fits))
        if disk is not None:
            fit.take(disk, lifts.get(i))


def even(nodes: int) -> int:
    """The next even number of nodes with a fast Fourier transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
