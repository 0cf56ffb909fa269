"""What a minimal surface is asked for: loops and Γ through them at unit size, and what all routes to it share."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import combinations, compress
from typing import Any, TypeAlias, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from spinor_geom.adapters import to_rims
from spinor_geom.errors import LoopsMeetError, OptionError, SpinorGeomError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.intersections import crossings_between, is_star, require_simple
from spinor_geom.mesh.polygons import Polygons
from spinor_geom.mesh.spacing import with_long_edges_divided
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.misfit import BoundaryResidual, Misfit
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.route_result import Found
from spinor_geom.plateau.solution import Annulus, PlateauSolution, RimDisks, RimMatch
from spinor_geom.plateau.steps import Clock, Iteration, Steps

AnyRequest = TypeVar("AnyRequest", bound="Request")
# Loops at unit size, their centre and their scale: see `Request`.
Frame: TypeAlias = tuple[tuple[BoundaryLoop, ...], Float[np.ndarray, "3"], float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """A loop or several, Γ through them, and how the surface is asked for."""

    loops: tuple[BoundaryLoop, ...]  # as they were given
    # with their common centre at 0 and their common diagonal 1, where every tolerance is a ratio
    units: tuple[BoundaryLoop, ...]
    curves: tuple[BoundaryCurve, ...]  # Γ through each, at unit size
    centre: Float[np.ndarray, "3"]  # of the loops
    scale: float  # their common diagonal
    options: Options  # of the call
    steps: Steps  # of all routes
    clock: Clock = field(default_factory=Clock)  # of their stages
    parts: int = 1  # into which each edge was divided: residuals count in whole edges

    @classmethod
    def of(
        cls: type[AnyRequest],
        given: Sequence[BoundaryLoop | ClosedCurve],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> AnyRequest:
        """The request of loops or curves in formulas.

        Raises:
            OptionError: a model that has no surfaces over so many loops.
            SelfCrossingLoopError: a loop crosses or touches itself.
            LoopsMeetError: two loops cross or touch each other.
            RepeatedPointError: two neighbouring points of a loop are equal.
            CurveError: formulas are not those of a smooth closed curve.
        """
        options.require_rims(len(given))
        samples = [(one, None) if isinstance(one, BoundaryLoop) else _sampled(one) for one in given]
        loops = tuple(loop for loop, _ in samples)
        _require_apart(loops)
        return cls.over(loops, [curve for _, curve in samples], options, on_iteration)

    @classmethod
    def over(
        cls: type[AnyRequest],
        loops: Sequence[BoundaryLoop],
        curves: Sequence[BoundaryCurve | None],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> AnyRequest:
        """The request of loops that are known to be simple and apart; for None the smooth curve through the points."""
        units, centre, scale = _at_unit_size(loops)
        return cls(
            loops=tuple(loops),
            units=units,
            curves=tuple(
                BoundaryCurve.from_loop(unit)
                if curve is None
                else curve.placed(unit.points, unit.diagonal / _extent(curve.coefficients[-1]))
                for unit, curve in zip(units, curves, strict=True)
            ),
            centre=centre,
            scale=scale,
            options=options,
            steps=Steps(limit=options.max_iterations, on_iteration=on_iteration),
        )

    @classmethod
    def each(cls: type[AnyRequest], loops: Sequence[Any], options: Options) -> list[AnyRequest | SpinorGeomError]:
        """The request of a disk over each of several loops, or why it cannot be made: see `of`."""
        options.require_rims(1)
        given = [_one_loop(loop) for loop in loops]
        frames = _frames(given)
        units = [frame[0][0] for frame in frames if not isinstance(frame, SpinorGeomError)]
        curves = iter(BoundaryCurve.from_loops(units))
        return [
            loop
            if isinstance(loop, SpinorGeomError)
            else frame
            if isinstance(frame, SpinorGeomError)
            else cls(
                loops=(loop,),
                units=frame[0],
                curves=(next(curves),),
                centre=frame[1],
                scale=frame[2],
                options=options,
                steps=Steps(limit=options.max_iterations),
            )
            for loop, frame in zip(given, frames, strict=True)
        ]

    @property
    def is_disk(self) -> bool:
        """Whether there is one loop."""
        return len(self.loops) == 1

    @property
    def loop(self) -> BoundaryLoop:
        """That of a disk."""
        return self.loops[0]

    @property
    def unit(self) -> BoundaryLoop:
        """That of a disk at unit size."""
        return self.units[0]

    @property
    def curve(self) -> BoundaryCurve:
        """That of a disk at unit size."""
        return self.curves[0]

    @cached_property
    def pinned(self) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        """The points of a disk's loop at unit size with more on its long edges, and which of them are its own."""
        return with_long_edges_divided(self.unit.points)

    @property
    def allowed(self) -> float:
        """RMS distance from Γ that is allowed, at unit size."""
        return self.options.tolerance * _mean_edge(self.units)

    def excess(self, misfit: Misfit) -> float:
        """How many times farther from Γ a surface is than it may be: 1 where the tolerance is met."""
        return misfit.excess(allowed=self.allowed, tolerance=self.options.tolerance)

    def solution(self, found: Found, rim_disks: RimDisks | None = None) -> PlateauSolution:
        """A surface in the loops' coordinates; that between several loops with the disks that it is set against."""
        scale, history, between = self.scale, tuple(self.steps.history), found.between
        misfit = found.misfit.enlarged(scale)
        residual = BoundaryResidual(
            rms=misfit.rms,
            max=misfit.max,
            max_per_local_edge=misfit.max_per_local_edge / self.parts,
            mean_edge=_mean_edge(self.loops) * self.parts,
            diagonal=scale,
        )
        converged, reason = residual.verdict(self.options.tolerance, steps=len(history), limit=found.limit)
        order, back = ((0,), (False,)) if between is None else (between.order, between.back)
        loops = [self.loops[k].reversed() if way else self.loops[k] for k, way in zip(order, back, strict=True)]
        parts = zip(loops, found.curves, found.domain.boundaries, found.matchings, strict=True)
        return PlateauSolution(
            rims=tuple(
                RimMatch(loop=loop, curve=curve.placed(loop.points, scale), boundary=boundary, matching=matching)
                for loop, curve, boundary, matching in parts
            ),
            domain=found.domain,
            boundary_residual=residual,
            area=found.area * scale**2,
            route=found.route,
            history=history,
            solve_timings=dict(self.clock.seconds),
            tolerance=self.options.tolerance,
            converged=converged,
            reason=reason,
            # a plane region is its Ω, whose boundaries were found to be simple
            evidence=Evidence(
                make=partial(found.surface_at, scale, self.centre),
                curvature=found.curvature,
                is_plane=found.route == "plane",
            ),
            annulus=None
            if between is None or rim_disks is None
            else Annulus(
                modulus=between.modulus,
                antiperiodic=between.antiperiodic,
                period=between.period * scale,
                backward=tuple(way for _, way in sorted(zip(order, back, strict=True))),
                order=order,
                rim_disks=rim_disks,
            ),
        )


