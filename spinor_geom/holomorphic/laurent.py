"""Laurent series on the unit disk without round holes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from jaxtyping import Complex
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.holomorphic.cauchy import sign_changing
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.series import power_sums

ROUND_OFF = 1e-17  # smaller powers on a circle are neglected


class LaurentSeries(torch.nn.Module):
    """p and q as Σ_{k ≥ 0} a_k z^k + Σ_j Σ_{k > 0} b_jk (r_j/(z − c_j))^k where |z| < 1 and all |z − c_j| > r_j.

    The first hole must be centred at 0. Because of the scaling, the coefficients of series that converge on Ω are
    bounded. For each hole around which p and q change their sign they have a factor √(z − c_j). Its sign jumps on the
    ray from c_j in the direction of the negative real axis; p², q² and pq are continuous.

    Shape:
        outward: (K, 2), complex, the a_k; column 0 is p, column 1 is q.
        inward: (holes, L, 2), the b_jk from k = 1 on.
    """

    kind: ClassVar[str] = "laurent"

    def __init__(
        self,
        outward: Complex[Tensor, "k 2"],
        inward: Complex[Tensor, "holes l 2"],
        holes: CircularDomain,
        *,
        antiperiodic: Sequence[bool] = (),
    ) -> None:
        """`antiperiodic` marks the holes around which p and q change their sign, none by default.

        Raises:
            DtypeError: coefficients are not complex, empty, or of another shape.
            OptionError: the holes are not disjoint in the unit disk, their number is not that of the coefficients, or
                the first one is not centred at 0.
        """
        super().__init__()
        for name, part, shape in (("outward", outward, "(K, 2)"), ("inward", inward, "(holes, L, 2)")):
            wanted = shape.count(",") + 1
            if not part.is_complex() or part.ndim != wanted or part.shape[-1] != 2 or not part.numel():
                raise DtypeError(
                    f"{name} must be complex coefficients of shape {shape}, K ≥ 1, L ≥ 1, got {part.dtype} of shape "
                    f"{tuple(part.shape)}"
                )
        if not holes.nearness < 1 or len(inward) != len(holes.centres):
            raise OptionError(
                f"Laurent series need disjoint holes in the unit disk, and coefficients for each: got {len(inward)} "
                f"for holes about {holes.centres.tolist()} of radii {holes.radii.tolist()}"
            )
        if (first := complex(holes.centres[0])) != 0:  # its powers are modes of the outer circle
            raise OptionError(
                f"the first hole of a Laurent series must be centred at 0, got {first:.6g}; "
                "map Ω onto such a domain by a conformal map of the unit disk onto itself"
            )
        self.antiperiodic = tuple(map(bool, antiperiodic)) or (False,) * len(inward)
        self.outward = torch.nn.Parameter(outward.clone())
        self.inward = torch.nn.Parameter(inward.clone())
        self.register_buffer("centres", holes.centres.clone(), persistent=False)
        self.register_buffer("log_radii", holes.log_radii.clone(), persistent=False)

    @property
    def circles(self) -> CircularDomain:
        """Ω."""
        return CircularDomain(centres=self.get_buffer("centres"), log_radii=self.get_buffer("log_radii"))

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        return _sums(self.circles.coordinates(z), self.outward, self.inward) * self.sign_changing(z)[..., None]

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        outer, *inner = zeta = self.circles.coordinates(z)
        terms = max(len(self.outward), self.inward.shape[1])
        k = torch.arange(1, terms + 1, device=z.device, dtype=z.real.dtype)[:, None]
        total = power_sums(outer, self.outward[1:] * k[: len(self.outward) - 1])
        logarithmic = torch.zeros_like(outer)
        for own, coefficients, radius, odd in zip(
            inner, self.inward, self.circles.radii, self.antiperiodic, strict=True
        ):
            total = total - (own**2 / radius)[..., None] * power_sums(own, coefficients * k[: len(coefficients)])
            if odd:
                logarithmic = logarithmic + 0.5 * own / radius
        total = total + logarithmic[..., None] * _sums(zeta, self.outward, self.inward)
        return total * self.sign_changing(z)[..., None]

    def primitive(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ): Laurent series and logarithms."""
        outward, inward, residues = self.integrals()
        logarithms = torch.log(z[..., None] - self.circles.centres)
        return _sums(self.circles.coordinates(z), outward, inward) + logarithms @ residues

    def integrals(self) -> tuple[Complex[Tensor, "k 3"], Complex[Tensor, "holes l 3"], Complex[Tensor, "holes 3"]]:
        """Coefficients of the integrals of p², q² and pq: `outward`, `inward`, and those of log(z − c_j)."""
        whole, parts = self.products()
        count = max(len(whole), parts.shape[1])
        k = torch.arange(1, count + 1, device=whole.device, dtype=whole.real.dtype)[:, None]
        outward = torch.cat([torch.zeros_like(whole[:1]), whole / k[: len(whole)]])
        scaled = self.circles.radii[:, None, None] * parts
        return outward, -scaled[:, 1:] / k[: parts.shape[1] - 1], scaled[:, 0]

    def products(self) -> tuple[Complex[Tensor, "k 3"], Complex[Tensor, "holes l 3"]]:
        """Coefficients of p², q² and pq: of z^k, k ≥ 0, and of (r_j/(z − c_j))^k, k > 0.

        They are the positive frequencies of the products on the outer circle and on that of hole j.
        """
        k, j = len(self.outward), self.inward.shape[1]
        ahead = 2 * k - 1 + sum(self.antiperiodic)  # number of positive frequencies, with 0, on the outer circle
        lead, lag = max(ahead, 2 * j + 2), max(k, j)
        if len(self.inward) > 1:
            # number of powers of another circle's coordinate that are not negligible on a circle
            lag = math.ceil(math.log(ROUND_OFF) / math.log(self.circles.nearness))
        n = next_fast_len(lead + 2 * lag + 2)
        p, q = self.on_circles(n).unbind(-1)
        root = self.circles.squared_root(self.circles.circles(n), self.antiperiodic)
        spectra = torch.fft.fft(torch.stack([p * p, q * q, p * q], dim=-1) * root[..., None], dim=1) / n
        return spectra[0, :ahead], spectra[1:, 1 : 2 * (j + 1)]

    def on_circles(self, n: int) -> Complex[Tensor, "m n 2"]:
        """Values of p and q without the factors √(z − c_j), at the points of `CircularDomain.circles`."""
        return sums_on_circles(self.circles, self.own, n).permute(1, 2, 0)

    @property
    def own(self) -> Complex[Tensor, "2 m k"]:
        """Coefficients of the powers k ≥ 0 of each circle's coordinate; those of k = 0 are 0 for holes."""
        outward, inward = self.outward.T[:, None], self.inward.movedim(-1, 0)
        count = max(outward.shape[-1], inward.shape[-1] + 1)
        pad = torch.nn.functional.pad
        rows = pad(outward, (0, count - outward.shape[-1])), pad(inward, (1, count - 1 - inward.shape[-1]))
        return torch.cat(rows, dim=1)

    def config(self) -> dict[str, Any]:
        """Numbers of terms, the holes, and which of them are antiperiodic."""
        domain = self.circles
        return {
            "outward": len(self.outward),
            "inward": self.inward.shape[1],
            "centres": torch.view_as_real(domain.centres).tolist(),
            "log_radii": domain.log_radii.tolist(),
            "antiperiodic": list(self.antiperiodic),
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> LaurentSeries:
        """A series of zeros with the given sizes."""
        centres = torch.view_as_complex(torch.tensor(config["centres"], dtype=torch.float64).reshape(-1, 2))
        holes = CircularDomain(centres=centres, log_radii=torch.tensor(config["log_radii"], dtype=torch.float64))
        return cls(
            torch.zeros(int(config["outward"]), 2, dtype=torch.complex128),
            torch.zeros(len(centres), int(config["inward"]), 2, dtype=torch.complex128),
            holes,
            antiperiodic=config["antiperiodic"],
        )

    def sign_changing(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts"]:
        """The product of √(z − c_j) over the holes around which p and q change their sign."""
        return sign_changing(z, self.circles.centres[list(self.antiperiodic)])


def sums_on_circles(domain: CircularDomain, own: Complex[Tensor, "*rows m k"], n: int) -> Complex[Tensor, "*rows m n"]:
    """Σ_j Σ_k c_jk ζ_j^k at n > k equal steps of every circle, ζ_j the coordinate of circle j."""
    if domain.rims == 1:
        alone: Tensor = torch.fft.ifft(own, n=n, norm="forward")
        return alone
    return parts_on_circles(domain, own, n).sum(-2)


def parts_on_circles(
    domain: CircularDomain, own: Complex[Tensor, "*rows m k"], n: int
) -> Complex[Tensor, "*rows m m n"]:
    """Σ_k c_jk ζ_j^k at n > k equal steps of every circle i: entry (i, j, step)."""
    m, count = own.shape[-2:]
    spectrum = own.new_zeros(*own.shape[:-2], m, m, n)
    torch.diagonal(spectrum, dim1=-3, dim2=-2)[..., :count, :] = own.mT
    if m > 1:
        # the first hole is concentric with the outer circle: powers of one coordinate are Fourier modes on the other
        k = torch.arange(count, dtype=own.real.dtype, device=own.device)
        for there, here in ((0, 1), (1, 0)):
            lagging = own[..., there, :] * domain.radii[0] ** k
            spectrum[..., here, there, 0] = lagging[..., 0]
            spectrum[..., here, there, n - count + 1 :] = lagging[..., 1:].flip(-1)
    parts: Tensor = torch.fft.ifft(spectrum, norm="forward")
    if m > 2:
        apart = torch.ones(m, m, dtype=torch.bool, device=own.device).fill_diagonal_(False)
        apart[:2, :2] = False
        here, there = apart.nonzero().T
        zeta = domain.coordinates(domain.circles(n))[there, here]
        terms = math.ceil(math.log(ROUND_OFF) / math.log(float(domain.gaps[apart].max()))) + 1
        total = parts.new_zeros(*own.shape[:-2], len(here), n)
        for coefficients in own[..., there, :terms].unbind(-1)[::-1]:
            total = total * zeta + coefficients[..., None]
        parts[..., here, there, :] = total
    return parts


def _sums(
    zeta: Complex[Tensor, "m *pts"], outward: Complex[Tensor, "k c"], inward: Complex[Tensor, "holes l c"]
) -> Complex[Tensor, "*pts c"]:
    outer, *inner = zeta
    total = power_sums(outer, outward)
    for own, coefficients in zip(inner, inward, strict=True):
        total = total + own[..., None] * power_sums(own, coefficients)
    return total
