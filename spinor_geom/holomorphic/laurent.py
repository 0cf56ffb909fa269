"""Laurent series on a round annulus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Complex
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.holomorphic.series import power_sums, power_table


class LaurentSeries(torch.nn.Module):
    """p and q as Σ_{k ≥ 0} a_k (z/R)^k + Σ_{k > 0} b_k (ρ/z)^k on ρ < |z| < R, times √(z/R) where antiperiodic.

    Scaled by the radii, the coefficients of series that converge on the annulus stay bounded. Antiperiodic p and q
    change their sign around the annulus, across the negative real axis; all that a surface is made of, p², q² and pq,
    does not.

    Shape:
        outward: (K, 2), complex, the a_k; column 0 is p, column 1 is q.
        inward: (L, 2), the b_k from k = 1 on.
    """

    kind: ClassVar[str] = "laurent"

    def __init__(
        self,
        outward: Complex[Tensor, "k 2"],
        inward: Complex[Tensor, "l 2"],
        *,
        inner: float,
        outer: float = 1.0,
        antiperiodic: bool = False,
    ) -> None:
        """Takes the coefficients and the radii ρ and R.

        Raises:
            DtypeError: coefficients are not complex or not (K, 2) with K ≥ 1.
            OptionError: not 0 < inner < outer.
        """
        super().__init__()
        for name, part in (("outward", outward), ("inward", inward)):
            if not part.is_complex() or part.ndim != 2 or part.shape[1] != 2 or not len(part):
                raise DtypeError(
                    f"{name} must be complex coefficients of shape (K, 2), K ≥ 1, got {part.dtype} of shape "
                    f"{tuple(part.shape)}"
                )
        if not 0 < inner < outer < float("inf"):
            raise OptionError(f"an annulus has radii 0 < inner < outer, got {inner} and {outer}")
        self.inner, self.outer = float(inner), float(outer)
        self.antiperiodic = bool(antiperiodic)
        self.outward = torch.nn.Parameter(outward.clone())
        self.inward = torch.nn.Parameter(inward.clone())

    def features(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts n"]:
        """The powers (z/R)^k, k = 0 … K − 1, then (ρ/z)^k, k = 1 … L; times √(z/R) where antiperiodic."""
        u, v = z / self.outer, self.inner / z
        powers = [power_table(u, len(self.outward)), v * power_table(v, len(self.inward))]
        return (torch.cat(powers) * self._root(u)).movedim(0, -1)

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        u, v = z / self.outer, self.inner / z
        total = power_sums(u, self.outward) + v[..., None] * power_sums(v, self.inward)
        return total * self._root(u)[..., None]

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        u, v = z / self.outer, self.inner / z
        half = 0.5 if self.antiperiodic else 0.0
        k = torch.arange(max(len(self.outward), len(self.inward) + 1), device=z.device, dtype=z.real.dtype)[:, None]
        ahead = power_sums(u, (k[: len(self.outward)] + half) * self.outward)
        back = v[..., None] * power_sums(v, (half - k[1 : len(self.inward) + 1]) * self.inward)
        return (ahead + back) * (self._root(u) / z)[..., None]

    def primitive(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ), Laurent series too, with the residues' logarithms."""
        u, v = z / self.outer, self.inner / z
        outward, inward = self.products()
        k = torch.arange(1, max(len(outward), len(inward)) + 1, device=z.device, dtype=z.real.dtype)[:, None]
        ahead = u[..., None] * power_sums(u, outward * (self.outer / k[: len(outward)]))
        back = v[..., None] * power_sums(v, -inward[1:] * (self.inner / k[: len(inward) - 1]))
        return ahead + back + torch.log(u)[..., None] * (self.inner * inward[0])

    def residues(self) -> Complex[Tensor, "3"]:
        """Coefficients of 1/z in p², q² and pq: their integrals around the annulus over 2πi."""
        return self.inner * self.products()[1][0]

    def config(self) -> dict[str, Any]:
        """Numbers of terms, radii and periodicity."""
        return {
            "outward": len(self.outward),
            "inward": len(self.inward),
            "inner": self.inner,
            "outer": self.outer,
            "antiperiodic": self.antiperiodic,
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> LaurentSeries:
        """A series of zeros with the given sizes."""
        outward, inward = (torch.zeros(int(config[name]), 2, dtype=torch.complex128) for name in ("outward", "inward"))
        return cls(
            outward,
            inward,
            inner=float(config["inner"]),
            outer=float(config["outer"]),
            antiperiodic=bool(config["antiperiodic"]),
        )

    def sign_changing(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts"]:
        """√(z/R), a factor of antiperiodic p and q, or 1."""
        return self._root(z / self.outer)

    def _root(self, u: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts"]:
        return torch.sqrt(u) if self.antiperiodic else torch.ones_like(u)

    def products(self) -> tuple[Complex[Tensor, "k 3"], Complex[Tensor, "l 3"]]:
        """Coefficients a_k and b_k of the series p², q² and pq, which have no root, antiperiodic or not.

        On each of the two circles the products are Fourier series: the outer one's frequencies k ≥ 0 are the a_k, the
        inner one's k < 0 the b_k.
        """
        k, j = len(self.outward), len(self.inward)
        n = next_fast_len(2 * (k + j + 1))
        ratio = self.inner / self.outer
        fading = ratio ** torch.arange(max(k, j + 1), device=self.outward.device, dtype=self.outward.real.dtype)
        angle = torch.arange(n, device=self.outward.device, dtype=self.outward.real.dtype) * (2 * torch.pi / n)
        circle = torch.polar(torch.ones_like(angle), angle)
        parts = []
        for ahead, back, u in (
            (self.outward, self.inward * fading[1 : j + 1, None], circle),
            (self.outward * fading[:k, None], self.inward, ratio * circle),
        ):
            gap = ahead.new_zeros(n - k - j, 2)
            p, q = (torch.fft.ifft(torch.cat([ahead, gap, back.flip(0)]), dim=0) * n).unbind(-1)
            products = torch.stack([p * p, q * q, p * q], dim=-1)
            if self.antiperiodic:
                products = products * u[:, None]
            parts.append(torch.fft.fft(products, dim=0) / n)
        return parts[0][: 2 * k], parts[1].flip(0)[: 2 * j]
