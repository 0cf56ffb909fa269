"""The plan for loops: the routes to a minimal surface that are tried, in their order, and how they are run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property, partial

import numpy as np

from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.errors import DomainError, FirstFillError, OutOfTimeError, SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES, MIN_POINTS_FOR_HIGH_DEGREE
from spinor_geom.plateau.found import FAILURES, Found, NoneBetweenError, typed_failures
from spinor_geom.plateau.harmonic_route import MOST_FREE_POINTS, Fit, HarmonicSolver, points_of_domain
from spinor_geom.plateau.network_route import PARTS_OF_A_SIDE, NetworkSolver, rim_indices
from spinor_geom.plateau.omega import has_narrow_place
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plane_route import lie_in_plane, plane_region
from spinor_geom.plateau.request import Request
from spinor_geom.plateau.rims import RimsSolver, obstacle
from spinor_geom.plateau.roughness import (
    FEW_POINTS,
    ROUGH_TURN,
    corners_are_seen,
    is_rough,
    roughness,
    roundest,
    shows_sides,
)
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution, RimDisks
from spinor_geom.plateau.solutions import Rim, find_disks, leave_unstable, lower_beside
from spinor_geom.plateau.steps import SPENT, Clock
from spinor_geom.plateau.vertex_route import disk_through_points

# A loop longer than so many times its width crowds on the disk: at 2.4 it is met to 1e-8 edges, at 4 no more.
_DISK_ELONGATION = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Task(Request):
    """Loops to be spanned."""

    on_disk: Fit | None = None  # the fit on the unit disk, where it was made together with those of other loops
    start: Disk | None = None  # the discrete surface to start from, at unit size; none for a first fill

    def starting_from(self, disk: Disk) -> Task:
        """With a discrete surface in the loops' coordinates to start from."""
        return replace(self, start=replace(disk, vertices=(disk.vertices - self.centre) / self.scale))

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


class Route(Enum):
    """A way from loops to a minimal surface of one piece."""

    IN_PLANE = "the region inside a plane loop, or between plane loops, which is the only minimal surface"
    THROUGH_POINTS = "through the points of rough loops, Γ between them being the surface's own boundary"
    ON_CIRCLES = "Douglas's slides of several loops, and the moduli of a disk with round holes"
    ON_UNIT_DISK = "Douglas's slide on the unit disk"
    ON_UNFOLDING = "Douglas's slide on the unfolded least-area triangulation of the loop"
    ON_FLATTENING = "Douglas's slide on the flattening of the task's discrete disk, or of a first one over the loop"
    BY_NETWORK = "Gauss-Newton for a Cauchy network, from a discrete surface to the nearest one, saddles included"
    BY_TRAINING = "a complex-valued network, trained, which takes over a minimal disk first where it is to start warm"

    def surface(self, task: Task) -> Found:
        """The surface at unit size.

        Raises:
            DomainError, FirstFillError, SingularMatrixError, SurfaceError: this way leads to none.
            NoneBetweenError: there is none.
        """
        match self:
            case Route.IN_PLANE:
                try:
                    return plane_region(task.units, task.curves, task.options.device, task.clock)
                except DomainError:
                    if task.options.between != "free":
                        raise
                # only the points are given: the polygon through them may be simple where the curve is not
                polygons = [replace(loop, corners=np.ones(len(loop), dtype=bool)) for loop in task.units]
                sides = BoundaryCurve.from_loops(polygons)
                return plane_region(task.units, sides, task.options.device, task.clock)
            case Route.THROUGH_POINTS:
                return disk_through_points(task, task.start) if task.is_disk else task.rims.through_points()
            case Route.ON_CIRCLES:
                return task.rims.on_circles()
            case Route.ON_UNIT_DISK:
                return task.harmonic.on_disk(task.on_disk)
            case Route.ON_UNFOLDING:
                return task.harmonic.unfolded()
            case Route.ON_FLATTENING:
                return task.harmonic.flattened(task.start, task.rim.indices)
            case Route.BY_NETWORK:
                return task.network.found_from(task.start or task.network.first_surface)
            case Route.BY_TRAINING:
                return _trained(task)


def _trained(task: Task) -> Found:
    start, trainer = None, task.options.trainer
    assert trainer is not None  # this route is planned with one only
    if task.options.warm_start and trainer.takes_start:
        first = replace(task, options=replace(task.options, model="auto", optimizer=None))
        start = minimal_disk(first, plan(first))
    with task.clock.stage("training"):
        return trainer.disk(task.curve, start=start, device=task.options.device, steps=task.steps)


def plan(task: Task) -> tuple[Route, ...]:
    """The routes to a surface, the likeliest first, as the loops' shapes, their corners and the options ask for.

    A NoneBetweenError says that no surface of one piece spans several loops.
    """
    in_plane = (Route.IN_PLANE,) if lie_in_plane(task.units, allowed=task.allowed) else ()
    return _plan_for_disk(task, in_plane) if task.is_disk else _plan_between(task, in_plane)


