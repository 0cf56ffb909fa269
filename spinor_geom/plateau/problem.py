"""Plateau's problem (boundary loops, curves through them, options), and the type of the routes that solve it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations, compress
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters import to_rims
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.errors import (
    LoopsMeetError,
    OptionError,
    SelfCrossingCurveError,
    SelfCrossingLoopError,
    SpinorGeomError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop, centroids, diagonals, require_distinct_neighbours
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.intersections import crossings_between, is_star, require_simple
from spinor_geom.plateau.annulus import Annulus, RimDisks
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.misfit import BoundaryResidual, Misfit
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.roughness import as_polygon, roughness
from spinor_geom.plateau.route_result import RouteResult, typed_failures
from spinor_geom.plateau.solution import PlateauSolution, RouteName
from spinor_geom.plateau.steps import Clock, Iteration, Steps
from spinor_geom.plateau.threads import one_thread

MOST_FREE_POINTS = 1500  # largest number of points for surfaces through the points, whose cost grows as n³
# Most points of a loop for the first disk, Ω and the poles. Longer loops are thinned for them. Γ uses all points.
_MOST_START_POINTS = 240
# The same for each corner of smooth loops with corners, at least as for a triangle. With 24 an octagon of 240 points is
# missed. `roughness` of such loops: with noise of 0.02 edges they take longer.
_POINTS_PER_SIDE, _SMOOTH = 32, 0.01

# Loops at unit size, their centre and their scale: see `PlateauProblem`.
UnitLoops: TypeAlias = tuple[tuple[BoundaryLoop, ...], Float[np.ndarray, "3"], float]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateauProblem:
    """Boundary loops, the curves Γ through them, and the options of the solve.

    Attributes:
        loops: the loops in the caller's coordinates.
        units: the loops at unit size: common centre 0, diagonal of the common bounding box 1.
        curves: Γ through each loop, at unit size.
        centre: centre of the loops, in the caller's coordinates.
        scale: common diagonal of the loops, in mesh units.
        options: options of the call.
        steps: the steps of all routes.
        clock: the time of their stages.
        parts: number of pieces that each edge of the given loop was divided into. Residuals are per undivided edge.
        start: a discrete surface to start from, at unit size, or None for a first fill.
    """

    loops: tuple[BoundaryLoop, ...]
    units: tuple[BoundaryLoop, ...]
    curves: tuple[BoundaryCurve, ...]
    centre: Float[np.ndarray, "3"]
    scale: float
    options: Options
    steps: Steps
    clock: Clock = field(default_factory=Clock)
    parts: int = 1
    start: Disk | None = None

    @classmethod
    def of(
        cls,
        given: Sequence[BoundaryLoop | ClosedCurve],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> PlateauProblem:
        """The problem for loops, or for curves given by formulas.

        Raises:
            OptionError: the model does not support this number of loops.
            SelfCrossingLoopError: a loop crosses or touches itself.
            LoopsMeetError: two loops cross or touch each other.
            RepeatedPointError: two neighbouring points of a loop are equal.
            CurveError: formulas do not give a smooth closed curve.
        """
        options.require_rims(len(given))
        samples = [(one, None) if isinstance(one, BoundaryLoop) else _sampled(one) for one in given]
        loops = tuple(loop for loop, _ in samples)
        if len(loops) > 1 and options.between == "free" and options.model == "auto":
            loops = tuple(map(as_polygon, loops))
        curves = [curve for _, curve in samples]
        _require_apart(loops, curves)
        return cls.over(loops, curves, options, on_iteration)

    @classmethod
    def over(
        cls,
        loops: Sequence[BoundaryLoop],
        curves: Sequence[BoundaryCurve | None],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> PlateauProblem:
        """The problem for loops known to be simple and disjoint. A curve that is None is `BoundaryCurve.from_loop`."""
        units, centre, scale = _at_unit_size(loops)
        return cls(
            loops=tuple(loops),
            units=units,
            curves=tuple(
                BoundaryCurve.from_loop(unit, quintic=options.is_quintic)
                if curve is None
                else curve.placed(unit.points, unit.diagonal / _diagonal(curve.coefficients[-1]))
                for unit, curve in zip(units, curves, strict=True)
            ),
            centre=centre,
            scale=scale,
            options=options,
            steps=Steps(limit=options.max_iterations, on_iteration=on_iteration),
        )

    @classmethod
    def each(cls, loops: Sequence[Any], options: Options) -> list[PlateauProblem | SpinorGeomError]:
        """A problem for each of many loops, or the error that `of` raises for it."""
        options.require_rims(1)
        given = [_single_loop(loop) for loop in loops]
        scaled = _each_at_unit_size(given)
        simple = [one for one in scaled if not isinstance(one, SpinorGeomError)]
        curves = iter(BoundaryCurve.from_loops([units[0] for units, _, _ in simple], quintic=options.is_quintic))
        problems: list[PlateauProblem | SpinorGeomError] = []
        for loop, one in zip(given, scaled, strict=True):
            if isinstance(one, SpinorGeomError):
                problems.append(one)
                continue
            assert isinstance(loop, BoundaryLoop)
            (units, centre, scale), steps, own = one, Steps(limit=options.max_iterations), (next(curves),)
            problems.append(
                cls(loops=(loop,), units=units, curves=own, centre=centre, scale=scale, options=options, steps=steps)
            )
        return problems

    def starting_from(self, disk: Disk) -> PlateauProblem:
        """The problem with a start, given in the caller's coordinates."""
        return replace(self, start=replace(disk, vertices=(disk.vertices - self.centre) / self.scale))

    @property
    def is_disk(self) -> bool:
        """Whether there is one loop."""
        return len(self.loops) == 1

    @property
    def loop(self) -> BoundaryLoop:
        """The first loop: the only one of a disk."""
        return self.loops[0]

    @property
    def unit(self) -> BoundaryLoop:
        """The first loop at unit size."""
        return self.units[0]

    @property
    def curve(self) -> BoundaryCurve:
        """Γ of the first loop, at unit size."""
        return self.curves[0]

    @property
    def may_be_free(self) -> bool:
        """Whether Γ of the first loop may be free between its points."""
        is_short = len(self.unit) <= MOST_FREE_POINTS
        return self.options.between == "free" and is_short and not self.curve.is_formula

    @cached_property
    def allowed(self) -> float:
        """Allowed RMS distance of the boundary from Γ, at unit size."""
        return self.options.tolerance * _mean_edge(self.units)

    def excess(self, misfit: Misfit) -> float:
        """Distance from Γ divided by the allowed distance: at most 1 if the tolerance is met."""
        return misfit.excess(allowed=self.allowed, tolerance=self.options.tolerance)

    def solution(self, found: RouteResult, rim_disks: RimDisks | None = None) -> PlateauSolution:
        """The solution in the caller's coordinates. A surface between loops is compared with `rim_disks`."""
        scale, history, rims = self.scale, tuple(self.steps.history), found.rims_result
        misfit = found.misfit.enlarged(scale)
        residual = BoundaryResidual(
            rms=misfit.rms,
            max=misfit.max,
            max_per_local_edge=misfit.max_per_local_edge / self.parts,
            mean_edge=_mean_edge(self.loops) * self.parts,
            diagonal=scale,
        )
        converged, reason = residual.verdict(self.options.tolerance, steps=len(history), limit=found.limit)
        order, backward = ((0,), (False,)) if rims is None else (rims.order, rims.backward)
        loops = [self.loops[k].reversed() if flip else self.loops[k] for k, flip in zip(order, backward, strict=True)]
        parts = zip(loops, found.curves, found.domain.boundaries, found.matchings, strict=True)
        annulus = None
        if rims is not None and rim_disks is not None:
            annulus = Annulus(
                modulus=rims.modulus,
                antiperiodic=rims.antiperiodic,
                period=rims.period * scale,
                backward=tuple(flip for _, flip in sorted(zip(order, backward, strict=True))),
                order=order,
                rim_disks=rim_disks,
            )
        evidence = Evidence(
            make=partial(found.surface_at, scale, self.centre),
            curvature=found.curvature,
            is_plane=found.route == "plane",
        )
        # the integral along an unresolved rim may be negative, that of λ² is not
        area = found.area * scale**2 if found.area > 0 else evidence.area_in_domain
        return PlateauSolution(
            rims=tuple(
                RimMatch(loop=loop, curve=curve.placed(loop.points, scale), boundary=boundary, matching=matching)
                for loop, curve, boundary, matching in parts
            ),
            domain=found.domain,
            boundary_residual=residual,
            area=area,
            route=found.route,
            history=history,
            solve_timings=dict(self.clock.seconds),
            tolerance=self.options.tolerance,
            converged=converged,
            reason=reason,
            evidence=evidence,
            annulus=annulus,
            solved_to=found.resume
            and partial(_resumed, found.resume, replace(self, steps=Steps(limit=self.steps.limit))),
        )


