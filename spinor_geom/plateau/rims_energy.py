"""Douglas's energy of harmonic surfaces over circular domains, with its derivatives by slides and moduli.

Ω is the unit disk less round holes. The energy E of the harmonic surface over Ω is stationary in the slides and in the
moduli where the surface is conformal, hence minimal. Circles that move with velocity v, values carried along, change it
by dE = −½ Im ∮ φ·φ v dz; polarised, that is the change of Λ itself, so that all second derivatives need Λ alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.circles import DirichletForm, derivative, without_highest
from spinor_geom.plateau.douglas import CROWDED, slid
from spinor_geom.plateau.problem import CurveTensors

# Halvings of a step until the circles stay apart.
_MOST_HALVINGS = 4
# Largest step of a modulus: of its logarithm, or of a place by the distance to the next circle.
_LARGEST_STEP = 0.5
# Share of a curve that no step may be: few nodes do not crowd before they are all in one place.
_LARGE_PART = 0.5
# Curvatures of the energy below this share of the largest count as none.
_FLAT = 1e-12
# Error of Λ, relative, above which so many nodes do not resolve the gaps between the circles.
_UNRESOLVED = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSurface:
    """A harmonic surface over a circular domain, its rims on curves at equal steps of every circle's angle.

    The energy and its derivatives by slides and moduli are sums over the nodes, without the factor 2π/n.
    """

    curves: CurveTensors  # of the rims, as the boundary of Ω runs, as a batch
    slides: Float[Tensor, "m n"]  # curve parameters
    points: Float[Tensor, "m n 3"]  # of the curves
    speed: Float[Tensor, "m n"]  # of the curves by their parameters
    unit: Float[Tensor, "m n 3"]  # their tangents
    bends: Float[Tensor, "m n"]  # Γ″·ΛX by arc length
    form: DirichletForm  # Λ
    negligible: float  # as for `DirichletForm.of`
    energy: float  # E
    by_slides: Float[Tensor, " mn"]  # derivative of E by arc length
    normal: Float[Tensor, "m n 3"]  # ΛX

    @classmethod
    def of(
        cls, curves: CurveTensors, slides: Float[Tensor, "m n"], domain: CircularDomain, negligible: float
    ) -> HarmonicSurface:
        """The energy with given slides over a given domain."""
        points, tangent, second = curves.point_and_derivatives(slides)
        form = DirichletForm.of(domain, slides.shape[1], negligible=negligible)
        normal = form(points)
        speed = tangent.square().sum(-1).sqrt()
        unit = tangent / speed[..., None]
        return cls(
            curves=curves,
            slides=slides,
            points=points,
            speed=speed,
            unit=unit,
            bends=(second * normal).sum(-1) / speed.square(),
            form=form,
            negligible=negligible,
            energy=0.5 * float((points * normal).sum()),
            by_slides=(normal * unit).sum(-1).flatten(),
            normal=normal,
        )

    @property
    def domain(self) -> CircularDomain:
        """Ω."""
        return self.form.domain

    @cached_property
    def moduli(self) -> Moduli:
        """Derivatives by the moduli."""
        return Moduli.of(self.form, self.points, self.normal)

    @property
    def dirichlet_energy(self) -> float:
        """E with its factor: the area where the surface is conformal, more elsewhere."""
        return self.energy * 2 * math.pi / self.slides.shape[1]

    @property
    def crowded(self) -> bool:
        """Whether the nodes leave out a large part of a curve, so that the energy means nothing."""
        steps = torch.diff(self.slides, append=self.slides[:, :1] + 1)
        return float(steps.max()) > min(CROWDED / self.slides.shape[1], _LARGE_PART)

    @cached_property
    def size(self) -> float:
        """Of the gradient: RMS by arc length relative to ΛX, or the steepest by a modulus over the energy.

        A rotation of Ω, which only nodes feel, is left out.
        """
        by_slides, normal = self.gradient()[: len(self.by_slides)], self.normal.square().sum(-1).mean()
        return max(
            float((by_slides.square().mean() / normal).sqrt()), float(self.moduli.slopes.abs().max()) / self.energy
        )

    @property
    def stiffness(self) -> float:
        """Mean of |k|: the size of the energy's second derivatives by one node, and of what holds a rotation."""
        return float(self.form.own.mean())

    def gradient(self) -> Float[Tensor, " k"]:
        """The first derivative by arc length and the moduli, less that by a rotation of Ω."""
        gradient = torch.cat([self.by_slides, self.moduli.slopes])
        return gradient - (gradient @ self.rotation) / (self.rotation @ self.rotation) * self.rotation

    def hessian(self) -> Float[Tensor, "k k"]:
        """The second derivative by arc length and the moduli, stiffened against a rotation of Ω."""
        unit, count = self.unit.reshape(-1, 3), self.slides.numel()
        hessian = unit.new_empty(len(self.rotation), len(self.rotation))
        torch.mul(unit @ unit.T, self.form.matrix(), out=hessian[:count, :count])
        hessian.diagonal()[:count] += self.bends.flatten()
        hessian[count:, :count], hessian[:count, count:] = self.mixed, self.mixed.T
        hessian[count:, count:] = self.moduli.hessian
        return hessian.addr_(self.rotation, self.rotation, alpha=self.stiffness)

    @property
    def index(self) -> int:
        """Number of directions of all slides and moduli along which the energy falls: the Morse index."""
        values = torch.linalg.eigvalsh(self.hessian())
        return int((values < -_FLAT * values.abs().max()).sum())

    @cached_property
    def mixed(self) -> Float[Tensor, "p mn"]:
        """The second derivatives by a modulus and by arc length."""
        mixed: Tensor = (self.moduli.changes * self.unit).sum(-1).flatten(1)
        return mixed

    @cached_property
    def rotation(self) -> Float[Tensor, " k"]:
        """What a rotation of Ω moves, by arc length and the moduli: the outer rim ahead, the others back."""
        steps = torch.diff(self.slides, append=self.slides[:, :1] + 1)
        signs = -torch.ones_like(steps[:, :1])
        signs[0] = 1
        turned: Tensor = self.speed * (steps + steps.roll(1, -1)) * signs
        place = -1j * self.domain.centres / self.domain.room[0] * (4 * math.pi / steps.shape[1])
        places = torch.stack([place.real, place.imag, torch.zeros_like(place.real)], dim=-1).flatten()
        rotation: Tensor = torch.cat([turned.flatten(), _without_first_place(places)]) / turned.norm()
        return rotation

    def stepped(self, step: Float[Tensor, " k"]) -> HarmonicSurface:
        """The surface after a step, or as much of it as keeps the circles apart and is resolved; else this one."""
        count = self.slides.numel()
        direction = step[:count].reshape(self.slides.shape) / self.speed
        along = step[count:]
        share = min(1.0, _LARGEST_STEP / max(float(along.abs().max()), _LARGEST_STEP))
        for _ in range(_MOST_HALVINGS):
            domain = self.domain.moved(share * along)
            if float(domain.room[1].min()) > 0:
                there = HarmonicSurface.of(self.curves, slid(self.slides, direction, share), domain, self.negligible)
                if there.form.error <= max(_UNRESOLVED, self.form.error):
                    return there
            share /= 2
        return self


