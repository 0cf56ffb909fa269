"""Harmonic surfaces between several rims of which some have corners, and Newton's method for Douglas's energy.

Ω is the unit disk less round holes. Harmonic functions are real parts of Laurent series, logarithms, and poles that are
clustered exponentially towards the image of each corner. The energy of boundary values is the maximum over these
functions (Galerkin), so that its errors are of second order. On the sides between corners slides are logit s =
a log u − b log (1 − u) + Chebyshev polynomials of tanh, u the share of the side's arc in ∂Ω: at a corner of angle α of
the surface s ~ u^(α/π). The unknowns are coefficients of the slides, the arguments of the corners' images, and the
circles. The Hessian is exact.

Source: Gopal & Trefethen, "Solving Laplace problems with corner singularities via rational functions", SIAM J. Numer.
Anal. 57 (2019), for the poles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from numpy.polynomial import Chebyshev

from spinor_geom.arrays import cis
from spinor_geom.deadline import require_time
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import UnresolvedRimsError
from spinor_geom.holomorphic.circular_domain import turned, turned_circles
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.steps import Steps

_GAUSS = 10  # nodes of a panel; with 8 areas are off by 1e-6, with 12 steps take a third longer
_DECAY = 4.0  # σ in the distances exp(−σ(√n − √k)) of poles from a corner
_MODES = 12  # degree of the Chebyshev polynomials of a side's slide
_POWERS = 8  # powers of a circle's coordinate for each of its sides
_HALVINGS = 24  # of the panels towards a corner with α = π/2; fewer for larger angles
_LEAST_HALVINGS = 10
_EVEN = 0.0625, 0.125, 0.25, 0.375, 0.5  # ends of panels far from corners
_DEPENDENT = 1e-14  # eigenvalues below this share of the largest are dropped: functions are nearly dependent
_NEGLIGIBLE = 1e-10  # expected relative decrease of the energy at which Newton's method ends
# Expected relative decrease at which it ends too if a step does not reduce that by the second factor: where rims nearly
# touch, the energy hardly depends on some slides.
_ENOUGH, _SLOW = 1e-6, 0.25
_FLAT = 1e-9  # relative curvature treated as 0
_MOST_STEPS = 40
_LARGEST_STEPS = 2.0, 0.5  # of logit s, and of arguments, logarithms of radii and centres
_MORE_DAMPING = 4.0  # factor of the damping, until a step is short enough
_LEAST_LENGTH = 1e-3  # of a step that lowers the energy
# Poles between circles that nearly touch: the first distance from a circle, in radii, and the ratio of distances
_FIRST_DISTANCE, _RATIO = 0.6, 0.75
# Share of a side near a corner, and the largest |φ·φ|/|φ|² there where the assumed angle is kept. Films that leave a
# corner outwards have its own angle at last; above this number areas by the rest of a full turn are off by 1e-6.
_NEAR, _CONFORMAL = 3e-3, 0.4
_CONTINUED = 1e-2  # least share of a side from which slides are fitted at a corner whose angle was wrong
# Density of modes at gaps between circles, and degree of its polynomial
_CROWDING, _GAP_DEGREE = 0.25, 200
ROUGHLY = 1e-4  # relative decrease of the energy at which gaps between circles are known well enough for modes
_SMOOTHING = 0.8  # factor of each power in holomorphic fields through the corners, so that low powers prevail
# Newton's method goes on over a conformal image of Ω when the mean of holes and corners is this far from 0
_UNEVEN = 0.2
_SPREADING_STEPS = 30  # of the maps to that image
_MARGIN = 1e-13  # least distance of parameters from those of corners, because Γ′ there is that of the next side


_Shares: TypeAlias = Float[np.ndarray, "*n"]


def _evenly(u: _Shares) -> _Shares:
    return u


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """A part of a rim between corners, or a whole rim without corners, with its nodes and the modes of its slide."""

    rim: int
    corners: tuple[int, int] | None  # numbers of its ends among all corners; None for a whole rim
    start: float  # curve parameter of its first end
    length: float  # in the curve parameter
    exponents: tuple[float, float]  # angles of the surface at its ends, over π
    frequencies: int  # of the Fourier modes of a whole rim
    shares: Float[np.ndarray, "2 n"]  # u and 1 − u
    weights: Float[np.ndarray, " n"]  # of integrals over u
    place: Callable[[_Shares], _Shares] = (
        _evenly  # v as a function of u in [0, 1]: slides are smooth functions of v, also at narrow gaps
    )

    @classmethod
    def between(
        cls,
        rim: int,
        corners: tuple[int, int],
        start: float,
        length: float,
        exponents: tuple[float, float],
        place: Callable[[_Shares], _Shares] = _evenly,
    ) -> Side:
        """A side between two corners."""
        (ahead, ahead_weights), (back, back_weights) = map(_graded, exponents)
        return cls(
            rim=rim,
            corners=corners,
            start=start,
            length=length,
            exponents=exponents,
            frequencies=0,
            shares=np.stack([np.concatenate([ahead, 1 - back[::-1]]), np.concatenate([1 - ahead, back[::-1]])]),
            weights=np.concatenate([ahead_weights, back_weights[::-1]]),
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
        # powers of u in s are half-integers at right angles
        flattening = min(sum(self.exponents) / 2, 1.0)
        first, last = self._logarithms(shares)
        return np.asarray(np.polynomial.chebyshev.chebvander(np.tanh(flattening * (first - last) / 2), _MODES))

    def _logarithms(self, shares: Float[np.ndarray, "2 n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Logarithms of v and 1 − v at given u and 1 − u."""
        v = self.place(shares[0])
        start, end = self.place(np.array([0.0, 1.0]))
        return np.log(v - start), np.log(end - v)

    def slide(self, sums: Float[np.ndarray, " n"]) -> Float[np.ndarray, "3 n"]:
        """The curve parameter and its first two derivatives with respect to the sum of `base` and modes."""
        if self.corners is None:
            return np.stack([sums, np.ones_like(sums), np.zeros_like(sums)])
        share, rest = (1 / (1 + np.exp(-sign * sums)) for sign in (1, -1))
        slope = self.length * share * rest
        inside = np.clip(self.length * share, _MARGIN, self.length - _MARGIN)
        return np.stack([self.start + inside, slope, slope * (rest - share)])


