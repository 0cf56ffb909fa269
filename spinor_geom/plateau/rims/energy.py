"""Douglas's variational problem for several rims: its energy and derivatives in the slides and the moduli of Ω.

Ω is the unit disk less round holes. The energy E of the harmonic surface over Ω is stationary in the slides and moduli
where the surface is conformal, hence minimal. When circles move with velocity v and keep their values, E changes by
dE = −½ Im ∮ φ·φ v dz. The bilinear form of this is the derivative of Λ, so all second derivatives follow from Λ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.arrays import (
    Array,
    add_to_diagonal,
    cholesky,
    closed_steps,
    complex_of,
    namespace,
    norm,
    place_of,
    square,
    zeros,
)
from spinor_geom.errors import OutOfTimeError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm, derivative, without_highest
from spinor_geom.plateau.harmonic.douglas import CROWDED, reflected, resampled, slid, smoothed
from spinor_geom.plateau.newton import MOST_STEPS, ROUNDING, Rows, conjugate_gradients, factored, stationary

MOST_MODULUS = 20.0  # above it, rims influence each other by less than 1e-9: there is no connected surface
# Number of nodes on all rims up to which matrices are factored. With twice or half as many, pairs of rims take an
# eighth longer.
DENSE = 512
# Largest step of a log modulus, or of a centre in widths of the gap. Without it Newton's method finds a surface of more
# area than a 5-noid.
LARGEST_STEP = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSurface:
    """A harmonic surface over a circular domain with rims on given curves, sampled at equal steps of the angles.

    It implements `newton.Energies` as a batch of one. The energy and its derivatives are in units of 2π/n.
    """

    curves: CurveTensors  # a batch of the rims in the direction of ∂Ω
    slides: Float[Array, "m n"]  # curve parameters
    points: Float[Array, "m n 3"]  # Γ
    speed: Float[Array, "m n"]  # |Γ′|
    unit: Float[Array, "m n 3"]  # unit tangents
    bends: Float[Array, "m n"]  # Γ″·ΛX by arc length
    form: CirclesForm  # Λ
    negligible: float  # as for `CirclesForm.of`
    energy: Float[Array, "1"]  # E
    by_slides: Float[Array, " mn"]  # derivative of E with respect to arc length along Γ
    normal: Float[Array, "m n 3"]  # ΛX
    fixed_moduli: bool = False  # whether the moduli are fixed: steps change the slides only

    @classmethod
    def of(
        cls, curves: CurveTensors, slides: Float[Array, "m n"], domain: CircularDomain, negligible: float
    ) -> HarmonicSurface:
        """The energy and its derivatives at given slides and domain."""
        points, tangent, second = curves.point_and_derivatives(slides)
        form = CirclesForm.of(domain, slides.shape[1], negligible=negligible)
        normal = form(points)
        speed = norm(tangent)
        unit = tangent / speed[..., None]
        return cls(
            curves=curves,
            slides=slides,
            points=points,
            speed=speed,
            unit=unit,
            bends=(second * normal).sum(-1) / square(speed),
            form=form,
            negligible=negligible,
            energy=0.5 * (points * normal).sum().reshape(1),
            by_slides=(normal * unit).sum(-1).reshape(-1),
            normal=normal,
        )

    @property
    def domain(self) -> CircularDomain:
        """Ω."""
        return self.form.domain

    @cached_property
    def moduli(self) -> Moduli:
        """Derivatives with respect to the moduli."""
        return Moduli.of(self.form, self.points, self.normal)

    @property
    def dirichlet_energy(self) -> float:
        """The Dirichlet energy: the area if the surface is conformal, more otherwise."""
        energy: float = self.energy[0]
        return float(energy * 2 * math.pi / self.slides.shape[1])

    @property
    def crowded(self) -> bool:
        """Whether a large part of a curve has no nodes."""
        return bool(closed_steps(self.slides).max() > CROWDED)

    @property
    def is_apart(self) -> bool:
        """Whether a modulus is too large for a connected surface."""
        return float(self.domain.room[1].max()) > MOST_MODULUS

    @cached_property
    def falls_apart(self) -> bool:
        """Whether the surface degenerates: nodes crowd, or a modulus is too large."""
        return self.crowded or self.is_apart

    @property
    def is_over(self) -> Bool[Array, "1"]:
        """Whether the surface degenerates."""
        return place_of(self.slides).put(np.array([self.falls_apart]))

    @cached_property
    def size(self) -> Float[Array, "1"]:
        """Relative gradient: the larger of its RMS in arc length over that of ΛX, and of its maximum in moduli over E.

        Rotations of Ω are projected out.
        """
        by_slides, normal = self.gradient[:, : len(self.by_slides)], square(self.normal).sum(-1).mean()
        xp = namespace(self.slides)
        return xp.maximum(xp.sqrt(square(by_slides).mean(-1) / normal), abs(self._slopes).max() / self.energy)

    @property
    def _slopes(self) -> Float[Array, " p"]:
        return 0 * self.moduli.slopes if self.fixed_moduli else self.moduli.slopes

    @property
    def stiffness(self) -> float:
        """Mean of |k|, the scale of second derivatives in one node, used as stiffness against rotations of Ω."""
        return float(self.form.own.mean())

    @cached_property
    def gradient(self) -> Float[Array, "1 k"]:
        """The gradient in arc length and the moduli, orthogonal to rotations of Ω."""
        gradient = namespace(self.slides).concat([self.by_slides, self._slopes])
        along = (gradient @ self.rotation) / (self.rotation @ self.rotation)
        return (gradient - along * self.rotation)[None]

    def matrix(self) -> Float[Array, "k k"]:
        """The Hessian in arc length and the moduli, with a stiffness against rotations of Ω."""
        unit, count = self.unit.reshape(-1, 3), self.count
        matrix = (self.stiffness * self.rotation)[:, None] * self.rotation
        own = (unit @ unit.mT) * self.form.matrix()
        add_to_diagonal(own, self.bends.reshape(-1))
        matrix[:count, :count] += own
        matrix[count:, :count] += self.mixed
        matrix[:count, count:] += self.mixed.mT
        matrix[count:, count:] += self._by_moduli
        return matrix

    def direction(
        self, damping: Float[Array, "1"] | None, forcing: Float[Array, "1"]
    ) -> tuple[Float[Array, "1 k"], Bool[Array, "1"]]:
        """Newton's step. For few nodes by a Cholesky factor, damped until the matrix is definite."""
        if damping is None:
            step = namespace(self.slides).linalg.solve(self.matrix(), -self.gradient.mT)
            return step.mT, self.energy != self.energy
        if self.count > DENSE:
            return conjugate_gradients(self.hessian(damping), self.gradient, self.precondition, forcing)
        xp = namespace(self.slides)
        metric = xp.concat([2 * xp.clip(-self.bends, 0, None).reshape(-1), self._scales])
        return factored(self.matrix(), metric, self.gradient, damping)

    @cached_property
    def _by_moduli(self) -> Float[Array, "p p"]:
        """The Hessian in the moduli."""
        if not self.fixed_moduli:
            return self.moduli.hessian
        # any definite matrix, because slopes and mixed derivatives are 0
        definite = zeros(self.moduli.hessian.shape, self.slides)
        add_to_diagonal(definite, self.energy)
        return definite

    @property
    def _scales(self) -> Float[Array, " p"]:
        own = namespace(self.slides).arange(len(self._by_moduli))
        return abs(self._by_moduli[own, own])

    @property
    def count(self) -> int:
        """Number of nodes on all rims."""
        return math.prod(self.slides.shape)

    def hessian(self, damping: Float[Array, "1"] | None) -> Rows:
        """Products with the damped `matrix`."""
        bends = reflected(self.bends, damping)
        moduli, xp = namespace(self.slides).asarray(self._by_moduli, copy=True), namespace(self.slides)
        if damping is not None:
            add_to_diagonal(moduli, damping * self._scales)

        def applied(rows: Float[Array, "1 k"]) -> Float[Array, "1 k"]:
            (x,) = rows
            along, by_moduli = x[: self.count], x[self.count :]
            u = along.reshape(bends.shape)
            image = (self.unit * self.form(self.unit * u[..., None])).sum(-1) + bends * u
            slides = image.reshape(-1) + self.mixed.mT @ by_moduli
            whole = xp.concat([slides, self.mixed @ along + moduli @ by_moduli])
            stiffened: Array = whole + self.stiffness * (self.rotation @ x) * self.rotation
            return stiffened[None]

        return applied

    def precondition(self, u: Float[Array, "1 k"]) -> Float[Array, "1 k"]:
        """An approximate solution of Newton's equations, for conjugate gradients."""
        count, scales = self.count, self._scales
        smooth = smoothed(u[0, :count].reshape(self.slides.shape))
        return namespace(u).concat([smooth.reshape(-1), u[0, count:] / scales])[None]

    def at(self, which: Int[Array, " _"]) -> HarmonicSurface:
        """This surface."""
        return self

    def replaced(self, which: Int[Array, " _"], other: HarmonicSurface) -> HarmonicSurface:
        """The other surface if `which` is not empty, else this one."""
        return other if len(which) else self

    @property
    def is_minimum(self) -> bool:
        """Whether the Morse index is 0. It is faster than `index`."""
        return cholesky(self.matrix()) is not None

    @property
    def index(self) -> int:
        """Morse index: the number of negative eigenvalues of the Hessian."""
        values = namespace(self.slides).linalg.eigvalsh(self.matrix())
        return int((values < -ROUNDING * abs(values).max()).sum())

    @cached_property
    def mixed(self) -> Float[Array, "p mn"]:
        """Second derivatives in a modulus and arc length, 0 for fixed moduli."""
        mixed = (self.moduli.changes * self.unit).sum(-1).reshape(-1, self.count)
        return 0 * mixed if self.fixed_moduli else mixed

    @cached_property
    def rotation(self) -> Float[Array, " k"]:
        """The displacement by an infinitesimal rotation of Ω, in arc length and the moduli."""
        steps, xp = closed_steps(self.slides), namespace(self.slides)
        signs = -xp.ones_like(steps[:, :1])
        signs[0] = 1
        turned = (self.speed * (steps + xp.roll(steps, 1, axis=-1)) * signs).reshape(-1)
        centre = -1j * self.domain.centres / self.domain.room[0] * (4 * math.pi / steps.shape[1])
        centres = xp.stack([centre.real, centre.imag, 0 * centre.real], axis=-1).reshape(-1)
        return xp.concat([turned, _without_first_centre(centres)]) / norm(turned)

    def stepped(self, direction: Float[Array, "1 k"], length: float = 1.0) -> HarmonicSurface:
        """The surface after a step, or this surface with infinite energy if circles would meet."""
        count = self.count
        slides, along = direction[0, :count].reshape(self.slides.shape) / self.speed, direction[0, count:]
        length = min(length, LARGEST_STEP / max(float(abs(along).max()), 1e-300))
        domain = self.domain.moved(length * along)
        if not float(domain.room[1].min()) > 0:
            return replace(self, energy=namespace(self.slides).full_like(self.energy, math.inf))
        moved = slid(self.slides, slides, length)
        there = HarmonicSurface.of(self.curves, moved, domain, self.negligible)
        return replace(there, fixed_moduli=self.fixed_moduli)


