"""Minimal disks and annuli as Cauchy networks on an Ω flattened from a discrete surface, fitted by Gauss-Newton.

The loops may have corners. Two loops may have shapes for which the points would be too close together on a round
annulus. The fit converges to the minimal surface nearest to its start, which may be unstable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Complex, Float

from spinor_geom.arrays import Array, modulo_one, unit
from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.minimal_surface import finer_disk, first_disk
from spinor_geom.discrete.strip import discrete_annulus, runs_backward
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary, sampled
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError
from spinor_geom.holomorphic.poles import corner_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.initial_spinors import lifted_spinors
from spinor_geom.plateau.network.discretisation import Discretisation, independent_residual
from spinor_geom.plateau.network.fitted import Fitted, fitted_surface
from spinor_geom.plateau.network.gauss_newton import Fit, gauss_newton
from spinor_geom.plateau.network.opened import opened
from spinor_geom.plateau.problem import PlateauProblem, Route, start_indices
from spinor_geom.plateau.roughness import is_rough, roughness
from spinor_geom.plateau.route_result import RimsResult, RouteResult
from spinor_geom.plateau.solution import RouteName
from spinor_geom.plateau.steps import SPENT, STALLED
from spinor_geom.surface.frames import signs_close_up

# Shares of a loop. For the first discrete surface long edges are divided into parts as long as the median edge, which
# is taken to be within these limits. Beside straight sides of one edge its flattening has kinks where Γ is smooth: of
# three frames with a straight and a curved side the residuals were 1e-4, 9e-6 and 1e-6 of the diagonal in 1 to 6 s, and
# are 3e-7, 1e-6 and 8e-7 in 0.3 to 3 s. Coarse polygons take twice the time if all their edges are a 64th.
_LONGEST_EDGE = 1 / 96, 1 / 32
# An edge along which Γ turns by more, in radians, is divided too: the residual at peaks and arcs of a few edges is a
# tenth then. Directions are compared at shares of an edge.
_MOST_TURN, _INSIDE = 0.25, np.linspace(0.01, 0.99, 8)
# Distance from Γ, in edges, above which a first fit is not refined, if it had all features: with fewer it is larger by
# the fourth power of their ratio. Of 138 narrow bands and sheets and 100 random loops none beyond it came to 1e-3.
_LOST = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """A loop with the surface on its left."""

    number: int  # index of the given loop
    backward: bool  # whether the given loop is reversed
    loop: BoundaryLoop
    curve: BoundaryCurve
    knots: Float[np.ndarray, " k1"]  # parameters of Γ at the boundary vertices of the discrete surface, closed
    corners: Bool[np.ndarray, " k"]  # which of those vertices are corners of Ω

    @classmethod
    def of(cls, number: int, loop: BoundaryLoop, curve: BoundaryCurve, *, backward: bool, is_kept: bool) -> _Side:
        """The loop with its `start_indices`, and unless it is kept with more points on long and curved edges."""
        if backward:
            loop, curve = loop.reversed(), curve.reversed()
        indices = start_indices(loop)
        lengths = np.add.reduceat(loop.edge_lengths, indices)
        ends = np.append(curve.breaks[indices], curve.breaks[indices[0]] + 1)
        parts = np.ones(len(lengths))
        if not is_kept:
            longest = loop.perimeter * np.clip(np.median(lengths) / loop.perimeter, *_LONGEST_EDGE)
            tangents = unit(curve.derivative((ends[:-1, None] + np.diff(ends)[:, None] * _INSIDE) % 1.0))
            turns = np.linalg.norm(np.diff(tangents, axis=1), axis=2).sum(axis=1)
            parts = np.maximum(parts, np.maximum(lengths / longest, turns / _MOST_TURN))
        parts = np.rint(parts).astype(np.int64)
        *first, count = np.cumsum([0, *parts]).tolist()
        knots = np.interp(np.arange(count + 1), [*first, count], ends)
        corners = np.zeros(count, dtype=bool)
        corners[first] = loop.corners[indices]
        return cls(number=number, backward=backward, loop=loop, curve=curve, knots=knots, corners=corners)


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkSolver:
    """Fits a Cauchy network to one loop or two."""

    problem: PlateauProblem
    power: float = 1.0  # see `gauss_newton`

    @cached_property
    def _sides(self) -> tuple[_Side, ...]:
        """The loops in the order of Ω's boundaries: the longest one is outside."""
        with self.problem.clock.stage("first fill"):
            reverse = len(self.problem.units) > 1 and runs_backward(*(loop.points for loop in self.problem.units))
        # a given start of a disk has the loop's own points as boundary, and between those of a rough one Γ is a guess
        is_kept = self.problem.start is not None or (self.problem.is_disk and self._is_rough)
        sides = [
            _Side.of(number, loop, curve, backward=reverse and number > 0, is_kept=is_kept)
            for number, (loop, curve) in enumerate(zip(self.problem.units, self.problem.curves, strict=True))
        ]
        return tuple(sorted(sides, key=lambda side: -side.loop.perimeter))

    @cached_property
    def first_surface(self) -> Disk:
        """A discrete minimal disk or annulus through points of the loops."""
        rims = [side.curve.point(side.knots[:-1]) for side in self._sides]
        with self.problem.clock.stage("first fill"):
            if len(rims) > 1:
                surface = discrete_annulus(*rims)[1]
            else:
                surface = first_disk(*rims)
                surface = finer_disk(surface, *self._sizes) if self._is_rough else surface
        require_time()  # from an unfinished descent the fit may converge to another surface
        return surface

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(len(side.corners) for side in self._sides)

    @property
    def _start(self) -> Disk:
        return self.problem.start or self.first_surface

    @property
    def _is_rough(self) -> bool:
        return any(map(is_rough, self.problem.units, self.problem.curves))

    def solve(self, before: Fitted | None = None) -> RouteResult:
        """The minimal surface fitted from an earlier fit, the problem's start, or a first discrete surface."""
        fitted = self._fitted_from(self._start) if before is None else self._resumed(before)
        gains = before is not None and fitted.misfit.rms < before.misfit.rms / 2
        if before is not None and not gains and self._is_missed(fitted) and not is_out_of_time():
            # few frames converge only by arc length
            fitted = min(fitted, replace(self, power=1.0)._resumed(before), key=lambda one: one.misfit.rms)
            gains = fitted.misfit.rms < before.misfit.rms / 2
        may_improve = self.problem.is_disk and not gains and not self._is_rough
        # a finer disk has moduli nearer to the right ones: eight corners of a prism are met only from it
        if may_improve and self._is_missed(fitted) and fitted.stage.has_moduli:
            fitted = self._improved(fitted, self._start)
        rims_result = None
        if not self.problem.is_disk:
            rims_result = RimsResult(
                order=tuple(side.number for side in self._sides),
                backward=tuple(side.backward for side in self._sides),
                antiperiodic=(len(fitted.stage.branches) > 0,),
                period=0.0,
            )
        curves = tuple(side.curve for side in self._sides)
        return self.result(fitted, curves, "network" if rims_result is None else "annular network", rims_result)

    def lifted(self, stage: Discretisation, readout: Complex[Array, "n 2"], slide: Float[Array, " nodes"]) -> Fitted:
        """Given p and q as they are, with the distance of their surface's boundary from Γ.

        Args:
            stage: Ω with the poles.
            readout: p and q.
            slide: curve parameters of the nodes.
        """
        return self._measured(stage, Fit.at(stage.problem, readout, slide))

    def brought_nearer(self, start: Fitted) -> Fitted:
        """The fit from a start over an Ω with the right conformal moduli."""
        with self.problem.clock.stage("fit"):
            return self._refined(start.stage, start.fit.readout, start.fit.slide, self._fitted)

    def result(
        self, fitted: Fitted, curves: tuple[BoundaryCurve, ...], route: RouteName, rims_result: RimsResult | None
    ) -> RouteResult:
        """The surface of a fit. `curves` are Γ in the order and direction of the boundaries of Ω."""
        with self.problem.clock.stage("surface"):
            surface, rms_offset = fitted_surface(fitted, allowed=self.problem.allowed)
            return RouteResult(
                curves=curves,
                domain=surface.domain,
                surface_at=surface.placed,
                matchings=tuple(fitted.stage.matchings(fitted.fit)),
                misfit=fitted.misfit.with_offset(rms_offset),
                area=surface.area(),
                route=route,
                limit=self._limit(fitted),
                rims_result=rims_result and replace(rims_result, period=surface.largest_period()),
                # without the features, which are computed again: they take megabytes
                resume=partial(_resume, replace(fitted, stage=replace(fitted.stage))) if route == "network" else None,
            )

    def _resumed(self, before: Fitted) -> Fitted:
        """The fit from an earlier one on its Ω, with the clusters of poles for this tolerance."""
        stage = replace(before.stage)  # so that the kept one stays without features
        with self.problem.clock.stage("features"):
            new = Discretisation.first(
                stage.domain,
                stage.curves,
                stage.corners,
                degree=stage.degree,
                offset=self.problem.options.cauchy.pole_offset,
                at_corner=corner_poles(self.problem.options.tolerance),
            )
            readout, slide = new.transferred(stage, before.fit)
        with self.problem.clock.stage("fit"):
            return self._refined(new, readout, slide, self._with_right_moduli if new.has_moduli else self._fitted)

    def _improved(self, fitted: Fitted, disk: Disk) -> Fitted:
        """The better of a fit and a fit from a finer disk, or the first one if the second fails."""
        try:
            with self.problem.clock.stage("first fill"):
                finer = finer_disk(disk, *self._sizes)
            return min(fitted, self._fitted_from(finer), key=lambda one: one.misfit.rms)
        except (DomainError, SingularMatrixError, OutOfTimeError):
            return fitted

    def _fitted_from(self, start: Disk) -> Fitted:
        """The fit from a discrete surface: its flattening gives Ω, its frames give p and q."""
        sides, place = self._sides, self.problem.options.place

        def boundaries(rims: tuple[Complex[np.ndarray, "_"], ...]) -> list[SplineBoundary]:
            return [SplineBoundary.through(rim, side.corners) for rim, side in zip(rims, sides, strict=True)]

        with self.problem.clock.stage("flattening"):
            flat = flatten(
                start.vertices,
                start.faces,
                sum(self._sizes),
                holes=self._sizes[1:],
                drawn=lambda rims: tuple(map(sampled, boundaries(rims))),
            )
            outer, *holes = given = boundaries(flat.rims)
            domain = PlaneDomain.inside(outer, flat.log_scale, holes=tuple(holes))
        with self.problem.clock.stage("features"):
            lifted = partial(lifted_spinors, start.vertices, start.faces, flat.images, self._sizes, place)
            spinors, branches = lifted(), tuple[complex, ...]()
            ends = np.cumsum([0, *self._sizes]).tolist()
            if holes and not any(bool(signs_close_up(*spinors[a:b].mT)) for a, b in pairwise(ends)):
                branches = (point_in_hole(flat.rims[1]),)
                spinors = lifted(branch=branches[0])
            stage = Discretisation.first(
                domain,
                tuple(CurveTensors.of(side.curve, place) for side in sides),
                tuple(side.knots[:-1][side.corners] for side in sides),
                degree=self.problem.options.cauchy.degree,
                offset=self.problem.options.cauchy.pole_offset,
                at_corner=corner_poles(self.problem.options.tolerance),
                branches=branches,
            )
            factor, own = stage.network.sign_changing(place.put(stage.panels.z)), stage.panels.own_parameters
            edges, slides = [], []
            for first, t, boundary, side in zip(ends, own, given, sides, strict=False):
                share = modulo_one(t)
                edges.append(first + np.searchsorted(boundary.parameters, share, side="right") - 1)
                slides.append(np.interp(share, boundary.parameters, side.knots) + np.round(t - share))
            readout = stage.readout_of(spinors[place.put(np.concatenate(edges))] * factor[:, None])
        with self.problem.clock.stage("fit"):
            # the moduli of a flattened mesh are inexact, and a fit may then be near Γ at its nodes only
            begin = self._with_right_moduli if stage.has_moduli else self._fitted
            return self._refined(stage, readout, place.put(np.concatenate(slides)), begin)

    def _refined(
        self,
        stage: Discretisation,
        readout: Complex[Array, "n 2"],
        slide: Float[Array, " nodes"],
        begin: _Begin,
    ) -> Fitted:
        """The best of several rounds of Gauss-Newton, on Ω changed at its corners if the tolerance is missed."""
        best = begin(stage, readout, slide)
        may_change = stage.domain.corners.any() and self.problem.is_disk and not self._is_rough
        if may_change:
            best = self._rescaled(self._opened(best, begin), begin)
        best = self._with_more_poles(best)
        if may_change:
            again = self._opened(best, begin)
            best = best if again is best else self._with_more_poles(again)
        return best

    def _opened(self, fitted: Fitted, begin: _Begin) -> Fitted:
        """The better of a fit that misses the tolerance and of one on Ω with spikes at its corners."""
        if not self._is_missed(fitted):
            return fitted
        try:
            again = begin(*opened(fitted.stage, fitted.fit, offset=self.problem.options.cauchy.pole_offset))
        except (DomainError, SingularMatrixError, OutOfTimeError):
            return fitted
        return min(fitted, again, key=lambda one: self.problem.excess(one.misfit))

    def _with_more_poles(self, best: Fitted) -> Fitted:
        """The best of several rounds of Gauss-Newton, each with more poles where the last residual was large."""
        while self._is_missed(best) and not self._is_lost(best):
            finer = best.stage.refined(best.energy, best.misfit.rms / self.problem.excess(best.misfit))
            if finer is None:
                break
            try:
                again = self._fitted(finer, *finer.transferred(best.stage, best.fit), near=True)
            except OutOfTimeError:  # keep the rounds so far
                break
            if not again.misfit.rms < best.misfit.rms:
                break
            before, best = best, replace(again, rounds=best.rounds + 1, folds=best.folds)
            if not self._may_meet(before, best):
                break
        return best

    def _rescaled(self, fitted: Fitted, begin: _Begin) -> Fitted:
        """The best of a fit that misses corners, and of those on rescaled Ω, as long as each halves the residual."""
        while self._is_missed(fitted) and fitted.stage.share_at_corners(fitted.energy) > 0.5:
            before, offset = fitted, self.problem.options.cauchy.pole_offset
            try:
                again = begin(*before.stage.rescaled(before.fit, offset=offset))
            except (DomainError, SingularMatrixError, OutOfTimeError):
                break
            fitted = min(again, before, key=lambda one: one.misfit.rms)
            if not fitted.misfit.rms < before.misfit.rms / 2:
                break
        return fitted

    def _is_lost(self, fitted: Fitted) -> bool:
        """Whether the disk over a smooth loop is too far from Γ for more features to help."""
        distance = self.problem.options.tolerance * self.problem.excess(fitted.misfit)  # in edges
        return self.problem.is_disk and not self._is_rough and distance > _LOST * fitted.stage.room**4

    def _may_meet(self, before: Fitted, now: Fitted) -> bool:
        """Whether the largest number of features would meet the tolerance, extrapolated from the last two rounds.

        The cost of a round grows with the cube of the number of features.
        """
        more = before.stage.room / now.stage.room
        order = math.log(before.misfit.rms / now.misfit.rms) / math.log(more) if more > 1 else 0.0
        return bool(self.problem.excess(now.misfit) <= now.stage.room**order)

    def _with_right_moduli(
        self, stage: Discretisation, readout: Complex[Array, "n 2"], slide: Float[Array, " nodes"]
    ) -> Fitted:
        """A fit in which the conformal moduli of Ω are unknowns too."""
        last, folds = np.inf, False
        allowed, steps = self.problem.allowed, self.problem.steps
        while True:
            fit = self._minimised(stage.flexible_problem, readout, slide)
            readout, slide = fit.readout, fit.slide
            length = stage.length_of_move(fit)
            # a displacement changes the residual by as much at most. Up to the residual itself areas are off by 5e-4
            negligible = (1 - STALLED) * fit.residual
            if length < negligible:
                return self._measured(stage, fit)
            try:
                moved = stage.moved(fit, offset=self.problem.options.cauchy.pole_offset)
            except DomainError:  # keep the fit so far
                folds = True
                break
            readout, slide = moved.transferred(stage, fit)
            stage = moved
            # below half of the allowed residual, continue only while it converges fast
            stalls = not fit.residual <= (STALLED if fit.residual > allowed / 2 else 0.5) * last
            # quadratic convergence: the next displacement would be about the square of this one
            if stalls or length**2 < negligible or steps.are_spent:
                break
            last = fit.residual
        return replace(self._fitted(stage, readout, slide), folds=folds)

    def _fitted(
        self,
        stage: Discretisation,
        readout: Complex[Array, "n 2"],
        slide: Float[Array, " nodes"],
        *,
        near: bool = False,
    ) -> Fitted:
        return self._measured(stage, self._minimised(stage.problem, readout, slide, near=near))

    @property
    def _minimised(self) -> Callable[..., Fit]:
        return partial(gauss_newton, allowed=self.problem.allowed, steps=self.problem.steps, power=self.power)

    def _measured(self, stage: Discretisation, fit: Fit) -> Fitted:
        misfit, energy = independent_residual(stage, fit, points=sum(map(len, self.problem.units)))
        return Fitted(stage=stage, fit=fit, misfit=misfit, energy=energy)

    def _is_missed(self, fitted: Fitted) -> bool:
        """Whether a fit misses the tolerance and steps are left."""
        return self.problem.excess(fitted.misfit) > 1 and not self.problem.steps.are_spent

    def _limit(self, fitted: Fitted) -> str:
        """Why the residual of a fit does not decrease further, as the end of a sentence."""
        stage, loops = fitted.stage, self.problem.units
        features = fitted.features
        if self.problem.steps.are_spent:
            return SPENT
        if fitted.folds:
            return (
                "the domain folds before it reaches the conformal moduli of the loop's corners; "
                f"a network of {features} features does not reduce the residual further"
            )
        at_corners = stage.share_at_corners(fitted.energy)
        if at_corners > 0.5:
            where = f"{at_corners:.0%} of the squared distance lies within an edge of the loop's corners"
        elif self._is_rough:
            missed = max(map(roughness, loops))
            where = f"the loop is rough: its points are {missed:.2f} edges from cubics through their neighbours"
        else:
            where = "more features would not meet the tolerance"
        if stage.is_full:
            return f"the network has the largest number of features, {features}, and {where}"
        return f"a network of {features} features does not reduce the residual further: {where}"


_Begin: TypeAlias = Callable[[Discretisation, Complex[Array, "n 2"], Float[Array, " nodes"]], Fitted]


def _resume(before: Fitted, problem: PlateauProblem) -> RouteResult:
    # largest distances count where a solve is continued, as for CAD
    return NetworkSolver(problem=problem, power=0.5).solve(before)


NETWORK = Route("network", lambda problem: NetworkSolver(problem=problem).solve())


def point_in_hole(hole: Complex[np.ndarray, " n"]) -> complex:
    """A point in a hole: the incentre of the triangle of its mesh with the largest incircle."""
    mesh = PlaneDomain.from_boundary(hole[::-1]).triangulation
    corners = mesh.points[mesh.faces]
    a, b, c = corners.T
    sides = np.abs(np.stack([b - c, c - a, a - b], axis=1))
    radius = np.imag(np.conj(b - a) * (c - a)) / sides.sum(axis=1)
    return complex(np.average(corners[radius.argmax()], weights=sides[radius.argmax()]))
