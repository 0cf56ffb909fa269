"""Douglas's variational problem: maps from ∂Ω to Γ whose harmonic surfaces have stationary Dirichlet energy.

Such a map is called a slide. The harmonic surface of a stationary slide is conformal, hence minimal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator

from spinor_geom.arrays import (
    Array,
    Place,
    arange,
    cis,
    closed_steps,
    namespace,
    padded,
    place_of,
    replaced,
    shifted,
    square,
    to_numpy,
)
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm, frequencies
from spinor_geom.plateau.newton import SMALL, Rows, conjugate_gradients, dots, stationary
from spinor_geom.plateau.stability import AMPLITUDES

# Largest spacing of nodes, as a share of Γ: the other nodes are crowded. With 1 no surface is found between a long rim
# and a small one near its end.
CROWDED = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicDisk:
    """A harmonic surface over Ω with its boundary values on Γ, sampled at equal steps of ∂Ω's parameter."""

    slide: Float[Array, " n"]  # curve parameter s at each node, increasing
    points: Float[Array, "n 3"]  # Γ(s)
    crowded: bool  # whether the solve ended because nodes crowd


def minimise_dirichlet_energies(
    curves: CurveTensors,
    form: DirichletForm,
    slides: Float[Array, "b n"],
    *,
    tolerances: Sequence[float],
    max_steps: Sequence[int],
    negligible: Sequence[float],
    near: bool = False,
    on_step: Sequence[Callable[[float], None]] = (),
) -> tuple[HarmonicDisk | None, ...]:
    """Harmonic disks of stationary slides of several curves on one Ω, by Newton's method, or None if time ran out.

    The energy E(s) = π/n Σ Γ(s)·ΛΓ(s) is evaluated by fast Fourier transforms. Conformal maps of Ω onto itself (the
    gauge) do not change it. On the disk, steps are orthogonal to the gauge. On other Ω conjugate gradients hardly move
    along it. Steps scale the increments of s, so that s stays increasing.

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
        negligible=[fall * slides.shape[1] / (2 * np.pi) for fall in negligible],
        near=near,
        on_step=on_step,
    )
    disks: dict[int, HarmonicDisk] = {}
    for numbers, over in found:
        for place, (number, crowded) in enumerate(zip(numbers, over.is_over.tolist(), strict=True)):
            disks[number] = HarmonicDisk(slide=over.slide[place], points=over.points[:, place].mT, crowded=crowded)
    return tuple(map(disks.get, range(len(slides))))


def slide_downhill(curve: CurveTensors, form: DirichletForm, slide: Float[Array, " n"]) -> Float[Array, " n"] | None:
    """A slide of less energy near a stationary one that is a saddle, or None for a minimum.

    The slide moves along the eigenvector of the Hessian with the lowest eigenvalue, in the direction and by the
    amplitude of least energy. The cost is O(n³).
    """
    here = Slides.of(CurveTensors.batch([curve]), form, slide[None])
    hessian = here.hessian(None)(place_of(slide).put(np.eye(len(slide))))
    values, vectors = namespace(slide).linalg.eigh((hessian + hessian.mT) / 2)
    if float(values[0]) >= -SMALL * float(values[-1]):
        return None
    direction = vectors[None, :, 0] / abs(vectors[:, 0]).max()
    trials = [here.stepped(direction, sign * amplitude) for sign in (1, -1) for amplitude in AMPLITUDES]
    best = min(trials, key=lambda trial: float(trial.energy[0]))
    return best.slide[0] if float(best.energy[0]) < float(here.energy[0]) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Slides:
    """Slides of b curves on one Ω, with the energies of their harmonic surfaces. It implements `newton.Energies`.

    Vectors are one array for each coordinate: operations on a last axis of length 3 are several times as slow.
    """

    curves: CurveTensors  # a batch of b
    form: DirichletForm  # Λ
    slide: Float[Array, "b n"]  # curve parameters at t = j/n
    points: Float[Array, "3 b n"]  # Γ
    tangent: Float[Array, "3 b n"]  # Γ′
    bend: Float[Array, "b n"]  # Γ″·ΛX
    normal: Float[Array, "3 b n"]  # ΛX
    energy: Float[Array, " b"]  # in units of 2π/n

    @classmethod
    def of(cls, curves: CurveTensors, form: DirichletForm, slide: Float[Array, "b n"]) -> Slides:
        """The energies and their derivatives at given slides."""
        points, tangent, second = curves.coordinates(slide)
        normal = form.on_rows(points)
        return cls(
            curves=curves,
            form=form,
            slide=slide,
            points=points,
            tangent=tangent,
            bend=(second * normal).sum(0),
            normal=normal,
            energy=0.5 * (points * normal).sum(0).sum(-1),
        )

    def at(self, which: Int[Array, " k"]) -> Slides:
        """The selected slides."""
        parts = {name: getattr(self, name)[which] for name in _SCALARS}
        # contiguous, unlike an array from an index
        vectors = {name: namespace(which).take(getattr(self, name), which, axis=1) for name in _VECTORS}
        selected = Slides(curves=self.curves.at(which), form=self.form, **parts, **vectors)
        # what a step needs again after others have finished
        cached = {"speed", "gauge", "gradient", "size"} & self.__dict__.keys()
        selected.__dict__.update({name: self.__dict__[name][which] for name in cached})
        return selected

    def replaced(self, which: Int[Array, " k"], other: Slides) -> Slides:
        """The slides with some of them replaced."""
        parts = {name: replaced(getattr(self, name), which, getattr(other, name)) for name in _SCALARS}
        vectors = {name: namespace(which).asarray(getattr(self, name), copy=True) for name in _VECTORS}
        for name, copy in vectors.items():
            copy[:, which] = getattr(other, name)
        return Slides(curves=self.curves, form=self.form, **parts, **vectors)

    @cached_property
    def speed(self) -> Float[Array, "b n"]:
        """|Γ′|."""
        return namespace(self.slide).sqrt(square(self.tangent).sum(0))

    @cached_property
    def _increments(self) -> Float[Array, "b n"]:
        """The increments s_{j+1} − s_j, whose sum is 1."""
        return closed_steps(self.slide)

    @cached_property
    def gradient(self) -> Float[Array, "b n"]:
        """Gradient of the energy with respect to arc length along Γ."""
        return self.without_gauge((self.normal * self.tangent).sum(0) / self.speed)

    @cached_property
    def size(self) -> Float[Array, " b"]:
        """RMS of the gradient over the RMS of ΛX: 0 where the surface is conformal."""
        return namespace(self.slide).sqrt(square(self.gradient).sum(-1) / square(self.normal).sum(0).sum(-1))

    @property
    def is_over(self) -> Bool[Array, " b"]:
        """Whether nodes crowd or the energy is not finite."""
        xp = namespace(self.slide)
        return (xp.max(self._increments, axis=-1) > CROWDED) | ~xp.isfinite(self.size)

    @cached_property
    def gauge(self) -> Float[Array, "b 3 n"]:
        """Orthonormal displacements along Γ of infinitesimal conformal maps of the disk."""
        fields = _first_harmonics(self.slide.shape[1], place_of(self.slide))
        return _orthonormal((self.speed * (self._increments + shifted(self._increments, 1)))[:, None] * fields)

    def without_gauge(self, u: Float[Array, "b n"]) -> Float[Array, "b n"]:
        """Displacements along Γ less those of conformal maps, on the disk."""
        if not self.form.is_disk:
            return u
        # scalar products of rows take less time than a product with a transposed matrix
        shares = namespace(u).linalg.vecdot(self.gauge, u[:, None])
        return u - (shares[:, None] @ self.gauge)[:, 0]

    def hessian(self, damping: Float[Array, " b"] | None) -> Rows:
        """The Hessian of the energy in arc length, as a map of rows.

        Damping multiplies a negative `bend` by (1 − 2·damping).
        """
        unit = self.tangent / self.speed
        bend = reflected(self.bend, damping) / square(self.speed)

        def applied(u: Float[Array, "b n"]) -> Float[Array, "b n"]:
            image = (unit * self.form.on_rows(unit * u)).sum(0) + bend * u
            return self.without_gauge(image)

        return applied

    def direction(
        self, damping: Float[Array, " b"] | None, forcing: Float[Array, " b"]
    ) -> tuple[Float[Array, "b n"], Bool[Array, " b"]]:
        """Newton's step."""
        return conjugate_gradients(self.hessian(damping), self.gradient, self.precondition, forcing)

    def precondition(self, u: Float[Array, "b n"]) -> Float[Array, "b n"]:
        """An approximate solution of Newton's equations, for conjugate gradients."""
        return self.without_gauge(smoothed(u))

    def stepped(self, direction: Float[Array, "b n"], length: float) -> Slides:
        """The slides after a step along a direction in arc length."""
        return Slides.of(self.curves, self.form, slid(self.slide, direction / self.speed, length))