def _resumed(
    resume: Callable[[PlateauProblem], RouteResult], problem: PlateauProblem, tolerance: float
) -> PlateauSolution:
    steps, options = replace(problem.steps, history=[]), replace(problem.options, tolerance=tolerance)
    with one_thread(), typed_failures():
        again = replace(problem, options=options, steps=steps, clock=Clock())
        return again.solution(resume(again))


@dataclass(frozen=True, eq=False)
class Route:
    """A method to solve a Plateau problem.

    Attributes:
        name: the value of `PlateauSolution.route` for one loop.
        solve: returns the surface at unit size. It raises one of `FAILURES` if it finds none, and
            NoConnectedSurfaceError if none exists.
    """

    name: RouteName
    solve: Callable[[PlateauProblem], RouteResult]

    def __repr__(self) -> str:
        return f"Route({self.name!r})"


def start_indices(loop: BoundaryLoop) -> Int[np.ndarray, " k"]:
    """Indices of the points that bound the first discrete disk: all, or for long loops the corners and even samples.

    Smooth loops with corners are thinned more, to every so many points, because their points are dense at details.
    """
    corners, most, steps = np.flatnonzero(loop.corners), _MOST_START_POINTS, loop.edge_lengths
    if len(corners) and roughness(loop) < _SMOOTH:
        most, steps = min(most, _POINTS_PER_SIDE * max(3, len(corners))), np.ones(len(loop))
    if len(loop) <= most:
        return np.arange(len(loop))
    along = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    wanted = np.searchsorted(along, np.arange(most) * (steps.sum() / most))
    return np.unique(np.concatenate([[0], wanted.clip(0, len(loop) - 1), corners]))