@dataclass(frozen=True, kw_only=True, eq=False)
class Moduli:
    """Derivatives of E with respect to the moduli: centre (in widths of the gap) and log modulus of each hole.

    The centre of the first hole is fixed at 0.
    """

    form: CirclesForm  # Λ
    null: Complex[Array, "h n c"]  # ∂X/∂τ + iΛX on the holes
    moves: Complex[Array, "h 3 n"]  # v/z′ for the three moduli of each hole

    @classmethod
    def of(cls, form: CirclesForm, points: Float[Array, "m n c"], normal: Float[Array, "m n c"]) -> Moduli:
        """The derivatives for boundary values X and ΛX."""
        room, modulus = form.domain.room
        turn = form.domain.circles(form.steps)[0]
        along = (room / form.domain.radii)[:, None] * turn
        moves = namespace(turn).stack([1j * along, -along, 0 * along - 1j * modulus[:, None]], axis=1)
        return cls(form=form, null=complex_of(derivative(points[1:]), without_highest(normal[1:])), moves=moves)

    @cached_property
    def _carried(self) -> Complex[Array, "h 3 n c"]:
        return self.null[:, None] * self.moves[..., None]

    @cached_property
    def _all_slopes(self) -> Float[Array, "h 3"]:
        return -0.5 * (self.null[:, None] * self._carried).imag.sum((-2, -1))

    @cached_property
    def slopes(self) -> Float[Array, " p"]:
        """First derivatives of E."""
        return _without_first_centre(self._all_slopes.reshape(-1))

    @cached_property
    def displacements(self) -> Float[Array, "p m n c"]:
        """Re φ·v for each modulus, on all circles: the displacement of the surface along itself by a move of Ω."""
        return self._on_circles(self._carried.real)

    def _on_circles(self, on_holes: Float[Array, "h 3 n c"]) -> Float[Array, "p m n c"]:
        """Values for the moduli of each hole on its circle, with 0 on the others."""
        h, _, n, columns = on_holes.shape
        values, own = zeros((h, 3, h + 1, n, columns), on_holes), np.arange(h)
        values[own, :, own + 1] = on_holes
        return _without_first_centre(values.reshape(3 * h, h + 1, n, columns))

    @cached_property
    def changes(self) -> Float[Array, "p m n c"]:
        """The derivative of ΛX in each modulus."""
        xp, (_, m, n, _) = namespace(self.null), self.displacements.shape
        side_by_side = xp.permute_dims(self.displacements, (1, 2, 0, 3))
        changed = -self.form(side_by_side.reshape(m, n, -1)).reshape(side_by_side.shape)
        return xp.permute_dims(changed, (2, 0, 1, 3)) + self._on_circles(derivative(self._carried.imag))

    @cached_property
    def hessian(self) -> Float[Array, "p p"]:
        """Second derivatives of E."""
        h = len(self.null)
        hole = _without_first_centre(np.repeat(np.arange(h), 3))
        carried = _without_first_centre(self._carried.real.reshape(3 * h, *self._carried.shape[2:]))
        second = -(carried * self.changes[:, hole + 1]).sum((-2, -1)).mT
        # the units of centres and log moduli depend on the modulus
        of_units, own = zeros((h, 3, h, 3), second), np.arange(h)
        _, modulus = self.form.domain.room
        of_units[own, :2, own, 2] = modulus[:, None] * self._all_slopes[:, :2]
        of_units[own, 2, own, 2] = self._all_slopes[:, 2]
        rows = _without_first_centre(of_units.reshape(3 * h, 3 * h))
        second = second + _without_first_centre(rows.mT).mT
        return (second + second.mT) / 2


