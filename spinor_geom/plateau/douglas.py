"""Douglas's variational problem: of all ways to slide ∂Ω along Γ, the one of least Dirichlet energy.

At a stationary slide the harmonic surface is conformal, hence minimal.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.problem import CurveTensors

_MAX_CG_STEPS = 60
_MAX_HALVINGS = 12
# A step may raise the energy up to the highest of so many last ones: valleys of the energy are bent, and Newton's
# method follows them far faster if it may climb their sides a little.
_REMEMBERED = 6
# Nodes may be no farther apart on Γ than so many times their mean distance: beyond, ∂Ω crowds and nothing is resolved.
_CROWDED = 40.0
# A gradient below this that does not halve in so many steps is the discretisation's.
_SMALL_GRADIENT, _PATIENCE = 1e-6, 4
# A rough loop's Newton systems are solved less exactly above this gradient: many steps are to come.
_LARGE_GRADIENT = 1e-4
# Curvatures of the energy below this share of the metric's count as none.
_FLAT = 1e-6
# Of the Hessian by arc length against conformal maps of Ω onto itself, where they are not known exactly.
_GAUGE_STIFFNESS = 1e-3
# Distances along Γ, in diagonals, that a slide is moved from a stationary one in search of less energy.
_AMPLITUDES = tuple(0.2 * 0.6**k for k in range(8))
# Increments shrink at most to e⁻³ of themselves in a step.
_LARGEST_SHRINKAGE = 3.0
# Where Γ curves against the step, the second derivative of the energy is reflected by this share at first, then less.
_REFLECT_MORE, _LEAST_REFLECTION = 4.0, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicDisk:
    """A harmonic surface over Ω whose boundary lies on Γ at equal steps of ∂Ω's parameter.

    Attributes:
        slide: (n,), curve parameter s at each node, increasing.
        points: (n, 3), Γ(s).
        energy: Dirichlet energy: the area where the surface is conformal, more elsewhere.
        gradient: RMS of the energy's derivative by arc length, less what conformal maps of Ω give it, relative to that
            of ΛX: 0 where conformal.
        steps: Newton steps taken.
        crowded: whether it was given up because the nodes crowd.
    """

    slide: Float[Tensor, " n"]
    points: Float[Tensor, "n 3"]
    energy: float
    gradient: float
    steps: int
    crowded: bool


def minimise_dirichlet_energy(
    curve: CurveTensors,
    form: DirichletForm,
    slide: Float[Tensor, " n"],
    *,
    tolerance: float,
    max_steps: int,
    near: bool = False,
    negligible: float = 0.0,
    on_step: Callable[[float], None] | None = None,
) -> HarmonicDisk:
    """The slide of one curve: see `minimise_dirichlet_energies`."""
    (disk,) = minimise_dirichlet_energies(
        CurveTensors.batch([curve]),
        form,
        slide[None],
        tolerances=[tolerance],
        max_steps=[max_steps],
        near=near,
        negligible=[negligible],
        on_step=[] if on_step is None else [on_step],
    )
    return disk


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
) -> tuple[HarmonicDisk, ...]:
    """Newton's method with conjugate gradients for the slides of several curves, all of it by fast Fourier transforms.

    The energy is E(s) = π/n Σ Γ(s)·ΛΓ(s). Conformal maps of Ω onto itself leave it as it is: on the disk steps are
    orthogonal, by arc length, to what those maps move; on other Ω a little stiffness against slow displacements keeps
    the Hessian regular and takes nothing from the solution. A step is taken along s by factors of the increments, so
    that s stays increasing. The curves do not know of each other; together they take little longer than the slowest
    of them where n is small.

    Args:
        curves: a batch of b curves.
        form: Λ, for all of them.
        slides: starts at t = j/n, increasing around the circle.
        tolerances: (b,), gradient, as in `HarmonicDisk`, at which each is to stop.
        max_steps: (b,), limit on each one's Newton steps.
        negligible: (b,), fall of the least energy over several steps at which to stop.
        near: whether the starts are near to solutions, so that plain Newton steps may be taken at once.
        on_step: one for each curve, is called with its gradient at the start of each of its steps; none for silence.

    Source: Douglas, "Solution of the problem of Plateau", Trans. AMS 33 (1931); Grippo, Lampariello & Lucidi, "A
    nonmonotone line search technique for Newton's method", SIAM J. Numer. Anal. 23 (1986).
    """
    disks: list[HarmonicDisk | None] = [None] * len(slides)
    problem = _Problem(curves=curves, form=form)
    state, limits = problem.state(slides), slides.new_tensor(tolerances)
    number = torch.arange(len(slides), device=slides.device)
    most = torch.tensor(max_steps, device=slides.device)
    reflection = torch.full_like(limits, 0.0 if near else 1.0)
    stuck = torch.zeros_like(number, dtype=torch.bool)
    recent = torch.full((len(slides), _PATIENCE), torch.inf, dtype=slides.dtype, device=slides.device)
    # the last energies, and the least that had been reached before each of the last steps
    energies = state.energy[:, None].expand(-1, _REMEMBERED)
    lowest = torch.full((len(slides), _REMEMBERED + 1), torch.inf, dtype=slides.dtype, device=slides.device)
    lowest[:, -1] = state.energy
    falls = slides.new_tensor(negligible) * slides.shape[1] / (2 * torch.pi)
    for steps in itertools.count():
        gauge = problem.gauge(state)
        gradient = gauge.left_out_of(problem.gradient(state) / state.speed)
        size = (gradient.square().mean(-1) / state.normal_derivative.square().sum(-1).mean(-1)).sqrt()
        # nor does what is not finite lead anywhere
        crowded = (state.increments.amax(-1) * slides.shape[1] > _CROWDED) | ~size.isfinite()
        # what is left once it stays as it is is rounding error
        stays = (size < _SMALL_GRADIENT) & (size > recent.amin(-1) / 2)
        # near a solution the energy has no more digits to tell
        still = (size > _SMALL_GRADIENT) & (lowest[:, 0] - lowest[:, -1] < falls)
        finished = (size <= limits) | stays | still | stuck | crowded | (steps >= most)
        if is_out_of_time():
            finished[:] = True
        over = finished.nonzero()[:, 0]
        told = zip(over.tolist(), *(x[over].tolist() for x in (number, state.energy, size, crowded)), strict=True)
        for i, place, energy, gradient_size, is_crowded in told:
            disks[place] = HarmonicDisk(
                slide=state.slide[i],
                points=state.points[i],
                energy=energy * 2 * torch.pi / slides.shape[1],
                gradient=gradient_size,
                steps=steps,
                crowded=is_crowded,
            )
        if finished.all():
            break
        if finished.any():
            rest = (~finished).nonzero()[:, 0]
            problem, state, number, limits = problem.at(rest), state.at(rest), number[rest], limits[rest]
            most, falls = most[rest], falls[rest]
            gradient, gauge, size = gradient[rest], gauge.at(rest), size[rest]
            reflection, recent, energies, lowest = reflection[rest], recent[rest], energies[rest], lowest[rest]
        if on_step:
            for i, value in zip(number.tolist(), size.tolist(), strict=True):
                on_step[i](value)
        recent = torch.cat([recent[:, 1:], size[:, None]], dim=1)
        recent[reflection != 0] = torch.inf
        inexact = (size > _LARGE_GRADIENT) & (falls > 0)
        forcing = torch.where(inexact, size.sqrt(), size).clamp(max=0.1)
        direction, downwards = problem.newton_direction(state, gradient, gauge, reflection, forcing=forcing)
        state, moved, full = problem.line_search(state, direction, highest=energies.amax(-1))
        energies = torch.cat([energies[:, 1:], state.energy[:, None]], dim=1)
        lowest = torch.cat([lowest[:, 1:], torch.minimum(lowest[:, -1], state.energy)[:, None]], dim=1)
        stuck = ~moved & (reflection >= 1)
        more = torch.where(moved, 10 * _LEAST_REFLECTION, 0.1)
        less = torch.where(reflection > _LEAST_REFLECTION, reflection / _REFLECT_MORE, 0.0)
        reflection = torch.where(
            ~moved | downwards,
            torch.maximum(_REFLECT_MORE * reflection, more).clamp(max=1.0),
            torch.where(full, less, reflection),
        )
    return tuple(disk for disk in disks if disk is not None)


def slide_downhill(curve: CurveTensors, form: DirichletForm, slide: Float[Tensor, " n"]) -> Float[Tensor, " n"] | None:
    """A slide of less energy beside a stationary one that is not a minimum; none beside a minimum.

    It is moved along the eigenvector of the Hessian by arc length that curves downwards most, to the side and by the
    amount that lower the energy most. The cost is n³.

    Args:
        curve: Γ, at unit size.
        form: Λ.
        slide: stationary, at t = j/n.
    """
    problem = _Problem(curves=CurveTensors.batch([curve]), form=form)
    state = problem.state(slide[None])
    gauge = problem.gauge(state)
    identity = torch.eye(len(slide), dtype=slide.dtype, device=slide.device)
    hessian = problem.hessian(state, gauge, state.bend / state.speed.square())(identity)
    values, vectors = torch.linalg.eigh((hessian + hessian.mT) / 2)
    if float(values[0]) >= -_FLAT * float(values[-1]):
        return None
    direction = vectors[:, 0] / vectors[:, 0].abs().max() / state.speed
    lengths = [sign * amplitude for sign in (1, -1) for amplitude in _AMPLITUDES]
    trials = [problem.state(slid(state.slide, direction, length)) for length in lengths]
    best = min(trials, key=lambda trial: float(trial.energy))
    return best.slide[0] if float(best.energy) < float(state.energy) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    slide: Tensor  # (b, n)
    points: Tensor  # (b, n, 3)
    tangent: Tensor  # Γ', (b, n, 3)
    bend: Tensor  # Γ''·ΛX, (b, n)
    normal_derivative: Tensor  # ΛX, (b, n, 3)
    energy: Tensor  # (b,)

    def at(self, which: Int[Tensor, " k"]) -> _State:
        return _State(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def replaced(self, which: Int[Tensor, " k"], other: _State) -> _State:
        """With the states of some curves from another."""
        return _State(
            **{
                field.name: getattr(self, field.name).index_copy(0, which, getattr(other, field.name))
                for field in fields(self)
            }
        )

    @property
    def increments(self) -> Float[Tensor, "b n"]:
        """s_{j+1} − s_j; their sum is 1."""
        return torch.diff(self.slide, append=self.slide[:, :1] + 1)

    @cached_property
    def speed(self) -> Float[Tensor, "b n"]:
        return self.tangent.square().sum(-1).sqrt()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Gauge:
    """Displacements that leave the energy as it is.

    Where they are known exactly steps and gradients have no part in them: the error of the samples would lead astray
    along them. Where they are not a little stiffness against them keeps the Hessian regular.
    """

    columns: Tensor  # (b, n, 3), orthonormal
    is_exact: bool

    def at(self, which: Int[Tensor, " k"]) -> _Gauge:
        return _Gauge(columns=self.columns[which], is_exact=self.is_exact)

    def left_out_of(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
        return u - self._part(u) if self.is_exact else u

    def stiffness(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"] | float:
        return 0.0 if self.is_exact else _GAUGE_STIFFNESS * self._part(u)

    def _part(self, u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
        part: Tensor = (self.columns @ (u[:, None] @ self.columns).mT)[..., 0]
        return part


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    curves: CurveTensors
    form: DirichletForm

    def at(self, which: Int[Tensor, " k"]) -> _Problem:
        return _Problem(curves=self.curves.at(which), form=self.form)

    def state(self, slides: Float[Tensor, "b n"]) -> _State:
        points, tangent, second = self.curves.point_and_derivatives(slides)
        normal = self.form(points)
        return _State(
            slide=slides,
            points=points,
            tangent=tangent,
            bend=(second * normal).sum(-1),
            normal_derivative=normal,
            energy=0.5 * (points * normal).sum((-2, -1)),
        )

    def gauge(self, state: _State) -> _Gauge:
        """What conformal maps of Ω near the identity move along Γ, by arc length: exactly on the disk, else roughly."""
        n = state.slide.shape[1]
        angle = 2 * torch.pi * torch.arange(n, dtype=state.slide.dtype, device=state.slide.device) / n
        fields = torch.stack([torch.ones_like(angle), angle.cos(), angle.sin()], dim=-1)
        if not self.form.is_disk:
            columns = torch.linalg.qr(fields)[0].expand(len(state.slide), -1, -1)
            return _Gauge(columns=columns, is_exact=False)
        increments = state.increments
        velocity = state.speed * (increments + increments.roll(1, -1))
        return _Gauge(columns=torch.linalg.qr(velocity[..., None] * fields)[0], is_exact=True)

    def gradient(self, state: _State) -> Float[Tensor, "b n"]:
        return (state.normal_derivative * state.tangent).sum(-1)

    def hessian(
        self, state: _State, gauge: _Gauge, bend: Float[Tensor, "b n"]
    ) -> Callable[[Float[Tensor, "b n"]], Float[Tensor, "b n"]]:
        """The second derivative of the energy by arc length, with a given diagonal part, on each row."""
        unit = state.tangent / state.speed[..., None]

        def applied(u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
            stretched = (unit * self.form(unit * u[..., None])).sum(-1)
            return gauge.left_out_of(stretched + bend * u) + gauge.stiffness(u)

        return applied

    def newton_direction(
        self,
        state: _State,
        gradient: Float[Tensor, "b n"],
        gauge: _Gauge,
        reflection: Float[Tensor, " b"],
        *,
        forcing: Float[Tensor, " b"],
    ) -> tuple[Float[Tensor, "b n"], Bool[Tensor, " b"]]:
        """Conjugate gradients on the Hessian by arc length; each stops where it curves downwards and says so.

        Where Γ bends towards the inside the Hessian's diagonal part is negative. Far from a solution that is taken with
        the opposite sign, times `reflection`: many rough places that each want another step do not hold each other up.
        """
        n = gradient.shape[1]
        bend = (state.bend + 2 * reflection[:, None] * (-state.bend).clamp(min=0)) / state.speed.square()
        symbol = 1 / (torch.arange(n // 2 + 1, dtype=gradient.dtype, device=gradient.device) + 0.5)

        hessian = self.hessian(state, gauge, bend)

        def precondition(u: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
            smooth: Tensor = torch.fft.irfft(torch.fft.rfft(u) * symbol, n=n)
            return gauge.left_out_of(smooth)

        x, rest = torch.zeros_like(gradient), -gradient
        z = precondition(rest)
        along, metric, size = z, rest, _dot(rest, z)
        enough = forcing[:, None] ** 2 * size
        unfinished = torch.ones_like(size, dtype=torch.bool)
        downwards = torch.zeros_like(unfinished)
        for step in range(_MAX_CG_STEPS):
            image = hessian(along)
            curvature, scale = _dot(along, image), _dot(along, metric)
            flat = unfinished & (curvature <= _FLAT * scale)
            downwards |= flat & (curvature < -_FLAT * scale)
            unfinished &= ~flat
            if step == 0:
                x = torch.where(flat, z, x)
            length = torch.where(unfinished, size / curvature, 0.0)
            x = x + length * along
            rest = rest - length * image
            z = precondition(rest)
            before, size = size, _dot(rest, z)
            unfinished &= ~(size < enough)
            if not unfinished.any():
                break
            ratio = torch.where(unfinished, size / before, 0.0)
            along, metric = z + ratio * along, rest + ratio * metric
        return x / state.speed, downwards[:, 0]

    def line_search(
        self, state: _State, direction: Float[Tensor, "b n"], *, highest: Float[Tensor, " b"]
    ) -> tuple[_State, Bool[Tensor, " b"], Bool[Tensor, " b"]]:
        """The longest of the steps 1, ½, ¼, … whose energy is not above the highest.

        Returns:
            The states after it, which of them moved, and which by the first of those steps.
        """
        start, moved, which = state, torch.zeros_like(state.energy, dtype=torch.bool), None
        full = moved
        for halving in range(_MAX_HALVINGS):
            problem, before, along, most = (
                (self, start, direction, highest)
                if which is None
                else (self.at(which), start.at(which), direction[which], highest[which])
            )
            trial = problem.state(slid(before.slide, along, 0.5**halving))
            lower = trial.energy <= most + 1e-13 * most.abs()
            if which is None:
                full = moved = lower
                if lower.all():
                    return trial, moved, full
                which = torch.arange(len(lower), device=lower.device)
            taken = which[lower]
            state = state.replaced(taken, trial.at(lower.nonzero()[:, 0]))
            moved = moved.index_fill(0, taken, value=True)
            which = which[~lower]
            if not len(which):
                break
        return state, moved, full


def slid(slide: Float[Tensor, "b n"], direction: Float[Tensor, "b n"], length: float) -> Float[Tensor, "b n"]:
    """Slides after a step of a given length along a direction, by factors of their increments: they increase."""
    increments = torch.diff(slide, append=slide[:, :1] + 1)
    change = length * torch.diff(direction, append=direction[:, :1]) / increments.clamp(min=1e-300)
    factor = torch.where(change < 0, change.clamp(min=-_LARGEST_SHRINKAGE).exp(), 1 + change)
    scaled = increments * factor
    share = (scaled / scaled.sum(-1, keepdim=True)).cumsum(-1)[:, :-1]
    start = torch.nn.functional.pad(share, (1, 0))
    return start + (slide + length * direction - start).mean(-1, keepdim=True)


def _dot(a: Float[Tensor, "b n"], b: Float[Tensor, "b n"]) -> Float[Tensor, "b 1"]:
    product: Tensor = torch.linalg.vecdot(a, b)
    return product[:, None]


def resampled(slide: Float[Tensor, " m"], n: int) -> Float[Tensor, " n"]:
    """The same slide at n equal steps."""
    m = len(slide)
    if m == n:
        return slide
    even = torch.arange(n, dtype=slide.dtype, device=slide.device) / n
    fine = band_limited((slide - torch.arange(m, dtype=slide.dtype, device=slide.device) / m)[:, None], n)[:, 0] + even
    if (torch.diff(fine, append=fine[:1] + 1) > 0).all():
        return fine
    # a rough slide overshoots
    around = slide.cpu().numpy()
    monotone = PchipInterpolator(np.arange(-2, m + 3) / m, np.concatenate([around[-2:] - 1, around, around[:3] + 1]))
    return torch.as_tensor(monotone(even.cpu().numpy()), device=slide.device)


def band_limited(x: Float[Tensor, "*batch m k"], n: int) -> Float[Tensor, "*batch n k"]:
    """Trigonometric interpolation of samples at m equal steps on n equal steps."""
    m = x.shape[-2]
    # along rows, as in DirichletForm
    spectrum = torch.fft.rfft(x.mT.contiguous())[..., : min(m, n) // 2]
    values: Tensor = torch.fft.irfft(spectrum * (n / m), n=n).mT.contiguous()
    return values
