"""Zeros of a holomorphic function inside a plane domain, by the argument principle and Newton's method.

The change of arg f along ∂Ω is the number of zeros inside. Newton's method finds approximations. The moments
(1/2πi)∮ zᵏ f′/f dz on a circle around each then give its order, and its position to round-off.

Source: Delves & Lyness, "A numerical method for locating the zeros of an analytic function", Math. Comp. 21 (1967);
Hubbard, Schleicher & Sutherland, "How to find all roots of complex polynomials by Newton's method", Invent. Math. 146
(2001), for starting points around all zeros.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import UnplacedZerosError, ZeroOnContourError
from spinor_geom.mesh.topology import linked

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]

RESOLUTION = 1e-4  # zeros nearer to each other than this share of the domain's diameter count as one multiple zero
# A piece of ∂Ω is sampled finely enough when arg f changes by less than this between samples, and halving the steps
# does not change the sum.
_LARGEST_STEP = np.pi / 3
_FIRST_INTERVALS, _MOST_INTERVALS = 4, 1 << 12
# Starting points per zero on each boundary, and the distance, in resolutions, up to which two limits are one zero:
# Newton's method finds a k-fold zero to round-off^(1/k) only.
_ATTEMPTS = ((16, 1), (64, 10), (256, 1), (256, 100))
_MOST_ITERATIONS = 300
_DIFFERENCE, _LONGEST = 1e-6, 0.1  # difference for f′, and longest Newton step, as shares of the domain's diameter
_CHECKED = 8  # iterations between checks for points that have left Ω
_CIRCLE_NODES = 128


@dataclass(frozen=True, kw_only=True, eq=False)
class Zero:
    """A zero of a holomorphic function."""

    z: complex  # position, or the mean of zeros nearer to each other than the resolution
    order: int  # multiplicity


def find_zeros(function: HolomorphicFunction, domain: PlaneDomain) -> tuple[Zero, ...]:
    """All zeros in Ω of a function that is holomorphic on Ω and its boundary, ordered by real, then imaginary part.

    Positions are exact to round-off. Zeros nearer to each other than the resolution, a share of the domain's diameter,
    are reported as one.

    Raises:
        ZeroOnContourError: a zero lies on ∂Ω, or too near to it to be counted.
        UnplacedZerosError: the zeros were counted, but not all of them were found.
    """
    count = round(float(_argument_changes(function, domain).sum() / (2 * np.pi)))
    if count == 0:
        return ()
    for starts, relative in _ATTEMPTS:
        t = (np.arange(starts * count) + 0.5) / (starts * count)
        start, apart = (
            np.concatenate([boundary.point(t) for boundary in domain.boundaries]),
            relative * RESOLUTION * domain.diameter,
        )
        limits = _newton_limits(function, domain, start, 0.1 * apart)
        pairs = cKDTree(plane_coordinates(limits)).query_pairs(apart, output_type="ndarray")
        label = linked(pairs, len(limits))
        sums = np.bincount(label, limits.real) + 1j * np.bincount(label, limits.imag)
        centres = sums / np.bincount(label)
        distance = np.abs(centres[:, None] - np.concatenate([centres, _samples(domain, 4).ravel()]))
        np.fill_diagonal(distance, np.inf)
        zeros = [zero_inside(function, *circle) for circle in zip(centres, distance.min(axis=1) / 2, strict=True)]
        if sum(zero.order for zero in zeros) == count:
            step = RESOLUTION * domain.diameter  # equal real parts differ by rounding
            found = (zero for zero in zeros if zero.order)
            return tuple(sorted(found, key=lambda zero: (round(zero.z.real / step), zero.z.imag)))
    raise UnplacedZerosError(count=count)


def zero_inside(function: HolomorphicFunction, centre: complex, radius: float) -> Zero:
    """Mean and total order of the zeros inside a circle, order 0 if there are none or they cannot be counted.

    The error of the trapezoidal rule falls geometrically with the number of nodes, at a rate given by the distance of
    the circle from the nearest zero.
    """
    unit = np.exp(2j * np.pi * np.arange(_CIRCLE_NODES) / _CIRCLE_NODES)
    value = _evaluate(function, centre + radius * unit)
    if not value.all():
        return Zero(z=complex(centre), order=0)
    # on the circle f is a power series in w = (z − centre)/radius, and its coefficients give w f′
    derivative = np.fft.ifft(np.fft.fft(value) * np.arange(_CIRCLE_NODES))
    number, first = (derivative / value).mean(), (derivative / value * unit).mean()
    nearest = np.rint(number.real)
    order = int(nearest) if abs(number - nearest) < 0.1 else 0
    return Zero(z=complex(centre + radius * first / order) if order else complex(centre), order=order)


def _newton_limits(
    function: HolomorphicFunction, domain: PlaneDomain, z: Complex[np.ndarray, " n"], tolerance: float
) -> Complex[np.ndarray, " k"]:
    """Points of Ω at which Newton's method, started from the given points, makes a step shorter than the tolerance."""
    h, longest, limits = _DIFFERENCE * domain.diameter, _LONGEST * domain.diameter, []
    for iteration in range(_MOST_ITERATIONS):
        value = _evaluate(function, z)
        with np.errstate(all="ignore"):
            step = value / ((_evaluate(function, z + h) - _evaluate(function, z - h)) / (2 * h))
            following = z - step * np.minimum(1, longest / np.abs(step))
        converged = (value == 0) | (np.abs(step) < tolerance)
        limits.append(z[converged])
        z = following[~converged & np.isfinite(following)]
        if iteration % _CHECKED == 0:
            z = z[domain.contains(z)]
        if not len(z):
            break
    found = np.concatenate(limits)
    return np.asarray(found[domain.contains(found)])


def _evaluate(function: HolomorphicFunction, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
    return function(z.ravel()).reshape(z.shape)


def _samples(domain: PlaneDomain, intervals: int) -> Complex[np.ndarray, "e k"]:
    """Points at equal steps of each piece of ∂Ω, both ends included."""
    steps = np.linspace(0, 1, intervals + 1) * np.diff(domain.arcs, axis=1)
    return np.asarray(domain.point(domain.arcs[:, :1] + steps))


def _argument_changes(function: HolomorphicFunction, domain: PlaneDomain) -> Float[np.ndarray, " e"]:
    """Change of arg f along each piece of ∂Ω, by sampling each finely enough."""
    changes = np.full(len(domain.arcs), np.nan)
    open_, before = np.arange(len(changes)), np.full(len(changes), np.nan)
    intervals = _FIRST_INTERVALS
    while len(open_) and intervals <= _MOST_INTERVALS:
        values = _evaluate(function, _samples(domain, intervals)[open_])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.angle(values[:, 1:] / values[:, :-1])
            now = step.sum(axis=1)
            done = (np.abs(step).max(axis=1) < _LARGEST_STEP) & (np.abs(now - before) < 1e-3)
        changes[open_[done]] = now[done]
        open_, before = open_[~done], now[~done]
        intervals *= 2
    if len(open_):
        raise ZeroOnContourError(z=complex(domain.vertices[open_[0]]))
    return changes
