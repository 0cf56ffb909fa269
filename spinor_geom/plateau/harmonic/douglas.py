"""Douglas's variational problem: maps from ∂Ω to Γ whose harmonic surfaces have stationary Dirichlet energy.

Such a map is called a slide. The harmonic surface of a stationary slide is conformal, hence minimal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from torch import Tensor

from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm, frequencies
from spinor_geom.plateau.newton import SMALL, Rows, conjugate_gradients, stationary
from spinor_geom.plateau.stability import AMPLITUDES

# Largest spacing of neighbouring nodes on Γ, over the mean spacing: beyond it the other nodes crowd.
CROWDED = 40.0
# Stiffness against conformal maps of Ω onto itself, which do not change the energy, where Ω is not the disk.
_GAUGE_STIFFNESS = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicDisk:
    """A harmonic surface over Ω with its boundary values on Γ, sampled at equal steps of ∂Ω's parameter."""

    slide: Float[Tensor, " n"]  # curve parameter s at each node, increasing
    points: Float[Tensor, "n 3"]  # Γ(s)
    crowded: bool  # whether the solve ended because nodes crowd


def minimise_dirichlet_energies(
    curves: CurveTensors,
    form: DirichletForm,
    slides: Float[Tensor, "b n"],
    *,
    tolerances: Sequence[float],
    max_steps: Sequence[int],
    negligible: Sequence[float],
    near: bool = False,
    on_step: Sequence[Callable[[float], None]] = (),
) -> tuple[HarmonicDisk | None, ...]:
    """Harmonic disks of stationary slides of several curves on one Ω, by Newton's method; None where time ran out.

    The energy E(s) = π/n Σ Γ(s)·ΛΓ(s) is evaluated by fast Fourier transforms. Conformal maps of Ω onto itself (the
    gauge) do not change it. On the disk, steps are orthogonal to the gauge; on other Ω a small stiffness against slow
    displacements keeps the Hessian regular and does not change the solution. Steps scale the increments of s, so that
    s stays increasing.

    Args:
        curves: b curves.
        form: Λ of Ω.
        slides: starts at t = j/n, increasing.
        tolerances: as for `stationary`.
        max_steps: as for `stationary`.
        negligible: as for `stationary`.
        near: as for `stationary`.
        on_step: as for `stationary`.

    Source: Douglas, "Solution of the problem of Plateau", Trans. AMS 33 (1931).
    """
    found = stationary(
        Slides.of(curves, form, slides),
        tolerances=tolerances,
        max_steps=max_steps,
        negligible=[fall * slides.shape[1] / (2 * torch.pi) for fall in negligible],
        near=near,
        on_step=on_step,
    )
    disks: dict[int, HarmonicDisk] = {}
    for numbers, over in found:
        for place, (number, crowded) in enumerate(zip(numbers, over.is_over.tolist(), strict=True)):
            disks[number] = HarmonicDisk(slide=over.slide[place], points=over.points[place], crowded=crowded)
    return tuple(map(disks.get, range(len(slides))))