def _halvings(exponent: float) -> int:
    """Number of halvings of the panels towards a corner."""
    return int(np.clip(_HALVINGS / 2 / exponent, _LEAST_HALVINGS, _HALVINGS))


def _cluster(exponent: float, arc: float) -> Float[np.ndarray, " k"]:
    """Distances of the poles at a corner, down to the length of the last panel on a side with a given arc."""
    depth = _halvings(exponent) * math.log(2) - min(math.log(arc), 0.0)
    count = int((1 + depth / _DECAY) ** 2)
    return np.exp(-_DECAY * (math.sqrt(count) - np.sqrt(np.arange(1, count + 1))))


def _graded(exponent: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights on [0, 1/2], on panels that are quartered towards 0."""
    ends = np.concatenate([[0.0], 0.5 ** np.arange(_halvings(exponent), 4, -2), _EVEN])
    x, w = rule("gauss", _GAUSS)
    width = np.diff(ends)[:, None]
    return (ends[:-1, None] + width * x).ravel(), (width * w).ravel()


@dataclass(frozen=True, kw_only=True, eq=False)
class CorneredRims:
    """Curves in the order and direction of the boundaries of Ω, with the nodes and modes of their slides."""

    curves: tuple[CurveTensors, ...]
    sides: tuple[Side, ...]
    rim_of_corner: Int[np.ndarray, " c"]
    exponents: Float[np.ndarray, " c"]  # angles of the surface at the corners, over π
    powers: tuple[int, ...]  # of each circle's coordinate

    @classmethod
    def of(
        cls,
        curves: Sequence[CurveTensors],
        corners: Sequence[Float[np.ndarray, " _"]],
        exponents: Sequence[Float[np.ndarray, " _"]],
        frequencies: Sequence[int],
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
                sides.append(Side.between(rim, (first + k, first + following), float(own[k]), length, ends))
            powers.append(max(_POWERS * count, frequencies[rim]))
            first += count
        rim_of_corner = np.repeat(np.arange(len(corners)), [len(own) for own in corners])
        return cls(
            curves=tuple(curves),
            sides=tuple(sides),
            rim_of_corner=rim_of_corner,
            exponents=np.concatenate(exponents),
            powers=tuple(powers),
        )

    def adapted(self, exponents: Float[np.ndarray, " c"], circles: Circles) -> CorneredRims:
        """The rims with other exponents, and modes that resolve the gaps between given circles."""
        sides = tuple(
            side
            if side.corners is None
            else Side.between(
                side.rim,
                side.corners,
                side.start,
                side.length,
                (float(exponents[side.corners[0]]), float(exponents[side.corners[1]])),
                circles.places(side),
            )
            for side in self.sides
        )
        return replace(self, sides=sides, exponents=exponents)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The nodes of each side."""
        return _slices([len(side.weights) for side in self.sides])

    @cached_property
    def columns(self) -> tuple[slice, ...]:
        """The modes of each side."""
        return _slices([_MODES + 1 if side.corners else 2 * side.frequencies - 1 for side in self.sides])

    @cached_property
    def modes(self) -> Float[np.ndarray, "n k"]:
        """All modes at all nodes."""
        modes = np.zeros((self.rows[-1].stop, self.columns[-1].stop))
        for side, rows, columns in zip(self.sides, self.rows, self.columns, strict=True):
            modes[rows, columns] = side.modes(side.shares)
        return modes

    def by_modes(self, values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "k c"]:
        """Products of the modes with values at the nodes; each mode is 0 but on one side."""
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


def _slices(sizes: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *sizes]).tolist()
    return tuple(map(slice, ends[:-1], ends[1:]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Circles:
    """The circles of ∂Ω, and the images of corners on them. The first circle is the unit circle."""

    centres: Complex[np.ndarray, " m"]
    log_radii: Float[np.ndarray, " m"]
    arguments: Float[np.ndarray, " c"]  # of the corners, in the direction of ∂Ω: clockwise around holes

    @property
    def radii(self) -> Float[np.ndarray, " m"]:
        """Radii of all circles."""
        return np.asarray(np.exp(self.log_radii))

    @property
    def signs(self) -> Float[np.ndarray, " m"]:
        """1 for the outer circle, −1 for holes."""
        return np.where(np.arange(len(self.centres)) == 0, 1.0, -1.0)

    def images(self, rim_of_corner: Int[np.ndarray, " c"]) -> Complex[np.ndarray, " c"]:
        """Images of the corners."""
        turn = cis(self.signs[rim_of_corner] * self.arguments)
        return np.asarray(self.centres[rim_of_corner] + self.radii[rim_of_corner] * turn)

    def arc(self, side: Side) -> tuple[float, float]:
        """The argument of the first end of a side, and the length of its arc."""
        if side.corners is None:
            return 0.0, 2 * np.pi
        first, last = self.arguments[list(side.corners)].tolist()
        return first, (last - first) % (2 * np.pi) or 2 * np.pi

    def places(self, side: Side) -> Chebyshev:
        """`Side.place` that is steep where other circles are near: about the conformal coordinate of a narrow gap."""
        first, arc = self.arc(side)
        radius = self.radii[side.rim]

        def slope(u: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            z = self.centres[side.rim] + radius * cis(self.signs[side.rim] * (first + arc * u))
            gaps = np.abs(np.abs(z - self.centres[:, None]) - self.radii[:, None])
            return np.asarray(1 + _CROWDING * arc * radius * (1 / np.delete(gaps, side.rim, axis=0)).sum(axis=0))

        whole = Chebyshev.interpolate(slope, _GAP_DEGREE, domain=[0, 1]).integ(lbnd=0)
        scaled: Chebyshev = whole / float(whole(1.0))
        return scaled

    def _marks(self, rim_of_corner: Int[np.ndarray, " c"]) -> Complex[np.ndarray, " k"]:
        """Images of corners on the outer circle, and centres of holes."""
        return np.concatenate([self.images(rim_of_corner)[rim_of_corner == 0], self.centres[1:]])

    def unevenness(self, rim_of_corner: Int[np.ndarray, " c"]) -> float:
        """Distance of the mean of holes and corners of the outer circle from 0."""
        return float(np.abs(self._marks(rim_of_corner).mean()))

    def spread(self, rim_of_corner: Int[np.ndarray, " c"]) -> tuple[Circles, list[complex]]:
        """A conformal image with `unevenness` 0, and the points for `turned` that lead to it."""
        circles, points = self, []
        for _ in range(_SPREADING_STEPS):
            points.append(complex(circles._marks(rim_of_corner).mean()) / 2)
            circles = circles.turned(points[-1], rim_of_corner)
        return circles, points

    def turned(self, to: complex, rim_of_corner: Int[np.ndarray, " c"]) -> Circles:
        """The image by the conformal map of the unit disk onto itself that moves a point to 0."""
        centres, radii = turned_circles(self.centres, self.radii, to)
        centres[0], radii[0] = 0.0, 1.0
        arguments = self.signs[rim_of_corner] * np.angle(
            turned(self.images(rim_of_corner), to) - centres[rim_of_corner]
        )
        for rim in np.unique(rim_of_corner):
            own = rim_of_corner == rim
            arguments[own] = arguments[own][0] + (arguments[own] - arguments[own][0]) % (2 * np.pi)
        return Circles(centres=centres, log_radii=np.log(radii), arguments=arguments)

    def moved(self, step: Float[np.ndarray, " p"]) -> Circles:
        """The circles after a step of all arguments, then of x, y and log radius of each hole."""
        count = len(self.arguments)
        x, y, log = step[count:].reshape(-1, 3).T
        return Circles(
            centres=self.centres + np.append(0.0, x + 1j * y),
            log_radii=self.log_radii + np.append(0.0, log),
            arguments=self.arguments + step[:count],
        )

    def is_domain(self, rim_of_corner: Int[np.ndarray, " c"]) -> bool:
        """Whether no circles meet and the corners are in order."""
        for rim in np.unique(rim_of_corner):
            own = self.arguments[rim_of_corner == rim]
            if not (np.diff(np.append(own, own[0] + 2 * np.pi)) > 0).all():
                return False
        return bool((self.gaps[~np.eye(len(self.centres), dtype=bool)] > 0).all())

    @cached_property
    def gaps(self) -> Float[np.ndarray, "m m"]:
        """Widths of the gaps between circles; 0 on the diagonal."""
        radii = self.radii
        gaps = np.abs(self.centres[:, None] - self.centres) - radii[:, None] - radii
        gaps[0] = gaps[:, 0] = 1 - np.abs(self.centres) - radii
        np.fill_diagonal(gaps, 0.0)
        return np.asarray(gaps)

    def _arcs(self, rim_of_corner: Int[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
        """The shorter arc beside each corner."""
        arcs = np.empty(len(rim_of_corner))
        for rim in np.unique(rim_of_corner):
            own = rim_of_corner == rim
            ahead = np.diff(np.append(self.arguments[own], self.arguments[own][0] + 2 * np.pi))
            arcs[own] = np.minimum(ahead, np.roll(ahead, 1))
        return arcs

    def poles(
        self, rim_of_corner: Int[np.ndarray, " c"], exponents: Float[np.ndarray, " c"]
    ) -> tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Poles at corners and between circles that nearly touch, and their distances from the circles."""
        radii, signs = self.radii, self.signs
        rims, directions, distances = [], [], []
        turns = cis(signs[rim_of_corner] * self.arguments)
        arcs = self._arcs(rim_of_corner)
        for rim, direction, exponent, arc in zip(rim_of_corner, turns, exponents, arcs, strict=True):
            cluster = _cluster(float(exponent), float(arc))
            rims.append(np.full(len(cluster), rim))
            directions.append(np.full(len(cluster), direction))
            # the poles of a hole stay between its circle and its centre
            distances.append(cluster * radii[rim] * (1.0 if rim == 0 else 0.5))
        for rim, other in zip(*np.nonzero(~np.eye(len(radii), dtype=bool)), strict=True):
            towards = self.centres[other] - self.centres[rim]
            towards = -towards if other == 0 else towards
            nearest = math.sqrt(self.gaps[rim, other] * min(radii[rim], radii[other]))
            reach = nearest / (_FIRST_DISTANCE * radii[rim])
            count = math.ceil(math.log(reach) / math.log(_RATIO)) if reach < 1 else 0
            if towards != 0 and count:
                rims.append(np.full(count, rim))
                directions.append(np.full(count, towards / abs(towards)))
                distances.append(_FIRST_DISTANCE * radii[rim] * _RATIO ** np.arange(count))
        rim, direction, distance = map(np.concatenate, (rims, directions, distances))
        return self.centres[rim] + direction * (radii[rim] + signs[rim] * distance), distance


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """Velocities v of points of ∂Ω by the moduli: arguments of corners, then x, y and log radius of each hole."""

    velocities: Complex[np.ndarray, "n p"]
    along: Complex[np.ndarray, "n p"]  # dv between nodes, times the weights
    turns: Complex[np.ndarray, "n p"]  # v/(z − c) of the velocities that turn or enlarge a circle, 0 for the others
    around: Complex[np.ndarray, " n"]  # z − c


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerForm:
    """Dirichlet's form Λ for values at the nodes of rims with corners, and the functions that it is made of."""

    rims: CorneredRims
    circles: Circles

    @cached_property
    def nodes(self) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """The nodes z on ∂Ω, and dz times the weights."""
        parts = [self._on(side) for side in self.rims.sides]
        z = [self.circles.centres[side.rim] + e for side, (e, _) in zip(self.rims.sides, parts, strict=True)]
        return np.concatenate(z), np.concatenate([step for _, step in parts])

    def _on(self, side: Side) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """The nodes of a side relative to the centre of its circle, and dz times the weights."""
        sign, (u, rest) = self.circles.signs[side.rim], side.shares
        first, arc = self.circles.arc(side)
        # from the nearer end, because nodes at corners are less than rounding errors of the argument apart
        argument = np.where(u < 0.5, first + arc * u, first + arc - arc * rest)
        e = self.circles.radii[side.rim] * cis(sign * argument)
        return e, 1j * sign * arc * side.weights * e

    def functions(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "3 n k"]:
        """The functions whose real parts span harmonic functions, and their first two derivatives.

        The last ones, one for each hole, are log|z − c|, with the derivatives of log(z − c).
        """
        at = z[:, None]
        k = np.arange(1, self.rims.powers[0] + 1)
        power = at ** np.maximum(k - 2, 0)
        slope = np.where(k > 1, power * at, 1.0)
        columns = [np.stack([slope * at, k * slope, k * (k - 1) * power])]
        for c, radius, count in zip(
            self.circles.centres[1:], self.circles.radii[1:], self.rims.powers[1:], strict=True
        ):
            inverse, k = 1 / (at - c), np.arange(1, count + 1)
            value = (radius * inverse) ** k
            columns.append(np.stack([value, -k * value * inverse, k * (k + 1) * value * inverse**2]))
        poles, distances = self.circles.poles(self.rims.rim_of_corner, self.rims.exponents)
        inverse = 1 / (at - poles)
        value = distances * inverse
        columns.append(np.stack([value, -value * inverse, 2 * value * inverse**2]))
        inverse = 1 / (at - self.circles.centres[1:])
        columns.append(np.stack([-np.log(np.abs(inverse)) + 0j, inverse, -(inverse**2)]))
        return np.concatenate(columns, axis=2)

    @cached_property
    def at_nodes(self) -> Complex[np.ndarray, "3 n k"]:
        """`functions` at the nodes."""
        return self.functions(self.nodes[0])

    @cached_property
    def _galerkin(self) -> tuple[Float[np.ndarray, "n r"], Float[np.ndarray, "k2 r"]]:
        """Y with Λ = Y Yᵀ, and the matrix from Yᵀ X to coefficients of the harmonic function."""
        logarithms = len(self.circles.centres) - 1
        value, slope, _ = self.at_nodes
        flux = slope * self.nodes[1][:, None]
        values = np.concatenate([value.real, value.imag[:, :-logarithms]], axis=1)
        normals = np.concatenate([flux.imag, -flux.real[:, :-logarithms]], axis=1)
        scale = np.abs(values).max(axis=0)
        gram = (values / scale).T @ (normals / scale)
        sizes, vectors = np.linalg.eigh((gram + gram.T) / 2)
        kept = sizes > _DEPENDENT * sizes[-1]
        basis = vectors[:, kept] / np.sqrt(sizes[kept]) / scale[:, None]
        return normals @ basis, basis

    @property
    def root(self) -> Float[np.ndarray, "n r"]:
        """Y with Λ = Y Yᵀ, integrals between nodes."""
        return self._galerkin[0]

    def coefficients(self, values: Float[np.ndarray, "n c"]) -> Complex[np.ndarray, "k c"]:
        """Coefficients of the functions whose real part has given values at the nodes."""
        both = self._galerkin[1] @ (self.root.T @ values)
        count = self.at_nodes.shape[2]
        imaginary = np.zeros((count, values.shape[1]))
        imaginary[: len(both) - count] = both[count:]
        return np.asarray(both[:count] - 1j * imaginary)

    @cached_property
    def moves(self) -> Moves:
        """The velocities of the nodes."""
        count = self.rims.corners + 3 * (len(self.circles.centres) - 1)
        velocities, along, turns = np.zeros((3, len(self.nodes[0]), count), dtype=np.complex128)
        around = np.empty_like(self.nodes[0])
        for side, rows in zip(self.rims.sides, self.rims.rows, strict=True):
            e, step = self._on(side)
            around[rows], sign = e, 1j * self.circles.signs[side.rim]
            for corner, share, slope in zip(side.corners or (), side.shares[::-1], (-1.0, 1.0), strict=False):
                turns[rows, corner] += sign * share
                along[rows, corner] += sign * (step * share + e * slope * side.weights)
            if side.rim:
                first = self.rims.corners + 3 * (side.rim - 1)
                velocities[rows, first : first + 2] = 1.0, 1j
                turns[rows, first + 2], along[rows, first + 2] = 1.0, step
        return Moves(velocities=velocities + around[:, None] * turns, along=along, turns=turns, around=around)

    @cached_property
    def moves_of_corners(self) -> Moves:
        """The velocities of the images of corners."""
        rims, circles = self.rims.rim_of_corner, self.circles
        own, count = np.arange(len(rims)), len(rims) + 3 * (len(circles.centres) - 1)
        velocities, turns = np.zeros((2, len(rims), count), dtype=np.complex128)
        turns[own, own] = 1j * circles.signs[rims]
        on_hole = own[rims > 0]
        first = len(rims) + 3 * (rims[on_hole] - 1)
        velocities[on_hole, first], velocities[on_hole, first + 1], turns[on_hole, first + 2] = 1.0, 1j, 1.0
        around = circles.images(rims) - circles.centres[rims]
        return Moves(velocities=velocities + around[:, None] * turns, along=0 * velocities, turns=turns, around=around)


@dataclass(frozen=True, kw_only=True, eq=False)
class CorneredSurface:
    """A harmonic surface between rims with corners, and derivatives of its energy."""

    form: CornerForm
    slides: Float[np.ndarray, " k"]  # coefficients of the modes

    @cached_property
    def _points(self) -> Float[np.ndarray, "3 n 3"]:
        return self.form.rims.points(self.slides)

    @cached_property
    def _projected(self) -> Float[np.ndarray, "r 3"]:
        return np.asarray(self.form.root.T @ self._points[0])

    @property
    def energy(self) -> float:
        """The Dirichlet energy: the area of a conformal surface."""
        return float((self._projected**2).sum() / 2)

    @cached_property
    def coefficients(self) -> Complex[np.ndarray, "k 3"]:
        """Coefficients of `CornerForm.functions`."""
        return self.form.coefficients(self._points[0])

    def null_curve(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
        """φ = 2∂X/∂z in Ω."""
        return np.asarray(self.form.functions(z)[1] @ self.coefficients)

    def are_conformal_at_corners(self) -> Bool[np.ndarray, " c"]:
        """Whether the surface is conformal near each corner, as it is if the assumed angle is right."""
        rims = self.form.rims
        phi = self.form.at_nodes[1] @ self.coefficients
        defects = np.abs((phi * phi).sum(1)) / (np.abs(phi) ** 2).sum(1)
        largest = np.zeros(rims.corners)
        for side, rows in zip(rims.sides, rims.rows, strict=True):
            for corner, share in zip(side.corners or (), side.shares, strict=False):
                largest[corner] = max(largest[corner], np.median(defects[rows][abs(np.log10(share / _NEAR)) < 0.5]))
        return largest < _CONFORMAL

    def refitted(self, exponents: Float[np.ndarray, " c"]) -> CorneredSurface:
        """The surface with other angles at corners, over π, and modes for its gaps between circles."""
        form, old = self.form, self.form.rims
        rims = old.adapted(exponents, form.circles)
        slides = self.slides.copy()
        for before, after, columns in zip(old.sides, rims.sides, rims.columns, strict=True):
            if after.corners is None:
                continue
            # beyond the range of another angle, the sum of the modes is continued as a constant
            least = [_CONTINUED if a != b else 0.0 for a, b in zip(before.exponents, after.exponents, strict=True)]
            u = np.clip(after.shares[0], least[0], 1 - least[1])
            shares = np.stack([u, np.maximum(after.shares[1], least[1])])
            sums = before.base(shares) + before.modes(shares) @ self.slides[columns] - after.base(shares)
            slides[columns] = np.linalg.lstsq(after.modes(after.shares), sums, rcond=None)[0]
        return CorneredSurface(form=replace(form, rims=rims), slides=slides)

    def derivatives(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
        """Gradient and Hessian of the energy in the coefficients of slides, then the moduli.

        Where the domain moves with velocity v, dE = −½ Im ∮ φ·φ v dz. Fields that are holomorphic in Ω change nothing.
        One is subtracted from each v, so that v = 0 at corners: φ v has finite energy then.
        """
        form = self.form
        (_, tangent, bend), modes, root = self._points, form.rims.modes, form.root
        normal = root @ self._projected
        pull = (tangent * normal).sum(1)
        turned = form.rims.by_modes((tangent[:, :, None] * root[:, None]).reshape(len(root), -1)).reshape(
            len(modes.T), -1
        )
        own = form.rims.by_modes((bend * normal).sum(1)[:, None] * modes) + turned @ turned.T
        (_, steps), (_, slopes, bends) = form.nodes, form.at_nodes
        phi, phi_slope = slopes @ self.coefficients, bends @ self.coefficients
        moves, second = self._vanishing_moves()
        velocities, along = moves.velocities, moves.along
        squares = (phi * phi).sum(1)
        n, count = velocities.shape
        carried = phi[:, :, None] * velocities[:, None]
        changes = phi_slope[:, :, None] * (velocities * steps[:, None])[:, None] + phi[:, :, None] * along[:, None]
        displaced = root.T @ carried.real.reshape(n, -1)
        normals = changes.imag.reshape(n, -1) - root @ displaced  # derivatives of ΛX
        mixed = form.rims.by_modes((tangent[:, :, None] * normals.reshape(n, 3, count)).sum(1))
        displaced = displaced.reshape(-1, count)
        by_moduli = displaced.T @ displaced - carried.real.reshape(-1, count).T @ changes.imag.reshape(-1, count)
        by_moduli += 0.5 * ((squares[:, None] * velocities).T @ along - second(squares * steps)).imag
        gradient = np.concatenate([modes.T @ pull, -0.5 * ((squares * steps) @ velocities).imag])
        return gradient, np.block([[own, mixed], [mixed.T, (by_moduli + by_moduli.T) / 2]])

    def _vanishing_moves(self) -> tuple[Moves, Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, "p p"]]]:
        """Velocities less holomorphic fields w with the same values at the corners, and integrals of their changes.

        The change of field j by a move along field i is ∂_i v_j − w_i′ v_j − (v_i − w_i) w_j′, again less a holomorphic
        field. The function takes weights of the nodes.
        """
        moves, at_corners = self.form.moves, self.form.moves_of_corners
        (z, steps), rim_of_corner = self.form.nodes, self.form.rims.rim_of_corner
        value, slope = self._smooth_functions(z)
        corner_value, corner_slope = self._smooth_functions(self.form.circles.images(rim_of_corner))
        through = np.linalg.pinv(corner_value)
        fields = through @ at_corners.velocities
        slopes, corner_slopes = slope @ fields, corner_slope @ fields
        less = moves.velocities - value @ fields
        at_corner = (at_corners.around[:, None] * at_corners.turns)[:, :, None] * at_corners.turns[:, None]
        at_corner = at_corner - corner_slopes[:, :, None] * at_corners.velocities[:, None]

        def second(weights: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "p p"]:
            at = weights[:, None]
            whole = (at * moves.around[:, None] * moves.turns).T @ moves.turns
            whole = whole - (at * slopes).T @ moves.velocities - (at * less).T @ slopes
            return np.asarray(whole - np.tensordot(weights @ value @ through, at_corner, 1))

        return replace(moves, velocities=less, along=moves.along - slopes * steps[:, None]), second

    def _smooth_functions(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "2 n k"]:
        """Powers of all circles' coordinates, with decreasing factors, and their derivatives: more than corners."""
        circles, count = self.form.circles, self.form.rims.corners
        at, k = z[:, None], np.arange(count + 3)
        power = at ** np.maximum(k - 1, 0)
        columns = [np.stack([np.where(k > 0, power * at, 1.0), k * power]) * _SMOOTHING**k]
        k = np.arange(1, count // 2 + 3)
        for c, radius in zip(circles.centres[1:], circles.radii[1:], strict=True):
            inverse = 1 / (at - c)
            value = (radius * inverse * _SMOOTHING) ** k
            columns.append(np.stack([value, -k * value * inverse]))
        return np.concatenate(columns, axis=2)

    def stepped(self, step: Float[np.ndarray, " k"]) -> CorneredSurface | None:
        """The surface after a step; None if circles would meet."""
        count, form = len(self.slides), self.form
        circles = form.circles.moved(step[count:])
        if not circles.is_domain(form.rims.rim_of_corner):
            return None
        return CorneredSurface(form=replace(form, circles=circles), slides=self.slides + step[:count])

    def spread(self) -> CorneredSurface:
        """The surface over a conformal image of Ω whose holes and corners are spread evenly."""
        form = self.form
        circles, points = form.circles.spread(form.rims.rim_of_corner)
        image = replace(form, circles=circles)
        z = image.nodes[0]
        for point in reversed(points):
            z = turned(z, -point)
        slides = np.empty_like(self.slides)
        angles = np.angle(z - form.circles.centres[form.rims.rim_of_node])
        for side, rows, columns in zip(form.rims.sides, form.rims.rows, form.rims.columns, strict=True):
            first, arc = form.circles.arc(side)
            # from the nearer end, as the nodes
            ends = form.circles.signs[side.rim] * angles[rows] - np.array([[first], [first + arc]])
            near, far = ends[0] % (2 * np.pi), -ends[1] % (2 * np.pi)
            shares = np.where(side.shares[0] < 0.5, [near, arc - near], [arc - far, far]) / arc
            modes = form.rims.modes[rows, columns]
            sums = side.base(shares) + side.modes(shares) @ self.slides[columns]
            if side.corners is None:  # s − u is continuous
                sums += np.round(side.shares[0] + (sums - shares[0]).mean() - sums)
            slides[columns] = np.linalg.lstsq(modes, sums - side.base(side.shares), rcond=None)[0]
        return CorneredSurface(form=image, slides=slides)

    @property
    def is_free(self) -> Bool[np.ndarray, " k"]:
        """Which unknowns vary: conformal maps of the unit disk fix the centre of the first hole and one argument."""
        count, corners = len(self.slides), self.form.rims.corners
        is_free = np.ones(count + corners + 3 * (len(self.form.circles.centres) - 1), dtype=bool)
        is_free[[count, count + corners, count + corners + 1]] = False
        return is_free


def stationary(start: CorneredSurface, steps: Steps, negligible: float = _NEGLIGIBLE) -> tuple[CorneredSurface, int]:
    """The critical point of the energy that damped Newton steps from a start lead to, and its Morse index.

    Negative curvature is reversed. Long steps are damped, and shortened until they lower the energy.

    Raises:
        OutOfTimeError: time ran out.
        UnresolvedRimsError: the steps do not converge.
    """
    here, is_free, before = start, start.is_free, math.inf
    for _ in range(_MOST_STEPS):
        require_time()
        if here.form.circles.unevenness(here.form.rims.rim_of_corner) > _UNEVEN:
            here = here.spread()
        gradient, hessian = here.derivatives()
        gradient, hessian = gradient[is_free], hessian[np.ix_(is_free, is_free)]
        diagonal = np.abs(np.diag(hessian))
        unit = 1 / np.sqrt(np.maximum(diagonal, _FLAT * diagonal.max()))
        curvatures, vectors = np.linalg.eigh(unit[:, None] * hessian * unit)
        sizes, pull, step = np.abs(curvatures), (unit * gradient) @ vectors, np.zeros(len(is_free))
        damping = _FLAT * sizes.max()
        while True:
            step[is_free] = -unit * (vectors @ (pull / (sizes + damping)))
            if max(_extents(here, step)) <= 1:
                break
            damping *= _MORE_DAMPING
        fall = -float(step[is_free] @ gradient)
        steps.take("Douglas-Newton", math.sqrt(abs(fall) / here.energy))
        is_slow, before = _SLOW * before < fall < _ENOUGH * here.energy, fall
        if fall < negligible * here.energy or is_slow:
            return here, int(np.count_nonzero(curvatures < -_FLAT * sizes.max()))
        there = _lower(here, step)
        if there is None:
            break
        here = there
    if fall < _ENOUGH * here.energy:
        return here, int(np.count_nonzero(curvatures < -_FLAT * sizes.max()))
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
