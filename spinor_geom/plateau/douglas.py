"""Douglas's variational problem: of all ways to slide ∂Ω along Γ, the one of least Dirichlet energy.

At a stationary slide the harmonic surface is conformal, hence minimal.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from torch import Tensor

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
# Share of the Hessian's scale that is added where conformal maps of Ω onto itself leave it singular.
_GAUGE_STIFFNESS = 1e-3
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
        gradient: RMS of the energy's derivative by s, relative to that of its two factors: 0 where conformal.
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
    """Newton's method with conjugate gradients for the slide, all of it by fast Fourier transforms.

    The energy is E(s) = π/n Σ Γ(s)·ΛΓ(s). Conformal maps of Ω onto itself leave it as it is, so its Hessian is singular
    at a solution; a small multiple of the projection on {1, cos 2πt, sin 2πt}, which those maps change, is added to it
    and takes nothing from the solution. A step is taken along s by factors of the increments, so that s stays
    increasing.

    Args:
        curve: Γ.
        form: Λ.
        slide: start at t = j/n, increasing around the circle.
        tolerance: gradient, as in `HarmonicDisk`, at which to stop.
        max_steps: limit on Newton steps.
        near: whether the start is near to a solution, so that plain Newton steps may be taken at once.
        negligible: fall of the least energy over several steps at which to stop.
        on_step: is called with the gradient at the start of each step.

    Source: Douglas, "Solution of the problem of Plateau", Trans. AMS 33 (1931); Grippo, Lampariello & Lucidi, "A
    nonmonotone line search technique for Newton's method", SIAM J. Numer. Anal. 23 (1986).
    """
    problem = _Problem.of(curve, form, slide)
    state = problem.state(slide)
    reflection, steps, crowded, sizes = 0.0 if near else 1.0, 0, False, [np.inf]
    energies = deque([state.energy], maxlen=_REMEMBERED)
    lowest = [state.energy]
    negligible *= len(slide) / (2 * torch.pi)
    while True:
        gradient = problem.gradient(state)
        size = float((gradient.square().mean() / state.force.square().mul(state.speed2).mean()).sqrt())
        crowded = float(state.increments.max()) * len(slide) > _CROWDED
        # what is left once it stays as it is belongs to conformal maps of Ω, to which the samples are not quite blind
        stays = size < _SMALL_GRADIENT and size > min(sizes[-_PATIENCE:]) / 2
        # near a solution the energy has no more digits to tell
        fallen = lowest[-_REMEMBERED - 1] - lowest[-1] if len(lowest) > _REMEMBERED else np.inf
        still = size > _SMALL_GRADIENT and fallen < negligible
        if not size > tolerance or stays or still or steps >= max_steps or crowded:
            break
        if on_step is not None:
            on_step(size)
        sizes = [*sizes, size] if reflection == 0 else [np.inf]
        forcing = min(0.1, size**0.5 if negligible and size > _LARGE_GRADIENT else size)
        direction, downwards = problem.newton_direction(state, gradient, reflection, forcing=forcing)
        moved, full = problem.line_search(state, direction, highest=max(energies))
        steps += 1
        if moved is None:
            if reflection >= 1:
                break
            reflection = min(1.0, max(_REFLECT_MORE * reflection, 0.1))
            continue
        if downwards:
            reflection = min(1.0, max(_REFLECT_MORE * reflection, 10 * _LEAST_REFLECTION))
        elif full:
            reflection = reflection / _REFLECT_MORE if reflection > _LEAST_REFLECTION else 0.0
        state = moved
        energies.append(state.energy)
        lowest.append(min(lowest[-1], state.energy))
    return HarmonicDisk(
        slide=state.slide,
        points=state.points,
        energy=state.energy * 2 * torch.pi / len(slide),
        gradient=size,
        steps=steps,
        crowded=crowded,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    slide: Tensor
    points: Tensor
    tangent: Tensor  # Γ', (n, 3)
    bend: Tensor  # Γ''·ΛX, (n,)
    normal_derivative: Tensor  # ΛX, (n, 3)
    energy: float

    @property
    def increments(self) -> Float[Tensor, " n"]:
        """s_{j+1} − s_j; their sum is 1."""
        return torch.diff(self.slide, append=self.slide[:1] + 1)

    @property
    def speed2(self) -> Float[Tensor, " n"]:
        return self.tangent.square().sum(-1)

    @property
    def force(self) -> Float[Tensor, " n"]:
        return self.normal_derivative.square().sum(-1).sqrt()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    curve: CurveTensors
    form: DirichletForm
    gauge: Tensor  # (n, 3), orthonormal columns 1, cos, sin
    stiffness: float  # of the gauge

    @classmethod
    def of(cls, curve: CurveTensors, form: DirichletForm, slide: Float[Tensor, " n"]) -> _Problem:
        n = len(slide)
        angle = 2 * torch.pi * torch.arange(n, dtype=slide.dtype, device=slide.device) / n
        columns = torch.stack([torch.ones_like(angle), 2**0.5 * angle.cos(), 2**0.5 * angle.sin()], dim=-1) / n**0.5
        _, tangent, _ = curve.point_and_derivatives(slide)
        stiffness = _GAUGE_STIFFNESS * float(tangent.square().sum(-1).mean())
        return cls(curve=curve, form=form, gauge=columns, stiffness=stiffness)

    def state(self, slide: Float[Tensor, " n"]) -> _State:
        points, tangent, second = self.curve.point_and_derivatives(slide)
        normal = self.form(points)
        return _State(
            slide=slide,
            points=points,
            tangent=tangent,
            bend=(second * normal).sum(-1),
            normal_derivative=normal,
            energy=float(0.5 * (points * normal).sum()),
        )

    def gradient(self, state: _State) -> Float[Tensor, " n"]:
        return (state.normal_derivative * state.tangent).sum(-1)

    def newton_direction(
        self, state: _State, gradient: Float[Tensor, " n"], reflection: float, *, forcing: float
    ) -> tuple[Float[Tensor, " n"], bool]:
        """Conjugate gradients on the Hessian; stops where it curves downwards and says so.

        Where Γ bends towards the inside the Hessian's diagonal part is negative. Far from a solution that is taken with
        the opposite sign, times `reflection`: many rough places that each want another step do not hold each other up.
        """
        tangent, n = state.tangent, len(gradient)
        bend = state.bend + 2 * reflection * (-state.bend).clamp(min=0)
        speed = state.speed2.sqrt()
        symbol = 1 / (torch.arange(n // 2 + 1, dtype=gradient.dtype, device=gradient.device) + 0.5)

        def hessian(v: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
            stretched = (tangent * self.form(tangent * v[:, None])).sum(-1)
            return stretched + bend * v + self.stiffness * (self.gauge @ (self.gauge.T @ v))

        def precondition(v: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
            smooth: Tensor = torch.fft.irfft(torch.fft.rfft(v / speed) * symbol, n=n)
            return smooth / speed

        x, rest = torch.zeros_like(gradient), -gradient
        z = precondition(rest)
        along, metric, size = z, rest, float(rest @ z)
        enough = forcing**2 * size
        for _ in range(_MAX_CG_STEPS):
            image = hessian(along)
            curvature = float(along @ image)
            scale = float(along @ metric)
            if curvature <= _FLAT * scale:
                # a flat direction is a conformal map of Ω: it has nothing to give and does not disturb the others
                return (x if x.any() else z), curvature < -_FLAT * scale
            x = x + (size / curvature) * along
            rest = rest - (size / curvature) * image
            z = precondition(rest)
            before, size = size, float(rest @ z)
            if size < enough:
                break
            along, metric = z + (size / before) * along, rest + (size / before) * metric
        return x, False

    def line_search(
        self, state: _State, direction: Float[Tensor, " n"], *, highest: float
    ) -> tuple[_State | None, bool]:
        """The longest of the steps 1, ½, ¼, … whose energy is not above the highest, and whether it is the first."""
        increments = state.increments
        change = torch.diff(direction, append=direction[:1]) / increments.clamp(min=1e-300)
        length = 1.0
        for halving in range(_MAX_HALVINGS):
            factor = torch.where(
                change < 0, (length * change).clamp(min=-_LARGEST_SHRINKAGE).exp(), 1 + length * change
            )
            moved = increments * factor
            slide = torch.cat([moved.new_zeros(1), (moved / moved.sum()).cumsum(0)[:-1]])
            slide = slide + (state.slide + length * direction - slide).mean()
            trial = self.state(slide)
            if trial.energy <= highest + 1e-13 * abs(highest):
                return trial, halving == 0
            length /= 2
        return None, False


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
    spectrum = torch.fft.rfft(x, dim=-2)[..., : min(m, n) // 2, :]
    values: Tensor = torch.fft.irfft(spectrum * (n / m), n=n, dim=-2)
    return values