def _frames(given: Sequence[BoundaryLoop | SpinorGeomError]) -> list[Frame | SpinorGeomError]:
    """Loops at unit size, each by itself, or why no surface over it can be asked for."""
    found: dict[int, Frame | SpinorGeomError] = {}
    alike: dict[int, list[int]] = defaultdict(list)
    loops = {place: loop for place, loop in enumerate(given) if isinstance(loop, BoundaryLoop)}
    for place, loop in enumerate(given):
        if isinstance(loop, SpinorGeomError):
            found[place] = loop
        else:
            alike[len(loop)].append(place)
    for places in alike.values():
        are_stars = is_star(np.stack([loops[place].points for place in places]))
        refusals = ((place, _refusal(require_simple, loops[place])) for place in compress(places, ~are_stars))
        found.update((place, refusal) for place, refusal in refusals if refusal)
        if simple := [place for place in places if place not in found]:
            polygons = Polygons(points=np.stack([loops[place].points for place in simple]))
            points = (polygons.points - polygons.centroids[:, None]) / polygons.diagonals[:, None, None]
            units = BoundaryLoop.moved_together([loops[place] for place in simple], points)
            for place, unit, centre, scale in zip(
                simple, units, polygons.centroids, polygons.diagonals.tolist(), strict=True
            ):
                found[place] = _refusal(require_distinct_neighbours, unit) or ((unit,), centre, scale)
    return [found[place] for place in range(len(given))]


def _one_loop(what: Any) -> BoundaryLoop | SpinorGeomError:
    """The loop of a batch that `what` stands for, or why it is none."""
    try:
        rims = to_rims(what)
    except SpinorGeomError as error:
        return error
    if len(rims) == 1 and isinstance(rims[0], BoundaryLoop):
        return rims[0]
    return OptionError("a batch is of single loops; solve curves in formulas and several rims by solve_plateau")


def _refusal(check: Callable[[BoundaryLoop], None], loop: BoundaryLoop) -> SpinorGeomError | None:
    """What a check says of a loop."""
    try:
        check(loop)
    except SpinorGeomError as error:
        return error
    return None


def _at_unit_size(loops: Sequence[BoundaryLoop]) -> Frame:
    """Loops with their common centre at 0 and their common diagonal 1, with both."""
    lengths = np.array([loop.perimeter for loop in loops])
    # relative to the first centre: loops far from the origin lose no digits
    first = loops[0].centroid
    centre = first + lengths @ np.stack([loop.centroid - first for loop in loops]) / lengths.sum()
    scale = _extent(np.concatenate([loop.points for loop in loops]))
    units = tuple(
        BoundaryLoop(points=(loop.points - centre) / scale, vertex_ids=loop.vertex_ids, corners=loop.corners)
        for loop in loops
    )
    return units, centre, scale


def _mean_edge(loops: Sequence[BoundaryLoop]) -> float:
    return sum(loop.perimeter for loop in loops) / sum(map(len, loops))


def _extent(points: Float[np.ndarray, "n 3"]) -> float:
    """Diagonal of their bounding box, rounded as those of many loops."""
    return float(Polygons(points=points[None]).diagonals[0])


def _sampled(given: ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve]:
    """The loop of the ends of the polynomials of a curve in formulas, and these."""
    curve = BoundaryCurve.from_formula(given)
    return BoundaryLoop.from_points(curve.coefficients[-1], corners=np.flatnonzero(curve.corners)), curve


def _require_apart(loops: Sequence[BoundaryLoop]) -> None:
    """Checks that loops neither cross or touch themselves nor each other."""
    for loop in loops:
        require_simple(loop)
    for first, second in combinations(loops, 2):
        meeting = crossings_between(first.points, second.points)
        if len(meeting):
            pairs = zip((first, second), meeting[0].tolist(), strict=True)
            raise LoopsMeetError(
                edges=[[int(loop.vertex_ids[k]), int(loop.vertex_ids[(k + 1) % len(loop)])] for loop, k in pairs]
            )
