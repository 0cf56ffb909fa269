"""Zeros of a holomorphic function inside a plane domain, by rational approximation and the argument principle.

The change of arg f along ∂Ω counts the zeros inside. The zeros of a rational function with the values of f on ∂Ω are
near them; then the moments (1/2πi)∮ zᵏ f′/f dz on a circle around each give its order, and its place to round-off.

Source: Nakatsukasa, Sète & Trefethen, "The AAA algorithm for rational approximation", SIAM J. Sci. Comput. 40 (2018);
Delves & Lyness, "A numerical method for locating the zeros of an analytic function", Math. Comp. 21 (1967).
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from scipy.interpolate import AAA
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import UnplacedZerosError, ZeroOnContourError
from spinor_geom.mesh.topology import linked

HolomorphicFunction = Callable[[Complex[Tensor, " n"]], Complex[Tensor, " n"]]

RESOLUTION = 1e-4  # zeros nearer to each other than this share of the domain's diameter count as one multiple zero
# a piece of ∂Ω is followed when arg f changes by less than this between samples, and halving the steps changes nothing
_LARGEST_STEP = np.pi / 3
_FIRST_INTERVALS = 4
_MOST_INTERVALS = 1 << 12
# samples of each piece of ∂Ω that rational functions are tried on, and how far apart, in resolutions, their zeros may
# lie that stand for one of f: a k-fold zero is only known to round-off^(1/k)
_ATTEMPTS = ((4, 1), (16, 1), (16, 10), (64, 1))
_TOLERANCE = 1e-8  # of the rational function: enough to find its zeros by
_SMALL = 0.1  # |f| near its zeros, per that on ∂Ω
_CIRCLE_NODES = 128
_BLOCK = 1 << 14


@dataclass(frozen=True, kw_only=True, eq=False)
class Zero:
    """A zero of a holomorphic function."""

    z: complex  # where; for a cluster of zeros nearer to each other than the resolution their mean
    order: int  # multiplicity


def find_zeros(
    function: HolomorphicFunction, domain: PlaneDomain, *, resolution: float = RESOLUTION
) -> tuple[Zero, ...]:
    """All zeros of a function, holomorphic on Ω and its boundary, inside ∂Ω, with multiplicity.

    They are ordered by real and then imaginary part; simple and multiple ones are exact to round-off. Those nearer to
    each other than the resolution, a share of the domain's diameter, are reported as one.

    Raises:
        ZeroOnContourError: a zero lies on ∂Ω, or too near to it to be counted.
        UnplacedZerosError: the zeros were counted, but not all of them were found.
    """
    count = round(float(_turning(function, domain).sum() / (2 * np.pi)))
    if count == 0:
        return ()
    for samples, near in _ATTEMPTS:
        rim = _along(domain, np.arange(samples) / samples).ravel()
        centres = _approximate_zeros(function, domain, rim, near * resolution * domain.diameter)
        apart = np.abs(centres[:, None] - np.concatenate([centres, rim]))
        np.fill_diagonal(apart, np.inf)
        zeros = [zero_inside(function, *circle) for circle in zip(centres, 0.5 * apart.min(axis=1), strict=True)]
        if sum(zero.order for zero in zeros) == count:
            found = [zero for zero in zeros if zero.order]
            step = RESOLUTION * domain.diameter  # equal real parts differ by rounding
            return tuple(sorted(found, key=lambda zero: (round(zero.z.real / step), zero.z.imag)))
    raise UnplacedZerosError(count=count)


def zero_inside(function: HolomorphicFunction, centre: complex, radius: float) -> Zero:
    """The mean of the zeros inside a circle, as one; of order 0 where there is none.

    The trapezoidal rule's error falls geometrically with its nodes, as fast as other zeros are far from the circle.
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


def _evaluate(function: HolomorphicFunction, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
    flat = torch.tensor(np.ascontiguousarray(z)).reshape(-1)
    with torch.no_grad():
        values = torch.cat([function(block) for block in torch.split(flat, _BLOCK)])
    return np.asarray(values.cpu().resolve_conj().numpy().reshape(z.shape))


def _along(domain: PlaneDomain, s: Float[np.ndarray, " k"]) -> Complex[np.ndarray, "e k"]:
    """Points at the fractions s of each piece of ∂Ω."""
    return np.asarray(domain.point(domain.arcs[:, :1] + s * np.diff(domain.arcs, axis=1)))


def _turning(function: HolomorphicFunction, domain: PlaneDomain) -> Float[np.ndarray, " e"]:
    """Change of arg f along each piece of ∂Ω, by sampling each finely enough."""
    turning = np.full(len(domain.arcs), np.nan)
    todo = np.arange(len(turning))
    before = np.full(len(todo), np.nan)
    intervals = _FIRST_INTERVALS
    while len(todo) and intervals <= _MOST_INTERVALS:
        values = _evaluate(function, _along(domain, np.linspace(0, 1, intervals + 1))[todo])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.angle(values[:, 1:] / values[:, :-1])
            now = step.sum(axis=1)
            done = (np.abs(step).max(axis=1) < _LARGEST_STEP) & (np.abs(now - before) < 1e-3)
        turning[todo[done]] = now[done]
        todo, before = todo[~done], now[~done]
        intervals *= 2
    if len(todo):
        raise ZeroOnContourError(z=complex(domain.vertices[todo[0]]))
    return turning


def _approximate_zeros(
    function: HolomorphicFunction, domain: PlaneDomain, rim: Complex[np.ndarray, " n"], size: float
) -> Complex[np.ndarray, " k"]:
    """Where in Ω a rational function has zeros that has the values of f on ∂Ω; those nearer than `size` as one."""
    values = _evaluate(function, rim)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an approximation that is no better: what it gives is checked
        roots = AAA(rim, values, rtol=_TOLERANCE).roots()
    roots = roots[domain.contains(roots)]
    # a zero of its own beside a pole of its own is none of f
    roots = roots[np.abs(_evaluate(function, roots)) < _SMALL * np.median(np.abs(values))]
    label = linked(np.argwhere(np.abs(roots[:, None] - roots) <= size), len(roots))
    return np.array([roots[label == k].mean() for k in np.unique(label)], dtype=np.complex128)