@dataclass(frozen=True, kw_only=True, eq=False)
class Moduli:
    """Derivatives by the moduli: of each hole its place, by the distance to the next circle, and its log modulus.

    The first hole stays about 0.
    """

    form: DirichletForm  # Λ
    null: Complex[Tensor, "h n c"]  # ∂X/∂τ + iΛX on the holes
    moves: Complex[Tensor, "h 3 n"]  # v/z′ of the three moduli of each hole

    @classmethod
    def of(cls, form: DirichletForm, points: Float[Tensor, "m n c"], normal: Float[Tensor, "m n c"]) -> Moduli:
        """The derivatives for values X and ΛX."""
        room, modulus = form.domain.room
        turn = form.domain.circles(form.steps)[0]
        along = (room / form.domain.radii)[:, None] * turn
        moves = torch.stack([1j * along, -along, (-1j * modulus)[:, None].expand_as(along)], dim=1)
        return cls(form=form, null=torch.complex(derivative(points[1:]), without_highest(normal[1:])), moves=moves)

    @cached_property
    def _carried(self) -> Complex[Tensor, "h 3 n c"]:
        return self.null[:, None] * self.moves[..., None]

    @cached_property
    def _all_slopes(self) -> Float[Tensor, "h 3"]:
        total: Tensor = -0.5 * (self.null[:, None] * self._carried).imag.sum((-2, -1))
        return total

    @cached_property
    def slopes(self) -> Float[Tensor, " p"]:
        """Derivatives of E by each modulus."""
        return _without_first_place(self._all_slopes.flatten())

    @cached_property
    def changes(self) -> Float[Tensor, "p m n c"]:
        """The derivative of ΛX by each modulus."""
        h, _, n, columns = self._carried.shape
        values = self.null.real.new_zeros(h, 3, h + 1, n, columns)
        own = torch.arange(h)
        values[own, :, own + 1] = self._carried.real
        side_by_side = _without_first_place(values.flatten(0, 1)).permute(1, 2, 0, 3)
        changes = -self.form(side_by_side.flatten(-2)).reshape(side_by_side.shape).permute(2, 0, 1, 3)
        values[own, :, own + 1] = derivative(self._carried.imag)
        return changes + _without_first_place(values.flatten(0, 1))

    @cached_property
    def hessian(self) -> Float[Tensor, "p p"]:
        """The second derivatives of E by the moduli."""
        h = len(self.null)
        hole = _without_first_place(torch.arange(h).repeat_interleave(3))
        carried = _without_first_place(self._carried.real.flatten(0, 1))
        second = -torch.einsum("pnc,qpnc->pq", carried, self.changes[:, hole + 1])
        # the units of a place and of a log modulus change with the modulus
        of_units = torch.zeros(h, 3, h, 3, dtype=second.dtype, device=second.device)
        own = torch.arange(h)
        _, modulus = self.form.domain.room
        of_units[own, :2, own, 2] = modulus[:, None] * self._all_slopes[:, :2]
        of_units[own, 2, own, 2] = self._all_slopes[:, 2]
        rows = _without_first_place(of_units.reshape(3 * h, 3 * h))
        second = second + _without_first_place(rows.T).T
        return (second + second.T) / 2


def _without_first_place(rows: Tensor) -> Tensor:
    """Rows of all moduli of holes without those of the first one's place."""
    return rows[2:]
