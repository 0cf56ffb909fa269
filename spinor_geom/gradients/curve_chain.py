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
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.sparse import csr_array

from spinor_geom.arrays import modulo_one
from spinor_geom.errors import NotDifferentiableError
from spinor_geom.gradients.spline_chain import SplineSystem
from spinor_geom.mesh.boundary_loop import straight_edges
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import (
    ARC_NODES,
    EQUAL,
    RIDGE,
    ends_of_lines,
    piecewise_cubic,
    poisson_kernels,
    quintic_degrees,
)
from spinor_geom.mesh.piece_polynomials import gauss_nodes
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
    lines: Bool[np.ndarray, " m"] | None = None
    has_natural_ends: bool = True

    @cached_property
    def system(self) -> SplineSystem:
        natural = self.has_natural_ends
        breaks, coefficients = piecewise_cubic(self.points, self.corners, self.lines, has_natural_ends=natural)
        degrees = np.full(len(self.points), 3)
        return _system(breaks, coefficients, self.corners, degrees, self.lines, natural)

    @cached_property
    def _at_nodes(self) -> tuple[Float[np.ndarray, "m g 3"], Float[np.ndarray, "3 g"]]:
        """dΓ/du at Gauss-Legendre nodes on the pieces, and the derivatives of u, u² and u³ there, times the weights."""
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
        lines = straight_edges(curve.coefficients[-1], curve.corners) if natural else None
        cubic = _Cubic(points=curve.coefficients[-1], corners=curve.corners, lines=lines, has_natural_ends=natural)
        system = _system(curve.breaks, curve.coefficients, curve.corners, self._degrees, lines, natural)
        own, by_logs = system.by_points(np.stack(by_powers))
        is_cubic = self._degrees == 3
        total = starts + own + cubic.by_chords(np.where(is_cubic, by_logs, 0.0))
        return np.asarray(total if is_cubic.all() else total + cubic.by_arcs(np.where(is_cubic, 0.0, by_logs)))


def _system(
    breaks: Float[np.ndarray, " m_plus_1"],
    coefficients: Float[np.ndarray, "d1 m 3"],
    corners: Bool[np.ndarray, " m"],
    degrees: Int[np.ndarray, " m"],
    lines: Bool[np.ndarray, " m"] | None,
    has_natural_ends: bool,
) -> SplineSystem:
    widths, points = np.diff(breaks), coefficients[-1]
    lines = np.zeros_like(corners) if lines is None else lines
    joints = ends_of_lines(lines, corners)
    clamped = np.stack([joints, np.roll(joints, -1)]) & ~lines
    powers = coefficients[-2::-1] * widths[:, None] ** np.arange(1, len(coefficients))[:, None, None]
    natural = has_natural_ends & are_long(points)
    return SplineSystem(
        widths=widths, powers=powers, corners=corners | joints, degrees=degrees, natural=natural, clamped=clamped
    )


def by_trigonometric_points(
    m: int, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "m 3"]:
    """The gradient in the points of a trigonometric polynomial, from that in its values."""
    turn = np.exp(-2j * np.pi * s)
    # with k = 8a + b, in a third of the time of cumulative products
    low, high = turn ** np.arange(8)[:, None], turn ** (8 * np.arange(m // 16 + 1))[:, None]
    powers = (high[:, None] * low).reshape(-1, len(s))[: m // 2 + 1]
    return np.asarray(np.fft.irfft(powers @ by_values, n=m, axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class PoissonCurve:
    """The interpolating sum of Poisson kernels at given parameters: Γ(s) = mean + Σ_j c_j K(s − k_j)."""

    points: Float[np.ndarray, "m 3"]
    breaks: Float[np.ndarray, " m_plus_1"]

    @property
    def places(self) -> Float[np.ndarray, " m"]:
        """The parameters k_j of the points."""
        return self.breaks[:-1]

    @cached_property
    def _own(self) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
        """Kernels and their slopes at the points."""
        kernel, slope = poisson_kernels(self.places, self.places, len(self.points), 1)
        kernel.flat[:: len(kernel) + 1] *= 1 + RIDGE
        return kernel, slope

    @cached_property
    def _factor(self) -> Float[np.ndarray, "m m"]:
        # LAPACK directly, because the checks of scipy.linalg take as long as the computation
        factor, is_singular = dpotrf(self._own[0])
        if is_singular:
            raise np.linalg.LinAlgError("the equations of an analytic curve are singular")
        return np.asarray(factor)

    @cached_property
    def weights(self) -> Float[np.ndarray, "m 3"]:
        """The weights c."""
        return np.asarray(dpotrs(self._factor, self.points - self.points.mean(axis=0))[0])

    def by_values(
        self, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in Γ(s) at fixed s."""
        kernel, slope = poisson_kernels(s, self.places, len(self.points), 1)
        by_points, by_places = self._by_weights(kernel.T @ by_values)
        by_places -= (slope.T @ by_values * self.weights).sum(axis=1)
        return by_points + by_values.sum(axis=0) / len(by_points), by_places

    def by_lengths(self, by_logs: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in the logarithms of the lengths of the pieces."""
        m, widths = len(self.points), np.diff(self.breaks)
        nodes, shares = gauss_nodes(ARC_NODES)
        s = (self.breaks[:-1, None] + widths[:, None] * (nodes + 1) / 2).ravel()
        _, slope, bend = poisson_kernels(np.append(s, self.places), self.places, m, 2)
        velocity = slope @ self.weights
        speed = np.linalg.norm(velocity, axis=1)
        inner, ends = np.split(speed, [len(s)])
        steps = np.outer(widths, shares) / 2
        by_arcs = by_logs / (inner.reshape(steps.shape) * steps).sum(axis=1)
        by_velocity = (by_arcs[:, None] * steps).reshape(-1, 1) * velocity[: len(s)] / inner[:, None]
        by_points, by_places = self._by_weights(slope[: len(s)].T @ by_velocity)
        by_places -= (bend[: len(s)].T @ by_velocity * self.weights).sum(axis=1)
        return by_points, by_places + ends * (np.roll(by_arcs, 1) - by_arcs)

    def _by_weights(
        self, by_weights: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in the weights c."""
        by_points = dpotrs(self._factor, by_weights)[0]
        turned = self._own[1] * (by_points @ self.weights.T)
        return by_points - by_points.mean(axis=0), turned.sum(axis=0) - turned.sum(axis=1)


def by_steps(by_breaks: Float[np.ndarray, " m"], breaks: Float[np.ndarray, " m_plus_1"]) -> Float[np.ndarray, " m"]:
    """The gradient in the logarithms of lengths, from that in their cumulative sums, normalised to end at 1."""
    after = np.append(np.cumsum(by_breaks[:0:-1])[::-1], 0.0)
    return np.asarray(np.diff(breaks) * (after - by_breaks @ breaks[:-1]))
