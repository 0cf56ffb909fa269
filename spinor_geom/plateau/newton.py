"""Newton's method for Douglas's energy, in the slides and, where Ω has holes, its moduli."""

import itertools
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time

MOST_STEPS = 60  # default limit on Newton steps, and on conjugate gradient steps in each
# A step may raise the energy up to the maximum of this many last values: in curved valleys of the energy a nonmonotone
# line search allows longer steps.
_REMEMBERED = 6
# Relative curvature and step length treated as 0, and relative gradient below which changes of the energy are rounding
# errors. With the root of `ROUNDING` rough curves take 4 % more steps.
SMALL = 1e-6
ROUNDING = 1e-13  # relative rounding error of gradients and energies; with 3e-15 series take more steps
# Factor by which damping changes (with 2 smooth loops take a third more steps, with 8 hardly fewer), and its least
# value above 0 (with 0.1 narrow loops take a quarter more steps, with 1e-6 smooth ones 6 %).
_MORE_DAMPING, _LEAST_DAMPING = 4.0, 1e-3

E = TypeVar("E", bound="Energies")
Rows: TypeAlias = Callable[[Float[Tensor, "b k"]], Float[Tensor, "b k"]]  # a linear map of rows of displacements


class Energies(Protocol):
    """Energies of b independent surfaces, with k unknowns each: displacements along Γ, and changes of the moduli."""

    @property
    def energy(self) -> Float[Tensor, " b"]:
        """The energies, up to a common factor."""

    @property
    def size(self) -> Float[Tensor, " b"]:
        """Relative size of the gradients."""

    @property
    def is_over(self) -> Bool[Tensor, " b"]:
        """Whether the surfaces degenerate, so that the iteration ends."""

    def at(self: E, which: Int[Tensor, " j"]) -> E:
        """The selected surfaces."""

    def replaced(self: E, which: Int[Tensor, " j"], other: E) -> E:
        """The surfaces with some of them replaced."""

    def direction(
        self, damping: Float[Tensor, " b"] | None, forcing: Float[Tensor, " b"]
    ) -> tuple[Float[Tensor, "b k"], Bool[Tensor, " b"]]:
        """Newton's step, and whether the damped Hessian has a direction of negative curvature.

        Newton's equations are solved to the relative residual `forcing`. Without damping the step leads to critical
        points of any index.
        """

    def stepped(self: E, direction: Float[Tensor, "b k"], length: float) -> E:
        """The surfaces after a step."""


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
    """Critical points of energies, by damped Newton steps with a nonmonotone line search.

    Newton's equations are damped where the energy has negative curvature, and, unless `near`, from the first step.

    Args:
        here: b starts.
        tolerances: relative gradient at which each stops.
        max_steps: limit on steps of each.
        negligible: each stops when its least energy decreases by less than this over several steps.
        near: whether the starts are near solutions: the first steps are not damped.
        saddles: whether saddles are sought too: steps are never damped, and each must halve the gradient.
        on_step: for each surface, or empty: called with the relative gradient at the start of a step.

    Returns:
        Groups (indices of the starts, surfaces) in the order of finishing. Surfaces that have not finished when time
        runs out are missing.

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
    # the last energies, and the least energy before each of the last steps
    energies = -recent
    energies[:, -1] = energy
    lowest = torch.full((count, _REMEMBERED + 1), torch.inf, dtype=energy.dtype, device=energy.device)
    lowest[:, -1] = energy
    for steps in itertools.count():
        size = here.size
        # a small gradient that is no longer halved is rounding error
        at_rounding = (size < SMALL) & (size > recent.amin(-1) / 2)
        # the energy changes by rounding errors only
        unchanged = energies.amax(-1) - energies.amin(-1) < ROUNDING * here.energy
        is_flat = (size > SMALL) & (unchanged | (lowest[:, 0] - lowest[:, -1] < falls))
        finished = (size <= limits) | at_rounding | (is_flat & (not saddles)) | stuck | here.is_over | (steps >= most)
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
        # rough loops take many steps; the first ones are solved inexactly
        forcing = torch.where(falls > 0, size.sqrt(), size).clamp(max=0.1)
        direction, downwards = here.direction(None if saddles else damping, forcing)
        here, lengths = _full_step(here, direction) if saddles else _line_search(here, direction, energies.amax(-1))
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
    """`Energies.direction` by preconditioned conjugate gradients, which stop at a direction of negative curvature."""
    residual = -gradient
    x, z = torch.zeros_like(residual), precondition(residual)
    search, metric, size = z, residual, _dot(residual, z)
    enough = forcing[:, None] ** 2 * size
    unfinished = torch.ones_like(size, dtype=torch.bool)
    downwards = torch.zeros_like(unfinished)
    for step in range(MOST_STEPS):
        image = hessian(search)
        curvature, scale = _dot(search, image), _dot(search, metric)
        flat = unfinished & (curvature <= SMALL * scale)
        downwards |= flat & (curvature < -SMALL * scale)
        unfinished &= ~flat
        if step == 0:
            x = torch.where(flat, z, x)
        length = torch.where(unfinished, size / curvature, 0.0)
        x = x + length * search
        residual = residual - length * image
        z = precondition(residual)
        before, size = size, _dot(residual, z)
        unfinished &= ~(size < enough)
        if not unfinished.any():
            break
        ratio = torch.where(unfinished, size / before, 0.0)
        search, metric = z + ratio * search, residual + ratio * metric
    return x, downwards[:, 0]


def factored(
    matrix: Float[Tensor, "k k"],
    metric: Float[Tensor, " k"],
    gradient: Float[Tensor, "1 k"],
    damping: Float[Tensor, "1"],
) -> tuple[Float[Tensor, "1 k"], Bool[Tensor, "1"]]:
    """`Energies.direction` of one surface by a Cholesky factor; damping increases until the matrix is definite."""
    tried = damping
    while True:
        factor, info = torch.linalg.cholesky_ex(matrix + torch.diag(tried * metric))
        if int(info) == 0 or float(tried) > 1 / ROUNDING:
            return torch.cholesky_solve(-gradient.T, factor).T, tried > damping
        tried = (_MORE_DAMPING * tried).clamp(min=10 * _LEAST_DAMPING)


def _full_step(here: E, direction: Float[Tensor, "b k"]) -> tuple[E, Float[Tensor, " b"]]:
    """The surfaces after a full step where that halves the gradient; and the step lengths, 1 or 0."""
    trial = here.stepped(direction, 1.0)
    lower = trial.size < here.size / 2
    taken = lower.nonzero()[:, 0]
    return here.replaced(taken, trial.at(taken)), lower.to(trial.size)


def _line_search(
    here: E, direction: Float[Tensor, "b k"], highest: Float[Tensor, " b"]
) -> tuple[E, Float[Tensor, " b"]]:
    """The surfaces after the longest step 1, ½, ¼, … with an energy of at most `highest`; its lengths, 0 if none."""
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