def _plan_for_disk(task: Task, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    loop, curve, options = task.unit, task.curve, task.options
    if options.trainer is not None:
        return (Route.BY_TRAINING,)
    if options.is_series:
        return (Route.ON_UNIT_DISK,)
    if not options.is_free:
        return (Route.BY_NETWORK,)
    if loop.corners.any():
        # kinks of Γ are singularities of p and q; those that are only seen may be none, but between smooth sides
        may_be_none = options.between == "free" and len(loop) <= MOST_FREE_POINTS and corners_are_seen(loop)
        through = (Route.THROUGH_POINTS,) if may_be_none and not in_plane else ()
        by_network = () if through and not shows_sides(loop) else (Route.BY_NETWORK,)
        return (*in_plane, *by_network, *through)
    if options.between == "free" and _shows_no_curve(loop, curve):
        return (*in_plane, Route.THROUGH_POINTS)
    on_disk = (Route.ON_UNIT_DISK,) if loop.elongation < _DISK_ELONGATION else ()
    on_domain: tuple[Route, ...] = (Route.ON_UNFOLDING, Route.ON_FLATTENING)
    if is_rough(loop, curve):  # unfoldings of rough loops pinch where their surfaces do not
        on_disk, on_domain = (), on_domain[::-1]
    if options.between == "free" and len(loop) <= MOST_FREE_POINTS:
        # the cost of a slide on a narrow Ω grows with the cube of its nodes, that through the points does not
        is_narrow = has_narrow_place(curve, points_of_domain(loop))
        on_domain = (Route.THROUGH_POINTS, *on_domain) if is_narrow else (*on_domain, Route.THROUGH_POINTS)
    return (*in_plane, *on_disk, *on_domain, Route.BY_NETWORK)


def _plan_between(task: Task, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    options = task.options
    with task.clock.stage("moduli"):
        reason = obstacle(task.units, task.curves)
    if reason is not None:
        raise NoneBetweenError(reason)
    if options.is_series:
        return (*in_plane, Route.ON_CIRCLES)
    if not options.is_free:
        return (*in_plane, Route.BY_NETWORK)
    is_free = options.between == "free" or (options.between == "auto" and options.model == "auto")
    through = (Route.THROUGH_POINTS,) if is_free and any(map(is_rough, task.units, task.curves)) else ()
    # two rims that crowd on circles are told by few nodes
    by_network = (Route.BY_NETWORK,) if len(task.loops) == 2 else ()
    return (*in_plane, *through, Route.ON_CIRCLES, *by_network)


def _shows_no_curve(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether no smooth curve is seen in the points of a loop."""
    n = len(loop)
    if n > MOST_FREE_POINTS:
        return False
    if detect_corners(loop.points).any():  # which somebody took from the loop: Γ bulges there, whatever its degree
        return True
    if curve.degree > min(DEGREES):
        return False
    # only of so few points, in which no analytic curve is looked for, any loop turns by as much
    turn = roughness(loop) - (roundest(n) if n < MIN_POINTS_FOR_HIGH_DEGREE else 0.0)
    if n <= FEW_POINTS or turn > ROUGH_TURN:
        return True
    return has_narrow_place(curve, points_of_domain(loop))


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
        if is_out_of_time() and route is not Route.IN_PLANE:  # which needs no time
            break
        is_other = route in (Route.THROUGH_POINTS, Route.BY_NETWORK)
        if best is not None and best.route in ("unfolded", "flattened") and not is_other:
            continue  # a second Ω is for loops that the first leads to no surface of: it spends the steps
        try:
            with typed_failures():
                found = route.surface(task)
            if not np.isfinite(found.misfit.rms):
                raise SurfaceError("p and q of a surface overflow, so that its boundary is not finite; scale the loop")
        except OutOfTimeError:
            break
        except FAILURES as failure:
            # what is known of a surface says more than that no domain was found
            error = error if isinstance(error, SurfaceError) else failure
            continue
        if best is None or found.misfit.rms < best.misfit.rms:
            best = found
        if task.excess(best.misfit) <= 1:
            break
    if best is None:
        require_time()
        raise error or FirstFillError("no route to a minimal surface was tried")
    return replace(best, limit=SPENT) if is_out_of_time() and task.excess(best.misfit) > 1 else best


def minimal_disk(task: Task, routes: tuple[Route, ...]) -> PlateauSolution:
    """The disk that the routes lead to, or one of less area where that is unstable and may be left."""
    if routes == (Route.BY_NETWORK,) and task.loop.corners.all():
        return _on_sides(task)
    solution = _solution(routes, task)
    if not task.options.leaves_unstable:
        return solution
    if task.options.is_series:
        where = "in power series: model='auto' looks among others"
        solution = leave_unstable(solution, partial(_lower_on_disk, task), where)
    # a plane disk is stable, one through a rough loop's points is next to a discrete disk of least area, and a trained
    # one is taken as it is; of one that is far from Γ it says nothing of those over Γ whether it is stable
    elif solution.route in ("disk", "unfolded", "flattened", "network") and solution.converged:
        is_harmonic = task.options.is_free and not task.loop.corners.any()
        down = (Route.ON_FLATTENING, Route.BY_NETWORK) if is_harmonic else (Route.BY_NETWORK,)

        def lower(unstable: PlateauSolution) -> PlateauSolution | None:
            with task.clock.stage("leaving"):
                return lower_beside(
                    unstable, task.rim, lambda disk: _solution(down, task.starting_from(disk)), task.steps
                )

        solution = leave_unstable(solution, lower, "along its eigenvectors")
    return replace(solution, history=tuple(task.steps.history), solve_timings=dict(task.clock.seconds))


def surface_between(task: Task) -> PlateauSolution | NoConnectedSurface:
    """The surface of one piece between several loops, or that there is none."""
    try:
        solution = _solution(plan(task), task)
        if task.options.leaves_unstable and solution.route == "annular network":
            solution = leave_unstable(solution, lambda _: _solution((Route.ON_CIRCLES,), task), "over a round annulus")
    except NoneBetweenError as verdict:
        are_two = len(task.loops) == 2
        kind = "annulus" if are_two else "surface of one piece"
        left = "two disks" if are_two else "surfaces of fewer rims each"
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
    try:
        if plan(task)[0] is Route.IN_PLANE:
            return (_solution((Route.IN_PLANE,), task),)
    except NoneBetweenError:
        return ()
    except DomainError:  # the loop is plane, but Γ crosses itself
        pass
    if task.is_disk:

        def solve(disk: Disk) -> PlateauSolution:
            # each with its own steps and time
            anew = replace(task.starting_from(disk), steps=replace(task.steps, history=[]), clock=Clock())
            return _solution((Route.BY_NETWORK,), anew)

        return find_disks(task.rim, solve)
    disks, critical = _rim_disks(task), task.rims.all_critical()
    solutions = []
    for placed in critical:
        # each with the steps and the time of the search, and its own
        own = replace(task, steps=task.steps.copied(), clock=task.clock.copied())
        solutions.append(own.solution(own.rims.fitted(placed), disks))
    return tuple(sorted(solutions, key=lambda solution: solution.area))


def _solution(routes: tuple[Route, ...], task: Task) -> PlateauSolution:
    return task.solution(nearest_surface(routes, task), None if task.is_disk else _rim_disks(task))


def _rim_disks(task: Task) -> RimDisks:
    """What a surface between loops is set against: disks over each and surfaces over some, of whatever model suits."""
    options = task.options if task.options.laurent is None else replace(task.options, model="auto")
    return RimDisks(count=len(task.loops), surface_over=partial(_surface_over, task.loops, task.curves, options))


def _surface_over(
    loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve], options: Options, numbers: Sequence[int]
) -> PlateauSolution | None:
    """The surface of least area over some of the loops; none where none is found."""
    try:
        with typed_failures():
            part = Task.over([loops[k] for k in numbers], [curves[k] for k in numbers], options)
            answer = minimal_disk(part, plan(part)) if part.is_disk else surface_between(part)
            require_time()  # what a time limit cut short is not kept as the answer
    except OutOfTimeError:
        raise
    except SpinorGeomError:
        return None
    return answer if isinstance(answer, PlateauSolution) else None


def _lower_on_disk(task: Task, solution: PlateauSolution) -> PlateauSolution | None:
    """A disk of less area than an unstable one, where the unit disk has room for it."""
    found = task.harmonic.below_on_disk(solution.matching)
    lower = None if found is None else task.solution(found)
    return lower if lower is not None and lower.area < solution.area else None


def _on_sides(task: Task) -> PlateauSolution:
    """The disk over a polygon given by its corners alone: sides without points are followed by nothing."""
    loop, steps = task.loop, task.steps
    share = np.arange(PARTS_OF_A_SIDE)[:, None] / PARTS_OF_A_SIDE
    points = loop.points[:, None] + share * (np.roll(loop.points, -1, axis=0) - loop.points)[:, None]
    whole = BoundaryLoop.from_points(points.reshape(-1, 3), corners=PARTS_OF_A_SIDE * np.arange(len(loop)))
    finer = replace(Task.of([whole], task.options), steps=steps, parts=PARTS_OF_A_SIDE)
    solution = minimal_disk(finer, plan(finer))
    rim = replace(solution.rims[0], loop=loop, curve=task.curve.placed(loop.points, loop.diagonal))
    return replace(solution, rims=(rim,))