def slide_downhill(curve: CurveTensors, form: DirichletForm, slide: Float[Tensor, " n"]) -> Float[Tensor, " n"] | None:
    """A slide of less energy near a stationary one that is a saddle; None for a minimum.

    The slide moves along the eigenvector of the Hessian with the lowest eigenvalue, in the direction and by the
    amplitude of least energy. The cost is O(n³).
    """
    here = Slides.of(CurveTensors.batch([curve]), form, slide[None])
    hessian = here.hessian(None)(torch.eye(len(slide), dtype=slide.dtype, device=slide.device))
    values, vectors = torch.linalg.eigh((hessian + hessian.mT) / 2)
    if float(values[0]) >= -SMALL * float(values[-1]):
        return None
    direction = vectors[None, :, 0] / vectors[:, 0].abs().max()
    trials = [here.stepped(direction, sign * amplitude) for sign in (1, -1) for amplitude in AMPLITUDES]
    best = min(trials, key=lambda trial: float(trial.energy))
    return best.slide[0] if float(best.energy) < float(here.energy) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Slides:
    """Slides of b curves on one Ω, with the energies of their harmonic surfaces; it implements `newton.Energies`."""

    curves: CurveTensors  # a batch of b
    form: DirichletForm  # Λ
    slide: Float[Tensor, "b n"]  # curve parameters at t = j/n
    points: Float[Tensor, "b n 3"]  # Γ
    tangent: Float[Tensor, "b n 3"]  # Γ′
    bend: Float[Tensor, "b n"]  # Γ″·ΛX
    normal: Float[Tensor, "b n 3"]  # ΛX
    energy: Float[Tensor, " b"]  # in units of 2π/n

    @classmethod
    def of(cls, curves: CurveTensors, form: DirichletForm, slide: Float[Tensor, "b n"]) -> Slides:
        """The energies and their derivatives at given slides."""
        points, tangent, second = curves.point_and_derivatives(slide)
        normal = form(points)
        return cls(
            curves=curves,
            form=form,
            slide=slide,
            points=points,
            tangent=tangent,
            bend=(second * normal).sum(-1),
            normal=normal,
            energy=0.5 * (points * normal).sum((-2, -1)),
        )

    def at(self, which: Int[Tensor, " k"]) -> Slides:
        """The selected slides."""
        parts = {name: getattr(self, name)[which] for name in _BY_CURVE}
        return Slides(curves=self.curves.at(which), form=self.form, **parts)

    def replaced(self, which: Int[Tensor, " k"], other: Slides) -> Slides:
        """The slides with some of them replaced."""
        parts = {name: getattr(self, name).index_copy(0, which, getattr(other, name)) for name in _BY_CURVE}
        return Slides(curves=self.curves, form=self.form, **parts)

    @cached_property
    def speed(self) -> Float[Tensor, "b n"]:
        """|Γ′|."""
        return self.tangent.square().sum(-1).sqrt()

    @cached_property
    def _increments(self) -> Float[Tensor, "b n"]:
        """s_{j+1} − s_j; their sum is 1."""
        return torch.diff(self.slide, append=self.slide[:, :1] + 1)

    @cached_property
    def gradient(self) -> Float[Tensor, "b n"]:
        """Gradient of the energy with respect to arc length along Γ."""
        return self._without_gauge((self.normal * self.tangent).sum(-1) / self.speed)

    @cached_property
    def size(self) -> Float[Tensor, " b"]:
        """RMS of the gradient over the RMS of ΛX: 0 where the surface is conformal."""
        return (self.gradient.square().mean(-1) / self.normal.square().sum(-1).mean(-1)).sqrt()

    @property
    def is_over(self) -> Bool[Tensor, " b"]:
        """Whether nodes crowd or the energy is not finite."""
        return (self._increments.amax(-1) * self.slide.shape[1] > CROWDED) | ~self.size.isfinite()

    @cached_property
    def gauge(self) -> Float[Tensor, "b 3 n"]:
        """Orthonormal displacements along Γ of infinitesimal conformal maps of Ω; approximate if Ω is not the disk."""
        fields = _first_harmonics(self.slide.shape[1], self.slide.device)
        if not self.form.is_disk:
            fields = fields.expand(len(self.slide), -1, -1)
        else:
            fields = (self.speed * (self._increments + self._increments.roll(1, -1)))[..., None] * fields
        columns: Tensor = torch.linalg.qr(fields)[0]
        return columns.mT

    def _in_gauge(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
        # row products take half the time of column products
        return (u[:, None] @ self.gauge.mT @ self.gauge)[:, 0]

    def _without_gauge(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
        return u - self._in_gauge(u) if self.form.is_disk else u

    def hessian(self, damping: Float[Tensor, " b"] | None) -> Rows:
        """The Hessian of the energy by arc length, as a map of rows; with damping negative `bend`s are reflected."""
        unit = self.tangent / self.speed[..., None]
        bend = reflected(self.bend, damping) / self.speed.square()

        def applied(u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
            image = (unit * self.form(unit * u[..., None])).sum(-1) + bend * u
            return self._without_gauge(image) if self.form.is_disk else image + _GAUGE_STIFFNESS * self._in_gauge(u)

        return applied

    def direction(
        self, damping: Float[Tensor, " b"] | None, forcing: Float[Tensor, " b"]
    ) -> tuple[Float[Tensor, "b n"], Bool[Tensor, " b"]]:
        """Newton's step."""
        return conjugate_gradients(self.hessian(damping), self.gradient, self._precondition, forcing)

    def _precondition(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
        return self._without_gauge(smoothed(u))

    def stepped(self, direction: Float[Tensor, "b n"], length: float) -> Slides:
        """The slides after a step along a direction in arc length."""
        return Slides.of(self.curves, self.form, slid(self.slide, direction / self.speed, length))


_BY_CURVE = ("slide", "points", "tangent", "bend", "normal", "energy")


def reflected(bends: Float[Tensor, "b n"], damping: Float[Tensor, " b"] | None) -> Float[Tensor, "b n"]:
    """Γ″·ΛX; with damping 1 its negative values change sign, with damping ½ they become 0."""
    return bends if damping is None else bends + 2 * damping[:, None] * (-bends).clamp(min=0)


def smoothed(u: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """Rows with each frequency k divided by |k| + ½: an approximate inverse of Λ."""
    n = u.shape[-1]
    smooth: Tensor = torch.fft.irfft(torch.fft.rfft(u) * _smoothing(n, u.device), n=n)
    return smooth


@lru_cache(maxsize=64)
def _smoothing(n: int, device: torch.device) -> Float[Tensor, " k"]:
    # for complex numbers multiplication is four times as fast as division
    return 1 / (frequencies(n, device) + 0.5)


@lru_cache(maxsize=64)
def _first_harmonics(n: int, device: torch.device) -> Float[Tensor, "n 3"]:
    """1, cosine and sine of the angle at n equal steps."""
    angle = 2 * torch.pi * torch.arange(n, dtype=torch.float64, device=device) / n
    return torch.stack([torch.ones_like(angle), angle.cos(), angle.sin()], dim=-1)


def slid(slide: Float[Tensor, "b n"], direction: Float[Tensor, "b n"], length: float) -> Float[Tensor, "b n"]:
    """Slides after a step along a direction; the step scales the increments, which stay positive."""
    increments = torch.diff(slide, append=slide[:, :1] + 1)
    change = length * torch.diff(direction, append=direction[:, :1]) / increments.clamp(min=1e-300)
    # positive, and 1 + change up to third order
    factor = torch.where(change < 0, 1 / (1 - change + change**2), 1 + change)
    scaled = increments * factor
    share = (scaled / scaled.sum(-1, keepdim=True)).cumsum(-1)[:, :-1]
    start = torch.nn.functional.pad(share, (1, 0))
    return start + (slide + length * direction - start).mean(-1, keepdim=True)


def resampled(slides: Float[Tensor, "*b m"], n: int) -> Float[Tensor, "*b n"]:
    """Slides interpolated at n equal steps."""
    m = slides.shape[-1]
    if m == n:
        return slides
    even, steps = (torch.arange(k, dtype=slides.dtype, device=slides.device) / k for k in (n, m))
    spectrum = torch.fft.rfft(slides - steps)[..., : min(m, n) // 2]
    fine: Tensor = torch.fft.irfft(spectrum * (n / m), n=n) + even
    # Fourier interpolation of rough slides overshoots
    rough = (torch.diff(fine, append=fine[..., :1] + 1) <= 0).any(-1)
    if rough.any():
        some = slides[rough].cpu().numpy()
        around = np.concatenate([some[:, -2:] - 1, some, some[:, :3] + 1], axis=-1)
        monotone = PchipInterpolator(np.arange(-2, m + 3) / m, around, axis=-1)(even.cpu().numpy())
        fine[rough] = torch.as_tensor(monotone, device=slides.device)
    return fine
