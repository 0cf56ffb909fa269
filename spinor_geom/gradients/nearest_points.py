"""Points of a minimal surface nearest to given places: a search over samples, then Newton's method in Ω."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial import cKDTree

from spinor_geom.arrays import EPS, TINY, norm
from spinor_geom.errors import OptionError, SurfaceError
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.formulas import conformal_factor, phi, phi_derivative

# Nearest samples from which Newton's method starts. From one, 1 of 889 places near six surfaces ends in a minimum that
# is not the least, from two none.
_STARTS = 4
_STEPS = 50
_HALVINGS = 12  # of a step that leaves Ω or the way downhill
_PRECISE = 1e-9  # largest tangential part of the vector to a place, in diagonals of the rims
_FLOOR = EPS**0.5  # least curvature of the squared distance, per λ², that a step divides by
_LONGEST = 0.25  # step in space, in diagonals of the rims


def nearest(solution: PlateauSolution, places: Float[np.ndarray, "k 3"]) -> Complex[np.ndarray, " k"]:
    """Points of Ω where the surface is nearest to given places.

    Raises:
        OptionError: a place is nearest to the boundary of the surface.
        SurfaceError: the distance of a place has no minimum that Newton's method finds.
    """
    samples = mesh_surface(solution.array_surface)
    _, start = cKDTree(samples.vertices).query(places, k=np.arange(1, _STARTS + 1))
    goals = np.repeat(places, _STARTS, axis=0)
    z, offset, tangential = _minima(solution, samples.points[start.ravel()], goals)
    distance = norm(offset)
    is_minimum = (tangential <= _PRECISE * (solution.diagonal + distance)) & solution.domain.contains(z)
    distance, is_minimum = distance.reshape(-1, _STARTS), is_minimum.reshape(-1, _STARTS)
    best = np.where(is_minimum, distance, np.inf).argmin(axis=1)
    is_found, error = is_minimum.any(axis=1), solution.boundary_residual.max
    least = np.where(is_found, distance[np.arange(len(places)), best] - error, distance.min(axis=1) + error)
    to_rims = np.min([norm(rim.curve.point(rim.curve.nearest(places)) - places) for rim in solution.rims], axis=0)
    if (is_outside := to_rims < least).any():
        raise OptionError(
            f"place {int(is_outside.argmax())} is nearest to the boundary of the surface; move it inwards"
        )
    if not is_found.all():
        k = int(is_found.argmin())
        raise SurfaceError(f"the point of the surface nearest to place {k} was not found; move the place")
    return np.asarray(z.reshape(-1, _STARTS)[np.arange(len(places)), best])


def _minima(
    solution: PlateauSolution, z: Complex[np.ndarray, " n"], goals: Float[np.ndarray, "n 3"]
) -> tuple[Complex[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Local minima of the distance from `goals`: points of Ω, r − goal, and the length of its tangential part.

    A step of Newton's method is halved until it stays in Ω and decreases the distance. Where the squared distance is
    not convex, the step divides by the absolute value of its curvature.
    """
    surface, domain, size = solution.array_surface, solution.domain, solution.diagonal
    z, offset = z.copy(), surface.position(z) - goals
    tangential = np.full(len(z), np.inf)
    left = np.arange(len(z))
    for _ in range(_STEPS):
        here = z[left]
        (p, q), (p1, q1) = surface.spinors(here).T, surface.spinor_derivatives(here).T
        # r_x = Re φ and r_y = −Im φ are orthogonal and of length λ
        scale = np.maximum(conformal_factor(p, q), TINY**0.25)
        slope = np.conj((offset[left] * phi(p, q)).sum(axis=1))
        bend = (offset[left] * phi_derivative(p, q, p1, q1)).sum(axis=1)
        last, tangential[left] = tangential[left], np.abs(slope) / scale
        # near a minimum a step divides it by more, up to rounding
        going = (tangential[left] > _PRECISE * size) | (tangential[left] < last / 2)
        # the second derivative along s is λ²s + conj(bend·s): λ² ± |bend| along and across an axis
        axis = np.exp(-0.5j * np.angle(bend))
        along, across = scale**2 + np.abs(bend), np.abs(scale**2 - np.abs(bend))
        turned = slope / axis
        step = -axis * (turned.real / along + 1j * turned.imag / np.maximum(across, _FLOOR * scale**2))
        step *= np.minimum(1, _LONGEST * size / np.maximum(np.abs(step) * scale, TINY))
        share, moved = np.ones(len(left)), np.zeros(len(left), dtype=bool)
        waiting = np.flatnonzero(going)
        before = (offset[left] ** 2).sum(axis=1)
        for _ in range(_HALVINGS):
            trial = here[waiting] + share[waiting] * step[waiting]
            inside = domain.contains(trial)
            waiting_in, trial = waiting[inside], trial[inside]
            found = surface.position(trial) - goals[left[waiting_in]]
            lower = (found**2).sum(axis=1) <= before[waiting_in] * (1 + 4 * EPS)
            done = waiting_in[lower]
            z[left[done]], offset[left[done]], moved[done] = trial[lower], found[lower], True
            waiting = waiting[~moved[waiting]]
            share[waiting] /= 2
            if not len(waiting):
                break
        left = left[moved]
        if not len(left):
            break
    return z, offset, tangential
