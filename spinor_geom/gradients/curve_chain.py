"""The chain rule from values of a curve to the points of the loop that define it.

A displacement of Γ along itself does not change the surface. Therefore the parameter of a point on an analytic Γ is
fixed, and so are the piece of a spline and the share u of the piece. Γ depends on the points of the loop directly and
through their parameters: chord lengths, or arc lengths of the cubic spline over these chords.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from spinor_geom.arrays import modulo_one
from spinor_geom.errors import NotDifferentiableError
from spinor_geom.gradients.analytic_chain import PoissonCurve, by_steps, by_trigonometric_points
from spinor_geom.gradients.spline_chain import SplineSystem
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import ARC_NODES, EQUAL, gauss_nodes, piecewise_cubic, quintic_degrees
from spinor_geom.mesh.spacing import are_long


def by_points(
    curve: BoundaryCurve, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "m 3"]:
    """The gradient in the points of a curve's loop, from that in Γ(s), which is normal to Γ′.

    Raises a NotDifferentiableError if the shape of the curve is not a function of points.
    """
    if curve.slopes is not None:
        raise NotDifferentiableError("the curve is given by a formula; solve over points of the curve instead")
    if curve.is_of_surface:
        raise NotDifferentiableError(
            "the surface passes through the points of a rough loop, and its boundary between them is not a function of "
            "the points; solve with between='smooth'"
        )
    if curve.kind != "analytic":
        return _Spline(curve=curve).by_points(s, by_values)
    points = curve.coefficients[-1]
    m = len(points)
    if np.abs(m * curve.breaks - np.arange(m + 1)).max() <= EQUAL:
        return by_trigonometric_points(m, s, by_values)
    cubic = _Cubic(points=points, corners=curve.corners)
    last = PoissonCurve(points=points, breaks=curve.breaks)
    by_last, by_places = last.by_values(s, by_values)
    first = PoissonCurve(points=points, breaks=cubic.arcs)
    by_first, by_arcs = first.by_lengths(by_steps(by_places, last.breaks))
    return np.asarray(by_last + by_first + cubic.by_arcs(by_steps(by_arcs, first.breaks)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cubic:
    """The cubic spline with chord-length parameters."""

    points: Float[np.ndarray, "m 3"]
    corners: Bool[np.ndarray, " m"]
    has_natural_ends: bool = True

    @cached_property
    def system(self) -> SplineSystem:
        natural = self.has_natural_ends
        breaks, coefficients = piecewise_cubic(self.points, self.corners, has_natural_ends=natural)
        degrees = np.full(len(self.points), 3)
        return _system(breaks, coefficients, self.corners, degrees, natural)

    @cached_property
    def _at_nodes(self) -> tuple[Float[np.ndarray, "m g 3"], Float[np.ndarray, "3 g"]]:
        """dΓ/du at Gauss-Legendre nodes on the pieces; derivatives of u, u² and u³ there, times the weights."""
        nodes, weights = gauss_nodes(ARC_NODES)
        powers = np.arange(1, 4)[:, None] * ((nodes + 1) / 2) ** np.arange(3)[:, None]
        return np.einsum("rg,rmk->mgk", powers, self.system.powers), powers * weights / 2

    @cached_property
    def _lengths(self) -> Float[np.ndarray, " m"]:
        velocity, powers = self._at_nodes
        return np.asarray(np.linalg.norm(velocity, axis=2) @ powers[0])

    @property
    def arcs(self) -> Float[np.ndarray, " m_plus_1"]:
        """Normalised arc lengths up to the points, from 0 to 1."""
        arcs = np.append(0.0, np.cumsum(self._lengths) / self._lengths.sum())
        arcs[-1] = 1.0
        return arcs

    def by_arcs(self, by_logs: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """The gradient in the points, from that in the logarithms of the arc lengths of the pieces."""
        velocity, powers = self._at_nodes
        unit = velocity / np.linalg.norm(velocity, axis=2, keepdims=True)
        by_powers = np.einsum("m,rg,mgk->rmk", by_logs / self._lengths, powers, unit)
        own, by_chords = self.system.by_points(by_powers)
        return np.asarray(own + self.by_chords(by_chords))

    def by_chords(self, by_logs: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """The gradient in the points, from that in the logarithms of the chord lengths."""
        chord = np.roll(self.points, -1, axis=0) - self.points
        steps = (by_logs / (chord * chord).sum(axis=1))[:, None] * chord
        return np.asarray(np.roll(steps, 1, axis=0) - steps)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spline:
    """A spline of `BoundaryCurve`.

    Its parameters are chord lengths on cubic sides, arc lengths of the cubic spline over these on others.
    """

    curve: BoundaryCurve

    @cached_property
    def _degrees(self) -> Int[np.ndarray, " m"]:
        curve = self.curve
        if curve.kind == "quintic":
            return quintic_degrees(curve.corners)
        if not curve.corners.any():
            return np.full(len(curve.corners), curve.degree)
        # sides of a lower degree are padded with 0
        highest = np.zeros(len(curve.corners), dtype=np.int64)
        for power in range(3, curve.degree + 1):
            highest[curve.coefficients[curve.degree - power].any(axis=1)] = power
        # pieces before the first corner belong to the last side
        side = np.cumsum(curve.corners) % curve.corners.sum()
        of_side = np.full(side.max() + 1, 3)
        np.maximum.at(of_side, side, highest)
        return np.asarray(of_side[side])

    def by_points(self, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "m 3"]:
        """The gradient in the points, from that in Γ(s) at fixed shares u of the pieces."""
        curve, m = self.curve, len(self.curve.corners)
        s = modulo_one(s)
        piece = np.searchsorted(curve.breaks, s, side="right") - 1
        u = ((s - curve.breaks[piece]) / np.diff(curve.breaks)[piece])[:, None]
        terms = [by_values]
        for _ in range(curve.degree):
            terms.append(terms[-1] * u)
        order = np.argsort(piece, kind="stable")
        sums = csr_array((np.ones(len(s)), order, np.searchsorted(piece[order], np.arange(m + 1))), shape=(m, len(s)))
        starts, *by_powers = np.split(sums @ np.concatenate(terms, axis=1), curve.degree + 1, axis=1)
        natural = curve.kind != "quintic"
        cubic = _Cubic(points=curve.coefficients[-1], corners=curve.corners, has_natural_ends=natural)
        system = _system(curve.breaks, curve.coefficients, curve.corners, self._degrees, natural)
        own, by_logs = system.by_points(np.stack(by_powers))
        is_cubic = self._degrees == 3
        total = starts + own + cubic.by_chords(np.where(is_cubic, by_logs, 0.0))
        return np.asarray(total if is_cubic.all() else total + cubic.by_arcs(np.where(is_cubic, 0.0, by_logs)))


def _system(
    breaks: Float[np.ndarray, " m_plus_1"],
    coefficients: Float[np.ndarray, "d1 m 3"],
    corners: Bool[np.ndarray, " m"],
    degrees: Int[np.ndarray, " m"],
    has_natural_ends: bool,
) -> SplineSystem:
    widths, points = np.diff(breaks), coefficients[-1]
    powers = coefficients[-2::-1] * widths[:, None] ** np.arange(1, len(coefficients))[:, None, None]
    natural = has_natural_ends & are_long(points)
    return SplineSystem(widths=widths, powers=powers, corners=corners, degrees=degrees, natural=natural)
