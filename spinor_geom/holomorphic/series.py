"""Power series on a disk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.errors import DtypeError, require_positive

# rows and columns of a table of powers that fits the cache
_POWERS, _POINTS = 32, 1 << 10


class PowerSeries(torch.nn.Module):
    """p and q as polynomials Σ a_k ((z − centre)/radius)^k.

    Because of the scaling, the coefficients of a series that converges on the disk are bounded.

    Shape:
        coefficients: (K, 2), complex; column 0 is p, column 1 is q.
    """

    kind: ClassVar[str] = "series"

    def __init__(self, coefficients: Complex[Tensor, "k 2"], *, center: complex = 0.0, radius: float = 1.0) -> None:
        """Raises DtypeError unless the coefficients are complex (K, 2), OptionError unless the radius is positive."""
        super().__init__()
        require_positive("the radius of a power series", radius)
        if not coefficients.is_complex() or coefficients.ndim != 2 or coefficients.shape[1] != 2:
            raise DtypeError(
                f"a power series needs complex coefficients of shape (K, 2), got {coefficients.dtype} of shape "
                f"{tuple(coefficients.shape)}"
            )
        self.center = complex(center)
        self.radius = float(radius)
        self.coefficients = torch.nn.Parameter(coefficients.clone())

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        return power_sums((z - self.center) / self.radius, self.coefficients)

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        k = torch.arange(len(self.coefficients), device=z.device, dtype=self.coefficients.real.dtype)
        return power_sums((z - self.center) / self.radius, (self.coefficients * (k / self.radius)[:, None])[1:])

    def primitive(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ) from the centre to z, which are polynomials too."""
        u = (z - self.center) / self.radius
        # the coefficients of products are convolutions, of 2K − 1 terms
        p, q = torch.fft.fft(self.coefficients, n=max(2 * len(self.coefficients) - 1, 1), dim=0).unbind(-1)
        products = torch.fft.ifft(torch.stack([p * p, q * q, p * q], dim=-1), dim=0)
        k = torch.arange(1, len(products) + 1, device=z.device, dtype=products.real.dtype)
        return u[..., None] * power_sums(u, products * (self.radius / k)[:, None])

    def config(self) -> dict[str, Any]:
        """Number of terms, centre and radius."""
        return {"terms": len(self.coefficients), "center": [self.center.real, self.center.imag], "radius": self.radius}

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> PowerSeries:
        """A series of zeros with the given sizes."""
        zeros = torch.zeros(int(config["terms"]), 2, dtype=torch.complex128)
        return cls(zeros, center=complex(*config["center"]), radius=float(config["radius"]))


def power_sums(u: Complex[Tensor, "*pts"], coefficients: Complex[Tensor, "k c"]) -> Complex[Tensor, "*pts c"]:
    """Σ_k a_k u^k for each column of coefficients, by Horner's rule on blocks of `_POWERS` terms."""
    parts = [part.mT for part in torch.split(coefficients, _POWERS)]

    def block(some: Complex[Tensor, " n"]) -> Complex[Tensor, "c n"]:
        powers = power_table(some, min(_POWERS, len(coefficients)))
        total = parts[-1] @ powers[: parts[-1].shape[1]]
        if len(parts) > 1:
            step = powers[-1] * some
            for part in reversed(parts[:-1]):
                total = total * step + part @ powers
        return total

    total = torch.cat([block(some) for some in torch.split(u.reshape(-1), _POINTS)], dim=-1)
    return total.mT.reshape(*u.shape, coefficients.shape[1])


def power_table(u: Complex[Tensor, "*pts"], count: int) -> Complex[Tensor, "k *pts"]:
    """u⁰ … u^(count − 1)."""
    powers = torch.cat([torch.ones_like(u)[None], u.expand(max(count - 1, 0), *u.shape)])[:count]
    return torch.cumprod(powers, dim=0)
