"""Boundaries of Ω with the parameters of the curves that the surface maps them to."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.interpolate import BPoly
from scipy.optimize import nnls
from scipy.special import binom

from spinor_geom.arrays import to_numpy
from spinor_geom.domain.plane_domain import Boundary, FourierBoundary
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.nurbs.smooth_primitive import SmoothPrimitive
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.interior import RimPrimitive

_STEPS = 10  # of Newton's method for the parameter on ∂Ω
_PRECISE, _REACH = 1e-8, 0.02  # largest last Newton step (the error is about its square), longest step
# relative accuracy of ∫ φ dz: this share of the boundary residual, within limits suitable for the tolerance 1e-6
_OF_RESIDUAL, _ACCURACY = 1e-3, (1e-10, 1e-8)
_ASIDE = 1e-9  # distance of one-sided derivatives from a corner
# Shares of ∂Ω beside a corner where the growth of positions is measured, and how near it is to the power that it shows
_GROWTH, _SURE = (1e-5, 1e-4), 0.05
_SMOOTH = 1e-6  # largest difference of unit tangents where ∂Ω is smooth
# Where s and t, as shares of a side, differ by more than this, s is a polynomial of x. They differ by 0.44 next to the
# opened corner of an L, by at most 0.04 elsewhere. `_DEGREE` is that of the polynomial, `_NODES` the number of steps
# between the nodes of its fit.
_UNEVEN, _DEGREE, _NODES = 0.2, 9, 64
_EXACT, _LEAST = 1e3, 1e-5  # weight of the end of a side in the fit, and least coefficient of the derivative


@dataclass(frozen=True, kw_only=True, eq=False)
class Rim:
    """A boundary of Ω as a curve z(x), where x is the parameter s of Γ except beside opened corners.

    As functions of s, positions on ∂Ω are as smooth as Γ. Equal steps of the parameter t of ∂Ω may be uneven in space.
    At opened corners (`domain.opening`) s grows like a power of the distance in Ω. On sides that end there s is a
    polynomial of x, so that the surface is smooth in x too.
    """

    match: RimMatch  # the boundary and Γ
    start: Float[np.ndarray, "3"]  # position of the boundary's first point
    primitive: RimPrimitive | SmoothPrimitive  # ∫ φ dz along the boundary

    @classmethod
    def all_of(cls, solution: PlateauSolution) -> tuple[Rim, ...]:
        """The rims of a solution, in order."""
        surface, domain = solution.array_surface, solution.domain
        share = solution.boundary_residual.max / solution.diagonal
        accuracy = float(np.clip(_OF_RESIDUAL * share, *_ACCURACY))
        primitives = [_primitive(surface, boundary, accuracy) for boundary in domain.boundaries]
        is_inner = domain.root >= domain.triangulation.boundary_size
        if is_inner and not (domain.holes or surface.has_closed_positions):
            # by Cauchy's formula, as at inner points, because paths from there to ∂Ω would be close to poles
            starts = to_numpy(surface.constant) - primitives[0].inside(np.array([surface.root])).real
        else:
            starts = surface.position(np.array([match.boundary.point(np.zeros(())) for match in solution.rims]))
        return tuple(
            cls(match=match, start=start, primitive=primitive)
            for match, start, primitive in zip(solution.rims, starts, primitives, strict=True)
        )

    @property
    def boundary(self) -> Boundary:
        """The boundary of Ω."""
        return self.match.boundary

    @property
    def curve(self) -> BoundaryCurve:
        """Γ."""
        return self.match.curve

    @cached_property
    def corners(self) -> Float[np.ndarray, " c"]:
        """Parameters of the corners of Γ."""
        return np.asarray(self.curve.breaks[:-1][self.curve.corners])

    @property
    def powers(self) -> Float[np.ndarray, " c"]:
        """β at corners of angle πβ of the surface where ∂Ω is smooth, and 1 at the others.

        The surface has the angle of Γ or the rest of a full turn: the one by which positions grow along ∂Ω.
        """
        if not len(self.corners):
            return np.ones(0)
        before, after = (self.curve.derivative((self.corners + side) % 1.0) for side in (-_ASIDE, _ASIDE))
        sine, cosine = np.linalg.norm(np.cross(before, after), axis=1), (before * after).sum(axis=1)
        angle = 1 - np.arctan2(sine, cosine) / np.pi
        t = self._at_corners[:-1]
        lengths = [np.linalg.norm(self.positions(t + x) - self.positions(t), axis=1) for x in _GROWTH]
        growth = np.log(lengths[1] / lengths[0]) / math.log(_GROWTH[1] / _GROWTH[0])
        nearest = np.where(np.abs(growth - angle) < np.abs(growth - 2 + angle), angle, 2 - angle)
        start, end = self.tangents(self.corners)
        return np.where((np.abs(start - end) < _SMOOTH) & (np.abs(growth - nearest) < _SURE), nearest, 1.0)

    def point(self, x: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """z(x)."""
        return self.boundary.point(self.on_boundary(x))

    def derivative(self, x: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """dz/dx up to the boundary residual, except at corners. It is infinite where positions do not move along Γ."""
        t = self.on_boundary(x)
        _, velocity = self.primitive.at(t.ravel() % 1.0)
        s, change = self.on_curve(np.ravel(x))
        tangent = self.curve.derivative(s)
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = change * (tangent * tangent).sum(axis=1) / (velocity * tangent).sum(axis=1)
            return np.asarray(self.boundary.derivative(t) * speed.reshape(t.shape))

    def tangents(self, x: Float[np.ndarray, " n"]) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """Unit tangents of ∂Ω before and after points."""
        t = self.on_boundary(x)
        before, after = (self.boundary.derivative((t + side) % 1.0) for side in (-_ASIDE, _ASIDE))
        return before / np.abs(before), after / np.abs(after)

    def on_curve(self, x: Float[np.ndarray, "*pts"]) -> tuple[Float[np.ndarray, "*pts"], Float[np.ndarray, "*pts"]]:
        """s(x) and ds/dx."""
        s = np.array(x, dtype=np.float64)
        change = np.ones(s.shape)
        for side, shares in self._shares:
            first, last = np.append(self.corners, self.corners[0] + 1)[side : side + 2]
            share = (s - first) % 1.0 / (last - first)
            inside = share < 1
            s[inside] += (last - first) * (shares(share[inside]) - share[inside])
            change[inside] = shares.derivative()(share[inside])
        return s, change

    @cached_property
    def _shares(self) -> list[tuple[int, BPoly]]:
        """Sides where s and t, as shares of the side, differ by more than `_UNEVEN`, and polynomials from t to s there.

        They increase: their derivatives are sums of Bernstein polynomials with positive coefficients.
        """
        found, matched = [], np.concatenate([self.match.matching + turn for turn in range(-2, 3)]).T
        degrees, nodes = np.arange(_DEGREE + 1), (1 - np.cos(np.pi * np.arange(1, _NODES) / _NODES)) / 2
        basis = binom(_DEGREE, degrees) * nodes[:, None] ** degrees * (1 - nodes[:, None]) ** degrees[::-1]
        steps = basis[:, ::-1].cumsum(axis=1)[:, -2::-1]  # multiples of the integrals of Bernstein polynomials
        for side, (first, last) in enumerate(itertools.pairwise(self._at_corners if len(self.corners) else ())):
            s = np.interp(first + nodes * (last - first), *matched)
            begin, end = np.append(self.corners, self.corners[0] + 1)[side : side + 2]
            shares = (s - begin) % 1.0 / (end - begin)
            if np.abs(shares - nodes).max() > _UNEVEN:
                rows = np.vstack([steps, np.full(_DEGREE, _EXACT)])
                least = np.full(_DEGREE, _LEAST)
                factors, _ = nnls(rows, np.append(shares, _EXACT) - rows @ least)
                factors += least
                sums = np.append(0.0, np.cumsum(factors) / factors.sum())
                found.append((side, BPoly(sums[:, None], [0.0, 1.0])))
        return found

    def on_boundary(self, x: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """Parameters t on ∂Ω whose positions lie in the normal planes of Γ(s(x)). Corners map to corners.

        Along a side Γ is shifted by an interpolation of the differences at its two corners, so that t is continuous
        there.
        """
        flat = self.on_curve(np.ravel(x))[0]
        is_corner, least, most, shift = self._sides(flat)
        t = np.clip(self._matched(flat), least, most)
        point, tangent = self.curve.point(flat) + shift, self.curve.derivative(flat)
        for _ in range(_STEPS):
            moved, velocity = self.primitive.at(t % 1.0)
            gap = ((point - self.start - moved) * tangent).sum(axis=1)
            speed = (velocity * tangent).sum(axis=1)
            step = np.divide(gap, speed, out=np.zeros_like(gap), where=speed > 0)
            t, before = np.clip(t + np.clip(step, -_REACH, _REACH), least, most), t
            if np.abs(t - before).max(initial=0.0) <= _PRECISE:
                break
        return np.where(is_corner, least, t).reshape(np.shape(x))

    def _sides(
        self, s: Float[np.ndarray, " n"]
    ) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "#n 3"]]:
        """Whether points are corners, the parameters of the corners before and after them, and the shift of Γ there."""
        if not len(self.corners):
            return np.zeros(len(s), dtype=bool), np.full(len(s), -np.inf), np.full(len(s), np.inf), np.zeros((1, 3))
        ends = np.append(self.corners, self.corners[0] + 1)
        turns = np.floor(s - ends[0])
        place = np.clip(np.searchsorted(ends, s - turns, side="right") - 1, 0, len(self.corners) - 1)
        t, missed = self._at_corners, self._missed_corners
        share = ((s - turns - ends[place]) / (ends[place + 1] - ends[place]))[:, None]
        shift = (1 - share) * missed[place] + share * missed[place + 1]
        return s - turns == ends[place], t[place] + turns, t[place + 1] + turns, shift

    @property
    def largest_at_corners(self) -> float:
        """The largest distance of positions from Γ at its corners."""
        missed = self._missed_corners if len(self.corners) else np.zeros((1, 3))
        return float(np.linalg.norm(missed, axis=1).max())

    @cached_property
    def _missed_corners(self) -> Float[np.ndarray, "c1 3"]:
        """Positions minus Γ at the corners."""
        return np.asarray(self.positions(self._at_corners) - self.curve.point(np.append(self.corners, self.corners[0])))

    @cached_property
    def _at_corners(self) -> Float[np.ndarray, " c1"]:
        """Parameters of the corners of ∂Ω that are matched to those of Γ. The last is the first one plus 1."""
        t = self._matched(self.corners)
        offset = (t[:, None] - self.boundary.parameters[:-1] + 0.5) % 1.0 - 0.5
        t = t - offset[np.arange(len(t)), np.abs(offset).argmin(axis=1)]
        return np.append(t, t[0] + 1)

    def _matched(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters on ∂Ω by the matching of the solution. They increase with s, which is not taken modulo 1."""
        turns = np.floor(s)
        return np.asarray(self.match.parameters(s - turns) + turns)

    def positions(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Positions of the surface at parameters on ∂Ω."""
        return np.asarray(self.start + self.primitive.at(t % 1.0)[0])

    def positions_inside(self, z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Positions of a surface over a disk inside Ω, by Cauchy's formula: paths to corners would end near poles."""
        return np.asarray(self.start + self.primitive.inside(z.ravel()).real.reshape(*z.shape, 3))


def _primitive(surface: ArraySurface, boundary: Boundary, accuracy: float) -> RimPrimitive | SmoothPrimitive:
    """∫ φ dz along a boundary, by Fourier series where it is smooth, else by panels."""
    if isinstance(boundary, FourierBoundary):
        smooth = SmoothPrimitive.along(boundary, surface.null_curve, accuracy)
        if smooth is not None:
            return smooth
    return RimPrimitive.along(boundary, surface.null_curve, surface.order)
