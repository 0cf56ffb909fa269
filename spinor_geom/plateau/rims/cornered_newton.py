"""Newton's method for Douglas's energy between rims with corners."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.linalg import orth

from spinor_geom.arrays import EPS
from spinor_geom.deadline import require_time
from spinor_geom.errors import UnresolvedRimsError
from spinor_geom.plateau.harmonic.lift import WORTHWHILE
from spinor_geom.plateau.harmonic.smooth_domain import COARSE
from spinor_geom.plateau.newton import MORE_DAMPING, MOST_STEPS, ROUNDING, SMALL
from spinor_geom.plateau.rims.cornered import CorneredSurface
from spinor_geom.plateau.rims.energy import LARGEST_STEP
from spinor_geom.plateau.route_result import COLLAPSED, NoConnectedSurfaceError
from spinor_geom.plateau.steps import Steps

# Least curvature at minima, relative to the diagonal of the Hessian. It is -3 where a surface comes apart because
# images of corners merge, and above -0.05 on the way to minima when the first stage ends.
_LEAST_CURVATURE = -0.1
# Relative curvature treated as 0. With 1e-8 lunes miss the curves by 1e-4 of an edge instead of 1e-5.
_FLAT = 1e-9
_LARGEST_OF_SLIDES = 2.0  # largest step of logit s


def stationary(start: CorneredSurface, steps: Steps, negligible: float = ROUNDING) -> CorneredSurface:
    """The critical point of the energy that damped Newton steps from a start lead to.

    Negative curvature is reversed. Steps are damped where they are long or the last one fell short of what the Hessian
    predicts, and shortened until they lower the energy. Steps along conformal maps of the unit disk, which change
    nothing, are excluded.

    Raises:
        NoConnectedSurfaceError: a hole shrinks to a point.
        OutOfTimeError: time ran out.
        UnresolvedRimsError: the steps do not converge.
    """
    here, before, reach = start, math.inf, 1.0
    for _ in range(MOST_STEPS):
        require_time()
        gradient, hessian = here.derivatives()
        diagonal = np.abs(np.diag(hessian))
        unit = 1 / np.sqrt(np.maximum(diagonal, _FLAT * diagonal.max()))
        scaled, count = unit[:, None] * hessian * unit, len(here.slides)
        free = orth(here.form.circles.rotations(here.form.rims.rim_of_corner) / unit[count:, None])
        scaled[count:, count:] += free @ free.T
        curvatures, vectors = np.linalg.eigh(scaled)
        is_minimum = curvatures[0] > _LEAST_CURVATURE
        sizes, pull = np.abs(curvatures), (unit * gradient) @ vectors
        damping = _FLAT * sizes.max()
        while True:
            step = -unit * (vectors @ (pull / (sizes + damping)))
            if (extent := max(_extents(here, step))) <= reach:
                break
            damping *= MORE_DAMPING
        fall = -float(step @ gradient)
        steps.take("Douglas-Newton", math.sqrt(abs(fall) / here.energy))
        there, length = _lower(here, step)
        if there is None:
            break
        share = (here.energy - there.energy) / fall  # ½ for a quadratic energy
        if length < 1 or share < 0.125:
            reach = extent * min(length, 0.5)
        elif share > 0.3:
            reach = min(3 * reach, 1.0)
        # where rims nearly touch, the energy hardly depends on some slides
        is_slow, here, before = WORTHWHILE**2 * before < fall < EPS**0.5 * here.energy, there, fall
        radii = here.form.circles.radii[1:]
        is_done = is_minimum and (fall < negligible * here.energy or is_slow)
        # the energy decreases slowly as a hole shrinks, as 1 / |log radius|
        if is_done and radii.min() > SMALL:
            return here
        if is_done or reach < SMALL:
            break
    if (gradient[len(here.slides) + here.form.rims.corners :].reshape(-1, 3)[:, 2] > here.energy * radii).any():
        raise NoConnectedSurfaceError(COLLAPSED)
    if is_minimum and fall < COARSE * here.energy:  # the residual shows whether that is near enough
        return here
    raise UnresolvedRimsError(rims=len(here.form.circles.centres), failure="does not converge")


def _extents(here: CorneredSurface, step: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """The largest changes of the slides and of the moduli, over those allowed in a step."""
    count = len(here.slides)
    slides = here.form.rims.modes @ step[:count]
    return float(np.abs(slides).max()) / _LARGEST_OF_SLIDES, float(np.abs(step[count:]).max()) / LARGEST_STEP


def _lower(here: CorneredSurface, step: Float[np.ndarray, " k"]) -> tuple[CorneredSurface | None, float]:
    """The surface after the longest part of a step that lowers the energy, or None, and the length of that part."""
    length = 1.0
    while length > SMALL**0.5:
        require_time()
        there = here.stepped(length * step)
        if there is not None and there.energy < here.energy * (1 + ROUNDING):
            return there, length
        length /= 2
    return None, length
