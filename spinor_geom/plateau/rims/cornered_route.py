"""Minimal surfaces between several rims of which some have corners: starts, Newton's method, and a lift.

`stationary` finds the harmonic surface with the corners from a projection of the rims, and `CorneredLift` p and q.
Where their surface is too far from Γ, corners are resolved better.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from jaxtyping import Bool, Complex, Float

from spinor_geom.arrays import EPS, NUMPY, Place, norm, shifted, to_numpy, unit
from spinor_geom.domain.plane_domain import panel_breaks
from spinor_geom.errors import OutOfTimeError, SurfaceError, UnresolvedRimsError
from spinor_geom.holomorphic.cauchy import sign_changing
from spinor_geom.holomorphic.circular_domain import CircularDomain, centring, turned
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.smooth_domain import COARSE
from spinor_geom.plateau.network.discretisation import Discretisation, interpolate_matching
from spinor_geom.plateau.network.fitted import Fitted
from spinor_geom.plateau.network.network_route import NetworkSolver
from spinor_geom.plateau.newton import ROUNDING
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.capacity_path import mean_modulus
from spinor_geom.plateau.rims.circles import Circles
from spinor_geom.plateau.rims.cornered import CorneredSurface, CornerForm
from spinor_geom.plateau.rims.cornered_lift import CorneredLift, LiftedSurface
from spinor_geom.plateau.rims.cornered_newton import stationary
from spinor_geom.plateau.rims.sides import FINE, ROUGH, SAMPLES, START, CorneredRims, Resolution, Side
from spinor_geom.plateau.rims.starts import OrientedSurface
from spinor_geom.plateau.route_result import (
    COLLAPSED,
    FAILURES,
    NoConnectedSurfaceError,
    RimsResult,
    RouteResult,
    typed_failures,
)
from spinor_geom.plateau.steps import SPENT
from spinor_geom.plateau.vertices.rims_through_points import SmoothSurface

_FREQUENCIES = 20, 96  # least and largest number of frequencies of a rim without corners
# Arcs of Γ, by samples of its tangents: parts that bend that much more than a circle, and turn by more than an angle
_SHARP, _LEAST_TURN = 2.5, 0.5
_SHARP_OF_AVERAGES = 1.5  # for averages of ragged rims: with 2.5 coarse surfaces are found for 8 instead of 9 of ten
# Share of the allowed distance to reach if finer corners do. They take as long as all before.
_WELL_BELOW = 1e-2


def solve_with_corners(problem: PlateauProblem, starts: Sequence[OrientedSurface]) -> RouteResult:
    """The minimal surface near a harmonic one, from the first start of least energy that leads to one.

    Raises:
        NoConnectedSurfaceError: the energy decreases from every start until the surface degenerates.
        OutOfTimeError: time ran out.
        UnresolvedRimsError: there is no start, or Newton's method does not converge.
        SurfaceError: the surface has a branch point.
        DomainError: the polygon of ∂Ω crosses itself.
    """
    start, surface = next(_harmonic(problem, starts, ROUGH, _SHARP))
    return _minimal(problem, start, surface)


def coarse_surfaces(
    problem: PlateauProblem, starts: Sequence[OrientedSurface]
) -> Iterator[tuple[OrientedSurface, LiftedSurface]]:
    """Minimal surfaces about a tenth of an edge from Γ, least energy of the starts first. Raises as the function above.

    Between four rims they take a tenth of its time.
    """
    for start, surface in _harmonic(problem, starts, START, _SHARP_OF_AVERAGES):
        with suppress(SurfaceError):  # the signs of p and q may be unclear
            yield start.oriented, _lifted(problem, start, surface)


def _harmonic(
    problem: PlateauProblem, starts: Sequence[OrientedSurface], resolution: Resolution, sharp: float
) -> Iterator[tuple[_Start, CorneredSurface]]:
    """The harmonic surfaces that starts lead to, least energy first. Raises as the functions above if there is none."""
    error: UnresolvedRimsError | None = None
    with problem.clock.stage("slides"):
        given = [_Start.of(problem, oriented, sharp) for oriented in starts]
        given.sort(key=lambda start: start.surface.energy)
    is_found = False
    for start in given:
        surface: CorneredSurface | None
        try:
            with problem.clock.stage("slides"):
                # corners have wrong angles at first
                surface = stationary(start.surface, problem.steps, COARSE**0.5)
                surface = stationary(surface.refitted(START), problem.steps, COARSE)
                if resolution != START:
                    surface = stationary(surface.refitted(resolution), problem.steps, COARSE**2)
        except UnresolvedRimsError as failure:
            error, surface = failure, None
        except NoConnectedSurfaceError:
            surface = None
        if surface is not None:
            is_found = True
            yield start, surface
    if is_found:
        return
    if error or not starts:
        raise error or UnresolvedRimsError(rims=len(problem.units), failure="has no start")
    raise NoConnectedSurfaceError(COLLAPSED)


def _minimal(problem: PlateauProblem, start: _Start, surface: CorneredSurface) -> RouteResult:
    """The minimal surface near a harmonic one, with corners as fine as its distance from Γ needs."""
    found, limits = list[LiftedSurface](), ["more poles at the corners do not reduce the residual further"]
    with suppress(SurfaceError):  # the signs of p and q may be unclear near corners of a coarse surface
        found.append(_lifted(problem, start, surface))
    if not found or problem.excess(found[0].misfit) > _WELL_BELOW:
        with _improvement(limits) if found else nullcontext():
            with problem.clock.stage("slides"):
                surface = stationary(
                    surface.refitted(FINE), problem.steps, max((_WELL_BELOW * problem.allowed) ** 2, ROUNDING)
                )
            found.append(_lifted(problem, start, surface))
    best = min(found, key=lambda one: one.misfit.rms)
    if problem.excess(best.misfit) > 1:
        with _improvement(limits):
            fitted = _fitted(problem, best)
            if fitted.misfit.rms < best.misfit.rms:
                rims_result = _rims_result(best, start.oriented, period=0.0)  # of the surface before the fit
                return NetworkSolver(problem=problem).result(fitted, start.curves, "network on circles", rims_result)
    surface_found = best.surface(problem.options.place)
    return RouteResult(
        curves=start.curves,
        domain=surface_found.domain,
        surface_at=surface_found.placed,
        matchings=best.matchings,
        misfit=best.misfit,
        area=best.lift.surface.energy,
        route="network on circles",
        limit=limits[-1],
        rims_result=_rims_result(best, start.oriented, period=surface_found.largest_period()),
    )


@contextmanager
def _improvement(limits: list[str]) -> Iterator[None]:
    """Adds the reason, as the end of a sentence, if a `with` block fails, so that the surface before it is kept."""
    try:
        with typed_failures():
            yield
    except OutOfTimeError:
        limits.append(SPENT)
    except FAILURES as failure:
        limits.append(f"finer surfaces fail: {failure}")


def _lifted(problem: PlateauProblem, start: _Start, surface: CorneredSurface) -> LiftedSurface:
    with problem.clock.stage("lift"):
        return CorneredLift(surface=surface, curves=start.curves).lifted()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Start:
    """A harmonic surface over equal steps of circles, made to start `stationary`."""

    oriented: OrientedSurface
    curves: tuple[BoundaryCurve, ...]  # in the order and direction of ∂Ω
    arguments: Float[np.ndarray, "m n"]  # of the nodes on their circles, in the direction of ∂Ω
    slides: Float[np.ndarray, "m n"]
    normals: Float[np.ndarray, "m n 3"]  # ∂X/∂n
    circles: Circles
    corners: Sequence[Float[np.ndarray, " _"]]

    @classmethod
    def of(cls, problem: PlateauProblem, oriented: OrientedSurface, sharp: float) -> _Start:
        """The start over a conformal image of Ω whose holes and corners are spread evenly."""
        here, curves = oriented.surface, tuple(oriented.as_directed(problem.curves))
        slides, z = to_numpy(here.slides), to_numpy(here.domain.circles(here.slides.shape[1]))
        centres = np.append(0.0, to_numpy(here.domain.centres))
        log_radii = np.append(0.0, to_numpy(here.domain.log_radii))
        corners = [corners_of(curve, sharp) for curve in curves]
        rim_of_corner = np.repeat(np.arange(len(curves)), [len(own) for own in corners])
        at_corners = map(_arguments, corners, slides, _unwrapped(z, centres))
        circles, points = Circles(
            centres=centres, log_radii=log_radii, arguments=np.concatenate(list(at_corners))
        ).spread(rim_of_corner)
        for point in points:
            z = turned(z, point)
        return cls(
            oriented=oriented,
            curves=curves,
            arguments=_unwrapped(z, circles.centres),
            slides=slides,
            normals=to_numpy(here.normal),
            circles=circles,
            corners=corners,
        )

    @cached_property
    def exponents(self) -> Float[np.ndarray, " c"]:
        """Probable angles of the surface at all corners, over π."""
        return np.concatenate(list(map(self._exponents, range(len(self.curves)), self.corners)))

    @cached_property
    def surface(self) -> CorneredSurface:
        """The start of Newton's method."""
        corners, exponents = self.corners, self.exponents
        rims = CorneredRims.of(
            [CurveTensors.of(curve, NUMPY) for curve in self.curves],
            corners,
            np.split(exponents, np.cumsum([len(own) for own in corners])[:-1]),
            [0 if len(own) else _frequencies(curve) for own, curve in zip(corners, self.curves, strict=True)],
        )
        rims = rims.adapted(exponents, rims.resolution, partial(self.circles.places, rims.rim_of_corner))
        slides = np.concatenate(list(map(self._modes, rims.sides)))
        return CorneredSurface(form=CornerForm(rims=rims, circles=self.circles), slides=slides)

    def _exponents(self, rim: int, corners: Float[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
        """Angles of the surface at corners, over π: those of Γ or the rest of a full turn."""
        curve = self.curves[rim]
        back, ahead = (unit(sign * curve.derivative(corners + sign * EPS**0.5)) for sign in (-1, 1))
        angles = 2 * np.arctan2(np.linalg.norm(ahead - back, axis=1), np.linalg.norm(ahead + back, axis=1))
        bisectors = ahead + back
        # the part of ∂X/∂n around each corner
        far = np.abs((self.slides[rim] - corners[:, None] + 0.5) % 1 - 0.5)
        near = far < 0.25 * np.diff(np.append(corners, corners[:1] + 1))[:, None]
        outwards = near @ self.normals[rim]
        is_reflex = (outwards * bisectors).sum(axis=1) > 0
        exponents = np.where(is_reflex, 2 * np.pi - angles, angles) / np.pi
        return np.where(np.isin(corners, curve.breaks[:-1][curve.corners]), exponents, 1.0)

    def _modes(self, side: Side) -> Float[np.ndarray, " k"]:
        """Coefficients of the modes of a slide: those of a rim without corners, else 0.

        Few nodes do not show slides between corners.
        """
        if side.corners is not None:
            return np.zeros(side.degree + 1)
        arguments, slides = _around(self.arguments[side.rim], 2 * np.pi), _around(self.slides[side.rim], 1.0)
        u = side.shares[0]
        spectrum = np.fft.rfft(np.interp(2 * np.pi * u, arguments, slides - arguments / (2 * np.pi))) / len(u)
        spectrum[min(side.frequencies, self.slides.shape[1] // 4) :] = 0
        waves = 2 * spectrum[1 : side.frequencies]
        return np.concatenate([spectrum[:1].real, waves.real, -waves.imag])


def _around(values: Float[np.ndarray, " n"], period: float) -> Float[np.ndarray, " n3"]:
    """Three periods of values that increase by `period` in each."""
    return np.concatenate([values - period, values, values + period])


def ends_of_arcs(curve: BoundaryCurve) -> Bool[np.ndarray, " m"]:
    """At which breaks the curvature jumps by more than that of a circle, if it varies less between them in total."""
    s = np.stack([curve.breaks[:-1], np.nextafter(curve.breaks[1:], 0)])
    slopes = curve.derivative(s)
    bends = norm(np.cross(slopes, curve.second_derivative(s))) / norm(slopes) ** 3
    jumps = np.abs(bends[0] - shifted(bends[1], 1)) * ~curve.corners
    return np.asarray((jumps.sum() > np.ptp(bends, axis=0).sum()) & (jumps * curve.length() > 2 * np.pi))


def corners_of(curve: BoundaryCurve, sharp: float = _SHARP) -> Float[np.ndarray, " c"]:
    """Parameters of a curve's corners, and of ends of lines and arcs, where its curvature jumps.

    If there are none, of the ends of its sharp bends: of the breaks nearest to them.
    """
    if (are_ends := curve.corners | ends_of_arcs(curve)).any():
        return np.asarray(curve.breaks[:-1][are_ends])
    tangents = unit(curve.derivative(np.arange(SAMPLES) / SAMPLES))
    turns = norm(np.roll(tangents, -1, axis=0) - tangents)
    first = int(turns.argmin())  # outside of arcs
    turns = np.roll(turns, -first)
    is_sharp, turned = turns > sharp * 2 * np.pi / SAMPLES, np.append(0.0, np.cumsum(turns))
    ends = np.flatnonzero(np.diff(is_sharp, prepend=False, append=False)).reshape(-1, 2)
    arcs = (first + ends[np.ptp(turned[ends], axis=1) > _LEAST_TURN].ravel()) / SAMPLES % 1
    nearest = np.abs(arcs[:, None] - curve.breaks).argmin(axis=1)
    return np.unique(curve.breaks[nearest] % 1)


def _arguments(
    corners: Float[np.ndarray, " c"], slides: Float[np.ndarray, " n"], arguments: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " c"]:
    """Arguments of the images of a curve's corners."""
    lifted = corners + np.ceil(slides[0] - corners[:1])
    return np.asarray(np.interp(lifted, _around(slides, 1.0), _around(arguments, 2 * np.pi)))


def _frequencies(curve: BoundaryCurve) -> int:
    """The number of frequencies for the slide of a curve without corners: twice those of the curve."""
    spectrum = np.abs(np.fft.rfft(curve.point(np.arange(SAMPLES) / SAMPLES), axis=0)).sum(axis=1)[1:]
    needed = np.flatnonzero(spectrum > EPS**0.5 * spectrum.max()).max() + 1
    return int(np.clip(2 * needed, *_FREQUENCIES))


def _unwrapped(z: Complex[np.ndarray, "m n"], centres: Complex[np.ndarray, " m"]) -> Float[np.ndarray, "m n"]:
    """Arguments of points on circles, in the direction of ∂Ω: increasing in each row."""
    signs = np.where(np.arange(len(centres)) == 0, 1.0, -1.0)
    return np.unwrap(signs[:, None] * np.angle(z - centres[:, None]), axis=1)


def smooth_surface(oriented: OrientedSurface, found: LiftedSurface, place: Place) -> SmoothSurface:
    """A surface over averages of rims as the start of one through their points."""
    circles = found.lift.surface.form.circles
    return SmoothSurface(
        surface=found.surface(place),
        centres=circles.centres[1:],
        radii=circles.radii[1:],
        branches=found.lift.branches,
        part=lambda z, number: place.put(found.part(z, number)),
        boundaries=found.lift.domain.boundaries,
        averages=found.lift.curves,
        matchings=found.matchings,
        rims_result=_rims_result(found, oriented, period=0.0),
    )


def _rims_result(found: LiftedSurface, oriented: OrientedSurface, *, period: float) -> RimsResult:
    form = found.lift.surface.form
    return RimsResult(
        order=tuple(rim.number for rim in oriented.rims),
        backward=oriented.backward,
        modulus=mean_modulus(_normalised(form)),
        antiperiodic=tuple(np.isin(form.circles.centres[1:], found.lift.branches).tolist()),
        period=period,
    )


def _fitted(problem: PlateauProblem, found: LiftedSurface) -> Fitted:
    """P and q fitted to Γ from those of a lift, with more poles where that misses Γ."""
    lift, place, solver = found.lift, problem.options.place, NetworkSolver(problem=problem)
    stage = Discretisation(
        domain=lift.domain,
        curves=tuple(CurveTensors.of(curve, place) for curve in lift.curves),
        corners=tuple(curve.breaks[:-1][curve.corners] for curve in lift.curves),
        poles=lift.poles,
        breaks=tuple(map(panel_breaks, lift.domain.boundaries)),
        degree=len(lift.hessenberg) - 1,
        at_corner=0,  # of those to be placed, which `poles` has
        branches=tuple(lift.branches.tolist()),
    )
    z = stage.panels.z
    spinors = (lift.features(z) @ found.readout) * sign_changing(z, lift.branches)[:, None]
    pairs = zip(found.matchings, stage.panels.own_parameters, strict=True)
    slide = np.concatenate([interpolate_matching(matching, t) for matching, t in pairs])
    return solver.brought_nearer(solver.lifted(stage, stage.readout_of(place.put(spinors)), place.put(slide)))


def _normalised(form: CornerForm) -> CircularDomain:
    """The circular domain with its first hole around 0."""
    to = centring(complex(form.circles.centres[1]), float(form.circles.radii[1]))
    circles = form.circles.turned(to, form.rims.rim_of_corner)
    # up to rounding errors
    return CircularDomain(centres=np.append(0j, circles.centres[2:]), log_radii=circles.log_radii[1:])
