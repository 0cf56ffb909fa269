"""Newton's method for Douglas's energy, in the slides and, where Ω has holes, its moduli."""

import itertools
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import Array, add_to_diagonal, as_dtype, cholesky, cholesky_solve, indices, namespace, place_of
from spinor_geom.deadline import is_out_of_time

MOST_STEPS = 60  # default limit on Newton steps, and on conjugate gradient steps in each
# A step may increase the energy up to the maximum of this number of last values. Such a nonmonotone line search allows
# longer steps in curved valleys of the energy.
_REMEMBERED = 6
# Relative curvature and step length treated as 0, and relative gradient below which changes of the energy are rounding
# errors. With the root of `ROUNDING` rough curves take 4 % more steps.
SMALL = 1e-6
STEPS_TO_ROUNDING = 5  # of Newton's method, from a start with few correct digits
ROUNDING = 1e-13  # relative rounding error of gradients and energies. With 3e-15 series take more steps
# Factor by which damping changes: with 2 smooth loops take a third more steps, and with 8 hardly fewer. Least value of
# damping above 0: with 0.1 narrow loops take a quarter more steps, and with 1e-6 smooth ones 6 % more.
MORE_DAMPING, LEAST_DAMPING = 4.0, 1e-3

E = TypeVar("E", bound="Energies")
Rows: TypeAlias = Callable[[Float[Array, "b k"]], Float[Array, "b k"]]  # a linear map of rows of displacements


class Energies(Protocol):
    """Energies of b independent surfaces, with k unknowns each: displacements along Γ, and changes of the moduli."""

    @property
    def energy(self) -> Float[Array, " b"]:
        """The energies, up to a common factor."""

    @property
    def size(self) -> Float[Array, " b"]:
        """Relative size of the gradients."""

    @property
    def is_over(self) -> Bool[Array, " b"]:
        """Whether the surfaces degenerate, so that the iteration ends."""

    def at(self: E, which: Int[Array, " j"]) -> E:
        """The selected surfaces."""

    def replaced(self: E, which: Int[Array, " j"], other: E) -> E:
        """The surfaces with some of them replaced."""

    def direction(
        self, damping: Float[Array, " b"] | None, forcing: Float[Array, " b"]
    ) -> tuple[Float[Array, "b k"], Bool[Array, " b"]]:
        """Newton's step, and whether the damped Hessian has a direction of negative curvature.

        Newton's equations are solved to the relative residual `forcing`. Undamped steps converge to critical points of
        any index.
        """

    def stepped(self: E, direction: Float[Array, "b k"], length: float) -> E:
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
    place = place_of(energy)
    xp, put = place.xp, place.put
    limits, falls = put(np.array(tolerances, dtype=np.float64)), put(np.array(negligible, dtype=np.float64))
    number, most = put(np.arange(count)), put(np.array(max_steps))
    damping = put(np.full(count, 0.0 if near else 1.0))
    stuck = put(np.zeros(count, dtype=bool))
    recent = put(np.full((count, _REMEMBERED), np.inf))
    # the last energies, and the least energy before each of the last steps
    energies = -recent
    energies[:, -1] = energy
    lowest = put(np.full((count, _REMEMBERED + 1), np.inf))
    lowest[:, -1] = energy
    for steps in itertools.count():
        size = here.size
        # a small gradient that a step does not halve is rounding error
        at_rounding = (size < SMALL) & (size > xp.min(recent, axis=-1) / 2)
        # the energy changes by rounding errors only
        unchanged = xp.max(energies, axis=-1) - xp.min(energies, axis=-1) < ROUNDING * here.energy
        is_flat = (size > SMALL) & (unchanged | (lowest[:, 0] - lowest[:, -1] < falls))
        finished = (size <= limits) | at_rounding | (is_flat & (not saddles)) | stuck | here.is_over | (steps >= most)
        if finished.any():
            over = indices(finished)
            found.append((number[over].tolist(), here.at(over)))
            if finished.all():
                break
            rest = indices(~finished)
            here, number, limits, most, falls = here.at(rest), number[rest], limits[rest], most[rest], falls[rest]
            size, damping, recent = size[rest], damping[rest], recent[rest]
            energies, lowest = energies[rest], lowest[rest]
        if is_out_of_time():
            break
        if on_step:
            for i, value in zip(number.tolist(), size.tolist(), strict=True):
                on_step[i](value)
        recent = xp.concat([recent[:, 1:], size[:, None]], axis=1)
        recent[damping != 0] = np.inf
        # rough loops take many steps. Newton's equations of the first ones are solved less accurately
        forcing = xp.clip(xp.where(falls > 0, xp.sqrt(size), size), None, 0.1)
        direction, downwards = here.direction(None if saddles else damping, forcing)
        here, lengths = (
            _full_step(here, direction) if saddles else _line_search(here, direction, xp.max(energies, axis=-1))
        )
        moved = lengths > 0
        energies = xp.concat([energies[:, 1:], here.energy[:, None]], axis=1)
        lowest = xp.concat([lowest[:, 1:], xp.minimum(lowest[:, -1], here.energy)[:, None]], axis=1)
        stuck = ~moved & (saddles | (damping >= 1))
        more = xp.where(moved, 10 * LEAST_DAMPING, 0.1 + 0 * damping)
        less = xp.where(damping > LEAST_DAMPING, damping / MORE_DAMPING, 0.0)
        damping = xp.where(
            ~moved | downwards,
            xp.clip(xp.maximum(MORE_DAMPING * damping, more), None, 1.0),
            xp.where(lengths == 1, less, damping),
        )
    return found


