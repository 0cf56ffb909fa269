"""Newton's method for Douglas's energy: slides, and the moduli of Ω where it has holes; minima, or saddles too."""

import itertools
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time

MOST_STEPS = 60  # Newton steps of one solve where nothing else is said, and of conjugate gradients in each
# A step may raise the energy up to the highest of so many last ones: valleys of the energy are bent, and Newton's
# method follows them far faster if it may climb their sides a little.
_REMEMBERED = 6
# A curvature of the energy counts as none below this share of the metric's, and a step below this share of Newton's; of
# gradients so small the energy tells no more. With the root of the rounding error rough curves take 4 % more steps.
SMALL = 1e-6
ROUNDING = 1e-13  # gradients, and falls of the energy by itself, of rounding errors: at 3e-15 series take more steps
# The factor by which damping grows and falls: with 2 smooth loops take a third more steps, with 8 hardly fewer. And the
# least that is any: with 0.1 narrow loops take a quarter more steps, with 1e-6 smooth ones 6 %.
_MORE_DAMPING, _LEAST_DAMPING = 4.0, 1e-3

E = TypeVar("E", bound="Energies")
Rows: TypeAlias = Callable[[Float[Tensor, "b k"]], Float[Tensor, "b k"]]  # what maps rows of displacements to rows


class Energies(Protocol):
    """Energies of b surfaces that do not know of each other, with k displacements each: along Γ, and of the moduli."""

    @property
    def energy(self) -> Float[Tensor, " b"]:
        """Up to a factor."""

    @property
    def size(self) -> Float[Tensor, " b"]:
        """Of the gradient, relative to the energy's factors."""

    @property
    def is_over(self) -> Bool[Tensor, " b"]:
        """Whether more steps lead nowhere."""

    def at(self: E, which: Int[Tensor, " j"]) -> E:
        """Some of them."""

    def replaced(self: E, which: Int[Tensor, " j"], other: E) -> E:
        """With some of them from another."""

    def direction(
        self, damping: Float[Tensor, " b"] | None, forcing: Float[Tensor, " b"]
    ) -> tuple[Float[Tensor, "b k"], Bool[Tensor, " b"]]:
        """Newton's step, and whether the energy curves downwards along some way in spite of so much damping.

        It solves Newton's equations up to this share; without damping it leads to a critical point of any kind.
        """

    def stepped(self: E, direction: Float[Tensor, "b k"], length: float) -> E:
        """After a step."""


def stationary(
    here: E,
    *,
    tolerances: Sequence[float],
    max_steps: Sequence[int],
    negligible: Sequence[float],
    near: bool,
    saddles: bool = False,
    on_step: Sequence[Callable[[float], None]] = (),
) -> list[tuple[list[int], E]]:
    """The surfaces to which the energies fall: the numbers of those after as many Newton steps, and they.

    They do not know of each other; together they take little longer than the slowest of them where they are small.
    Where the energy curves downwards Newton's equations are damped, as a surface takes it. Far from a solution they are
    from the beginning, by a share that falls: many rough places that each want another step do not hold each other up.

    Each of b stops at the gradient that is tolerated, after most steps, or at a fall of the least energy over several
    steps that is negligible; those that a time limit cuts short are left out. Starts that are near to solutions take
    plain Newton steps at once; where saddles are sought as well no others, while each halves the gradient at least.
    `on_step`, one for each or none, is called with the size of the gradient at the start of a step.

    Source: Grippo, Lampariello & Lucidi, "A nonmonotone line search technique for Newton's method", SIAM J. Numer.
    Anal. 23 (1986).
    """
    energy = here.energy
    count = len(energy)
    found: list[tuple[list[int], E]] = []
    limits, falls = energy.new_tensor(tolerances), energy.new_tensor(negligible)
    number = torch.arange(count, device=energy.device)
    most = torch.tensor(max_steps, device=energy.device)
    damping = torch.full_like(limits, 0.0 if near else 1.0)
    stuck = torch.zeros_like(number, dtype=torch.bool)
    recent = torch.full((count, _REMEMBERED), torch.inf, dtype=energy.dtype, device=energy.device)
    # the last energies, and the least that had been reached before each of the last steps
    energies = -recent
    energies[:, -1] = energy
    lowest = torch.full((count, _REMEMBERED + 1), torch.inf, dtype=energy.dtype, device=energy.device)
    lowest[:, -1] = energy
    for steps in itertools.count():
        size = here.size
        # what is left once it stays as it is is rounding error
        stays = (size < SMALL) & (size > recent.amin(-1) / 2)
        # near a solution the energy has no more digits to tell
        level = energies.amax(-1) - energies.amin(-1) < ROUNDING * here.energy
        still = (size > SMALL) & (level | (lowest[:, 0] - lowest[:, -1] < falls))
        finished = (size <= limits) | stays | (still & (not saddles)) | stuck | here.is_over | (steps >= most)
        if finished.any():
            over = finished.nonzero()[:, 0]
            found.append((number[over].tolist(), here.at(over)))
            if finished.all():
                break
            rest = (~finished).nonzero()[:, 0]
            here, number, limits, most, falls = here.at(rest), number[rest], limits[rest], most[rest], falls[rest]
            size, damping, recent = size[rest], damping[rest], recent[rest]
            energies, lowest = energies[rest], lowest[rest]
        if is_out_of_time():
            break
        if on_step:
            for i, value in zip(number.tolist(), size.tolist(), strict=True):
                on_step[i](value)
        recent = torch.cat([recent[:, 1:], size[:, None]], dim=1)
        recent[damping != 0] = torch.inf
        # of the many steps that rough loops take the first need not be exact
        forcing = torch.where(falls > 0, size.sqrt(), size).clamp(max=0.1)
        direction, downwards = here.direction(None if saddles else damping, forcing)
        here, lengths = _halved(here, direction) if saddles else _line_search(here, direction, energies.amax(-1))
        moved = lengths > 0
        energies = torch.cat([energies[:, 1:], here.energy[:, None]], dim=1)
        lowest = torch.cat([lowest[:, 1:], torch.minimum(lowest[:, -1], here.energy)[:, None]], dim=1)
        stuck = ~moved & (saddles | (damping >= 1))
        more = torch.where(moved, 10 * _LEAST_DAMPING, 0.1)
        less = torch.where(damping > _LEAST_DAMPING, damping / _MORE_DAMPING, 0.0)
        damping = torch.where(
            ~moved | downwards,
            torch.maximum(_MORE_DAMPING * damping, more).clamp(max=1.0),
            torch.where(lengths == 1, less, damping),
        )
    return found


