"""Dirichlet's form of harmonic functions on the flat cylinder [0, m] × S¹, on equal steps of the angle of both rims."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class CylinderForm:
    """The Dirichlet-to-Neumann map Λ(m) of the cylinder of modulus m, and its derivatives by log m.

    Both rims run with the cylinder on their left, as the boundary of an annulus does: the angle of the first one is
    2πt, that of the second −2πt. For the frequency k a rim's own part is |k| coth |k|m, the other's −|k| / sinh |k|m
    (for k = 0: ±1/m).

    Attributes:
        own: multipliers of a rim's own values, frequencies 0 … n/2.
        other: multipliers of the conjugate spectrum of the other rim.
        steps: n.
    """

    own: Float[Tensor, " f"]
    other: Float[Tensor, " f"]
    steps: int

    @classmethod
    def of(cls, log_modulus: float, like: Float[Tensor, "..."], *, order: Literal[0, 1, 2] = 0) -> CylinderForm:
        """Λ or its first or second derivative by log m, for samples such as those of a tensor, (*, n, 3)."""
        own, other = multipliers(like.new_tensor(math.exp(log_modulus)), like.shape[-2], order=order)
        return cls(own=own, other=other, steps=like.shape[-2])

    def __call__(self, x: Float[Tensor, "2 n c"]) -> Float[Tensor, "2 n c"]:
        """Λ of each column, at both rims."""
        spectrum = torch.fft.rfft(x, dim=-2)
        result = self.own[:, None] * spectrum + self.other[:, None] * spectrum.flip(0).conj()
        values: Tensor = torch.fft.irfft(result, n=self.steps, dim=-2)
        return values

    def matrix(self) -> Float[Tensor, "2n 2n"]:
        """Λ on the samples of both rims, the first rim's before the second's."""
        n = self.steps
        j = torch.arange(n, device=self.own.device)
        own = torch.fft.irfft(self.own.to(torch.complex128), n=n)[(j[:, None] - j) % n]
        other = torch.fft.irfft(self.other.to(torch.complex128), n=n)[(j[:, None] + j) % n]
        return torch.cat([torch.cat([own, other], dim=1), torch.cat([other, own], dim=1)])


def multipliers(
    modulus: Float[Tensor, "*m"], n: int, *, order: Literal[0, 1, 2] = 0
) -> tuple[Float[Tensor, "*m f"], Float[Tensor, "*m f"]]:
    """`own` and `other` of `CylinderForm` for any moduli, or their first or second derivatives by log m."""
    m = modulus[..., None]
    k = torch.arange(n // 2 + 1, dtype=m.dtype, device=m.device)
    k[0] = 1
    # coth and 1/sinh of km without overflow
    e, rest = torch.exp(-k * m), -torch.expm1(-2 * k * m)
    coth, csch = (1 + e * e) / rest, 2 * e / rest
    if order == 0:
        own, other, constant = k * coth, -k * csch, 1 / modulus
    elif order == 1:
        own, other, constant = -m * k**2 * csch**2, m * k**2 * csch * coth, -1 / modulus
    else:
        own = m * k**2 * csch**2 * (2 * m * k * coth - 1)
        other = m * k**2 * csch * (coth - m * k * (coth**2 + csch**2))
        constant = 1 / modulus
    own[..., 0], other[..., 0] = constant, -constant
    return own, other
