"""Rims with corners: their sides, the nodes of these, and the modes of their slides.

On the sides between corners slides are logit s = a log u − b log (1 − u) + Chebyshev polynomials of tanh, u the share
of the side's arc in ∂Ω: at a corner of angle α of the surface s ~ u^(α/π).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.newton import ROUNDING, STEPS_TO_ROUNDING

# Nodes far from corners: so many steps for each unit of `Place`, because powers of the coordinate are no functions of
# log u.
_FAR = 7.0
# Beyond the last pole of a corner, u decreases double exponentially: from exp(−_BEYOND) times its distance, in log u,
# to 2e-9 of that.
_BEYOND = 3.0
# κ of the coordinate tanh(κ log u) of slides, which are smooth in √u: powers of u are half-integers at right angles
_RATE = 0.25
SAMPLES = 1024  # of a curve, or of a function on a side


class Resolution(NamedTuple):
    """How well corners are resolved."""

    depth: float  # −log u of the last pole at a corner with α = π/2, less for larger angles
    degree: int  # of the Chebyshev polynomials of a side's slide
    decay: float  # σ in the distances exp(−σ(√n − √k)) of poles from a corner
    rate: float  # κ of the coordinate tanh(κ log u) of slides, at corners with angles above 180°
    # Of the trapezoid rule in log u. The field of a pole at a corner is analytic for |Im log u| < π/2, and the error is
    # exp(−π²/step).
    step: float

    def rate_at(self, exponent: float) -> float:
        """κ at a corner with a given angle over π."""
        return self.rate if exponent > 1 else _RATE

    @property
    def dependent(self) -> float:
        """Least square of a function's part independent of the others, over its own: others are dropped.

        With 50 times less, errors of the quadrature count, and the energy is not smooth.
        """
        return 200 * math.exp(-(math.pi**2) / self.step)


# The start has few modes: with many, slides far from the solution find values that few poles take for less energy. Near
# corners with angles above 180° its slides are flat, because there the energy hardly depends on them. Afterwards, the
# boundary is within 5e-5 of a side at corners of 90°, and within 5e-6.
START, ROUGH, FINE = (
    Resolution(depth=11.0, degree=6, decay=5.0, rate=0.5, step=0.4),
    Resolution(depth=20.0, degree=20, decay=5.0, rate=_RATE, step=0.4),
    Resolution(depth=25.0, degree=28, decay=4.0, rate=_RATE, step=0.3),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """The integral of 1 + Σ weight/(1 − eccentricity·cos) of angles along an arc, with its ends at the shares 0 and 1.

    With angles from the points nearest to other circles it is about the conformal coordinate of narrow gaps.
    """

    arc: float
    first: Float[np.ndarray, " g"]  # angles of the first end
    eccentricities: Float[np.ndarray, " g"]
    weights: Float[np.ndarray, " g"]
    near: tuple[float, float] = (0.0, 0.0)  # logarithms of its length over that of the shorter arc at each end

    @classmethod
    def even(cls) -> Place:
        """The share itself."""
        none = np.zeros(0)
        return cls(arc=1.0, first=none, eccentricities=none, weights=none)

    def __call__(self, shares: Float[np.ndarray, "2 n"]) -> Float[np.ndarray, "2 n"]:
        """The integrals from either end to the points with given u and 1 − u."""
        half = self.arc / 2 * shares[..., None]
        square = (1 + self.eccentricities) / (1 - self.eccentricities)
        ends = np.stack([self.first, -self.first - self.arc])[:, None] / 2
        cosines = np.cos(ends) * np.cos(ends + half) + square * np.sin(ends) * np.sin(ends + half)
        turns = 2 * np.arctan2(np.sqrt(square) * np.sin(half), cosines)
        return np.asarray(shares + turns @ (self.weights / self.arc / np.sqrt(1 - self.eccentricities**2)))

    def slope(self, shares: Float[np.ndarray, "2 n"]) -> Float[np.ndarray, " n"]:
        """The integrand."""
        angles = self.first + self.arc * shares[0, :, None]
        return np.asarray(1 + (1 / (1 - self.eccentricities * np.cos(angles))) @ self.weights)


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """A part of a rim between corners, or a whole rim without corners, with its nodes and the modes of its slide."""

    rim: int
    corners: tuple[int, int] | None  # numbers of its ends among all corners, or None for a whole rim
    start: float  # curve parameter of its first end
    length: float  # in the curve parameter
    exponents: tuple[float, float]  # angles of the surface at its ends, over π
    frequencies: int  # of the Fourier modes of a whole rim
    shares: Float[np.ndarray, "2 n"]  # u and 1 − u
    weights: Float[np.ndarray, " n"]  # of integrals over u
    degree: int  # of the polynomials of its slide
    rates: tuple[float, float]  # κ of their coordinate at its ends
    place: Place  # slides are smooth functions of it, also at narrow gaps

    @classmethod
    def between(
        cls,
        rim: int,
        corners: tuple[int, int],
        start: float,
        length: float,
        exponents: tuple[float, float],
        resolution: Resolution,
        place: Place,
    ) -> Side:
        """A side between two corners."""
        depths = [_depth(at, resolution) + more + _BEYOND for at, more in zip(exponents, place.near, strict=True)]
        shares, weights = _nodes(depths, place, resolution.step)
        return cls(
            rim=rim,
            corners=corners,
            start=start,
            length=length,
            exponents=exponents,
            frequencies=0,
            shares=shares,
            weights=weights,
            degree=resolution.degree,
            rates=(resolution.rate_at(exponents[0]), resolution.rate_at(exponents[1])),
            place=place,
        )

    @classmethod
    def whole(cls, rim: int, frequencies: int) -> Side:
        """A rim without corners, whose slide has Fourier modes below a frequency."""
        n = 4 * frequencies
        u = np.arange(n) / n
        return cls(
            rim=rim,
            corners=None,
            start=0.0,
            length=1.0,
            exponents=(1.0, 1.0),
            frequencies=frequencies,
            shares=np.stack([u, 1 - u]),
            weights=np.full(n, 1 / n),
            degree=0,
            rates=(_RATE, _RATE),
            place=Place.even(),
        )

    def base(self, shares: Float[np.ndarray, "2 n"]) -> Float[np.ndarray, " n"]:
        """The sum that `slide` takes, without modes, at given u and 1 − u: logit s, or s of a whole rim."""
        if self.corners is None:
            return np.asarray(shares[0])
        first, last = self._logarithms(shares)
        return np.asarray(self.exponents[0] * first - self.exponents[1] * last)

    def modes(self, shares: Float[np.ndarray, "2 n"]) -> Float[np.ndarray, "n k"]:
        """The modes at given u and 1 − u."""
        if self.corners is None:
            turns = 2 * np.pi * np.arange(1, self.frequencies) * shares[0, :, None]
            return np.concatenate([np.ones((len(turns), 1)), np.cos(turns), np.sin(turns)], axis=1)
        first, last = self._logarithms(shares)
        at = np.tanh(self.rates[0] * first - self.rates[1] * last)
        return np.asarray(np.polynomial.chebyshev.chebvander(at, self.degree))

    def _logarithms(self, shares: Float[np.ndarray, "2 n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Logarithms of `place` from both ends, as shares, at given u and 1 − u."""
        parts = self.place(shares)
        first, last = np.log(parts / parts.sum(axis=0))
        return first, last

    def slide(self, sums: Float[np.ndarray, " n"]) -> Float[np.ndarray, "3 n"]:
        """The curve parameter and its first two derivatives with respect to the sum of `base` and modes."""
        if self.corners is None:
            return np.stack([sums, np.ones_like(sums), np.zeros_like(sums)])
        share, rest = (1 / (1 + np.exp(-sign * sums)) for sign in (1, -1))
        slope = self.length * share * rest
        # away from the corners, because Γ′ there is that of the next side
        inside = np.clip(self.length * share, ROUNDING, self.length - ROUNDING)
        return np.stack([self.start + inside, slope, slope * (rest - share)])


