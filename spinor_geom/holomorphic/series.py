"""Power series on a disk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.errors import DtypeError


class PowerSeries(torch.nn.Module):
    """p and q as polynomials Σ a_k ((z − centre)/radius)^k.

    Scaled by the radius, the coefficients of a series that converges on the disk stay bounded.

    Shape:
        coefficients: (K, 2), complex; column 0 is p, column 1 is q.
    """

    kind: ClassVar[str] = "series"

    def __init__(self, coefficients: Complex[Tensor, "k 2"], *, center: complex = 0.0, radius: float = 1.0) -> None:
        """Raises DtypeError where the coefficients are not complex or not (K, 2)."""
        super().__init__()
        if not coefficients.is_complex() or coefficients.ndim != 2 or coefficients.shape[1] != 2:
            raise DtypeError(
                f"a power series needs complex coefficients of shape (K, 2), got {coefficients.dtype} of shape "
                f"{tuple(coefficients.shape)}"
            )
        self.center = complex(center)
        self.radius = float(radius)
        self.coefficients = torch.nn.Parameter(coefficients.clone())

    def features(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts k"]:
        """Powers ((z − centre)/radius)^k, k = 0 … K − 1."""
        return _powers((z - self.center) / self.radius, len(self.coefficients))

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        return self.features(z) @ self.coefficients

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        count = len(self.coefficients)
        k = torch.arange(1, count, device=z.device, dtype=self.coefficients.real.dtype)
        powers = _powers((z - self.center) / self.radius, max(count - 1, 0))
        return powers @ (self.coefficients[1:] * (k / self.radius)[:, None])

    def config(self) -> dict[str, Any]:
        """Number of terms, centre and radius."""
        return {
            "terms": len(self.coefficients),
            "center": [self.center.real, self.center.imag],
            "radius": self.radius,
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> PowerSeries:
        """A series of zeros with the given sizes."""
        zeros = torch.zeros(int(config["terms"]), 2, dtype=torch.complex128)
        return cls(zeros, center=complex(*config["center"]), radius=float(config["radius"]))


def _powers(u: Complex[Tensor, "*pts"], count: int) -> Complex[Tensor, "*pts k"]:
    if count == 0:
        return u.new_zeros((*u.shape, 0))
    ones = torch.ones_like(u)
    if count == 1:
        return ones[..., None]
    repeated = u[..., None].expand(*u.shape, count - 1)
    return torch.cat([ones[..., None], torch.cumprod(repeated, dim=-1)], dim=-1)
