"""Dirichlet's form of harmonic functions on Ω, on equal steps of the parameter of ∂Ω."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary


@dataclass(frozen=True, kw_only=True, eq=False)
class DirichletForm:
    """The Dirichlet-to-Neumann map Λ of Ω: boundary values x(t) ↦ ∂x*/∂θ, θ = 2πt, with x* the conjugate of x.

    ½ ∫ x·Λx dθ is the Dirichlet energy of the harmonic function with boundary values x; it does not depend on the
    parameter of ∂Ω. On the disk Λ is the multiplier |k| of Fourier series. On an analytic ∂Ω it differs from that by an
    operator with a smooth kernel, which acts on low frequencies only: a small matrix says it all, whatever the number
    of samples. The smooth kernel and its counterpart for Cauchy integrals come from the Cauchy integral by the
    trapezoidal rule with the cotangent taken out.

    Attributes:
        boundary: ∂Ω.
        kernel: (c, c), the smooth part of Cauchy's integral on c equal steps, 1/n included; none on the unit disk.
        correction: (c, c), Λ of Ω less that of the disk on c equal steps; none on the unit disk.
        error: measure of the discretisation's, the larger of two: of Λ on the real and the imaginary part of z, which
            are each other's conjugates, relative to the largest |dz/dθ|; and the correction's deviation from a
            symmetric matrix, relative to the largest entry of |k|'s. Neither sees all: the second is blind on domains
            as symmetric as ellipses, the first where far parts of ∂Ω come near each other.

    Source: Kress, "Linear Integral Equations" (2014), sections 7 and 12, for the integral equation.
    """

    boundary: FourierBoundary
    kernel: Complex[Tensor, "c c"] | None
    correction: Float[Tensor, "c c"] | None
    error: float

    @classmethod
    @lru_cache(maxsize=16)
    def of_disk(cls, vertices: int) -> DirichletForm:
        """The form of the unit disk about 0, with so many vertices on ∂Ω: z(t) = e^{2πit}."""
        return cls(boundary=FourierBoundary.circle(1.0, vertices), kernel=None, correction=None, error=0.0)

    @classmethod
    def of(cls, boundary: FourierBoundary, n: int, device: torch.device) -> DirichletForm:
        """The form of any Ω.

        Args:
            boundary: ∂Ω.
            n: equal steps that resolve the kernel; even. The cost is n³.
            device: where the matrix lives.
        """
        z, dz, ddz = (torch.tensor(row, device=device) for row in boundary.grid(n))
        kernel = _smooth_kernel(z, z, dz) / n
        kernel.diagonal().copy_(ddz / (4 * np.pi * dz * n))
        k = torch.fft.fftfreq(n, 1 / n, dtype=torch.float64, device=device)
        k[n // 2] = 0
        identity = torch.eye(n, dtype=torch.float64, device=device)
        # column j is e_j conjugated on the disk
        disk = torch.fft.ifft((-1j * k.sign())[:, None] * torch.fft.fft(identity, dim=0), dim=0).real
        # a real density μ gives the boundary values (½ + Im kernel) μ and their conjugate (½ H − Re kernel) μ
        conjugate = torch.linalg.solve(0.5 * identity + kernel.imag, 0.5 * disk - kernel.real, left=False)
        slope = torch.fft.ifft((1j * k)[:, None] * torch.fft.fft(conjugate - disk, dim=0), dim=0).real
        asymmetry = float((slope - slope.T).abs().max()) / (n / 4)
        form = cls(boundary=boundary, kernel=kernel, correction=(slope + slope.T) / 2, error=asymmetry)
        return replace(form, error=max(asymmetry, form._error_on_coordinates(z, dz)))

    @property
    def is_disk(self) -> bool:
        """Whether Ω is the unit disk, its boundary by angle."""
        return self.correction is None

    def __call__(self, x: Float[Tensor, "*batch n k"]) -> Float[Tensor, "*batch n k"]:
        """Λ of each column, sampled at t = j/n."""
        n = x.shape[-2]
        # along rows: of columns side by side some processors round a loop's otherwise when other loops are beside it
        spectrum = torch.fft.rfft(x.mT.contiguous())
        result = spectrum * frequencies(n, x.device)
        if self.correction is not None:
            count = len(self.correction)
            half = count // 2
            # BLAS is far slower on narrow columns, and the matrix is symmetric
            low = torch.fft.irfft(spectrum[..., :half], n=count) @ self.correction
            result[..., :half] += torch.fft.rfft(low)[..., :half]
        values: Tensor = torch.fft.irfft(result, n=n)
        return values.mT

    def _error_on_coordinates(self, z: Complex[Tensor, " n"], dz: Complex[Tensor, " n"]) -> float:
        """Largest error of Λ on Re z and Im z, whose conjugates are Im z and −Re z."""
        found = self(torch.view_as_real(z))
        exact = torch.view_as_real(-1j * dz)
        return float((2 * np.pi * found - exact).abs().max() / dz.abs().max())


@lru_cache(maxsize=64)
def frequencies(n: int, device: torch.device) -> Float[Tensor, " k"]:
    """Those of the real Fourier transform of n values."""
    return torch.arange(n // 2 + 1, dtype=torch.float64, device=device)


def _smooth_kernel(
    target: Complex[Tensor, " m"], source: Complex[Tensor, " n"], derivative: Complex[Tensor, " n"]
) -> Complex[Tensor, "m n"]:
    """Cauchy's kernel z'(τ)/(z(τ) − z(t)) less the circle's ½cot(π(τ − t)), per step of τ, over 2π.

    Both curves are sampled at equal steps, t from 0 on; where t = τ the entry means nothing.
    """
    m, n = len(target), len(source)
    real = derivative.real
    turn = torch.arange(n).to(real)[None] / n - torch.arange(m).to(real)[:, None] / m
    difference = source[None] - target[:, None]
    same = turn == 0
    cotangent = 0.5 / torch.tan(np.pi * turn.masked_fill(same, 0.5))
    return derivative[None] / (2 * np.pi) / difference.masked_fill(same, 1) - cotangent