def _each_at_unit_size(given: Sequence[BoundaryLoop | SpinorGeomError]) -> list[UnitLoops | SpinorGeomError]:
    """Each loop scaled to unit size by itself, or the error of a loop that is not valid."""
    scaled: dict[int, UnitLoops | SpinorGeomError] = {}
    loops: dict[int, BoundaryLoop] = {}
    by_length: dict[int, list[int]] = defaultdict(list)
    for place, loop in enumerate(given):
        if isinstance(loop, SpinorGeomError):
            scaled[place] = loop
        else:
            loops[place] = loop
            by_length[len(loop)].append(place)
    for places in by_length.values():
        are_stars = is_star(np.stack([loops[place].points for place in places]))
        errors = ((place, _error_of(require_simple, loops[place])) for place in compress(places, ~are_stars))
        scaled.update((place, error) for place, error in errors if error)
        if simple := [place for place in places if place not in scaled]:
            together = np.stack([loops[place].points for place in simple])
            centres, scales = centroids(together), diagonals(together)
            points = (together - centres[:, None]) / scales[:, None, None]
            for place, own, centre, scale in zip(simple, points, centres, scales.tolist(), strict=True):
                unit = _moved(loops[place], own)
                scaled[place] = _error_of(require_distinct_neighbours, unit) or ((unit,), centre, scale)
    return [scaled[place] for place in range(len(given))]


def _single_loop(curve: Any) -> BoundaryLoop | SpinorGeomError:
    """The loop of one entry of a batch, or the error if it is not a single loop."""
    try:
        rims = to_rims(curve)
    except SpinorGeomError as error:
        return error
    if len(rims) == 1 and isinstance(rims[0], BoundaryLoop):
        return rims[0]
    return OptionError("a batch takes single loops; use solve_plateau for curves given by formulas and several rims")


def _error_of(check: Callable[[BoundaryLoop], None], loop: BoundaryLoop) -> SpinorGeomError | None:
    """The error that a check raises for a loop."""
    try:
        check(loop)
    except SpinorGeomError as error:
        return error
    return None


def _at_unit_size(loops: Sequence[BoundaryLoop]) -> UnitLoops:
    """Loops moved to their common centre and scaled to diagonal 1."""
    lengths = np.array([loop.perimeter for loop in loops])
    # relative to the first centre, so that no digits are lost far from the origin
    first = loops[0].centroid
    centre = first + lengths @ np.stack([loop.centroid - first for loop in loops]) / lengths.sum()
    scale = _diagonal(np.concatenate([loop.points for loop in loops]))
    units = tuple(_moved(loop, (loop.points - centre) / scale) for loop in loops)
    return units, centre, scale


def _moved(loop: BoundaryLoop, points: Float[np.ndarray, "m 3"]) -> BoundaryLoop:
    """A loop with other positions, without the data of the adjacent mesh."""
    return BoundaryLoop(
        points=points, vertex_ids=loop.vertex_ids, corners=loop.corners, corners_given=loop.corners_given
    )


def _mean_edge(loops: Sequence[BoundaryLoop]) -> float:
    return sum(loop.perimeter for loop in loops) / sum(map(len, loops))


def _diagonal(points: Float[np.ndarray, "n 3"]) -> float:
    """Diagonal of the bounding box."""
    return float(diagonals(points))


def _sampled(given: ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve]:
    """The polynomial pieces of a curve given by formulas, and the loop of their end points."""
    curve = BoundaryCurve.from_formula(given)
    return BoundaryLoop.from_points(curve.coefficients[-1], corners=np.flatnonzero(curve.corners)), curve


def _require_simple(loop: BoundaryLoop, *, is_formula: bool) -> None:
    try:
        require_simple(loop)
    except SelfCrossingLoopError as error:
        if not is_formula:
            raise
        # the user does not know the edges of the polygon
        point = [float(f"{x:.6g}") for x in loop.points[error.fields["edges"][0][0]]]
        raise SelfCrossingCurveError(point=point, **error.fields) from None


def _require_apart(loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve | None]) -> None:
    """Checks that no loop crosses or touches itself or another one."""
    for loop, curve in zip(loops, curves, strict=True):
        _require_simple(loop, is_formula=curve is not None)
    for first, second in combinations(loops, 2):
        meeting = crossings_between(first.points, second.points)
        if len(meeting):
            pairs = zip((first, second), meeting[0].tolist(), strict=True)
            raise LoopsMeetError(
                edges=[[int(loop.vertex_ids[k]), int(loop.vertex_ids[(k + 1) % len(loop)])] for loop, k in pairs]
            )