def conjugate_gradients(
    hessian: Rows, gradient: Float[Array, "b k"], precondition: Rows, forcing: Float[Array, " b"]
) -> tuple[Float[Array, "b k"], Bool[Array, " b"]]:
    """`Energies.direction` by preconditioned conjugate gradients, which stop at a direction of negative curvature."""
    residual, xp = -gradient, namespace(gradient)
    x, search = xp.zeros_like(residual), precondition(residual)
    size = scale = dots(residual, search)  # scale is the square of the search direction's norm by the preconditioner
    enough = forcing[:, None] ** 2 * size
    unfinished = xp.ones_like(size, dtype=xp.bool)
    downwards = xp.zeros_like(unfinished)
    for step in range(MOST_STEPS):
        image = hessian(search)
        curvature = dots(search, image)
        flat = unfinished & (curvature <= SMALL * scale)
        if flat.any():
            downwards |= flat & (curvature < -SMALL * scale)
            unfinished &= ~flat
            if step == 0:
                x = xp.where(flat, search, x)
        length = xp.where(unfinished, size / curvature, 0.0)
        x = x + length * search
        residual = residual - length * image
        z = precondition(residual)
        before, size = size, dots(residual, z)
        unfinished &= ~(size < enough)
        if not unfinished.any():
            break
        ratio = xp.where(unfinished, size / before, 0.0)
        search, scale = z + ratio * search, size + ratio**2 * scale
    return x, downwards[:, 0]


def factored(
    matrix: Float[Array, "k k"], metric: Float[Array, " k"], gradient: Float[Array, "1 k"], damping: Float[Array, "1"]
) -> tuple[Float[Array, "1 k"], Bool[Array, "1"]]:
    """`Energies.direction` of one surface by a Cholesky factor. Damping increases until the matrix is definite."""
    tried, xp = damping, namespace(matrix)
    while True:
        shifted = xp.asarray(matrix, copy=True)
        add_to_diagonal(shifted, tried * metric)
        factor = cholesky(shifted)
        if factor is not None:
            return cholesky_solve(factor, -gradient.mT).mT, tried > damping
        if float(tried[0]) > 1 / ROUNDING:
            return xp.full_like(gradient, np.nan), tried > damping
        tried = xp.clip(MORE_DAMPING * tried, 10 * LEAST_DAMPING, None)


def _full_step(here: E, direction: Float[Array, "b k"]) -> tuple[E, Float[Array, " b"]]:
    """The surfaces after a full step where that halves the gradient, and the step lengths, 1 or 0."""
    trial = here.stepped(direction, 1.0)
    lower = trial.size < here.size / 2
    taken = indices(lower)
    return here.replaced(taken, trial.at(taken)), as_dtype(lower, trial.size.dtype)


def _line_search(here: E, direction: Float[Array, "b k"], highest: Float[Array, " b"]) -> tuple[E, Float[Array, " b"]]:
    """The surfaces after the longest step 1, ½, ¼, … with an energy of at most `highest`, and its length, or 0."""
    start, trial, length = here, here.stepped(direction, 1.0), 1.0
    highest = highest + ROUNDING * abs(highest)
    lower = trial.energy <= highest
    lengths = as_dtype(lower, highest.dtype)
    if lower.all():
        return trial, lengths
    which = place_of(lower).put(np.arange(len(lower)))
    while True:
        taken = which[lower]
        here = here.replaced(taken, trial.at(indices(lower)))
        lengths[taken] = length
        which = which[~lower]
        length /= 2
        if not len(which) or length < SMALL:
            return here, lengths
        trial = start.at(which).stepped(direction[which], length)
        lower = trial.energy <= highest[which]


def dots(a: Float[Array, "b k"], b: Float[Array, "b k"]) -> Float[Array, "b 1"]:
    """Scalar products of rows."""
    product: Array = namespace(a).linalg.vecdot(a, b)
    return product[:, None]