_SCALARS, _VECTORS = ("slide", "bend", "energy"), ("points", "tangent", "normal")


def reflected(bends: Float[Array, "b n"], damping: Float[Array, " #b"] | None) -> Float[Array, "b n"]:
    """Γ″·ΛX with its negative values changed by damping: they become 0 for damping ½, and change sign for damping 1."""
    return bends if damping is None else bends + 2 * damping[:, None] * namespace(bends).clip(-bends, 0, None)


def smoothed(u: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
    """Rows with each frequency k divided by |k| + ½: an approximate inverse of Λ."""
    n, xp = u.shape[-1], namespace(u)
    return xp.fft.irfft(xp.fft.rfft(u) * _smoothing(n, place_of(u)), n=n)


@lru_cache(maxsize=64)
def _smoothing(n: int, place: Place) -> Float[Array, " k"]:
    # for complex numbers multiplication is four times as fast as division
    return 1 / (frequencies(n, place) + 0.5)


@lru_cache(maxsize=64)
def _first_harmonics(n: int, place: Place) -> Float[Array, "3 n"]:
    """1, cosine and sine of the angle at n equal steps."""
    turn = cis(2 * np.pi * np.arange(n) / n)
    return place.put(np.stack([np.ones(n), turn.real, turn.imag]))


def _orthonormal(rows: Float[Array, "b 3 n"]) -> Float[Array, "b 3 n"]:
    """Orthonormal rows with the same span, by the modified Gram-Schmidt process."""
    xp, found = namespace(rows), list[Array]()
    for k in range(rows.shape[1]):
        row = rows[:, k]
        for before in found:
            row = row - dots(row, before) * before
        found.append(row / xp.sqrt(dots(row, row)))
    return xp.stack(found, axis=1)


def slid(slide: Float[Array, "b n"], direction: Float[Array, "b n"], length: float) -> Float[Array, "b n"]:
    """Slides after a step along a direction. The step scales the increments, which stay positive."""
    xp, increments = namespace(slide), closed_steps(slide)
    change = length * (shifted(direction, -1) - direction) / xp.clip(increments, 1e-150, None)  # has a square
    # positive, and 1 + change up to third order
    factor = xp.where(change < 0, 1 / (1 - change + change**2), 1 + change)
    scaled = increments * factor
    share = (scaled / scaled.sum(-1)[:, None]).cumsum(-1)[:, :-1]
    start = padded(share, 1, 0)
    return start + (slide + length * direction - start).mean(-1)[:, None]


def resampled(slides: Float[Array, "*b m"], n: int) -> Float[Array, "*b n"]:
    """Slides interpolated at n equal steps."""
    m = slides.shape[-1]
    if m == n:
        return slides
    xp = namespace(slides)
    even, steps = (arange(k, slides) / k for k in (n, m))
    spectrum = xp.fft.rfft(slides - steps)[..., : min(m, n) // 2]
    fine = xp.fft.irfft(spectrum * (n / m), n=n) + even
    # Fourier interpolation of rough slides overshoots
    rough = (closed_steps(fine) <= 0).any(-1)
    if rough.any():
        some = to_numpy(slides[rough])
        around = np.concatenate([some[..., -2:] - 1, some, some[..., :3] + 1], axis=-1)
        monotone = PchipInterpolator(np.arange(-2, m + 3) / m, around, axis=-1)(to_numpy(even))
        fine[rough] = place_of(slides).put(monotone)
    return fine
