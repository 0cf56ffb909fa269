"""Connected minimal surfaces between several loops, and criteria for their non-existence."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import brentq

from spinor_geom.arrays import EPS, TINY, Array, to_numpy
from spinor_geom.domain.plane_domain import PARTS, FourierBoundary
from spinor_geom.errors import DomainError, OutOfTimeError, SurfaceError, UnresolvedRimsError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.harmonic_route import FEWEST_POINTS, even, points_of_domain
from spinor_geom.plateau.harmonic.lift import WORTHWHILE, Lift, lifted_between
from spinor_geom.plateau.harmonic.lifted_surface import circles_of, domain_of, surface_of
from spinor_geom.plateau.harmonic.smooth_domain import MOST_NODES
from spinor_geom.plateau.newton import MOST_STEPS, ROUNDING, SMALL
from spinor_geom.plateau.plane_route import lie_beside
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.capacity_path import all_on_path, mean_modulus
from spinor_geom.plateau.rims.cornered_route import (
    coarse_surfaces,
    corners_of,
    ends_of_arcs,
    smooth_surface,
    solve_with_corners,
)
from spinor_geom.plateau.rims.energy import DENSE, HarmonicSurface, RimsProblem
from spinor_geom.plateau.rims.starts import OrientedSurface, Rim, projected_starts, start_between
from spinor_geom.plateau.roughness import ROUGH_GRADIENT, is_rough, negligible_energy
from spinor_geom.plateau.route_result import COLLAPSED, NoConnectedSurfaceError, RimsResult, RouteResult
from spinor_geom.plateau.steps import SPENT
from spinor_geom.plateau.vertices.rims_through_points import SmoothSurface, surface_through

# Share of the allowed distance to reach while matrices are factored. With 0.1 surfaces between smooth rims keep 1e-6 of
# an edge instead of 1e-10, for as much time. With 0 rims of free points do not converge.
_WELL_BELOW = 1e-3
# Largest relative gradient of a critical point. With 1e-4 rims of a cube with noise get more nodes than their averages
# need, and the surface bulges.
_SETTLED = 1e-3
# Width of the smoothing of noisy curves, as a share of the loop. With half of it solves take half as many steps more.
# With twice as much rims of squares are rounded, and areas differ by 2 %.
_AVERAGE = 0.03
# The same for three rims and more, in edges: wider averages lack the corners between the gaps of chunks.
_EDGES = 1.5
_WITHOUT_MINIMUM = "the energy of surfaces between the rims decreases as the modulus increases, without a minimum"


def obstacle(loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve]) -> str | None:
    """The reason why no connected surface spans several loops at unit size, or None if no criterion applies."""
    if lie_beside(loops):
        return "the rims lie beside each other in one plane, and minimal surfaces between them lie in that plane"
    if len(curves) == 2 and parted_by_cone(*curves):
        return "the rims lie so far apart, in opposite halves of a cone, that no connected minimal surface spans them"
    return None


def parted_by_cone(first: BoundaryCurve, second: BoundaryCurve) -> bool:
    """Whether two curves lie in the two halves of the cone ρ < 1.5089·|ζ| about the line between their centres.

    Such curves bound no connected minimal surface: it would touch one of the catenoids around that line, which fill the
    outside of the cone. Each half is convex, so it contains a curve if it contains the control points of its pieces.

    Source: Dierkes, Hildebrandt & Tromba, "Regularity of Minimal Surfaces" (2010), chapter 4, the cone theorem.
    """
    # the catenoids around an axis, of all sizes, touch the cone with this radius at height 1
    opening = np.sinh(brentq(lambda x: x * np.tanh(x) - 1, 1, 2))
    pieces = (PPoly(curve.coefficients, curve.breaks) for curve in (first, second))
    points = [BPoly.from_power_basis(piece).c.reshape(-1, 3) for piece in pieces]
    centres = [some.mean(axis=0) for some in points]
    axis = centres[1] - centres[0]
    length = float(np.linalg.norm(axis))
    if not length:
        return False
    ends = []
    for some, side in zip(points, (1, -1), strict=True):
        away = some - centres[0]
        height = away @ axis / length
        radius = np.linalg.norm(away - height[:, None] * axis / length, axis=1)
        # bound on the height of the apex of a half that contains the curve
        ends.append(side * float((side * height + radius / opening).max()))
    return ends[0] < ends[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class RimsSolver:
    """Finds connected minimal surfaces between several loops."""

    problem: PlateauProblem

    @property
    def have_corners(self) -> bool:
        """Whether some rims have corners, arcs, or bends if they are not analytic, and all rims their own curves."""
        return not self._are_rough and any(
            len(corners_of(curve)) and (curve.kind != "analytic" or (curve.corners | ends_of_arcs(curve)).any())
            for curve in self.problem.curves
        )

    @property
    def may_crowd(self) -> bool:
        """Whether equal steps of circles may be too few for one rim: for its arcs, or among several rims."""
        curves = self.problem.curves
        return len(curves) > 2 or (not self._are_rough and any(len(corners_of(curve)) for curve in curves))

    @property
    def _are_rough(self) -> bool:
        return any(map(is_rough, self.problem.units, self.problem.curves))

    def on_own_nodes(self) -> RouteResult:
        """The surface between rims with as many nodes as each needs."""
        return solve_with_corners(self.problem, self._projected)

    def on_circles(self, *, is_last: bool = True) -> RouteResult:
        """The minimal surface of least energy found, or the one with the modulus nearest to that of the options.

        Raises:
            NoConnectedSurfaceError: it seems that there is none.
            UnresolvedRimsError: so it seems, but another search follows.
        """
        laurent = self.problem.options.laurent
        if laurent is not None and laurent.modulus is not None:
            log = math.log(laurent.modulus)
            found = self._stable() if self.problem.options.replaces_unstable else self.all_critical()
            best = min(found, key=lambda one: abs(math.log(mean_modulus(one.surface.domain)) - log), default=None)
        else:
            best = self._descended
            if best is None and len(self.problem.units) == 2:
                best = min(self._stable(), key=lambda oriented: oriented.surface.dirichlet_energy, default=None)
        if best is None and not is_last:
            raise UnresolvedRimsError(rims=len(self.problem.units), failure="finds none on equal steps of circles")
        if best is None:
            raise NoConnectedSurfaceError(COLLAPSED if len(self.problem.units) > 2 else _WITHOUT_MINIMUM)
        return self.fitted(best)

    def through_points(self) -> RouteResult:
        """The surface through the points of rough rims, near the first smooth one that leads to one.

        Raises:
            NoConnectedSurfaceError: between three rims or more two searches find that all surfaces degenerate.
        """
        best: RouteResult | None = None
        error: SurfaceError | DomainError | None = None
        degenerate = False
        try:
            for oriented, smooth in self._smooth_surfaces():
                loops, found = oriented.as_directed(self.problem.units), None
                try:
                    with self.problem.clock.stage("fit"):
                        found = surface_through(smooth, loops, allowed=self.problem.allowed, steps=self.problem.steps)
                except (DomainError, SurfaceError) as failure:
                    error = failure
                if found is not None and (best is None or found.misfit.rms < best.misfit.rms):
                    period = found.surface.largest_period()
                    best = replace(found, rims_result=replace(smooth.rims_result, period=period))
                if best is not None and self.problem.excess(best.misfit) <= 1:
                    break
        except NoConnectedSurfaceError:
            degenerate = True
        except UnresolvedRimsError as failure:
            error = failure
        except OutOfTimeError:
            if best is None:
                raise
        if best is not None:
            return best
        error = error or SurfaceError("no minimal surface was found between the smoothed rims")
        if len(self.problem.units) == 2:
            raise error
        try:
            return self.on_circles()
        except NoConnectedSurfaceError:
            if degenerate:
                raise
            raise error from None

    def _smooth_surfaces(self) -> Iterator[tuple[OrientedSurface, SmoothSurface]]:
        """Minimal surfaces over averages of the rims."""
        place = self.problem.options.place
        if len(self.problem.units) > 2:
            averaged = replace(self.problem, curves=self._averages)
            for start, found in coarse_surfaces(averaged, self._projected):
                yield start, smooth_surface(start, found, place)
            return
        oriented = self._descended
        if oriented is None:
            return
        with self.problem.clock.stage("lift"):
            lift = _lifted(oriented.surface, self._problem(oriented).curves, allowed=self.problem.allowed)
            circles = self._circles(oriented, oriented.surface.domain)
        series = lift.series
        yield (
            oriented,
            SmoothSurface(
                surface=surface_of(lift, domain_of(lift, *circles))(1.0, np.zeros(3)),
                centres=to_numpy(series.centres),
                radii=to_numpy(series.circles.radii),
                branches=to_numpy(series.centres)[np.flatnonzero(series.antiperiodic)],
                part=lambda z, number: series.part(place.put(z), number),
                boundaries=circles,
                averages=oriented.as_directed(self._averages),
                matchings=[_matching(slide) for slide in lift.slides],
                rims_result=_rims_result(oriented, series.antiperiodic, 0.0),
            ),
        )

    @property
    def _descended(self) -> OrientedSurface | None:
        """The surface that `_searched` finds, or None if all surfaces degenerate or two rims need too many nodes.

        Raises:
            UnresolvedRimsError: three rims or more need too many nodes, or have no start.
        """
        best, is_resolved = self._searched
        if not is_resolved and len(self.problem.units) > 2:
            failure = f"needs more than its limit of {DENSE} nodes"
            raise UnresolvedRimsError(rims=len(self.problem.units), failure=failure)
        return best

    @cached_property
    def _searched(self) -> tuple[OrientedSurface | None, bool]:
        """The first minimum of the energy from the starts, least energy first, or None, and whether nodes sufficed."""
        with self.problem.clock.stage("slides"):
            starts = sorted(self._starts, key=lambda start: start.surface.dirichlet_energy)
            are_resolved = len(starts) > 0
            for start in starts:
                best, is_resolved = self._settled(start)
                if best is not None:
                    return best, True
                are_resolved &= is_resolved
            return None, are_resolved

    def _settled(self, start: OrientedSurface) -> tuple[OrientedSurface | None, bool]:
        """The minimum of the energy from a start that is one with twice as many nodes too, as `_lower` returns it."""
        best, is_resolved = self._lower(start)
        while best is not None:
            problem, nodes = self._problem(best), 2 * best.surface.slides.shape[1]
            fine = problem.stationary(problem.resampled(best.surface, nodes), saddles=True)
            is_last = nodes * len(self.problem.units) > 2 * DENSE
            if is_last or (fine.size <= _SETTLED and fine.is_minimum):
                return replace(best, surface=fine), True
            # on few nodes the energy may have other minima
            best, is_resolved = self._lower(replace(best, surface=problem.resampled(best.surface, nodes)))
        return None, is_resolved

    def _lower(self, start: OrientedSurface) -> tuple[OrientedSurface | None, bool]:
        """The minimum of the energy from a start, with more nodes until the solve converges, and whether it does.

        None if too many nodes are needed. None and true if the modulus of two rims is too large, or the surface
        degenerates twice (once is not enough, because few nodes on a small rim may all meet in one point).
        """
        problem, n, fallen = self._problem(start), start.surface.slides.shape[1], 0
        while True:
            lower = problem.stationary(problem.resampled(start.surface, n), tolerance=SMALL)
            if not lower.falls_apart and lower.size <= _SETTLED:
                return replace(start, surface=lower), True
            n, fallen = 2 * n, fallen + lower.falls_apart
            degenerates = fallen == 2 or (len(self.problem.units) == 2 and lower.is_apart)
            if degenerates or n * len(self.problem.units) > DENSE:
                return None, degenerates

    @cached_property
    def _starts(self) -> tuple[OrientedSurface, ...]:
        """The starts, two for two rims, with the second one as given and reversed."""
        rims = self._rims[0]
        if len(rims) == 2:
            return tuple(start_between(*rims, FEWEST_POINTS, backward=backward) for backward in (False, True))
        return self._projected

    @cached_property
    def _projected(self) -> tuple[OrientedSurface, ...]:
        """Starts from projections. From a round ring, films between a frame and a rim off its middle degenerate."""
        return tuple(projected_starts(self._rims[0], FEWEST_POINTS))

    @cached_property
    def _averages(self) -> tuple[BoundaryCurve, ...]:
        """For noisy loops smooth averages of the curves, with which the search starts, else the curves.

        2A − A², with A the average, does not shrink features much longer than its width.
        """
        if not self._is_noisy:
            return self.problem.curves
        widths = [_AVERAGE if len(self.problem.units) == 2 else _EDGES / len(unit) for unit in self.problem.units]
        pairs = [(curve.smoothed(width), width) for curve, width in zip(self.problem.curves, widths, strict=True)]
        return tuple(
            replace(once, coefficients=2 * once.coefficients - once.smoothed(width).coefficients)
            for once, width in pairs
        )

    @cached_property
    def _is_noisy(self) -> bool:
        """Whether a loop is rough, or its curve a cubic spline without corners."""
        return self._are_rough or any(
            curve.kind == "cubic" and not curve.corners.any() for curve in self.problem.curves
        )

    @cached_property
    def _rims(self) -> tuple[tuple[Rim, ...], ...]:
        """The rims with the averages, and with the loops' own curves."""
        place = self.problem.options.place
        return tuple(
            tuple(
                Rim(number=k, directions=(CurveTensors.of(curve, place), CurveTensors.of(curve.reversed(), place)))
                for k, curve in enumerate(curves)
            )
            for curves in (self._averages, self.problem.curves)
        )

    def _problem(self, oriented: OrientedSurface, *, averaged: bool = True) -> RimsProblem:
        rims = self._rims[not averaged]
        curves = [rims[rim.number].directions[flip] for rim, flip in zip(oriented.rims, oriented.backward, strict=True)]
        return RimsProblem(
            curves=CurveTensors.batch(curves),
            negligible=EPS**0.5 if self._is_noisy else ROUND_OFF,
            on_step=partial(self.problem.steps.take, "Douglas-Newton"),
        )

    def all_critical(self) -> list[OrientedSurface]:
        """Critical points of the energy on the capacity path.

        For two rims these are all for which the second loop has the direction of the start of less energy, and for more
        those on the path of the minimum.
        """
        best, is_two = self._descended, len(self.problem.units) == 2
        start = min(self._starts, key=lambda start: start.surface.dirichlet_energy) if is_two else best
        if start is None:
            return []
        n = (best or start).surface.slides.shape[1]
        with self.problem.clock.stage("moduli"):
            problem = self._problem(start)
            # half of the nodes: an eighth of the cost
            coarse = problem.resampled(start.surface, max(FEWEST_POINTS, n // 2))
            # for two rims only the slides. `all_on_path` then varies the moduli
            start_of_path = problem.stationary(
                replace(coarse, fixed_moduli=is_two), tolerance=SMALL, saddles=not is_two
            )
            return [
                replace(start, surface=problem.stationary(problem.resampled(surface, n), saddles=True))
                for surface in all_on_path(problem, start_of_path)
            ]

    def _stable(self) -> list[OrientedSurface]:
        return [oriented for oriented in self.all_critical() if oriented.surface.index == 0]

    def fitted(self, oriented: OrientedSurface) -> RouteResult:
        """The minimal surface near a harmonic one, with enough nodes to meet the tolerance."""
        problem, saddles = self._problem(oriented, averaged=False), oriented.surface.index > 0
        tried: list[tuple[Lift, HarmonicSurface]] = []
        limit, before = "more nodes on the rims do not help", math.inf
        for finer in self._finer(oriented, saddles=saddles):
            goal = self.problem.allowed * (_WELL_BELOW if finer.count <= DENSE else 1.0)
            if self.problem.options.is_series:
                goal = TINY
            with self.problem.clock.stage("lift"):
                tried.append((_lifted(finer, problem.curves, allowed=goal), finer))
            lift, harmonic = min(tried, key=lambda pair: pair[0].misfit.rms)
            if lift.misfit.excess(allowed=goal, tolerance=self.problem.options.tolerance) <= 1:
                break
            # convergence at corners is slow: continue if the extrapolated distance is small enough
            now, doublings = tried[-1][0].misfit.rms, math.log2(MOST_NODES / finer.slides.shape[1])
            can_reach = now > self.problem.allowed >= now * (now / before) ** doublings
            if now >= WORTHWHILE * before and (saddles or not can_reach):
                break
            before = lift.misfit.rms
        else:
            are_spent = self.problem.steps.are_spent
            limit = SPENT if are_spent else f"{MOST_NODES} nodes on each rim are the largest number that is tried"
        with self.problem.clock.stage("surface"):
            domain = domain_of(lift, *self._circles(oriented, harmonic.domain))
        return RouteResult(
            domain=domain,
            surface_at=surface_of(lift, domain),
            curves=tuple(oriented.as_directed(self.problem.curves)),
            matchings=tuple(_matching(slide) for slide in lift.slides),
            misfit=lift.misfit,
            area=lift.area,
            route="annulus" if len(lift.slides) == 2 else "circles",
            limit=limit,
            rims_result=_rims_result(replace(oriented, surface=harmonic), lift.series.antiperiodic, lift.period),
        )

    def _finer(self, oriented: OrientedSurface, *, saddles: bool) -> Iterator[HarmonicSurface]:
        """Harmonic surfaces on the loops' own curves, with increasing numbers of nodes."""
        problem, surface = self._problem(oriented, averaged=False), oriented.surface
        if self._is_noisy:
            n = even(PARTS * max(map(len, self.problem.units)))
            with self.problem.clock.stage("slides"):
                surface = self._stationary(problem, surface, n, saddles=saddles)
        while True:
            yield surface
            n = even(2 * surface.slides.shape[1])
            if n > MOST_NODES or self.problem.steps.are_spent:
                return
            try:
                with self.problem.clock.stage("slides"):
                    surface = self._stationary(problem, surface, n, saddles=saddles)
            except OutOfTimeError:  # keep the surfaces so far
                return

    def _stationary(self, problem: RimsProblem, surface: HarmonicSurface, n: int, *, saddles: bool) -> HarmonicSurface:
        edges = max(map(len, self.problem.units))
        return problem.stationary(
            problem.resampled(surface, n),
            tolerance=ROUGH_GRADIENT * self.problem.options.tolerance if self._is_noisy else ROUNDING,
            max_steps=min(MOST_STEPS, self.problem.steps.left),
            near=not self._is_noisy,
            saddles=saddles,
            negligible=negligible_energy(edges, self.problem.allowed) if self._is_noisy else 0.0,
        )

    def _circles(self, oriented: OrientedSurface, domain: CircularDomain) -> list[FourierBoundary]:
        return circles_of(domain, [points_of_domain(self.problem.units[rim.number]) for rim in oriented.rims])


def _rims_result(oriented: OrientedSurface, antiperiodic: tuple[bool, ...], period: float) -> RimsResult:
    return RimsResult(
        order=tuple(rim.number for rim in oriented.rims),
        backward=oriented.backward,
        modulus=mean_modulus(oriented.surface.domain),
        antiperiodic=antiperiodic,
        period=period,
    )


def _matching(slide: Float[Array, " n"]) -> Float[np.ndarray, "n 2"]:
    """`RimMatch.matching` for slides at equal steps, shifted so that the first one is in [0, 1)."""
    return np.column_stack([np.arange(len(slide)) / len(slide), to_numpy(slide - float(slide[0]) // 1)])


def _lifted(surface: HarmonicSurface, curves: CurveTensors, *, allowed: float) -> Lift:
    return lifted_between(surface.domain, surface.points, surface.slides, curves, allowed=allowed)
