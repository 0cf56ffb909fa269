"""Power series on a disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, arange, is_numpy, is_real, namespace
from spinor_geom.errors import DtypeError, require_positive
from spinor_geom.holomorphic.array_model import ArrayModel, blank

# rows and columns of a table of powers that fits the cache
_POWERS, _POINTS = 32, 1 << 10


@dataclass(frozen=True, eq=False, repr=False)
class PowerSeries(ArrayModel):
    """p and q as polynomials Σ a_k ((z − centre)/radius)^k.

    Because of the scaling, the coefficients of a series that converges on the disk are bounded.

    Shape:
        coefficients: (K, 2), complex. Column 0 is p, column 1 is q.
    """

    kind: ClassVar[str] = "series"
    trained: ClassVar[tuple[str, ...]] = ("coefficients",)

    coefficients: Complex[Array, "k 2"]
    center: complex = field(default=0.0, kw_only=True)
    radius: float = field(default=1.0, kw_only=True)

    def __post_init__(self) -> None:
        """Raises DtypeError unless the coefficients are complex (K, 2), OptionError unless the radius is positive."""
        require_positive("the radius of a power series", self.radius)
        shape = tuple(self.coefficients.shape)
        if is_real(self.coefficients) or len(shape) != 2 or shape[1] != 2:
            raise DtypeError(
                f"a power series needs complex coefficients of shape (K, 2), got {self.coefficients.dtype} of shape "
                f"{shape}"
            )

    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z))."""
        return power_sums((z - self.center) / self.radius, self.coefficients)

    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""
        k = arange(len(self.coefficients), self.coefficients)
        return power_sums((z - self.center) / self.radius, (self.coefficients * (k / self.radius)[:, None])[1:])

    def primitive(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ) from the centre to z, which are polynomials too."""
        u = (z - self.center) / self.radius
        # the coefficients of products are convolutions, of 2K − 1 terms
        xp = namespace(z)
        p, q = xp.fft.fft(self.coefficients, n=max(2 * len(self.coefficients) - 1, 1), axis=0).mT
        products = xp.fft.ifft(xp.stack([p * p, q * q, p * q], axis=-1), axis=0)
        k = arange(len(products) + 1, products, start=1)
        return u[..., None] * power_sums(u, products * (self.radius / k)[:, None])

    def config(self) -> dict[str, Any]:
        """Number of terms, centre and radius."""
        center = complex(self.center)
        return {"terms": len(self.coefficients), "center": [center.real, center.imag], "radius": float(self.radius)}

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> PowerSeries:
        """A series of zeros with the given sizes."""
        zeros = blank(int(config["terms"]), 2)
        return cls(zeros, center=complex(*config["center"]), radius=float(config["radius"]))


def power_sums(u: Complex[Array, "*pts"], coefficients: Complex[Array, "k c"]) -> Complex[Array, "*pts c"]:
    """Σ_k a_k u^k for each column of coefficients, by Horner's rule on blocks of `_POWERS` terms."""
    xp, parts = namespace(u), [coefficients[k : k + _POWERS].mT for k in range(0, max(1, len(coefficients)), _POWERS)]

    def block(some: Complex[Array, " n"]) -> Complex[Array, "c n"]:
        powers = power_table(some, min(_POWERS, len(coefficients)))
        total = parts[-1] @ powers[: parts[-1].shape[1]]
        if len(parts) > 1:
            step = powers[-1] * some
            for part in parts[-2::-1]:
                total = total * step + part @ powers
        return total

    flat = u.reshape(-1)
    blocks = [block(flat[k : k + _POINTS]) for k in range(0, max(1, len(flat)), _POINTS)]
    total = blocks[0] if len(blocks) == 1 else xp.concat(blocks, axis=-1)
    return total.mT.reshape(*u.shape, coefficients.shape[1])


def power_moments(
    u: Complex[np.ndarray, " n"], weights: Float[np.ndarray, "n c"], count: int
) -> Complex[np.ndarray, "c k"]:
    """Σ_j w_j u_j^k for k < `count` and each column of weights: the transpose of `power_sums`."""
    total = np.zeros((weights.shape[1], count), dtype=np.complex128)
    for start in range(0, len(u), _POINTS):
        some, rows = u[start : start + _POINTS], weights[start : start + _POINTS].T + 0j
        powers = power_table(some, min(_POWERS, count))
        step = powers[-1] * some
        for k in range(0, count, _POWERS):
            total[:, k : k + _POWERS] += rows @ powers[: count - k].T
            rows = rows * step
    return total


def power_table(u: Complex[Array, "*pts"], count: int) -> Complex[Array, "k *pts"]:
    """u⁰ … u^(count − 1)."""
    xp = namespace(u)
    powers = xp.concat([xp.ones_like(u)[None], xp.broadcast_to(u, (max(count - 1, 0), *u.shape))])[:count]
    if not is_numpy(u):
        return powers.cumprod(0)
    last = 1
    while last < count - 1:  # products of rows take a tenth of the time of cumulative ones
        end = min(2 * last, count - 1)
        np.multiply(powers[1 : end - last + 1], powers[last], out=powers[last + 1 : end + 1])
        last = end
    return powers
