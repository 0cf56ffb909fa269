"""Discretisations of p and q on ∂Ω: coefficients of each circle's powers, or values at nodes.

Every rim has a parameter τ from 0 to 2π, with Ω on its left. The last axes of a `functions` array are the rims, and the
coefficients or nodes of each. The spinors are divided by the product of √(z − c_j) over the holes around which they
change sign. The square of this product is part of the `weights`, so that φ dz/dτ = φ(p, q) · weights.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import EPS, Array, Place, complex_of, contiguous, indices, namespace, place_of, zeros
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.holomorphic.arnoldi import arnoldi_basis
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import ROUND_OFF, LaurentSeries, parts_on_circles, sums_on_circles
from spinor_geom.holomorphic.series import PowerSeries, power_table
from spinor_geom.mesh.piece_polynomials import ANALYTIC_DEGREE
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm, DirichletForm, derivative
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi


@dataclass(frozen=True, kw_only=True, eq=False)
class OnCircles:
    """Functions on the unit disk less round holes, if any: coefficients of the powers of each circle's coordinate."""

    domain: CircularDomain  # Ω
    nodes: int  # n, of every rim
    antiperiodic: tuple[bool, ...] = ()  # for each hole: whether p and q change sign around it

    @classmethod
    def of(cls, domain: CircularDomain, slope: Complex[Array, "m n 3"]) -> OnCircles:
        """The discretisation with the sign changes of the spinors of a harmonic surface, from its φ dz/dτ."""
        n = slope.shape[1]
        is_periodic = signs_close_up(*spinors_from_phi(slope / domain.velocities(n)[..., None]))
        return cls(domain=domain, nodes=n, antiperiodic=tuple((~is_periodic[1:]).tolist()))

    def weights(self, n: int) -> Complex[Array, "m n"]:
        """dz/dτ at n equal steps of every rim, times the square of the divisor of p and q."""
        return self.domain.velocities(n) * self.domain.squared_root(self.domain.circles(n), self.antiperiodic)

    def functions(self, spinors: Complex[Array, "b 2 m n"]) -> Complex[Array, "b 2 m k"]:
        """Coefficients from values at the nodes, whose sign on each rim is arbitrary."""
        n = self.nodes
        xp = namespace(spinors)
        own = xp.fft.fft(spinors, norm="forward")[..., : n // 2]
        if self.domain.rims == 1:
            return own
        own[..., 1:, 0] = 0
        # the signs for which the values on a circle agree best with the powers of the other circles
        parts = parts_on_circles(self.domain, own, n)
        agreement = (spinors[..., None, :] * parts.conj()).sum((0, 1, -1)).real
        each = xp.arange(len(agreement))
        agreement[each, each] = 0.0
        vector = xp.linalg.eigh(agreement + agreement.mT)[1][:, -1]
        return own * xp.where(vector * vector[0] < 0, -xp.ones_like(vector), 1.0)[:, None]

    def values(self, functions: Complex[Array, "*rows m k"], n: int) -> Complex[Array, "*rows m n"]:
        """Values at n equal steps of every rim."""
        return sums_on_circles(self.domain, functions, n)

    def integral(self, f: Complex[Array, "*rows m n"]) -> Complex[Array, "*rows m n"]:
        """∫ f dτ along all rims, with log |z − c| in place of log(z − c)."""
        n, xp = f.shape[-1], namespace(f)
        spectrum = xp.fft.fft(f, norm="forward")[..., : n // 2]
        own = spectrum * _integrating(n, place_of(f))[: n // 2]
        total = self.values(own, n)
        if self.domain.rims > 1:
            logarithms = xp.log(abs(self.domain.circles(n)[None] - self.domain.centres[:, None, None]))
            # the holes run clockwise
            total = total + xp.tensordot(1j * spectrum[..., 1:, 0], logarithms + 0j, axes=1)
        return total

    @cached_property
    def powers(self) -> Complex[Array, "f m k"]:
        """Coefficients of the low powers of each circle's coordinate."""
        m, number = self.domain.rims, np.arange(self._few)
        functions = np.zeros((m, self._few, m, self.nodes // 2), dtype=np.complex128)
        functions[:, number, :, number] = np.eye(m)
        return _by_coordinate(place_of(self.domain.centres).put(functions))

    @cached_property
    def powers_at_nodes(self) -> Complex[Array, "f m n"]:
        """Values of `powers` at the nodes."""
        return _by_coordinate(power_table(self.domain.coordinates_on_circles(self.nodes), self._few).swapaxes(0, 1))

    @property
    def _few(self) -> int:
        return min(ANALYTIC_DEGREE + 1, self.nodes // 2)

    def model_of(self, spinors: Complex[Array, "2 m k"]) -> Callable[[], PowerSeries | LaurentSeries]:
        """A function that makes the model of p and q. It stores only a copy of their coefficients."""
        if self.domain.rims == 1:
            return partial(_power_series, _copied(spinors[:, 0].mT))
        return partial(_laurent_series, _copied(spinors), self.domain, self.antiperiodic)


@dataclass(frozen=True, kw_only=True, eq=False)
class OnCurve:
    """Functions on an Ω with one analytic boundary: values at nodes, continued by Cauchy's formula."""

    boundary: FourierBoundary  # ∂Ω
    kernel: Complex[Array, "c c"]  # of its `DirichletForm`
    nodes: int  # n

    def weights(self, n: int) -> Complex[Array, "1 n"]:
        """As `OnCircles.weights`."""
        return grid_of(self.boundary, n, place_of(self.kernel))[1:] / (2 * np.pi)

    def functions(self, spinors: Complex[Array, "b 2 1 n"]) -> Complex[Array, "b 2 1 n"]:
        """The values themselves."""
        return spinors

    def values(self, functions: Complex[Array, "b f 1 n"], n: int) -> Complex[Array, "b f 1 m"]:
        """Values at n equal steps."""
        each = n // self.nodes
        return functions if each == 1 else with_between_nodes(functions[..., 0, :], self.kernel, each)[..., None, :]

    def integral(self, f: Complex[Array, "*rows 1 n"]) -> Complex[Array, "*rows 1 n"]:
        """∫ f dτ, with mean 0."""
        xp = namespace(f)
        return xp.fft.ifft(xp.fft.fft(f) * _integrating(f.shape[-1], place_of(f)))

    @cached_property
    def powers(self) -> Complex[Array, "f 1 n"]:
        """Orthonormal polynomials of low degree."""
        z, dz = grid_of(self.boundary, self.nodes, place_of(self.kernel))
        return arnoldi_basis(z, abs(dz) / abs(dz).sum(), ANALYTIC_DEGREE)[1].mT[:, None]

    @property
    def powers_at_nodes(self) -> Complex[Array, "f 1 n"]:
        """Values of `powers` at the nodes."""
        return self.powers

    def model_of(self, spinors: Complex[Array, "2 1 n"]) -> Callable[[], CauchyInterpolant]:
        """As `OnCircles.model_of`."""
        z, dz = grid_of(self.boundary, self.nodes, place_of(self.kernel))
        return partial(CauchyInterpolant, z, dz, _copied(spinors[:, 0].mT))


def _copied(x: Array) -> Array:
    return namespace(x).asarray(contiguous(x), copy=True)


def _power_series(spinors: Complex[Array, "k 2"]) -> PowerSeries:
    return PowerSeries(_without_round_off(spinors))


def _laurent_series(
    spinors: Complex[Array, "2 m k"], domain: CircularDomain, antiperiodic: tuple[bool, ...]
) -> LaurentSeries:
    outward = _without_round_off(spinors[:, 0].mT)
    inward = _without_round_off(namespace(spinors).permute_dims(spinors[:, 1:, 1:], (2, 1, 0)))
    return LaurentSeries(outward, inward.swapaxes(0, 1), domain, antiperiodic=antiperiodic)


@lru_cache(maxsize=16)
def grid_of(boundary: FourierBoundary, n: int, place: Place) -> Complex[Array, "2 n"]:
    """The points at n equal steps of a boundary's parameter t, and dz/dt."""
    return place.put(boundary.grid(n)[:2])


def slopes(form: CirclesForm | DirichletForm, points: Float[Array, "*b m n 3"]) -> Complex[Array, "*b m n 3"]:
    """φ dz/dτ of harmonic surfaces with given values on ∂Ω: ∂X/∂τ + iΛX."""
    return complex_of(derivative(points), form(points))


def closed(
    traces: OnCircles | OnCurve, spinors: Complex[Array, "b 2 m t"], weights: Complex[Array, "m k"]
) -> tuple[Complex[Array, "b 2 m t"], Complex[Array, "b 2 m k"], Complex[Array, "b 3 m k"]]:
    """Spinors with the least correction in low powers so that Re ∮ φ dz = 0 around holes, their values, and φ dz/dτ.

    `weights` are those of the traces, at enough points to resolve products of p and q.
    """
    last = math.inf
    while True:
        values = traces.values(spinors, weights.shape[1])
        # contiguous rows: see `DirichletForm.__call__`
        velocity = contiguous(namespace(values).moveaxis(phi(values[:, 0], values[:, 1]), -1, 1)) * weights
        if len(weights) == 1:
            break
        gap = gaps(velocity)
        size, rounding = float(abs(gap).max()), EPS * float(abs(velocity).max())
        # Newton's method, until the gap is rounding error
        if size <= rounding or 2 * size > last:
            break
        nodes = (..., slice(None, None, weights.shape[1] // traces.nodes))
        rows = gap_rows(values[nodes], traces.powers_at_nodes * weights[nodes])
        spinors = spinors - changes((namespace(rows).linalg.pinv(rows.mT) @ gap[..., None])[..., 0], traces.powers)
        last = size
    return spinors, values, velocity


def gaps(velocity: Complex[Array, "b 3 m k"]) -> Float[Array, "b g"]:
    """Re ∮ φ dz around each hole over 2π."""
    return velocity[..., 1:, :].real.mean(-1).reshape(len(velocity), -1)


def gap_rows(spinors: Complex[Array, "b 2 m k"], moves: Complex[Array, "f m k"]) -> Float[Array, "b f4 g"]:
    """Derivatives of `gaps` with respect to the coefficients of functions f in p and q. `moves` are f dz/dτ."""
    xp, means = namespace(moves), [(spinors[:, i, None, 1:] * moves[..., 1:, :]).mean(-1) for i in (0, 1)]
    by_p, by_q = (xp.concat([mean, mean, mean], axis=-1) for mean in means)
    axes = np.repeat(np.eye(3), moves.shape[1] - 1, axis=1)[None]
    return moves_by(place_of(moves).put(axes), by_p, by_q)


def moves_by(
    e: Float[Array, "b 3 pts"], by_p: Complex[Array, "b f pts"], by_q: Complex[Array, "b f pts"]
) -> Float[Array, "b f4 pts"]:
    """Derivatives of e·r with respect to coefficients of functions f in p and q, from ∫ fp dz and ∫ fq dz.

    The order is: real parts for p, for q, then the imaginary parts.
    """
    along, upright, xp = complex_of(e[:, :1], -e[:, 1:2]), e[:, 2:], namespace(e)
    row = xp.concat([along * by_p + upright * by_q, upright * by_p - along.conj() * by_q], axis=1)
    return 2 * xp.concat([row.real, -row.imag], axis=1)


def changes(x: Float[Array, "b f4"], powers: Complex[Array, "f m t"]) -> Complex[Array, "b 2 m t"]:
    """Changes of p and q from changes of the powers' coefficients, in the order of `moves_by`."""
    half = x.shape[1] // 2
    factors = complex_of(x[:, :half], x[:, half:]).reshape(len(x), 2, -1)
    # one by one, because in a batch BLAS rounds differently
    change = namespace(x).stack([one @ powers.reshape(len(powers), -1) for one in factors])
    return change.reshape(len(x), 2, *powers.shape[1:])


def with_between_nodes(
    values: Complex[Array, "b 2 n"], kernel: Complex[Array, "c c"], each: int
) -> Complex[Array, "b 2 m"]:
    """Values of `CauchyInterpolant`s at their nodes and at each − 1 equal steps between neighbouring nodes.

    At a fraction δ between two nodes the cotangent part of the kernel multiplies Fourier coefficients by
    ½ sign(k) + ½i cot(πδ). The smooth part acts on low frequencies only.
    """
    n, count, xp, put = values.shape[-1], len(kernel), namespace(values), place_of(values).put
    half, k = count // 2, np.fft.fftfreq(n, 1 / n)
    spectrum = xp.fft.fft(xp.concat([values, xp.ones_like(values[:, :1])], axis=1)) / n
    low = zeros((len(values), 3, count), values)
    low[..., :half], low[..., -half + 1 :] = spectrum[..., :half], spectrum[..., -half + 1 :]
    smooth = xp.fft.fft(-1j * (xp.fft.ifft(low) * count) @ kernel.mT) / count
    total = put(0.5 * np.sign(k)) * spectrum
    total[..., :half] += smooth[..., :half]
    total[..., -half + 1 :] += smooth[..., -half + 1 :]
    total[..., n // 2] = 0
    share = np.arange(1, each)[:, None] / each
    cotangent, turn = put(0.5j / np.tan(np.pi * share)), put(np.exp(2j * np.pi * share / n * k))
    shifted = xp.fft.ifft((total[:, :, None] + cotangent * spectrum[:, :, None]) * turn) * n
    between = shifted[:, :2] / shifted[:, 2:]
    return xp.concat([values[:, :, None], between], axis=2).mT.reshape(len(values), 2, -1)


def _by_coordinate(powers: Complex[Array, "m j *rest"]) -> Complex[Array, "f *rest"]:
    """Rows of the powers of each circle: from the zeroth for the outer circle, from the first for holes."""
    others = powers[1:, 1:]
    return namespace(powers).concat([powers[0], others.reshape(-1, *others.shape[2:])])


@lru_cache(maxsize=64)
def _integrating(n: int, place: Place) -> Complex[Array, " n"]:
    """Fourier multipliers of the antiderivative with mean 0, or 0 for the highest frequency."""
    k = np.fft.fftfreq(n, 1 / n)
    k[0] = k[n // 2] = math.inf
    return place.put(-1j / k)


def _without_round_off(coefficients: Complex[Array, "k *rest"]) -> Complex[Array, "j *rest"]:
    """Coefficients without those at the end that are rounding errors. At least one is kept."""
    sizes = namespace(coefficients).max(abs(coefficients).reshape(len(coefficients), -1), axis=1)
    large = indices(sizes > ROUND_OFF * sizes.max())
    return coefficients[: int(large[-1]) + 1] if len(large) else coefficients[:1]
