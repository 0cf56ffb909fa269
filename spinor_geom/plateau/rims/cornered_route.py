"""Minimal surfaces between several rims of which some have corners: a start on few nodes, Newton's method, and a lift.

The start is a harmonic surface with rounded corners. `stationary` finds the harmonic surface with the corners; p and q,
square roots of components of its φ, are expanded in functions with the same poles. Where their surface is too far from
Γ, corners are resolved better, and at last p and q are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float
from scipy.integrate import cumulative_trapezoid

from spinor_geom.arrays import EPS, NUMPY, cis, to_numpy, unit
from spinor_geom.domain.plane_domain import TOWARDS_CORNER, PlaneDomain, SplineBoundary, panel_breaks
from spinor_geom.domain.quadrature import path_to
from spinor_geom.errors import OutOfTimeError, SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain, centring, turned
from spinor_geom.holomorphic.poles import Poles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network.discretisation import Discretisation
from spinor_geom.plateau.network.network_route import Fitted, NetworkSolver
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.capacity_path import mean_modulus
from spinor_geom.plateau.rims.circles import Circles
from spinor_geom.plateau.rims.cornered import CorneredSurface, CornerForm
from spinor_geom.plateau.rims.cornered_newton import ROUGHLY, stationary
from spinor_geom.plateau.rims.sides import COARSE, FINE, ROUGH, CorneredRims, Side
from spinor_geom.plateau.rims.starts import OrientedSurface
from spinor_geom.plateau.route_result import RimsResult, RouteResult
from spinor_geom.surface.array_surface import PATH_ORDER
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi

_TURN = np.radians(20.0)  # largest turn of an edge of a circle's polygon
_DEGREE = 14  # of the polynomials of the arcs: to rounding errors for such turns
_LEAST_EDGES = 6  # of a side
_FREQUENCIES = 10, 96  # least and largest number of frequencies of a rim without corners
_SPECTRUM = 1e-7  # share of the amplitude of Γ above the frequencies of the slide, which has half of them
_SAMPLES = 256  # of Γ for its spectrum, and of a side for the gap
_NULL = 0.03  # largest |φ·φ|/|φ|² where the signs of p and q are known
_FOR_AREAS = 1e-4  # distance from Γ, in mean edges, from which areas are off by 1e-6 and more
# Least number of poles in a hole, and the share of powers as high as their number that enter lower ones
_FEWEST_IN_HOLE, _ALIAS = 20, 1e-8
# Modes of the start's slides that are fitted to nodes, and the least share of a side between these and its ends
_START_MODES, _INSIDE = 3, 0.02


def solve_with_corners(problem: PlateauProblem, oriented: OrientedSurface) -> RouteResult:
    """The minimal surface near a harmonic one with rounded corners.

    Raises:
        OutOfTimeError: time ran out.
        UnresolvedRimsError: Newton's method does not converge.
        SurfaceError: the surface has a branch point.
        DomainError: the polygon of ∂Ω crosses itself.
    """
    start = _Start.of(problem, oriented)
    with problem.clock.stage("slides"):
        surface = stationary(start.surface, problem.steps, ROUGHLY)
        surface = stationary(surface.refitted(start.exponents, COARSE), problem.steps, ROUGHLY)
        are_right = surface.are_conformal_at_corners()
        if not are_right.all():
            exponents = np.where(are_right, start.exponents, 2 - start.exponents)
            other = stationary(surface.refitted(exponents, COARSE), problem.steps, ROUGHLY)
            surface = min(surface, other, key=lambda one: one.energy)
        surface = stationary(surface.refitted(surface.form.rims.exponents, ROUGH), problem.steps)
    best = _Lifted(problem=problem, curves=start.curves, surface=surface)
    if best.is_near(best.fitted):
        return best.result(oriented)
    with suppress(OutOfTimeError, SurfaceError):  # a finer surface that fails is not used
        with problem.clock.stage("slides"):
            surface = stationary(surface.refitted(surface.form.rims.exponents, FINE), problem.steps)
        best = min(best, replace(best, surface=surface), key=lambda one: one.fitted.misfit.rms)
    return best.result(oriented)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Start:
    """A harmonic surface over equal steps of circles, made to start `stationary`."""

    curves: tuple[BoundaryCurve, ...]  # in the order and direction of ∂Ω
    arguments: Float[np.ndarray, "m n"]  # of the nodes on their circles, in the direction of ∂Ω
    slides: Float[np.ndarray, "m n"]
    normals: Float[np.ndarray, "m n 3"]  # ∂X/∂n
    circles: Circles

    @classmethod
    def of(cls, problem: PlateauProblem, oriented: OrientedSurface) -> _Start:
        """The start over a conformal image of Ω whose holes and corners are spread evenly."""
        here, curves = oriented.surface, tuple(oriented.as_directed(problem.curves))
        slides, z = to_numpy(here.slides), to_numpy(here.domain.circles(here.slides.shape[1]))
        centres = np.append(0.0, to_numpy(here.domain.centres))
        log_radii = np.append(0.0, to_numpy(here.domain.log_radii))
        rim_of_corner = np.repeat(np.arange(len(curves)), [np.count_nonzero(curve.corners) for curve in curves])
        at_corners = map(_arguments, curves, slides, _unwrapped(z, centres))
        circles, points = Circles(
            centres=centres, log_radii=log_radii, arguments=np.concatenate(list(at_corners))
        ).spread(rim_of_corner)
        for point in points:
            z = turned(z, point)
        return cls(
            curves=curves,
            arguments=_unwrapped(z, circles.centres),
            slides=slides,
            normals=to_numpy(here.normal),
            circles=circles,
        )

    @cached_property
    def _corners(self) -> list[Float[np.ndarray, " _"]]:
        return [curve.breaks[:-1][curve.corners] for curve in self.curves]

    @cached_property
    def exponents(self) -> Float[np.ndarray, " c"]:
        """Probable angles of the surface at all corners, over π."""
        return np.concatenate(list(map(self._exponents, range(len(self.curves)), self._corners)))

    @property
    def surface(self) -> CorneredSurface:
        """The start of Newton's method."""
        corners, exponents = self._corners, self.exponents
        rims = CorneredRims.of(
            [CurveTensors.of(curve, NUMPY) for curve in self.curves],
            corners,
            np.split(exponents, np.cumsum([len(own) for own in corners])[:-1]),
            [0 if len(own) else _frequencies(curve) for own, curve in zip(corners, self.curves, strict=True)],
        )
        rims = rims.adapted(exponents, rims.resolution, self.circles.places)
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
        return np.asarray(np.where(is_reflex, 2 * np.pi - angles, angles) / np.pi)

    def _modes(self, side: Side) -> Float[np.ndarray, " k"]:
        """Coefficients of the modes of a side's slide."""
        arguments, slides = _around(self.arguments[side.rim], 2 * np.pi), _around(self.slides[side.rim], 1.0)
        if side.corners is None:
            u = side.shares[0]
            spectrum = np.fft.rfft(np.interp(2 * np.pi * u, arguments, slides - arguments / (2 * np.pi))) / len(u)
            spectrum[min(side.frequencies, self.slides.shape[1] // 4) :] = 0
            waves = 2 * spectrum[1 : side.frequencies]
            return np.concatenate([spectrum[:1].real, waves.real, -waves.imag])
        first, last = self.circles.arguments[list(side.corners)].tolist()
        u = (arguments - first) / ((last - first) % (2 * np.pi) or 2 * np.pi)
        s = (slides - side.start) % 1 / side.length
        inside = (np.abs(u - 0.5) < 0.5 - _INSIDE) & (np.abs(s - 0.5) < 0.5 - _INSIDE)
        shares = np.stack([u[inside], 1 - u[inside]])
        modes = side.modes(shares)
        coefficients = np.zeros(modes.shape[1])
        if len(modes) > _START_MODES:
            wanted = np.log(s[inside] / (1 - s[inside])) - side.base(shares)
            coefficients[:_START_MODES] = np.linalg.lstsq(modes[:, :_START_MODES], wanted, rcond=None)[0]
        return coefficients


def _around(values: Float[np.ndarray, " n"], period: float) -> Float[np.ndarray, " n3"]:
    """Three periods of values that increase by `period` in each."""
    return np.concatenate([values - period, values, values + period])


def _arguments(
    curve: BoundaryCurve, slides: Float[np.ndarray, " n"], arguments: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " c"]:
    """Arguments of the images of a curve's corners."""
    corners = curve.breaks[:-1][curve.corners]
    lifted = corners + np.ceil(slides[0] - corners[:1])
    return np.asarray(np.interp(lifted, _around(slides, 1.0), _around(arguments, 2 * np.pi)))


def _frequencies(curve: BoundaryCurve) -> int:
    """The number of frequencies for the slide of a curve without corners: twice those of the curve."""
    spectrum = np.abs(np.fft.rfft(curve.point(np.arange(_SAMPLES) / _SAMPLES), axis=0)).sum(axis=1)[1:]
    needed = np.flatnonzero(spectrum > _SPECTRUM * spectrum.max()).max() + 1
    return int(np.clip(2 * needed, *_FREQUENCIES))


def _unwrapped(z: Complex[np.ndarray, "m n"], centres: Complex[np.ndarray, " m"]) -> Float[np.ndarray, "m n"]:
    """Arguments of points on circles, in the direction of ∂Ω: increasing in each row."""
    signs = np.where(np.arange(len(centres)) == 0, 1.0, -1.0)
    return np.unwrap(signs[:, None] * np.angle(z - centres[:, None]), axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lifted:
    """p and q of a harmonic surface with corners."""

    problem: PlateauProblem
    curves: tuple[BoundaryCurve, ...]
    surface: CorneredSurface

    def is_near(self, fitted: Fitted) -> bool:
        """Whether a surface is within the tolerance, and near enough for areas to six digits."""
        return self.problem.excess(fitted.misfit) <= min(1.0, _FOR_AREAS / self.problem.options.tolerance)

    def result(self, oriented: OrientedSurface) -> RouteResult:
        """The minimal surface, fitted to Γ if that of p and q misses the tolerance."""
        solver, fitted = NetworkSolver(problem=self.problem), self.fitted
        if not self.is_near(fitted):
            with suppress(OutOfTimeError):
                fitted = min(fitted, solver.brought_nearer(fitted), key=lambda one: one.misfit.rms)
        rims_result = RimsResult(
            order=tuple(rim.number for rim in oriented.rims),
            backward=oriented.backward,
            modulus=mean_modulus(_normalised(self.surface.form)),
            antiperiodic=tuple(centre in fitted.stage.branches for centre in self.surface.form.circles.centres[1:]),
            period=0.0,
        )
        return solver.result(fitted, self.curves, "network on circles", rims_result)

    @cached_property
    def fitted(self) -> Fitted:
        """P and q expanded in functions with poles, with the distance of their surface from Γ."""
        place, form = self.problem.options.place, self.surface.form
        with self.problem.clock.stage("features"):
            domain = self.domain
            make = partial(
                Discretisation,
                domain=domain,
                curves=tuple(CurveTensors.of(curve, place) for curve in self.curves),
                corners=tuple(curve.breaks[:-1][curve.corners] for curve in self.curves),
                poles=self._poles,
                breaks=tuple(map(panel_breaks, domain.boundaries)),
                degree=max(self.problem.options.cauchy.degree, form.rims.powers[0]),
                at_corner=0,  # of those to be placed; `poles` has them
            )
            first = make(branches=())
            z = np.split(first.panels.z, np.cumsum(first.panels.rims)[:-1] * first.panels.order)
            is_odd = [not bool(signs_close_up(*self._spinors(own))) for own in z[1:]]
            branches = tuple(form.circles.centres[1:][is_odd].tolist())
            stage = make(branches=branches) if branches else first
            spinors = self._joined(domain, z, branches) * np.sqrt(
                first.panels.z[:, None, None] - np.array(branches, dtype=np.complex128)
            ).prod(axis=-1)
            readout = stage.readout_of(place.put(spinors))
            slide = np.concatenate(list(map(self._slide, range(len(z)), stage.panels.own_parameters)))
            return NetworkSolver(problem=self.problem).lifted(stage, readout, place.put(slide))

    @property
    def _poles(self) -> Poles:
        """Those of the harmonic surface, and poles in the holes in place of powers."""
        form = self.surface.form
        positions, scales, _ = form.circles.poles(form.rims)
        poles = Poles(positions=positions, scales=scales)
        circles = zip(form.circles.centres[1:], form.circles.radii[1:], form.rims.powers[1:], strict=True)
        for centre, radius, powers in circles:
            count = max(powers, _FEWEST_IN_HOLE)
            inside = radius * _ALIAS ** (1 / count)
            around = centre + inside * cis(2 * np.pi / count * np.arange(count))
            poles += Poles(positions=around, scales=np.full(count, radius - inside))
        return poles

    @cached_property
    def domain(self) -> PlaneDomain:
        """Ω, with vertices at the corners."""
        outer, *holes = self._boundaries
        return PlaneDomain.inside(outer, holes=tuple(holes))

    @cached_property
    def _boundaries(self) -> tuple[SplineBoundary, ...]:
        """The circles, from their first corners on."""
        circles, boundaries = self.surface.form.circles, []
        # of edges towards a corner with an angle below 180°; panels are shorter
        levels = self.surface.form.rims.resolution.halvings // 2 - len(TOWARDS_CORNER) // 2
        for rim, (centre, radius, sign) in enumerate(zip(circles.centres, circles.radii, circles.signs, strict=True)):
            arguments = self._ends(rim)
            parts = []
            sides = (side for side in self.surface.form.rims.sides if side.rim == rim)
            for (start, end), side in zip(pairwise(arguments.tolist()), sides, strict=True):
                even = self._edges(rim, start, end)
                near = 0.25 ** np.arange(levels, 0, -1)
                ahead, back = (
                    length * near[: levels * (exponent < 1)]
                    for length, exponent in zip((even[1] - start, end - even[-2]), side.exponents, strict=True)
                )
                parts.append(np.concatenate([[start], start + ahead, even[1:-1], end - back[::-1]]))
            corners = np.concatenate([np.arange(len(part)) == 0 for part in parts]) & self._has_corners(rim)
            at = np.append(np.concatenate(parts), arguments[-1])
            k = np.arange(_DEGREE, -1, -1)[:, None]
            slopes = (2j * np.pi * sign) ** k / [[math.factorial(power)] for power in k.ravel()]
            coefficients = radius * slopes * np.exp(1j * sign * at[:-1])
            coefficients[-1] += centre
            parameters = np.append((at[:-1] - at[0]) / (2 * np.pi), 1.0)
            boundaries.append(SplineBoundary(parameters, coefficients, corners))
        return tuple(boundaries)

    def _edges(self, rim: int, start: float, end: float) -> Float[np.ndarray, " k"]:
        """Arguments between two on a circle, in steps as long as the gap to the nearest other circle at most."""
        circles = self.surface.form.circles
        at = np.linspace(start, end, _SAMPLES)
        z = circles.centres[rim] + circles.radii[rim] * cis(circles.signs[rim] * at)
        gaps = np.abs(np.abs(z - circles.centres[:, None]) - circles.radii[:, None])
        longest = np.minimum(_TURN, np.delete(gaps, rim, axis=0).min(axis=0) / circles.radii[rim])
        edges = cumulative_trapezoid(1 / longest, at, initial=0)
        edges *= max(math.ceil(edges[-1]), _LEAST_EDGES) / edges[-1]
        return np.asarray(np.interp(np.arange(round(edges[-1]) + 1), edges, at))

    def _has_corners(self, rim: int) -> bool:
        return bool((self.surface.form.rims.rim_of_corner == rim).any())

    def _ends(self, rim: int) -> Float[np.ndarray, " k"]:
        """Arguments of the ends of a rim's sides, closed."""
        form = self.surface.form
        own = form.circles.arguments[form.rims.rim_of_corner == rim] if self._has_corners(rim) else np.zeros(1)
        return np.append(own, own[0] + 2 * np.pi)

    def _spinors(
        self, z: Complex[np.ndarray, " n"], branches: Sequence[complex] = ()
    ) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """Values of p and q along a path, over the product of √(z − c), with continuous signs.

        Where the surface is far from conformal, as in a corner that it leaves outwards, they are those before.
        """
        squared = (z[:, None] - np.array(branches, dtype=np.complex128)).prod(axis=-1)
        phi = self.surface.null_curve(z) / squared[:, None]
        is_null = np.abs((phi * phi).sum(axis=1)) < _NULL * (np.abs(phi) ** 2).sum(axis=1)
        nearest = np.maximum.accumulate(np.where(is_null, np.arange(len(z)), is_null.argmax()))
        return spinors_from_phi(phi[nearest])

    def _joined(
        self, domain: PlaneDomain, z: Sequence[Complex[np.ndarray, " _"]], branches: Sequence[complex]
    ) -> Complex[np.ndarray, "n 2"]:
        """Values of p and q on all rims, over the product of √(z − c), with continuous signs along paths across Ω.

        Raises:
            SurfaceError: the signs change around a rim.
        """
        parts = [np.stack(self._spinors(z[0], branches), axis=-1)]
        for hole, own in enumerate(z[1:]):
            first = sum(len(boundary.vertices) for boundary in domain.boundaries[: hole + 1])
            (back, _), (ahead, _) = (path_to(domain, vertex, PATH_ORDER) for vertex in (0, first))
            across = np.concatenate([z[0][:1], back[::-1], ahead, own])
            spinors = np.stack(self._spinors(across, branches), axis=-1)
            sign = np.sign((spinors[0] * parts[0][0].conj()).sum().real)
            parts.append(sign * spinors[-len(own) :])
        if not all(bool(signs_close_up(*part.T)) for part in parts):
            raise SurfaceError(
                "the harmonic surface between the rims has a branch point of odd order; no immersed minimal surface "
                "was found near it"
            )
        return np.concatenate(parts)

    def _slide(self, rim: int, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Curve parameters at parameters of a boundary of Ω."""
        rims, ends = self.surface.form.rims, self._ends(rim)
        starts = (ends - ends[0]) / (2 * np.pi)
        numbers = [number for number, side in enumerate(rims.sides) if side.rim == rim]
        own = np.searchsorted(starts[1:-1], t, side="right")
        slide = np.empty_like(t)
        for k, number in enumerate(numbers):
            side, here = rims.sides[number], own == k
            shares = np.stack([t[here] - starts[k], starts[k + 1] - t[here]]) / (starts[k + 1] - starts[k])
            coefficients = self.surface.slides[rims.columns[number]]
            slide[here] = side.slide(side.base(shares) + side.modes(shares) @ coefficients)[0]
        return slide


def _normalised(form: CornerForm) -> CircularDomain:
    """The circular domain with its first hole around 0."""
    to = centring(complex(form.circles.centres[1]), float(form.circles.radii[1]))
    circles = form.circles.turned(to, form.rims.rim_of_corner)
    # up to rounding errors
    return CircularDomain(centres=np.append(0j, circles.centres[2:]), log_radii=circles.log_radii[1:])
