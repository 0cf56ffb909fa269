"""The plan for loops: the routes to a minimal surface that are tried, in their order, and how they are run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.errors import DomainError, FirstFillError, SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES, MIN_POINTS_FOR_HIGH_DEGREE
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import FAILURES, Found, NoneBetweenError
from spinor_geom.plateau.harmonic_fit import Fit
from spinor_geom.plateau.harmonic_route import HarmonicSolver, points_of_domain, suits_unit_disk
from spinor_geom.plateau.network_route import NetworkSolver, rim_indices
from spinor_geom.plateau.omega import NodeDensity
from spinor_geom.plateau.options import Trainer
from spinor_geom.plateau.plane_route import lie_in_plane, plane_region
from spinor_geom.plateau.request import Request
from spinor_geom.plateau.rims import RimsSolver, obstacle
from spinor_geom.plateau.roughness import FEW_POINTS, ROUGH_TURN, corners_are_seen, is_rough, roughness, roundest
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution, RimDisks
from spinor_geom.plateau.solutions import Rim, find_disks, leave_unstable, lower_beside
from spinor_geom.plateau.vertex_route import disk_through_points

# Rough loops of more points have a smooth Γ: the cost of a surface through n points grows like n³.
_MOST_POINTS = 1500
# Parts that the sides of a polygon given by its corners alone are divided into: with 8 the tetrahedron's quadrilateral
# is met to 1e-6 of a side, with none to 1e-2.
_PARTS_OF_A_SIDE = 8


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
        return RimsSolver(request=self)


class Route(Protocol):
    """A way from loops to a minimal surface of one piece."""

    def surface(self, task: Task) -> Found:
        """The surface at unit size.

        Raises:
            DomainError, FirstFillError, SingularMatrixError, SurfaceError: this way leads to none.
            NoneBetweenError: there is none.
        """
        ...


@dataclass(frozen=True)
class InPlane:
    """The region inside a plane loop, or between plane loops."""

    def surface(self, task: Task) -> Found:
        """The region, which is the only minimal surface."""
        return plane_region(task.units, task.curves, task.options.device, task.clock)


@dataclass(frozen=True)
class NoneBetween:
    """Nowhere: no surface of one piece spans several loops."""

    reason: str  # how it is known

    def surface(self, task: Task) -> Found:
        """Says so."""
        raise NoneBetweenError(self.reason)


@dataclass(frozen=True)
class ThroughPoints:
    """Through the points of rough loops, with Γ between them left to the surface."""

    def surface(self, task: Task) -> Found:
        """The disk next to a discrete one, or the surface next to that over averages of several loops."""
        if not task.is_disk:
            return task.rims.through_points()
        return disk_through_points(task, task.first_disk)


@dataclass(frozen=True)
class OnCircles:
    """Douglas's slides of several loops, and the moduli of a disk with round holes."""

    def surface(self, task: Task) -> Found:
        """The surface, with p and q as Laurent series."""
        return task.rims.on_circles()


@dataclass(frozen=True)
class OnUnitDisk:
    """Douglas's slide on the unit disk."""

    def surface(self, task: Task) -> Found:
        """The disk, with p and q as power series."""
        return task.harmonic.on_disk(task.on_disk)


@dataclass(frozen=True)
class OnUnfolding:
    """Douglas's slide on the unfolded least-area triangulation of the loop."""

    def surface(self, task: Task) -> Found:
        """The disk, with p and q by Cauchy's formula."""
        return task.harmonic.unfolded()


@dataclass(frozen=True)
class OnFlattening:
    """Douglas's slide on the flattening of a discrete disk, which is in the loop's coordinates."""

    start: Disk

    def surface(self, task: Task) -> Found:
        """The disk to which the area falls from there."""
        return task.harmonic.flattened(_at_unit_size(self.start, task), task.rim.indices)


@dataclass(frozen=True)
class ByNetwork:
    """Gauss-Newton for a Cauchy network, from a discrete surface in the loops' coordinates, or from a first fill."""

    start: Disk | None = None

    def surface(self, task: Task) -> Found:
        """The disk or annulus nearest to the start, saddles of the area included."""
        network = task.network
        return network.found_from(network.first_surface if self.start is None else _at_unit_size(self.start, task))


@dataclass(frozen=True)
class ByTraining:
    """A complex-valued network, trained; it takes over a minimal disk first where it is to start from one."""

    optimizer: Trainer
    warm_start: bool

    def surface(self, task: Task) -> Found:
        """The disk as near to Γ as the training brings it."""
        start: PlateauSolution | None = None
        if self.warm_start and self.optimizer.takes_start:
            first = replace(task, options=replace(task.options, model="auto", optimizer=None))
            start = minimal_disk(first, plan(first))
        with task.clock.stage("training"):
            return self.optimizer.disk(task.curve, start=start, device=task.options.device, steps=task.steps)


