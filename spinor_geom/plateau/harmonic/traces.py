"""Discretisations of p and q on ∂Ω: coefficients of each circle's powers, or values at nodes.

Every rim has a parameter τ from 0 to 2π, with Ω on its left. The last axes of a `functions` array are the rims, and the
coefficients or nodes of each. The spinors are divided by the product of √(z − c_j) over the holes around which they
change sign; its square is part of the `weights`, so that φ dz/dτ = φ(p, q) · weights.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg, arnoldi_polynomials
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import ROUND_OFF, LaurentSeries, parts_on_circles, sums_on_circles
from spinor_geom.holomorphic.series import PowerSeries, power_table
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm, DirichletForm, derivative
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi

_DEGREE = 8  # degree of corrections of p and q: 4 and 16 give equal distances, 16 and 32 take longer


@dataclass(frozen=True, kw_only=True, eq=False)
class OnCircles:
    """Functions on the unit disk less round holes, if any: coefficients of the powers of each circle's coordinate."""

    domain: CircularDomain  # Ω
    nodes: int  # n, of every rim
    antiperiodic: tuple[bool, ...] = ()  # for each hole: whether p and q change sign around it

    @classmethod
    def of(cls, domain: CircularDomain, slope: Complex[Tensor, "m n 3"]) -> OnCircles:
        """The discretisation with the sign changes of the spinors of a harmonic surface, from its φ dz/dτ."""
        n = slope.shape[1]
        is_periodic = signs_close_up(*spinors_from_phi(slope / domain.velocities(n)[..., None]))
        return cls(domain=domain, nodes=n, antiperiodic=tuple((~is_periodic[1:]).tolist()))

    def weights(self, n: int) -> Complex[Tensor, "m n"]:
        """dz/dτ at n equal steps of every rim, times the square of the divisor of p and q."""
        return self.domain.velocities(n) * self.domain.squared_root(self.domain.circles(n), self.antiperiodic)

    def functions(self, spinors: Complex[Tensor, "b 2 m n"]) -> Complex[Tensor, "b 2 m k"]:
        """Coefficients from values at the nodes, whose sign on each rim is arbitrary."""
        n = self.nodes
        own: Tensor = torch.fft.fft(spinors, norm="forward")[..., : n // 2]
        if self.domain.rims == 1:
            return own
        own[..., 1:, 0] = 0
        # the signs with which values on a circle agree best with the powers of the other circles
        parts = parts_on_circles(self.domain, own, n)
        agreement = (spinors[..., None, :] * parts.conj()).sum((0, 1, -1)).real.fill_diagonal_(0.0)
        vector = torch.linalg.eigh(agreement + agreement.T)[1][:, -1]
        return own * torch.where(vector * vector[0] < 0, -1.0, 1.0)[:, None]

    def values(self, functions: Complex[Tensor, "*rows m k"], n: int) -> Complex[Tensor, "*rows m n"]:
        """Values at n equal steps of every rim."""
        return sums_on_circles(self.domain, functions, n)

    def integral(self, f: Complex[Tensor, "*rows m n"]) -> Complex[Tensor, "*rows m n"]:
        """∫ f dτ along all rims, with log |z − c| in place of log(z − c)."""
        n = f.shape[-1]
        spectrum = torch.fft.fft(f, norm="forward")[..., : n // 2]
        own = spectrum * _integrating(n, f.device)[: n // 2]
        total = self.values(own, n)
        if self.domain.rims > 1:
            logarithms = (self.domain.circles(n)[None] - self.domain.centres[:, None, None]).abs().log()
            # the holes run clockwise
            total = total + torch.tensordot(1j * spectrum[..., 1:, 0], logarithms.to(f.dtype), dims=1)
        return total

    @cached_property
    def powers(self) -> Complex[Tensor, "f m k"]:
        """Coefficients of the low powers of each circle's coordinate."""
        m, number = self.domain.rims, torch.arange(self._few)
        functions = self.domain.centres.new_zeros(m, self._few, m, self.nodes // 2)
        functions[:, number, :, number] = torch.eye(m, dtype=functions.dtype, device=functions.device)
        return _by_coordinate(functions)

    @cached_property
    def powers_at_nodes(self) -> Complex[Tensor, "f m n"]:
        """Values of `powers` at the nodes."""
        return _by_coordinate(power_table(self.domain.coordinates_on_circles(self.nodes), self._few).transpose(0, 1))

    @property
    def _few(self) -> int:
        return min(_DEGREE + 1, self.nodes // 2)

    def model_of(self, spinors: Complex[Tensor, "2 m k"]) -> Callable[[], PowerSeries | LaurentSeries]:
        """A function that makes the model of p and q; of large data it keeps only a copy of their coefficients."""
        if self.domain.rims == 1:
            return partial(_power_series, spinors[:, 0].T.clone())
        return partial(_laurent_series, spinors.clone(), self.domain, self.antiperiodic)


@dataclass(frozen=True, kw_only=True, eq=False)
class OnCurve:
    """Functions on an Ω with one analytic boundary: values at nodes, continued by Cauchy's formula."""

    boundary: FourierBoundary  # ∂Ω
    kernel: Complex[Tensor, "c c"]  # of its `DirichletForm`
    nodes: int  # n

    def weights(self, n: int) -> Complex[Tensor, "1 n"]:
        """As `OnCircles.weights`."""
        return grid_of(self.boundary, n, self.kernel.device)[1:] / (2 * np.pi)

    def functions(self, spinors: Complex[Tensor, "b 2 1 n"]) -> Complex[Tensor, "b 2 1 n"]:
        """The values themselves."""
        return spinors

    def values(self, functions: Complex[Tensor, "b f 1 n"], n: int) -> Complex[Tensor, "b f 1 m"]:
        """Values at n equal steps."""
        each = n // self.nodes
        return functions if each == 1 else with_between_nodes(functions[..., 0, :], self.kernel, each)[..., None, :]

    def integral(self, f: Complex[Tensor, "*rows 1 n"]) -> Complex[Tensor, "*rows 1 n"]:
        """∫ f dτ, with mean 0."""
        n = f.shape[-1]
        integral: Tensor = torch.fft.ifft(torch.fft.fft(f) * _integrating(n, f.device))
        return integral

    @cached_property
    def powers(self) -> Complex[Tensor, "f 1 n"]:
        """Orthonormal polynomials of low degree."""
        z, dz = grid_of(self.boundary, self.nodes, self.kernel.device)
        return arnoldi_polynomials(z, arnoldi_hessenberg(z, dz.abs() / dz.abs().sum(), _DEGREE)).T[:, None]

    @property
    def powers_at_nodes(self) -> Complex[Tensor, "f 1 n"]:
        """Values of `powers` at the nodes."""
        return self.powers

    def model_of(self, spinors: Complex[Tensor, "2 1 n"]) -> Callable[[], CauchyInterpolant]:
        """As `OnCircles.model_of`."""
        z, dz = grid_of(self.boundary, self.nodes, self.kernel.device)
        return partial(CauchyInterpolant, z, dz, spinors[:, 0].T.clone())


def _power_series(spinors: Complex[Tensor, "k 2"]) -> PowerSeries:
    return PowerSeries(_without_round_off(spinors))


def _laurent_series(
    spinors: Complex[Tensor, "2 m k"], domain: CircularDomain, antiperiodic: tuple[bool, ...]
) -> LaurentSeries:
    outward = _without_round_off(spinors[:, 0].T)
    inward = _without_round_off(spinors[:, 1:, 1:].permute(2, 1, 0))
    return LaurentSeries(outward, inward.transpose(0, 1), domain, antiperiodic=antiperiodic)


@lru_cache(maxsize=16)
def grid_of(boundary: FourierBoundary, n: int, device: torch.device) -> Complex[Tensor, "2 n"]:
    """The points at n equal steps of a boundary's parameter t, and dz/dt."""
    return torch.tensor(boundary.grid(n)[:2], device=device)


def slopes(form: CirclesForm | DirichletForm, points: Float[Tensor, "*b m n 3"]) -> Complex[Tensor, "*b m n 3"]:
    """φ dz/dτ of harmonic surfaces with given values on ∂Ω: ∂X/∂τ + iΛX."""
    return torch.complex(derivative(points), form(points))


def closed(
    traces: OnCircles | OnCurve, spinors: Complex[Tensor, "b 2 m t"], weights: Complex[Tensor, "m k"]
) -> tuple[Complex[Tensor, "b 2 m t"], Complex[Tensor, "b 2 m k"], Complex[Tensor, "b 3 m k"]]:
    """Spinors with the least correction in low powers so that Re ∮ φ dz = 0 around holes; their values, and φ dz/dτ.

    `weights` are those of the traces, at enough points to resolve products of p and q.
    """
    last = math.inf
    while True:
        values = traces.values(spinors, weights.shape[1])
        # contiguous rows: see `DirichletForm.__call__`
        velocity = phi(values[:, 0], values[:, 1]).movedim(-1, 1).contiguous() * weights
        if len(weights) == 1:
            break
        gap = gaps(velocity)
        size, rounding = float(gap.abs().max()), torch.finfo(gap.dtype).eps * float(velocity.abs().max())
        # Newton's method, until the gap is rounding error
        if size <= rounding or 2 * size > last:
            break
        nodes = (..., slice(None, None, weights.shape[1] // traces.nodes))
        rows = gap_rows(values[nodes], traces.powers_at_nodes * weights[nodes])
        spinors = spinors - changes((torch.linalg.pinv(rows.mT) @ gap[..., None])[..., 0], traces.powers)
        last = size
    return spinors, values, velocity


def gaps(velocity: Complex[Tensor, "b 3 m k"]) -> Float[Tensor, "b g"]:
    """Re ∮ φ dz around each hole over 2π."""
    return velocity[..., 1:, :].real.mean(-1).flatten(1)


def gap_rows(spinors: Complex[Tensor, "b 2 m k"], moves: Complex[Tensor, "f m k"]) -> Float[Tensor, "b f4 g"]:
    """Derivatives of `gaps` with respect to the coefficients of functions f in p and q; `moves` are f dz/dτ."""
    by_p, by_q = ((spinors[:, i, None, 1:] * moves[..., 1:, :]).mean(-1).repeat(1, 1, 3) for i in (0, 1))
    axes = torch.eye(3, dtype=moves.real.dtype, device=moves.device)
    return moves_by(axes.repeat_interleave(moves.shape[1] - 1, dim=1)[None], by_p, by_q)


def moves_by(
    e: Float[Tensor, "b 3 pts"], by_p: Complex[Tensor, "b f pts"], by_q: Complex[Tensor, "b f pts"]
) -> Float[Tensor, "b f4 pts"]:
    """Derivatives of e·r with respect to coefficients of functions f in p and q, from ∫ fp dz and ∫ fq dz.

    The order is: real parts for p, for q, then the imaginary parts.
    """
    along, upright = torch.complex(e[:, :1], -e[:, 1:2]), e[:, 2:]
    row = torch.cat([along * by_p + upright * by_q, upright * by_p - along.conj() * by_q], dim=1)
    return 2 * torch.cat([row.real, -row.imag], dim=1)


def changes(x: Float[Tensor, "b f4"], powers: Complex[Tensor, "f m t"]) -> Complex[Tensor, "b 2 m t"]:
    """Changes of p and q from changes of the powers' coefficients, in the order of `moves_by`."""
    half = x.shape[1] // 2
    factors = torch.complex(x[:, :half], x[:, half:]).reshape(len(x), 2, -1)
    # one by one: in a batch BLAS rounds differently
    change = torch.stack([one @ powers.flatten(1) for one in factors])
    return change.reshape(len(x), 2, *powers.shape[1:])


def with_between_nodes(
    values: Complex[Tensor, "b 2 n"], kernel: Complex[Tensor, "c c"], each: int
) -> Complex[Tensor, "b 2 m"]:
    """Values of `CauchyInterpolant`s at their nodes and at each − 1 equal steps between neighbouring nodes.

    At a fraction δ between two nodes the cotangent part of the kernel multiplies Fourier coefficients by
    ½ sign(k) + ½i cot(πδ); the smooth part acts on low frequencies only.
    """
    n, count = values.shape[-1], len(kernel)
    half = count // 2
    k = torch.fft.fftfreq(n, 1 / n, dtype=values.real.dtype, device=values.device)
    spectrum = torch.fft.fft(torch.cat([values, torch.ones_like(values[:, :1])], dim=1)) / n
    low = torch.zeros(len(values), 3, count, dtype=values.dtype, device=values.device)
    low[..., :half], low[..., -half + 1 :] = spectrum[..., :half], spectrum[..., -half + 1 :]
    smooth = torch.fft.fft(-1j * (torch.fft.ifft(low) * count) @ kernel.T) / count
    total = 0.5 * k.sign() * spectrum
    total[..., :half] += smooth[..., :half]
    total[..., -half + 1 :] += smooth[..., -half + 1 :]
    total[..., n // 2] = 0
    share = torch.arange(1, each, dtype=k.dtype, device=k.device)[:, None] / each
    cotangent = 0.5j / torch.tan(np.pi * share)
    rotated = (total[:, :, None] + cotangent * spectrum[:, :, None]) * torch.exp(2j * np.pi * share / n * k)
    shifted = torch.fft.ifft(rotated) * n
    between = shifted[:, :2] / shifted[:, 2:]
    return torch.cat([values[:, :, None], between], dim=2).mT.flatten(2)


def _by_coordinate(powers: Complex[Tensor, "m j *rest"]) -> Complex[Tensor, "f *rest"]:
    """Rows of the powers of each circle: from the zeroth for the outer circle, from the first for holes."""
    return torch.cat([powers[0], powers[1:, 1:].flatten(0, 1)])


@lru_cache(maxsize=64)
def _integrating(n: int, device: torch.device) -> Complex[Tensor, " n"]:
    """Fourier multipliers of the antiderivative with mean 0; 0 for the highest frequency."""
    k = torch.fft.fftfreq(n, 1 / n, dtype=torch.float64, device=device)
    k[0] = k[n // 2] = math.inf
    multipliers: Tensor = -1j / k
    return multipliers


def _without_round_off(coefficients: Complex[Tensor, "k *rest"]) -> Complex[Tensor, "j *rest"]:
    """Coefficients without those at the end that are rounding errors; at least one is kept."""
    sizes = coefficients.abs().flatten(1).amax(1)
    large = (sizes > ROUND_OFF * sizes.max()).nonzero()
    return coefficients[: int(large[-1]) + 1] if len(large) else coefficients[:1]