def _depth(exponent: float, resolution: Resolution) -> float:
    """−log u of the last pole at a corner."""
    return min(resolution.depth / 2 / exponent, resolution.depth)


def cluster(exponent: float, arc: float, resolution: Resolution) -> Float[np.ndarray, " k"]:
    """Distances of the poles at a corner, down to a share of a side with a given arc."""
    depth = _depth(exponent, resolution) - min(math.log(arc), 0.0)
    count = int((1 + depth / resolution.decay) ** 2)
    return np.exp(-resolution.decay * (math.sqrt(count) - np.sqrt(np.arange(1, count + 1))))


def _nodes(
    depths: Sequence[float], place: Place, step: float
) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, " n"]]:
    """Nodes u and 1 − u, and the weights of integrals over u.

    They are those of the trapezoid rule in x + c·place, with log u/(1 − u) = x up to the double exponential ends.
    """

    def at(x: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, " n"]]:
        ends = np.exp(np.stack([-x - depths[0], x - depths[1]]))
        logit = x - ends[0] + ends[1]
        shares = 1 / (1 + np.exp(np.stack([-logit, logit])))
        return shares, shares[0] * shares[1] * (1 + ends.sum(axis=0))

    table = np.linspace(-depths[0] - _BEYOND, depths[1] + _BEYOND, SAMPLES)
    steps = (table + _FAR * place(at(table)[0])[0]) / step
    wanted = np.linspace(steps[0], steps[-1], math.ceil(steps[-1] - steps[0]) + 1)
    x = np.interp(wanted, steps, table)
    for _ in range(STEPS_TO_ROUNDING):
        shares, slope = at(x)
        rate = (1 + _FAR * place.slope(shares) * slope) / step
        x = x - ((x + _FAR * place(shares)[0]) / step - wanted) / rate
    shares, slope = at(x)
    rate = (1 + _FAR * place.slope(shares) * slope) / step
    return shares, slope / rate * (wanted[1] - wanted[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class CorneredRims:
    """Curves in the order and direction of the boundaries of Ω, with the nodes and modes of their slides."""

    curves: tuple[CurveTensors, ...]
    sides: tuple[Side, ...]
    rim_of_corner: Int[np.ndarray, " c"]
    exponents: Float[np.ndarray, " c"]  # angles of the surface at the corners, over π
    resolution: Resolution
    powers: tuple[int, ...]  # of each circle's coordinate

    @classmethod
    def of(
        cls,
        curves: Sequence[CurveTensors],
        corners: Sequence[Float[np.ndarray, " _"]],
        exponents: Sequence[Float[np.ndarray, " _"]],
        frequencies: Sequence[int],
        resolution: Resolution = START,
    ) -> CorneredRims:
        """The rims with the ascending parameters of their corners, and the surface's angles there over π.

        `frequencies` are the largest of the slides of rims without corners.
        """
        sides: list[Side] = []
        first, powers = 0, []
        for rim, (own, angles) in enumerate(zip(corners, exponents, strict=True)):
            count = len(own)
            if not count:
                sides.append(Side.whole(rim, frequencies[rim]))
            for k in range(count):
                following = (k + 1) % count
                length = float(own[following] - own[k]) % 1 or 1.0
                ends = float(angles[k]), float(angles[following])
                numbers = first + k, first + following
                sides.append(Side.between(rim, numbers, float(own[k]), length, ends, resolution, Place.even()))
            powers.append(max(count * resolution.degree // 2, frequencies[rim]))
            first += count
        rim_of_corner = np.repeat(np.arange(len(corners)), [len(own) for own in corners])
        return cls(
            curves=tuple(curves),
            sides=tuple(sides),
            rim_of_corner=rim_of_corner,
            exponents=np.concatenate(exponents),
            resolution=resolution,
            powers=tuple(powers),
        )

    def adapted(
        self,
        exponents: Float[np.ndarray, " c"],
        resolution: Resolution,
        places: Callable[[Side], Place],
    ) -> CorneredRims:
        """The rims with other exponents, resolution and `Side.place`."""
        sides = tuple(
            side
            if side.corners is None
            else Side.between(
                side.rim,
                side.corners,
                side.start,
                side.length,
                (float(exponents[side.corners[0]]), float(exponents[side.corners[1]])),
                resolution,
                places(side),
            )
            for side in self.sides
        )
        adapted = replace(self, sides=sides, exponents=exponents, resolution=resolution)
        long = [
            side.rim for side, is_short in zip(sides, adapted.are_short, strict=True) if side.corners and not is_short
        ]
        counts = np.bincount(long, minlength=len(self.curves)).tolist()
        powers = tuple(
            count * resolution.degree // 2 or before for count, before in zip(counts, self.powers, strict=True)
        )
        return replace(adapted, powers=powers)

    @cached_property
    def are_short(self) -> Bool[np.ndarray, " k"]:
        """Which sides have much shorter arcs than others of their rim. Nodes resolve no powers as short as these."""
        rims, arcs = np.array([side.rim for side in self.sides]), np.array([side.place.arc for side in self.sides])
        longest = np.zeros(len(self.curves))
        np.maximum.at(longest, rims, arcs)
        return np.asarray(arcs < longest[rims] / 4)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The nodes of each side."""
        return slices([len(side.weights) for side in self.sides])

    @cached_property
    def columns(self) -> tuple[slice, ...]:
        """The modes of each side."""
        return slices([side.degree + 1 if side.corners else 2 * side.frequencies - 1 for side in self.sides])

    @cached_property
    def modes(self) -> Float[np.ndarray, "n k"]:
        """All modes at all nodes."""
        modes = np.zeros((self.rows[-1].stop, self.columns[-1].stop))
        for side, rows, columns in zip(self.sides, self.rows, self.columns, strict=True):
            modes[rows, columns] = side.modes(side.shares)
        return modes

    def by_modes(self, values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "k c"]:
        """Products of the modes with values at the nodes. Each mode is 0 but on one side."""
        return np.concatenate(
            [self.modes[rows, columns].T @ values[rows] for rows, columns in zip(self.rows, self.columns, strict=True)]
        )

    @cached_property
    def _bases(self) -> Float[np.ndarray, " n"]:
        return np.concatenate([side.base(side.shares) for side in self.sides])

    @cached_property
    def rim_of_node(self) -> Int[np.ndarray, " n"]:
        """The rim of each node."""
        return np.repeat([side.rim for side in self.sides], [len(side.weights) for side in self.sides])

    @property
    def corners(self) -> int:
        """Number of all corners."""
        return len(self.rim_of_corner)

    def points(self, coefficients: Float[np.ndarray, " k"]) -> Float[np.ndarray, "3 n 3"]:
        """Γ at the nodes, and its first two derivatives with respect to the sum of the modes."""
        parts, sums = [], self._bases + self.modes @ coefficients
        for side, rows in zip(self.sides, self.rows, strict=True):
            s, first, second = side.slide(sums[rows])
            point, tangent, bend = self.curves[side.rim].point_and_derivatives(s)
            along = bend * (first**2)[:, None] + tangent * second[:, None]
            parts.append(np.stack([point, tangent * first[:, None], along]))
        return np.concatenate(parts, axis=1)


def slices(sizes: Sequence[int]) -> tuple[slice, ...]:
    """The parts of an array with given lengths, one after the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return tuple(map(slice, ends[:-1], ends[1:]))