def plan(task: Task) -> tuple[Route, ...]:
    """The routes to a surface, the likeliest first, as the loops' shapes, their corners and the options ask for."""
    in_plane = (InPlane(),) if lie_in_plane(task.units, allowed=task.allowed) else ()
    return _plan_for_disk(task, in_plane) if task.is_disk else _plan_between(task, in_plane)


def _plan_for_disk(task: Task, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    loop, curve, options = task.unit, task.curve, task.options
    if options.trainer is not None:
        return (ByTraining(options.trainer, options.warm_start),)
    if options.is_series:
        return (OnUnitDisk(),)
    if not options.is_free:
        return (ByNetwork(),)
    if loop.corners.any():
        # kinks of Γ are singularities of p and q; those that are only seen may be none
        may_be_none = options.between == "free" and len(loop) <= _MOST_POINTS and corners_are_seen(loop)
        through = (ThroughPoints(),) if may_be_none and not in_plane else ()
        return (*in_plane, ByNetwork(), *through)
    if options.between == "free" and _shows_no_curve(loop, curve):
        return (*in_plane, ThroughPoints())
    on_disk = (OnUnitDisk(),) if suits_unit_disk(loop, curve) else ()
    return (*in_plane, *on_disk, OnUnfolding(), ByNetwork())


def _plan_between(task: Task, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    options = task.options
    with task.clock.stage("moduli"):
        reason = obstacle(task.units, task.curves)
    if reason is not None:
        return (NoneBetween(reason),)
    if options.is_series:
        return (*in_plane, OnCircles())
    if not options.is_free:
        return (*in_plane, ByNetwork())
    is_free = options.between == "free" or (options.between == "auto" and options.model == "auto")
    through = (ThroughPoints(),) if is_free and any(map(is_rough, task.units, task.curves)) else ()
    if len(task.loops) > 2:
        return (*in_plane, *through, OnCircles())
    on_domain = (ByNetwork(), OnCircles()) if task.network.crowds else (OnCircles(), ByNetwork())
    return (*in_plane, *through, *on_domain)


def _shows_no_curve(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether no smooth curve is seen in the points of a loop."""
    n = len(loop)
    if n > _MOST_POINTS or curve.degree > min(DEGREES):
        return False
    # only of so few points, in which no analytic curve is looked for, any loop turns by as much
    turn = roughness(loop) - (roundest(n) if n < MIN_POINTS_FOR_HIGH_DEGREE else 0.0)
    if n <= FEW_POINTS or turn > ROUGH_TURN or detect_corners(loop.points).any():
        return True
    return NodeDensity(curve, points_of_domain(loop)).is_narrow


def nearest_surface(routes: Sequence[Route], task: Task) -> Found:
    """The surface of the first route on which the tolerance is met; of all the one nearest to Γ where it is on none.

    Raises:
        OutOfTimeError: the time is over, and no surface was found.
        DomainError, FirstFillError, SingularMatrixError, SurfaceError: no route leads to one; the first
            SurfaceError, or else that of the last route.
        NoneBetweenError: a route says that there is none.
    """
    best: Found | None = None
    error: SpinorGeomError | None = None
    for route in routes:
        if is_out_of_time() and not isinstance(route, InPlane):  # which needs no time
            break
        try:
            found = route.surface(task)
        except FAILURES as failure:
            # what is known of a surface says more than that no domain was found
            error = error if isinstance(error, SurfaceError) else failure
            continue
        if best is None or found.misfit.rms < best.misfit.rms:
            best = found
        if task.is_met(best):
            break
    if best is None:
        require_time()
        raise error or FirstFillError("no route to a minimal surface was tried")
    return best


def minimal_disk(task: Task, routes: tuple[Route, ...]) -> PlateauSolution:
    """The disk that the routes lead to, or one of less area where that is unstable and may be left."""
    if routes == (ByNetwork(),) and task.loop.corners.all():
        return _on_sides(task)
    solution = _solution(routes, task)
    if not task.options.leaves_unstable:
        return solution
    if task.options.is_series:
        where = "in power series: model='auto' looks among others"
        solution = leave_unstable(solution, partial(_lower_on_disk, task), where)
    # a plane disk is stable, one through a rough loop's points is next to a discrete disk of least area, and a trained
    # one is taken as it is; of one that is far from Γ it says nothing of those over Γ whether it is stable
    elif solution.route in ("disk", "unfolded", "network") and solution.converged:

        def lower(unstable: PlateauSolution) -> PlateauSolution | None:
            with task.clock.stage("leaving"):
                return lower_beside(
                    unstable, task.rim, lambda disk: _solution(_routes_down(task, disk), task), task.steps
                )

        solution = leave_unstable(solution, lower, "along its eigenvectors")
    return replace(solution, history=tuple(task.steps.history), solve_timings=dict(task.clock.seconds))


def surface_between(task: Task) -> PlateauSolution | NoConnectedSurface:
    """The surface of one piece between several loops, or that there is none."""
    try:
        solution = _solution(plan(task), task)
        if task.options.leaves_unstable and solution.route == "annular network":
            solution = leave_unstable(solution, lambda _: _solution((OnCircles(),), task), "over a round annulus")
    except NoneBetweenError as verdict:
        kind, left = (
            ("annulus", "two disks")
            if len(task.loops) == 2
            else ("surface of one piece", "surfaces of fewer rims each")
        )
        return NoConnectedSurface(
            loops=task.loops,
            rim_disks=_rim_disks(task),
            reason=f"no {kind}: {verdict}; what is left are {left}",
            history=tuple(task.steps.history),
            solve_timings=dict(task.clock.seconds),
        )
    return solution


def all_surfaces(task: Task) -> tuple[PlateauSolution, ...]:
    """All surfaces that are found by area, saddles of the area included; see `find_disks` and `RimsSolver`."""
    routes = plan(task)
    if routes[0] == InPlane():
        try:
            return (_solution((InPlane(),), task),)
        except DomainError:  # the loop is plane, but Γ crosses itself
            pass
    if task.is_disk:
        return find_disks(task.rim, lambda disk: _solution((ByNetwork(disk),), task.anew()))
    if isinstance(routes[0], NoneBetween):
        return ()
    solutions = [_told(task.rims.fitted(placed), task) for placed in task.rims.all_critical()]
    return tuple(sorted(solutions, key=lambda solution: solution.area))


def _solution(routes: tuple[Route, ...], task: Task) -> PlateauSolution:
    return _told(nearest_surface(routes, task), task)


def _told(found: Found, task: Task) -> PlateauSolution:
    return task.solution(found, None if task.is_disk else _rim_disks(task))


def _rim_disks(task: Task) -> RimDisks:
    """What a surface between loops is set against: disks over each and surfaces over some, of whatever model suits."""
    options = task.options if task.options.laurent is None else replace(task.options, model="auto")

    def over(numbers: Sequence[int]) -> Task:
        return Task.over([task.loops[k] for k in numbers], [task.curves[k] for k in numbers], options)

    def disks() -> tuple[PlateauSolution, ...] | None:
        try:
            parts = [over([number]) for number in range(len(task.loops))]
            return tuple(minimal_disk(part, plan(part)) for part in parts)
        except SpinorGeomError:
            return None

    def area_over(numbers: tuple[int, ...]) -> float | None:
        try:
            answer = surface_between(over(numbers))
        except SpinorGeomError:
            return None
        return answer.area if isinstance(answer, PlateauSolution) else None

    return RimDisks(solve=disks, joined=area_over)


def _routes_down(task: Task, disk: Disk) -> tuple[Route, ...]:
    """The routes to the minimal disk to which the area falls from a discrete one."""
    is_harmonic = task.options.is_free and not task.loop.corners.any()
    return (OnFlattening(disk), ByNetwork(disk)) if is_harmonic else (ByNetwork(disk),)


def _lower_on_disk(task: Task, solution: PlateauSolution) -> PlateauSolution | None:
    """A disk of less area than an unstable one, where the unit disk has room for it."""
    found = task.harmonic.below_on_disk(solution.matching)
    lower = None if found is None else task.solution(found)
    return lower if lower is not None and lower.area < solution.area else None


def _on_sides(task: Task) -> PlateauSolution:
    """The disk over a polygon given by its corners alone: sides without points are followed by nothing."""
    loop, steps = task.loop, task.steps
    finer = replace(Task.of([subdivided(loop, _PARTS_OF_A_SIDE)], task.options), steps=steps)
    solution = minimal_disk(finer, plan(finer))
    residual = replace(
        solution.boundary_residual,
        mean_edge=loop.mean_edge_length,
        max_per_local_edge=solution.boundary_residual.max_per_local_edge / _PARTS_OF_A_SIDE,
    )
    rim = replace(solution.rims[0], loop=loop, curve=task.curve.placed(loop.points, loop.diagonal))
    return replace(solution, rims=(rim,), boundary_residual=residual)


def subdivided(loop: BoundaryLoop, parts: int) -> BoundaryLoop:
    """A loop with its edges divided into equal parts, and the same corners."""
    share = np.arange(parts) / parts
    edge = np.roll(loop.points, -1, axis=0) - loop.points
    points = (loop.points[:, None] + share[:, None] * edge[:, None]).reshape(-1, 3)
    return BoundaryLoop.from_points(points, corners=parts * np.flatnonzero(loop.corners))


def _at_unit_size(disk: Disk, task: Task) -> Disk:
    return replace(disk, vertices=(disk.vertices - task.centre) / task.scale)