def conjugate_gradients(
    hessian: Rows, gradient: Float[Tensor, "b k"], precondition: Rows, forcing: Float[Tensor, " b"]
) -> tuple[Float[Tensor, "b k"], Bool[Tensor, " b"]]:
    """`Energies.direction` by products alone; each stops where it curves downwards and says so."""
    rest = -gradient
    x, z = torch.zeros_like(rest), precondition(rest)
    along, metric, size = z, rest, _dot(rest, z)
    enough = forcing[:, None] ** 2 * size
    unfinished = torch.ones_like(size, dtype=torch.bool)
    downwards = torch.zeros_like(unfinished)
    for step in range(MOST_STEPS):
        image = hessian(along)
        curvature, scale = _dot(along, image), _dot(along, metric)
        flat = unfinished & (curvature <= SMALL * scale)
        downwards |= flat & (curvature < -SMALL * scale)
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
    return x, downwards[:, 0]


def factored(
    matrix: Float[Tensor, "k k"],
    metric: Float[Tensor, " k"],
    gradient: Float[Tensor, "1 k"],
    damping: Float[Tensor, "1"],
) -> tuple[Float[Tensor, "1 k"], Bool[Tensor, "1"]]:
    """`Energies.direction` of one surface by its second derivative, damped by more until it curves upwards."""
    share = damping
    while True:
        factor, info = torch.linalg.cholesky_ex(matrix + torch.diag(share * metric))
        if int(info) == 0 or float(share) > 1 / ROUNDING:
            return torch.cholesky_solve(-gradient.T, factor).T, share > damping
        share = (_MORE_DAMPING * share).clamp(min=10 * _LEAST_DAMPING)


def _halved(here: E, direction: Float[Tensor, "b k"]) -> tuple[E, Float[Tensor, " b"]]:
    """The whole step where it halves the gradient at least, and its length or 0."""
    trial = here.stepped(direction, 1.0)
    lower = trial.size < here.size / 2
    taken = lower.nonzero()[:, 0]
    return here.replaced(taken, trial.at(taken)), lower.to(trial.size)


def _line_search(
    here: E, direction: Float[Tensor, "b k"], highest: Float[Tensor, " b"]
) -> tuple[E, Float[Tensor, " b"]]:
    """The longest of the steps 1, ½, ¼, … after which the energy is not above the highest, and its length or 0."""
    start, trial, length = here, here.stepped(direction, 1.0), 1.0
    highest = highest + ROUNDING * highest.abs()
    lower = trial.energy <= highest
    lengths = lower.to(highest)
    if lower.all():
        return trial, lengths
    which = torch.arange(len(lower), device=lower.device)
    while True:
        taken = which[lower]
        here = here.replaced(taken, trial.at(lower.nonzero()[:, 0]))
        lengths = lengths.index_fill(0, taken, length)
        which = which[~lower]
        length /= 2
        if not len(which) or length < SMALL:
            return here, lengths
        trial = start.at(which).stepped(direction[which], length)
        lower = trial.energy <= highest[which]


def _dot(a: Float[Tensor, "b k"], b: Float[Tensor, "b k"]) -> Float[Tensor, "b 1"]:
    product: Tensor = torch.linalg.vecdot(a, b)
    return product[:, None]