def _without_first_centre(rows: Array) -> Array:
    """Rows for all moduli, without the two for the centre of the first hole."""
    return rows[2:]


@dataclass(frozen=True, kw_only=True, eq=False)
class RimsProblem:
    """Douglas's problem for curves in the order and direction of the boundaries of Ω."""

    curves: CurveTensors  # two or more, as a batch
    negligible: float = ROUND_OFF  # as for `CirclesForm.of`
    on_step: Callable[[float], None] = lambda size: None  # called with the relative gradient at each step

    def stationary(
        self,
        start: HarmonicSurface,
        *,
        tolerance: float = ROUNDING,
        max_steps: int = MOST_STEPS,
        negligible: float = 0.0,
        near: bool = True,
        saddles: bool = False,
    ) -> HarmonicSurface:
        """The critical point that `newton.stationary` finds from a start.

        Raises:
            OutOfTimeError: time ran out.
        """
        finished = stationary(
            start,
            tolerances=[tolerance],
            max_steps=[max_steps],
            negligible=[negligible * start.slides.shape[1] / (2 * math.pi)],
            near=near,
            saddles=saddles,
            on_step=[self.on_step],
        )
        if not finished:
            raise OutOfTimeError
        ((_, found),) = finished
        return found

    def resampled(self, surface: HarmonicSurface, n: int) -> HarmonicSurface:
        """The harmonic surface with the slides interpolated at n nodes on each rim."""
        return HarmonicSurface.of(self.curves, resampled(surface.slides, n), surface.domain, self.negligible)
