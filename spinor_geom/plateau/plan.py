"""The routes to try for a Plateau problem, their order, and the functions that run them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from spinor_geom.arrays import shifted
from spinor_geom.deadline import is_out_of_time, require_time, seconds_left
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.errors import DomainError, FirstFillError, OutOfTimeError, SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import SAMPLES_PER_PIECE, BoundaryCurve
from spinor_geom.plateau.annulus import RimDisks
from spinor_geom.plateau.disk_search import ThinnedLoop, find_disks, lower_beside, on_side_of_normal, replace_unstable
from spinor_geom.plateau.harmonic.harmonic_route import FLATTENING, UNIT_DISK, HarmonicSolver
from spinor_geom.plateau.network.network_route import NETWORK
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plane_route import PLANE, lie_in_plane
from spinor_geom.plateau.problem import PlateauProblem, Route
from spinor_geom.plateau.rims.rims_route import RimsSolver, obstacle
from spinor_geom.plateau.roughness import has_stray_corners, is_predicted, is_rough, shows_no_curve
from spinor_geom.plateau.route_result import FAILURES, NoConnectedSurfaceError, RouteResult, typed_failures
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.steps import SPENT, Clock
from spinor_geom.plateau.vertices.vertex_route import THROUGH_POINTS

# Elongation above which the nodes are too crowded on the unit disk: the residual is 1e-8 of an edge at 2.4, and above
# the tolerance at 4.
_DISK_ELONGATION = 2.5
# Number of pieces per side of polygons given by their corners alone: with 8 the residual of the tetrahedron's
# quadrilateral is 1e-6 of a side, undivided 1e-2.
_PARTS_OF_A_SIDE = 8
_ON_OWN_NODES: Final = "network on circles"


def plan(problem: PlateauProblem) -> tuple[Route, ...]:
    """The routes to try, in order. The first surface within the tolerance is the solution.

    The order depends on the shape of the loops, their corners and the options.

    Raises:
        NoConnectedSurfaceError: no connected surface spans several loops.
    """
    in_plane = (PLANE,) if lie_in_plane(problem.units, allowed=problem.allowed) else ()
    return _plan_for_disk(problem, in_plane) if problem.is_disk else _plan_between(problem, in_plane)


def _plan_for_disk(problem: PlateauProblem, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    loop, curve, options = problem.unit, problem.curve, problem.options
    if options.trainer is not None:
        return (Route("trained", _trained),)
    if options.is_series:
        return (UNIT_DISK,)
    if not options.is_automatic:
        return (NETWORK,)
    may_be_free = problem.may_be_free
    if loop.corners.any():
        through = (THROUGH_POINTS,) if may_be_free and not in_plane and not loop.corners_given else ()
        network = () if through and has_stray_corners(loop) else (NETWORK,)
        return (*in_plane, *network, *through)
    if may_be_free and shows_no_curve(loop, curve):
        return (*in_plane, THROUGH_POINTS, FLATTENING)
    is_wide = loop.elongation < _DISK_ELONGATION and not is_rough(loop, curve)
    last: tuple[Route, ...] = (NETWORK,)
    if may_be_free:
        last = (NETWORK, THROUGH_POINTS) if is_predicted(loop) else (THROUGH_POINTS, NETWORK)
    return (*in_plane, *((UNIT_DISK,) if is_wide else ()), FLATTENING, *last)


def _plan_between(problem: PlateauProblem, in_plane: tuple[Route, ...]) -> tuple[Route, ...]:
    options = problem.options
    with problem.clock.stage("moduli"):
        reason = obstacle(problem.units, problem.curves)
    if reason is not None:
        raise NoConnectedSurfaceError(reason)
    if not options.is_series and not options.is_automatic:
        return (*in_plane, NETWORK)
    solver = RimsSolver(problem=problem)  # its routes share the descent
    on_circles = Route("circles", lambda _: solver.on_circles())
    if options.is_series:
        return (*in_plane, on_circles)
    is_free = options.between == "free" and options.model == "auto" and not problem.curve.is_formula
    is_free = is_free and any(map(is_rough, problem.units, problem.curves))
    through = (Route("vertices", lambda _: solver.through_points()),) if is_free else ()
    if through and len(problem.loops) > 2:  # it ends with the route on circles
        return (*in_plane, *through)
    # the route on circles detects crowded nodes early, with few nodes
    network = (NETWORK,) if len(problem.loops) == 2 else ()
    on_own_nodes = Route(_ON_OWN_NODES, lambda _: solver.on_own_nodes())
    if options.model == "auto" and solver.have_corners:
        # between corners it has not been needed
        network = () if any(curve.corners.any() for curve in problem.curves) else network
        return (*in_plane, *through, on_own_nodes, on_circles, *network)
    if options.model != "auto" or through or not solver.may_crowd:
        return (*in_plane, *through, on_circles, *network)
    first = Route("circles", lambda _: solver.on_circles(is_last=False))
    return (*in_plane, first, *network, on_own_nodes)


def _trained(problem: PlateauProblem) -> RouteResult:
    """The disk of a trained complex-valued network. With a warm start it first fits p and q of a minimal disk."""
    start, trainer = None, problem.options.trainer
    assert trainer is not None  # only planned with a trainer
    if problem.options.warm_start and trainer.takes_start:
        first = replace(problem, options=replace(problem.options, model="auto", optimizer=None))
        start = minimal_disk(first, plan(first))
    with problem.clock.stage("training"):
        return trainer.disk(
            problem.curve, start=start, device=problem.options.place.device or "cpu", steps=problem.steps
        )


def nearest_surface(routes: Sequence[Route], problem: PlateauProblem) -> RouteResult:
    """The surface of the first route that meets the tolerance, or else the surface nearest to Γ.

    Raises:
        OutOfTimeError: no surface was found within the time limit.
        DomainError, FirstFillError, SingularMatrixError, SurfaceError: no route finds a surface. It is the
            first SurfaceError, or else the error of the last route.
        NoConnectedSurfaceError: a route shows that there is no surface, and those before it found none, or none within
            the tolerance if the rims have nodes of their own.
    """
    best: RouteResult | None = None
    error: SpinorGeomError | None = None
    for route in routes:
        if is_out_of_time() and route is not PLANE:  # PLANE takes no time
            break
        try:
            with typed_failures():
                found = route.solve(problem)
            if not found.misfit.rms < 1:  # the size of the problem's Γ
                raise SurfaceError(
                    "the fit of p and q diverged: its boundary is farther from the loop than the loop's size"
                )
        except OutOfTimeError:
            break
        except NoConnectedSurfaceError:
            # nodes of their own show most: a surface that other routes leave far from Γ is none
            if best is None or route.name == _ON_OWN_NODES:
                raise
            continue
        except FAILURES as failure:
            # a SurfaceError is more specific than the others
            error = error if isinstance(error, SurfaceError) else failure
            continue
        if best is None or _distance(found, problem) < best.misfit.rms:
            best = found
        if problem.excess(best.misfit) <= 1:
            break
    if best is None:
        require_time()
        raise error or FirstFillError("no route to a minimal surface was tried")
    return replace(best, limit=SPENT) if is_out_of_time() and problem.excess(best.misfit) > 1 else best


def _distance(found: RouteResult, problem: PlateauProblem) -> float:
    """RMS distance of a surface from Γ at unit size. Γ of a predicted loop is known between the points too."""
    if found.route != "vertices" or not (problem.is_disk and is_predicted(problem.unit)):
        return found.misfit.rms
    (own,) = found.curves
    count = SAMPLES_PER_PIECE * len(own.corners)
    boundary = own.point(np.arange(count) / count)
    missed = boundary - problem.curve.point(problem.curve.nearest(boundary))
    return found.misfit.with_offset(float(np.sqrt((missed**2).sum(axis=1).mean()))).rms


def minimal_disk(problem: PlateauProblem, routes: tuple[Route, ...]) -> PlateauSolution:
    """The disk that the routes find. An unstable one is replaced by a disk of less area if the options allow it."""
    if routes == (NETWORK,) and problem.loop.corners.all():
        return _on_divided_sides(problem)
    solution = _solution(routes, problem)
    if not problem.options.replaces_unstable:
        return solution
    if problem.options.is_series:
        where = "among power series; model='auto' searches further"
        solution = replace_unstable(solution, partial(_lower_on_disk, problem), where)
    # Plane disks are stable, disks through points are close to a discrete minimum, and trained ones are not replaced.
    # The stability of a disk far from Γ does not determine that of disks over Γ.
    elif solution.route in ("disk", "flattened", "network") and solution.converged:
        is_harmonic = problem.options.is_automatic and not problem.loop.corners.any()
        downhill = (FLATTENING, NETWORK) if is_harmonic else (NETWORK,)

        def solve(disk: Disk) -> PlateauSolution:
            return _solution(downhill, problem.starting_from(disk))

        def lower(unstable: PlateauSolution) -> PlateauSolution | None:
            with problem.clock.stage("unstable"):
                return lower_beside(unstable, ThinnedLoop.of(problem), solve, problem.steps)

        solution = replace_unstable(solution, lower, "along its eigenvectors")
        if problem.options.is_quintic:
            with problem.clock.stage("unstable"):
                solution = on_side_of_normal(solution, ThinnedLoop.of(problem), solve)
    return replace(solution, history=tuple(problem.steps.history), solve_timings=dict(problem.clock.seconds))


def surface_between(problem: PlateauProblem) -> PlateauSolution | NoConnectedSurface:
    """The connected minimal surface between several loops, or `NoConnectedSurface`."""
    try:
        routes = plan(problem)
        solution = _solution(routes, problem)
        if problem.options.replaces_unstable and solution.route == "annular network":
            solution = replace_unstable(solution, partial(_lower_on_circles, problem), "over a round annulus")
    except NoConnectedSurfaceError as verdict:
        are_two = len(problem.loops) == 2
        kind = "annulus" if are_two else "surface of one piece"
        left = "two disks" if are_two else "several surfaces of fewer rims each"
        return NoConnectedSurface(
            loops=problem.loops,
            rim_disks=_rim_disks(problem),
            reason=f"no {kind}: {verdict}; the rims bound {left} instead",
            history=tuple(problem.steps.history),
            solve_timings=dict(problem.clock.seconds),
        )
    return solution


def all_surfaces(problem: PlateauProblem) -> tuple[PlateauSolution, ...]:
    """All surfaces that the searches find, unstable ones too, sorted by area (see `find_disks` and `RimsSolver`)."""
    try:
        if plan(problem)[0] is PLANE:
            return (_solution((PLANE,), problem),)
    except NoConnectedSurfaceError:
        return ()
    except DomainError:  # the loop is plane, and Γ crosses itself
        pass
    if problem.is_disk:

        def solve(disk: Disk) -> PlateauSolution:
            # each solution has its own history and timings
            anew = replace(problem.starting_from(disk), steps=replace(problem.steps, history=[]), clock=Clock())
            return _solution((NETWORK,), anew)

        return find_disks(ThinnedLoop.of(problem), solve)
    disks = _rim_disks(problem)
    solutions = []
    for placed in RimsSolver(problem=problem).all_critical():
        # the history and timings of each solution are those of the search and of its own fit
        own = replace(problem, steps=problem.steps.copied(), clock=problem.clock.copied())
        solutions.append(own.solution(RimsSolver(problem=own).fitted(placed), disks))
    return tuple(sorted(solutions, key=lambda solution: solution.area))


def _solution(routes: tuple[Route, ...], problem: PlateauProblem) -> PlateauSolution:
    return problem.solution(nearest_surface(routes, problem), None if problem.is_disk else _rim_disks(problem))


def _rim_disks(problem: PlateauProblem) -> RimDisks:
    """The minimal surfaces over each loop and over subsets of the loops, with the given model or "auto"."""
    options = problem.options if problem.options.laurent is None else replace(problem.options, model="auto")
    return RimDisks(
        count=len(problem.loops),
        surface_over=partial(_surface_over, problem.loops, problem.curves, options),
        seconds=seconds_left(),
    )


def _surface_over(
    loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve], options: Options, numbers: Sequence[int]
) -> PlateauSolution | None:
    """The surface of least area over some of the loops, or None if none is found."""
    try:
        with typed_failures():
            part = PlateauProblem.over([loops[k] for k in numbers], [curves[k] for k in numbers], options)
            solution = minimal_disk(part, plan(part)) if part.is_disk else surface_between(part)
            require_time()  # a result interrupted by the time limit is not kept
    except OutOfTimeError:
        raise
    except SpinorGeomError:
        return None
    if not isinstance(solution, PlateauSolution):
        return None
    # a surface between rims that is far from them has another boundary
    return solution if part.is_disk or solution.converged else None


def _lower_on_circles(problem: PlateauProblem, solution: PlateauSolution) -> PlateauSolution | None:
    """A surface of less area than an unstable annulus, as Laurent series, or None if none is found."""
    on_circles = Route("circles", lambda own: RimsSolver(problem=own).on_circles())
    try:
        lower = _solution((on_circles,), problem)
    except (*FAILURES, NoConnectedSurfaceError):
        return None
    return lower if lower.area < solution.area else None


def _lower_on_disk(problem: PlateauProblem, solution: PlateauSolution) -> PlateauSolution | None:
    """A disk of less area than an unstable one, as power series on the unit disk, or None if none is found."""
    found = HarmonicSolver(problem=problem).below_on_disk(solution.matching)
    lower = None if found is None else problem.solution(found)
    return lower if lower is not None and lower.area < solution.area else None


def _on_divided_sides(problem: PlateauProblem) -> PlateauSolution:
    """The disk over a polygon that is given by its corners. Points on the sides are added for the fit."""
    loop = problem.loop
    share = np.arange(_PARTS_OF_A_SIDE)[:, None] / _PARTS_OF_A_SIDE
    points = loop.points[:, None] + share * (shifted(loop.points, -1, axis=0) - loop.points)[:, None]
    whole = BoundaryLoop.from_points(points.reshape(-1, 3), corners=_PARTS_OF_A_SIDE * np.arange(len(loop)))
    finer = replace(PlateauProblem.of([whole], problem.options), steps=problem.steps, parts=_PARTS_OF_A_SIDE)
    solution = minimal_disk(finer, plan(finer))
    rim = replace(solution.rims[0], loop=loop, curve=problem.curve.placed(loop.points, loop.diagonal))
    return replace(solution, rims=(rim,), solved_to=None)
