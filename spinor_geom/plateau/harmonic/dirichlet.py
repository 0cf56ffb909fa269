"""The Dirichlet-to-Neumann map of plane domains with one analytic boundary, and of disks with round holes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF


@dataclass(frozen=True, kw_only=True, eq=False)
class DirichletForm:
    """The Dirichlet-to-Neumann map Λ of Ω: boundary values x(t) ↦ ∂x*/∂θ, θ = 2πt, with x* the conjugate of x.

    ½ ∫ x·Λx dθ is the Dirichlet energy of the harmonic function with boundary values x; it does not depend on the
    parameter of ∂Ω. On the disk Λ multiplies Fourier coefficients by |k|. On an analytic ∂Ω it differs from that by an
    operator with a smooth kernel, which acts on low frequencies only, so that a small matrix suffices for any number of
    samples. That operator comes from the Cauchy kernel without its singular part, a cotangent, by the trapezoidal rule.

    Source: Kress, "Linear Integral Equations" (2014), sections 7 and 12, for the integral equation.
    """

    boundary: FourierBoundary  # ∂Ω
    # smooth part of the Cauchy kernel on c equal steps, with the weight 1/c; and Λ − |k|. None on the disk
    kernel: Complex[Tensor, "c c"] | None
    correction: Float[Tensor, "c c"] | None
    # the larger of two errors: of Λz = −i dz/dθ, relative to the largest |dz/dθ|, which does not detect parts of ∂Ω
    # that face each other closely; and the asymmetry of the correction, relative to the largest entry of |k|, which is
    # 0 on symmetric domains such as ellipses
    error: float

    @classmethod
    @lru_cache(maxsize=16)
    def of_disk(cls, vertices: int) -> DirichletForm:
        """Λ of the unit disk, z(t) = e^{2πit}, with a number of vertices on ∂Ω."""
        return cls(boundary=FourierBoundary.circle(1.0, vertices), kernel=None, correction=None, error=0.0)

    @classmethod
    def of(cls, boundary: FourierBoundary, n: int, device: torch.device) -> DirichletForm:
        """Λ of any Ω; n is even and resolves the kernel. The cost is O(n³).

        Raises:
            OutOfTimeError: time ran out.
        """
        z, dz, ddz = (torch.tensor(row, device=device) for row in boundary.grid(n))
        kernel = _smooth_kernel(z, dz) / n
        kernel.diagonal().copy_(ddz / (4 * np.pi * dz * n))
        k = torch.fft.fftfreq(n, 1 / n, dtype=torch.float64, device=device)
        k[n // 2] = 0
        identity = torch.eye(n, dtype=torch.float64, device=device)
        # column j is e_j conjugated on the disk
        disk = torch.fft.ifft((-1j * k.sign())[:, None] * torch.fft.fft(identity, dim=0), dim=0).real
        require_time()  # the solution takes seconds for thousands of steps
        # a real density μ gives the boundary values (½ + Im kernel) μ and their conjugate (½ H − Re kernel) μ
        conjugate = torch.linalg.solve(0.5 * identity + kernel.imag, 0.5 * disk - kernel.real, left=False)
        slope = torch.fft.ifft((1j * k)[:, None] * torch.fft.fft(conjugate - disk, dim=0), dim=0).real
        asymmetry = float((slope - slope.T).abs().max()) / (n / 4)
        form = cls(boundary=boundary, kernel=kernel, correction=(slope + slope.T) / 2, error=asymmetry)
        off = 2 * np.pi * form(torch.view_as_real(z)) - torch.view_as_real(-1j * dz)
        return replace(form, error=max(asymmetry, float(off.abs().max() / dz.abs().max())))

    @property
    def is_disk(self) -> bool:
        """Whether Ω is the unit disk, parametrised by angle."""
        return self.correction is None

    def __call__(self, x: Float[Tensor, "*batch n k"]) -> Float[Tensor, "*batch n k"]:
        """Λ applied to columns of samples at t = j/n."""
        n = x.shape[-2]
        # transformed as rows: on some processors the rounding of a column depends on the number of columns
        spectrum = torch.fft.rfft(x.movedim(-1, 0).contiguous())
        result = spectrum * frequencies(n, x.device)
        if self.correction is not None:
            count = len(self.correction)
            half = count // 2
            # BLAS is far slower on narrow columns, and the matrix is symmetric
            low = torch.fft.irfft(spectrum[..., :half], n=count) @ self.correction
            result[..., :half] += torch.fft.rfft(low)[..., :half]
        values: Tensor = torch.fft.irfft(result, n=n)
        return values.movedim(0, -1)


@lru_cache(maxsize=64)
def frequencies(n: int, device: torch.device) -> Float[Tensor, " k"]:
    """Frequencies of the real Fourier transform of n values."""
    return torch.arange(n // 2 + 1, dtype=torch.float64, device=device)


def _smooth_kernel(z: Complex[Tensor, " n"], dz: Complex[Tensor, " n"]) -> Complex[Tensor, "n n"]:
    """z'(τ)/(2π(z(τ) − z(t))) − ½cot(π(τ − t)) at equal steps, the smooth part of the Cauchy kernel; no diagonal."""
    step = torch.arange(len(z)).to(dz.real) / len(z)
    turn = step - step[:, None]
    same = turn == 0
    cotangent = 0.5 / torch.tan(np.pi * turn.masked_fill(same, 0.5))
    return dz / (2 * np.pi) / (z - z[:, None]).masked_fill(same, 1) - cotangent


