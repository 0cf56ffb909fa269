"""Douglas's variational problem for two rims: both slides and the modulus of the annulus, by Newton's method.

The energy E(s, m) of the harmonic surface over the cylinder [0, m] × S¹ is stationary in the slides s and in m where
the surface is conformal, hence minimal. E*(m), its minimum over the slides, is a function of one variable that tells
all: its minima are annuli that no change of modulus makes smaller, its maxima are unstable ones, and where it only
falls there is no annulus: the surface degenerates to two disks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.errors import SurfaceError
from spinor_geom.plateau.cylinder import CylinderForm, multipliers
from spinor_geom.plateau.douglas import resampled, slid
from spinor_geom.plateau.problem import CurveTensors

# Moduli that are looked at: below, rims are nearer than a thousandth of their length; above, all but the distance of
# their means has decayed to rounding errors.
_LEAST, _MOST = math.log(1e-3), math.log(40.0)
# Steps of the logarithm of the modulus in the search for sign changes of dE*/d log m, and in a search for a start.
_STEP, _START_STEP = 0.3, 0.05
# A slide of one modulus is a start for the next to this gradient; two digits more decide on a sign.
_COARSE, _FINE = 1e-5, 1e-9
_MOST_STEPS, _MOST_TRIES = 60, 30
_LARGEST_MODULUS_STEP = 0.5
# Damping of the first step, in units of the metric, and how it grows and falls.
_DAMPING, _MORE_DAMPING, _LESS_DAMPING, _LEAST_DAMPING = 1e-2, 4.0, 8.0, 1e-10
# Gradients at which nothing but rounding errors is left, and fall of the energy that is none.
_ROUNDING, _SAME_ENERGY = 1e-13, 1e-14
# A step of Newton's method at a critical point lowers the gradient at least to this share.
_GAIN = 0.5
# Interval of log m, and steps, at which the search for the place where E* falls least ends.
_NARROW, _MOST_HALVINGS = 1e-6, 60
# Nodes may be no farther apart on a curve than so many times their mean distance.
_CROWDED = 20.0
# Curvatures of the energy below this share of the largest count as none.
_FLAT = 1e-12
# Conjugate gradients: steps, and curvatures that count as none, of the metric and of the energy by log m.
_MOST_CG_STEPS, _FLAT_STEP, _FLAT_MODULUS = 60, 1e-6, 1e-3
# Energies among whose highest a step may end, halvings of a step, and reflections that are left away.
_REMEMBERED, _MOST_HALVINGS_OF_A_STEP, _LEAST_REFLECTION = 6, 12, 1e-3
_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicAnnulus:
    """A harmonic surface over a cylinder whose rims lie on two curves at equal steps of the angle.

    Attributes:
        slides: (2, n), curve parameters at each node, increasing; the second rim's angle falls, see `CylinderForm`.
        points: (2, n, 3), the points of the curves.
        log_modulus: log m.
        energy: Dirichlet energy: the area where the surface is conformal, more elsewhere.
        gradient: RMS of the energy's derivative by arc length, relative to that of ΛX.
        slope: dE/d log m over E.
    """

    slides: Float[Tensor, "2 n"]
    points: Float[Tensor, "2 n 3"]
    log_modulus: float
    energy: float
    gradient: float
    slope: float

    @property
    def crowded(self) -> bool:
        """Whether the nodes leave out a large part of a curve, so that the energy means nothing."""
        steps = torch.diff(self.slides, append=self.slides[:, :1] + 1)
        return float(steps.max()) * self.slides.shape[1] > _CROWDED

    @property
    def modulus(self) -> float:
        """m: the logarithm of the ratio of the radii of the plane annulus."""
        return math.exp(self.log_modulus)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Point:
    """The energy with its derivatives at given slides and modulus; sums over the nodes, without the factor 2π/n."""

    slides: Tensor
    points: Tensor
    speed: Tensor  # (2, n)
    unit: Tensor  # (2, n, 3)
    bends: Tensor  # Γ''·ΛX by arc length, (2, n)
    form: CylinderForm
    log_modulus: float
    energy: float
    by_slides: Tensor  # by arc length, (2n,)
    by_modulus: float
    change: Tensor  # of ΛX by log m, (2, n, 3)
    normal: float  # RMS of ΛX

    @property
    def gradient(self) -> float:
        return float(self.by_slides.square().mean().sqrt()) / self.normal

    @property
    def slope(self) -> float:
        return self.by_modulus / self.energy

    @property
    def size(self) -> float:
        return max(self.gradient, abs(self.slope))


@dataclass(frozen=True, kw_only=True, eq=False)
class AnnulusProblem:
    """Douglas's problem for two curves, both run as the boundary of an annulus is.

    Attributes:
        curves: the two.
        on_step: is called with the gradient at each Newton step; None for silence.
    """

    curves: tuple[CurveTensors, CurveTensors]
    on_step: Callable[[float], None] | None = None

    def start(self, n: int) -> tuple[Float[Tensor, "2 n"], float]:
        """Slides by the curves' own parameters, one shifted against the other, and log m: where E first has a minimum.

        Where it has none, m is 1 more than between circles of the curves' lengths in one plane.

        The matching comes from the curves alone: of all shifts the one of least energy is taken.
        """
        even = torch.arange(n, dtype=torch.float64, device=self.curves[0].breaks.device) / n
        points = torch.stack([curve.point_and_derivative(even)[0] for curve in self.curves])
        spectrum = torch.fft.rfft(points, dim=1)
        weight = torch.full_like(even[: n // 2 + 1], 2.0)
        weight[0] = weight[-1] = 1.0
        square = weight * spectrum.abs().square().sum((0, 2)) / n
        cross = (spectrum[0] * spectrum[1]).sum(-1)
        moduli = torch.arange(_LEAST, _MOST, _START_STEP, dtype=even.dtype, device=even.device).exp()
        own, other = multipliers(moduli, n)
        # the second curve shifted by j steps, for all j at once; a row for each modulus
        energy, shift = (0.5 * (own @ square)[:, None] + torch.fft.irfft(other * cross, n=n, dim=-1)).min(dim=1)
        first, second = (points.roll(-1, 1) - points).norm(dim=-1).sum(1).log().tolist()
        usual = int((moduli - 1 - abs(first - second)).abs().argmin())
        row = _first_valley(energy, usual)
        return torch.stack([even, even + float(shift[row]) / n]), math.log(float(moduli[row]))

    def energy(self, slides: Float[Tensor, "2 n"], log_modulus: float) -> float:
        """The Dirichlet energy of the harmonic surface with given slides."""
        return self._told(self._at(slides, log_modulus)).energy

    def descended(
        self, slides: Float[Tensor, "2 n"], log_modulus: float, *, tolerance: float, fixed: bool = False
    ) -> HarmonicAnnulus | None:
        """The annulus that the energy falls to, by damped Newton steps; None where the modulus runs away.

        Args:
            slides: start.
            log_modulus: start.
            tolerance: of gradient and slope.
            fixed: whether the modulus stays.
        """
        here = self._at(slides, log_modulus)
        damping = _DAMPING
        for _ in range(_MOST_STEPS):
            require_time()
            size = here.gradient if fixed else here.size
            if self.on_step is not None:
                self.on_step(size)
            if size <= tolerance:
                break
            hessian = self._hessian(here, fixed=fixed)
            gradient = self._gradient(here, fixed=fixed)
            metric = float(here.form.own.mean()) * torch.ones_like(gradient)
            if not fixed:
                metric[-1] = hessian[-1, -1].abs() + 0.1 * here.energy
            there = None
            for _ in range(_MOST_TRIES):
                factor, info = torch.linalg.cholesky_ex(hessian + damping * torch.diag(metric))
                if int(info) == 0:
                    step = torch.cholesky_solve(-gradient[:, None], factor)[:, 0]
                    there = self._stepped(here, step, fixed=fixed)
                    if there.energy <= here.energy * (1 + _SAME_ENERGY):
                        break
                    there = None
                damping = max(_MORE_DAMPING * damping, _LEAST_DAMPING)
            if there is None:
                break
            stays = here.energy - there.energy < _SAME_ENERGY * here.energy
            lower = (there.gradient if fixed else there.size) < _GAIN * size
            if stays and not lower:
                break
            here, damping = there, max(damping / _LESS_DAMPING, _LEAST_DAMPING)
            if here.log_modulus > _MOST:
                return None
        return self._told(here)

    def critical(self, near: HarmonicAnnulus, *, tolerance: float = _ROUNDING) -> HarmonicAnnulus:
        """The critical point next to an annulus, a minimum or not, by plain Newton steps while the gradient falls."""
        here = self._at(near.slides, near.log_modulus)
        for _ in range(_MOST_STEPS):
            if self.on_step is not None:
                self.on_step(here.size)
            if here.size <= tolerance:
                break
            step = torch.linalg.solve(self._hessian(here), -self._gradient(here))
            there = self._stepped(here, step)
            if not there.size < _GAIN * here.size:
                break
            here = there
        return self._told(here)

    def refined(self, annulus: HarmonicAnnulus, n: int) -> HarmonicAnnulus:
        """The critical point with n nodes on each rim."""
        slides = torch.stack([resampled(slide, n) for slide in annulus.slides])
        return self.critical(self._told(self._at(slides, annulus.log_modulus)))

    def settled(
        self, annulus: HarmonicAnnulus, n: int, *, tolerance: float, max_steps: int, near: bool, negligible: float = 0.0
    ) -> HarmonicAnnulus:
        """The annulus of less energy with n nodes on each rim, by conjugate gradients: for rims that take many nodes.

        Newton's directions are found to a share of the gradient, by fast Fourier transforms alone. Where a rim bends
        towards the inside the energy's second derivative is negative there; far from a solution it is taken with the
        opposite sign, as in `minimise_dirichlet_energies`, so that many rough places do not hold each other up.

        Args:
            annulus: start.
            n: nodes.
            tolerance: of gradient and slope.
            max_steps: limit on steps.
            near: whether the start is near to a solution, so that plain Newton steps may be taken at once.
            negligible: fall of the energy over several steps at which to stop.
        """
        here = self._at(torch.stack([resampled(slide, n) for slide in annulus.slides]), annulus.log_modulus)
        reflection = 0.0 if near else 1.0
        energies = [here.energy]
        for _ in range(max_steps):
            require_time()
            if self.on_step is not None:
                self.on_step(here.size)
            fall = energies[max(0, len(energies) - _REMEMBERED)] - energies[-1]
            stays = len(energies) > _REMEMBERED and fall * 2 * math.pi / n < negligible
            if here.size <= tolerance or stays:
                break
            direction, downwards = self._inexact_direction(here, reflection)
            there, halvings = here, 0
            while halvings < _MOST_HALVINGS_OF_A_STEP:
                there = self._stepped(here, direction * 0.5**halvings)
                if there.energy <= max(energies[-_REMEMBERED:]) * (1 + _SAME_ENERGY):
                    break
                halvings += 1
            else:
                if reflection >= 1:
                    break
                reflection = 1.0
                continue
            here = there
            energies.append(here.energy)
            if halvings or downwards:
                reflection = min(1.0, max(4 * reflection, 0.01))
            else:
                reflection = reflection / 4 if reflection > _LEAST_REFLECTION else 0.0
        return self._told(here)

    def _inexact_direction(self, here: _Point, reflection: float) -> tuple[Float[Tensor, " k"], bool]:
        """A direction by conjugate gradients on the Hessian, and whether they met one in which it falls."""
        shape, n = here.slides.shape, here.slides.shape[1]
        bends = here.bends + 2 * reflection * (-here.bends).clamp(min=0)
        second = CylinderForm.of(here.log_modulus, here.points, order=2)(here.points)
        mixed = (here.change * here.unit).sum(-1).flatten()
        corner = (0.5 * (here.points * second).sum()).clamp(min=_FLAT_MODULUS * here.energy)
        rotation = self._rotation(here)
        stiffness = float(here.form.own.mean())
        symbol = 1 / (torch.arange(n // 2 + 1, dtype=mixed.dtype, device=mixed.device) + 0.5)

        def hessian(x: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
            u = x[:-1].reshape(shape)
            image = (here.unit * here.form(here.unit * u[..., None])).sum(-1) + bends * u
            slides = image.flatten() + stiffness * (rotation @ x[:-1]) * rotation + mixed * x[-1]
            image = torch.cat([slides, (mixed @ x[:-1] + corner * x[-1])[None]])
            return image

        def precondition(x: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
            smooth = torch.fft.irfft(torch.fft.rfft(x[:-1].reshape(shape)) * symbol, n=n)
            scaled: Tensor = torch.cat([smooth.flatten(), (x[-1] / corner)[None]])
            return scaled

        rest = -self._gradient(here)
        x, z = torch.zeros_like(rest), precondition(rest)
        along, metric, size = z, rest, rest @ z
        enough = min(0.1, math.sqrt(here.size)) ** 2 * size
        for step in range(_MOST_CG_STEPS):
            image = hessian(along)
            curvature = along @ image
            if curvature <= _FLAT_STEP * (along @ metric):
                return (z if step == 0 else x), True
            length = size / curvature
            x, rest = x + length * along, rest - length * image
            z = precondition(rest)
            before, size = size, rest @ z
            if size < enough:
                break
            along, metric = z + size / before * along, rest + size / before * metric
        return x, False

    @staticmethod
    def _rotation(here: _Point) -> Float[Tensor, " k"]:
        """What a rotation of the cylinder moves, by arc length: one rim ahead, the other back."""
        steps = torch.diff(here.slides, append=here.slides[:, :1] + 1)
        rotation: Tensor = here.speed * (steps + steps.roll(1, -1)) * steps.new_tensor([[1.0], [-1.0]])
        direction: Tensor = rotation.flatten() / rotation.norm()
        return direction

    def all_critical(self, n: int) -> tuple[HarmonicAnnulus, ...]:
        """All annuli that a grid of moduli shows as zeros of dE*/d log m, by modulus; none where E* only falls.

        Raises:
            SurfaceError: the nodes crowd, or E* rises from the least modulus on that n nodes resolve: annuli of lower
                ones may exist.
        """
        found: list[HarmonicAnnulus] = []
        traced = self._traced(n)
        if any(annulus.crowded for annulus in traced):
            raise SurfaceError(
                "the nodes crowd on the rims: the gap between them is too long or too uneven for a round annulus, and "
                "none was found"
            )
        if traced[0].slope > 0:
            raise SurfaceError(
                f"the gap between the rims is too narrow for their length: {n} nodes on each do not resolve it, and no "
                "annulus was found; divide the gap by a few edges between the rims and fill the holes that result"
            )
        for before, after in pairwise(traced):
            if before.slope * after.slope <= 0:
                found.append(self._between(before, after))
        for left, middle, right in zip(traced, traced[1:], traced[2:], strict=False):
            if max(left.slope, middle.slope, right.slope) < 0 and middle.slope >= max(left.slope, right.slope):
                found += self._near_fold(left, middle, right)
        return tuple(sorted(found, key=lambda annulus: annulus.log_modulus))

    def _traced(self, n: int) -> list[HarmonicAnnulus]:
        """The least energy for one modulus after the other, from the least whose rims n nodes resolve.

        The way goes down and up from the start. Below it, where the energy rises, rims that are far apart may collapse
        to points of them; there is no annulus beyond.
        """
        slides, log = self.start(n)
        least = max(_LEAST, math.log(2 * math.pi / n))
        middle = self._fixed(slides, min(max(log, least), _MOST))
        below, above = [middle], [middle]
        while (log := below[-1].log_modulus - _STEP) >= least:
            annulus = self._fixed(below[-1].slides, log)
            if annulus.crowded and annulus.slope < 0 and not middle.crowded:
                break
            below.append(annulus)
        while (log := above[-1].log_modulus + _STEP) <= _MOST:
            above.append(self._fixed(above[-1].slides, log))
        return [*below[:0:-1], *above]

    def _fixed(self, slides: Float[Tensor, "2 n"], log_modulus: float, tolerance: float = _COARSE) -> HarmonicAnnulus:
        annulus = self.descended(slides, log_modulus, tolerance=tolerance, fixed=True)
        assert annulus is not None  # a modulus that stays does not run away
        return annulus

    def _between(self, before: HarmonicAnnulus, after: HarmonicAnnulus) -> HarmonicAnnulus:
        """The critical point between two moduli with slopes of different signs."""
        low, high = before, after
        for _ in range(_MOST_HALVINGS):
            share = low.slope / (low.slope - high.slope)
            share = min(max(share, 0.1), 0.9)
            middle = self._fixed(low.slides, low.log_modulus + share * (high.log_modulus - low.log_modulus), _FINE)
            if middle.slope * low.slope > 0:
                low = middle
            else:
                high = middle
            exact = self.critical(middle)
            width = high.log_modulus - low.log_modulus
            inside = low.log_modulus - width <= exact.log_modulus <= high.log_modulus + width
            if (inside and max(exact.gradient, abs(exact.slope)) < _FINE) or width < _NARROW:
                return exact
        return exact

    def _near_fold(
        self, left: HarmonicAnnulus, middle: HarmonicAnnulus, right: HarmonicAnnulus
    ) -> list[HarmonicAnnulus]:
        """Two critical points between moduli with negative slopes, where the largest slope between them is positive."""
        low, high = left.log_modulus, right.log_modulus
        a, b = (self._fixed(middle.slides, low + share * (high - low), _FINE) for share in (1 - _GOLDEN, _GOLDEN))
        while high - low > _NARROW:
            best = max(a, b, key=lambda annulus: annulus.slope)
            if best.slope > 0:
                return [self._between(left, best), self._between(best, right)]
            if a.slope > b.slope:
                high, b = b.log_modulus, a
                a = self._fixed(b.slides, high - _GOLDEN * (high - low), _FINE)
            else:
                low, a = a.log_modulus, b
                b = self._fixed(a.slides, low + _GOLDEN * (high - low), _FINE)
        return []

    def _at(self, slides: Float[Tensor, "2 n"], log_modulus: float) -> _Point:
        parts = [curve.point_and_derivatives(slide) for curve, slide in zip(self.curves, slides, strict=True)]
        points, tangent, second = (torch.stack(part) for part in zip(*parts, strict=True))
        form = CylinderForm.of(log_modulus, points)
        normal = form(points)
        speed = tangent.square().sum(-1).sqrt()
        unit = tangent / speed[..., None]
        change = CylinderForm.of(log_modulus, points, order=1)(points)
        return _Point(
            slides=slides,
            points=points,
            speed=speed,
            unit=unit,
            bends=(second * normal).sum(-1) / speed.square(),
            form=form,
            log_modulus=log_modulus,
            energy=0.5 * float((points * normal).sum()),
            by_slides=(normal * unit).sum(-1).flatten(),
            by_modulus=0.5 * float((points * change).sum()),
            change=change,
            normal=float(normal.square().sum(-1).mean().sqrt()),
        )

    def _gradient(self, here: _Point, *, fixed: bool = False) -> Float[Tensor, " k"]:
        return here.by_slides if fixed else torch.cat([here.by_slides, here.by_slides.new_tensor([here.by_modulus])])

    def _hessian(self, here: _Point, *, fixed: bool = False) -> Float[Tensor, "k k"]:
        """The second derivative by arc length and log m, stiffened against a rotation of the cylinder."""
        unit = here.unit.reshape(-1, 3)
        hessian = (unit @ unit.T) * here.form.matrix()
        hessian.diagonal().add_(here.bends.flatten())
        rotation = self._rotation(here)
        hessian += float(here.form.own.mean()) * torch.outer(rotation, rotation)
        if fixed:
            return hessian
        second = CylinderForm.of(here.log_modulus, here.points, order=2)(here.points)
        mixed = (here.change * here.unit).sum(-1).flatten()[:, None]
        corner = 0.5 * (here.points * second).sum().reshape(1, 1)
        return torch.cat([torch.cat([hessian, mixed], dim=1), torch.cat([mixed.T, corner], dim=1)])

    def _stepped(self, here: _Point, step: Float[Tensor, " k"], *, fixed: bool = False) -> _Point:
        along = 0.0 if fixed else float(step[-1])
        share = min(1.0, _LARGEST_MODULUS_STEP / abs(along)) if along else 1.0
        count = here.slides.numel()
        direction = step[:count].reshape(here.slides.shape) / here.speed
        return self._at(slid(here.slides, direction, share), here.log_modulus + share * along)

    def index(self, annulus: HarmonicAnnulus) -> int:
        """Number of directions of both slides and the modulus along which the energy falls: the Morse index."""
        values = torch.linalg.eigvalsh(self._hessian(self._at(annulus.slides, annulus.log_modulus)))
        return int((values < -_FLAT * values.abs().max()).sum())

    @staticmethod
    def _told(here: _Point) -> HarmonicAnnulus:
        return HarmonicAnnulus(
            slides=here.slides,
            points=here.points,
            log_modulus=here.log_modulus,
            energy=here.energy * 2 * math.pi / here.slides.shape[1],
            gradient=here.gradient,
            slope=here.slope,
        )


def _first_valley(energy: Float[Tensor, " k"], usual: int) -> int:
    """Where a function has its first minimum; else where it falls least before it falls more; else the usual place."""
    inner = (energy[1:-1] <= energy[:-2]) & (energy[1:-1] < energy[2:])
    if not inner.any():
        slope = energy.diff()
        inner = (slope[1:-1] > slope[:-2]) & (slope[1:-1] >= slope[2:])
    return 1 + int(inner.to(torch.int8).argmax()) if inner.any() else usual
