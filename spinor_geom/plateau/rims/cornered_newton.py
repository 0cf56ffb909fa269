"""Newton's method for Douglas's energy between rims with corners."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from spinor_geom.deadline import require_time
from spinor_geom.errors import UnresolvedRimsError
from spinor_geom.plateau.rims.cornered import CorneredSurface
from spinor_geom.plateau.steps import Steps

ROUGHLY = 1e-4  # relative decrease of the energy at which gaps between circles are known well enough for modes
_NEGLIGIBLE = 1e-12  # expected relative decrease of the energy at which Newton's method ends
# Expected relative decrease at which it ends too if a step does not reduce that by the second factor: where rims nearly
# touch, the energy hardly depends on some slides.
_ENOUGH, _SLOW = 1e-8, 0.25
_FLAT = 1e-9  # relative curvature treated as 0
_MOST_STEPS = 40
_LARGEST_STEPS = 2.0, 0.5  # of logit s, and of arguments, logarithms of radii and centres
_MORE_DAMPING = 4.0  # factor of the damping, until a step is short enough
_LEAST_LENGTH = 1e-3  # of a step that lowers the energy
# Newton's method goes on over a conformal image of Ω when the mean of holes and corners is this far from 0
_UNEVEN = 0.2


def stationary(start: CorneredSurface, steps: Steps, negligible: float = _NEGLIGIBLE) -> CorneredSurface:
    """The critical point of the energy that damped Newton steps from a start lead to.

    Negative curvature is reversed. Long steps are damped, and shortened until they lower the energy. Conformal maps of
    the unit disk are free: modes represent some images of a surface better than others.

    Raises:
        OutOfTimeError: time ran out.
        UnresolvedRimsError: the steps do not converge.
    """
    here, before = start, math.inf
    for _ in range(_MOST_STEPS):
        require_time()
        if here.form.circles.unevenness(here.form.rims.rim_of_corner) > _UNEVEN:
            here = here.spread()
        gradient, hessian = here.derivatives()
        diagonal = np.abs(np.diag(hessian))
        unit = 1 / np.sqrt(np.maximum(diagonal, _FLAT * diagonal.max()))
        curvatures, vectors = np.linalg.eigh(unit[:, None] * hessian * unit)
        sizes, pull = np.abs(curvatures), (unit * gradient) @ vectors
        damping = _FLAT * sizes.max()
        while True:
            step = -unit * (vectors @ (pull / (sizes + damping)))
            if max(_extents(here, step)) <= 1:
                break
            damping *= _MORE_DAMPING
        fall = -float(step @ gradient)
        steps.take("Douglas-Newton", math.sqrt(abs(fall) / here.energy))
        there = _lower(here, step)
        if there is None:
            break
        is_slow, here, before = _SLOW * before < fall < _ENOUGH * here.energy, there, fall
        if fall < negligible * here.energy or is_slow:
            return here
    if fall < ROUGHLY * here.energy:  # the residual shows whether that is near enough
        return here
    raise UnresolvedRimsError(rims=len(here.form.circles.centres), failure="does not converge")


def _extents(here: CorneredSurface, step: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """The largest changes of the slides and of the moduli, over those allowed in a step."""
    count = len(here.slides)
    slides = here.form.rims.modes @ step[:count]
    return float(np.abs(slides).max()) / _LARGEST_STEPS[0], float(np.abs(step[count:]).max()) / _LARGEST_STEPS[1]


def _lower(here: CorneredSurface, step: Float[np.ndarray, " k"]) -> CorneredSurface | None:
    """The surface after the longest part of a step that lowers the energy; None if short ones do not."""
    length = 1.0
    while length > _LEAST_LENGTH:
        there = here.stepped(length * step)
        if there is not None and there.energy < here.energy * (1 + _NEGLIGIBLE):
            return there
        length /= 2
    return None