@dataclass(frozen=True, kw_only=True, eq=False)
class CirclesForm:
    """Λ of the unit disk less round holes, on equal steps of the angle τ of every circle; see `DirichletForm`.

    Each circle has a coordinate ζ that maps its side of the plane to the unit disk: ζ = z for the unit circle,
    ζ = r/(z − c) for a hole. A harmonic function on Ω is the real part of a sum of powers of all coordinates, and of a
    logarithm for each hole. On a circle the normal derivative is |k| on the powers of its own coordinate and −|k| on
    the others. Between two concentric circles Λ multiplies Fourier coefficients; with more circles it differs from |k|
    by an operator with a smooth kernel.
    """

    domain: CircularDomain  # Ω
    steps: int  # n, of every circle
    own: Float[Tensor, " f"]  # multipliers of a circle's own values, frequencies 0 … n/2
    # multipliers of the conjugate spectrum of the other circle; None with more than two circles
    other: Float[Tensor, " f"] | None
    # Λ − |k| on c equal steps of every circle, which resolve it; None for two circles
    correction: Float[Tensor, "mc mc"] | None
    error: float  # asymmetry of the correction, relative to the largest entry of |k|

    @classmethod
    def of(cls, domain: CircularDomain, n: int, *, negligible: float = ROUND_OFF) -> CirclesForm:
        """Λ on n equal steps of every circle, n even; powers below `negligible` on other circles are omitted."""
        if domain.rims == 2:
            own, other = multipliers(domain.log_radii.new_tensor(domain.modulus), n)
            return cls(domain=domain, steps=n, own=own, other=other, correction=None, error=0.0)
        own = torch.arange(n // 2 + 1, dtype=domain.radii.dtype, device=domain.radii.device)
        powers = math.log(negligible) / math.log(domain.nearness)
        count = n if powers >= n // 2 else 2 * math.ceil(powers)
        coupling = _coupling(domain, count)
        error = float((coupling - coupling.T).abs().max()) / (count / 4)
        return cls(domain=domain, steps=n, own=own, other=None, correction=(coupling + coupling.T) / 2, error=error)

    def __call__(self, x: Float[Tensor, "*batch m n c"]) -> Float[Tensor, "*batch m n c"]:
        """Λ applied to columns of samples on all circles."""
        n = self.steps
        spectrum = torch.fft.rfft(x, dim=-2)
        result = self.own[:, None] * spectrum
        if self.other is not None:
            result = result + self.other[:, None] * spectrum.flip(-3).conj()
        if self.correction is not None:
            m = x.shape[-3]
            count = len(self.correction) // m
            few = count // 2 + (count == n)
            low = torch.fft.irfft(spectrum[..., :few, :], n=count, dim=-2) * (count / n)
            change = (self.correction @ low.flatten(-3, -2)).reshape(*x.shape[:-3], m, count, x.shape[-1])
            result[..., :few, :] += torch.fft.rfft(change, dim=-2)[..., :few, :] * (n / count)
        values: Tensor = torch.fft.irfft(result, n=n, dim=-2)
        return values

    def matrix(self) -> Float[Tensor, "mn mn"]:
        """Λ as a matrix on the samples of all circles, circle by circle."""
        n, m = self.steps, self.domain.rims
        j = torch.arange(n, device=self.own.device)
        own = torch.fft.irfft(self.own.to(torch.complex128), n=n)[(j[:, None] - j) % n]
        if self.other is not None:
            other = torch.fft.irfft(self.other.to(torch.complex128), n=n)[(j[:, None] + j) % n]
            return torch.cat([torch.cat([own, other], dim=1), torch.cat([other, own], dim=1)])
        assert self.correction is not None
        count = len(self.correction) // m
        matrix = self.correction.reshape(m, count, m, count)
        if count < n:
            # interpolated on both sides; n/c because sums run over n steps
            spectrum = torch.fft.rfft(matrix, dim=1)[:, : count // 2]
            matrix = torch.fft.irfft(spectrum, n=n, dim=1) * (n / count)
            spectrum = torch.fft.rfft(matrix, dim=3)[..., : count // 2]
            matrix = torch.fft.irfft(spectrum, n=n, dim=3)
        matrix = matrix.reshape(m, n, m, n).clone()
        matrix.diagonal(dim1=0, dim2=2).add_(own[..., None])
        return matrix.reshape(m * n, m * n)


def multipliers(modulus: Float[Tensor, "*m"], n: int) -> tuple[Float[Tensor, "*m f"], Float[Tensor, "*m f"]]:
    """Multipliers of the Dirichlet-to-Neumann map of cylinders of modulus m, on n equal steps of both rims.

    Both rims are oriented with the cylinder on their left. For k = 0 … n/2 the multiplier of a rim's own spectrum is
    |k| coth |k|m, that of the other rim's conjugate spectrum −|k| / sinh |k|m (for k = 0: ±1/m).
    """
    m = modulus[..., None]
    k = torch.arange(n // 2 + 1, dtype=m.dtype, device=m.device)
    k[0] = 1
    # coth and 1/sinh of km without overflow
    e, rest = torch.exp(-k * m), -torch.expm1(-2 * k * m)
    own, other = k * (1 + e * e) / rest, -2 * k * e / rest
    own[..., 0], other[..., 0] = 1 / modulus, -1 / modulus
    return own, other


def _coupling(domain: CircularDomain, n: int) -> Float[Tensor, "mn mn"]:
    """Λ − |k| by collocation of harmonic functions at n equal steps of every circle.

    The functions of a circle are the powers of its coordinate, and 1 (outer circle) or log(|z − c|/r) (holes). Only the
    real part of the highest power is used: its imaginary part is 0 at n equal steps.
    """
    m, zeta = domain.rims, domain.coordinates_on_circles(n)
    powers = torch.cumprod(zeta[:, None].expand(-1, n // 2, *zeta.shape[1:]), dim=1)
    first = -zeta.abs().log()[:, None]
    first[0] = 1
    values = torch.cat([first, powers.real, powers.imag[:, :-1]], dim=1)  # coordinate, function, circle, step
    circle = torch.arange(m)
    of_others = values.clone()
    of_others[circle, :, circle] = 0
    spectrum = torch.fft.rfft(of_others)
    frequency = torch.arange(spectrum.shape[-1], dtype=values.dtype, device=values.device)
    # the normal derivative multiplies own powers by |k|, all others by −|k|
    change = torch.fft.irfft(-2 * frequency * spectrum, n=n)
    # the flux of a logarithm: out of Ω at the outer circle, into it at its hole
    change[1:, 0, 0] += 1
    change[circle[1:], 0, circle[1:]] -= 1
    coupling: Tensor = torch.linalg.solve(values.reshape(m * n, m * n), change.reshape(m * n, m * n)).T
    return coupling


def derivative(x: Float[Tensor, "*m n c"]) -> Float[Tensor, "*m n c"]:
    """dx/dτ of columns at n equal steps of every circle; that of the highest frequency is 0 there."""
    n = x.shape[-2]
    k = 1j * torch.arange(n // 2 + 1, dtype=x.dtype, device=x.device)
    k[-1] = 0
    # transformed as rows: see `DirichletForm.__call__`
    values: Tensor = torch.fft.irfft(k * torch.fft.rfft(x.mT.contiguous()), n=n).mT
    return values


def without_highest(x: Float[Tensor, "*m n c"]) -> Float[Tensor, "*m n c"]:
    """Columns at n equal steps of every circle, without their highest frequency."""
    n = x.shape[-2]
    values: Tensor = torch.fft.irfft(torch.fft.rfft(x, dim=-2)[..., : n // 2, :], n=n, dim=-2)
    return values
