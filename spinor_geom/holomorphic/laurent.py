"""Laurent series on the unit disk without round holes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Complex, Float
from scipy.fft import next_fast_len

from spinor_geom.arrays import Array, arange, is_real, namespace, padded, zeros
from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.holomorphic.array_model import ArrayModel, blank
from spinor_geom.holomorphic.cauchy import sign_changing
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.series import power_sums

ROUND_OFF = 1e-17  # smaller powers on a circle are neglected


@dataclass(frozen=True, init=False, eq=False, repr=False)
class LaurentSeries(ArrayModel):
    """p and q as Σ_{k ≥ 0} a_k z^k + Σ_j Σ_{k > 0} b_jk (r_j/(z − c_j))^k where |z| < 1 and all |z − c_j| > r_j.

    The first hole must be centred at 0. Because of the scaling, the coefficients of series that converge on Ω are
    bounded. For each hole around which p and q change their sign they have a factor √(z − c_j). Its sign jumps on the
    ray from c_j in the direction of the negative real axis. p², q² and pq are continuous.

    Shape:
        outward: (K, 2), complex, the a_k. Column 0 is p, column 1 is q.
        inward: (holes, L, 2), the b_jk from k = 1 on.
    """

    kind: ClassVar[str] = "laurent"
    trained: ClassVar[tuple[str, ...]] = ("outward", "inward")
    described: ClassVar[tuple[str, ...]] = ("centres", "log_radii")

    outward: Complex[Array, "k 2"]
    inward: Complex[Array, "holes l 2"]
    centres: Complex[Array, " holes"]
    log_radii: Float[Array, " holes"]
    antiperiodic: tuple[bool, ...]

    def __init__(
        self,
        outward: Complex[Array, "k 2"],
        inward: Complex[Array, "holes l 2"],
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
        for name, part, shape in (("outward", outward, "(K, 2)"), ("inward", inward, "(holes, L, 2)")):
            wanted = shape.count(",") + 1
            if is_real(part) or part.ndim != wanted or part.shape[-1] != 2 or 0 in part.shape:
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
        vars(self).update(
            outward=outward,
            inward=inward,
            centres=holes.centres,
            log_radii=holes.log_radii,
            antiperiodic=tuple(map(bool, antiperiodic)) or (False,) * len(inward),
        )

    @cached_property
    def circles(self) -> CircularDomain:
        """Ω."""
        return CircularDomain(centres=self.centres, log_radii=self.log_radii)

    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z))."""
        return _sums(self.circles.coordinates(z), self.outward, self.inward) * self.sign_changing(z)[..., None]

    def part(self, z: Complex[Array, "*pts"], number: int) -> Complex[Array, "*pts 2"]:
        """The part of p and q in powers of one circle's coordinate, without the factors √(z − c_j)."""
        zeta = self.circles.coordinates(z)[number]
        if number == 0:
            return power_sums(zeta, self.outward)
        return zeta[..., None] * power_sums(zeta, self.inward[number - 1])

    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""
        outer, *inner = zeta = self.circles.coordinates(z)
        terms = max(len(self.outward), self.inward.shape[1])
        k = arange(terms + 1, z, start=1)[:, None]
        total = power_sums(outer, self.outward[1:] * k[: len(self.outward) - 1])
        logarithmic = namespace(z).zeros_like(outer)
        for own, coefficients, radius, odd in zip(
            inner, self.inward, self.circles.radii, self.antiperiodic, strict=True
        ):
            total = total - (own**2 / radius)[..., None] * power_sums(own, coefficients * k[: len(coefficients)])
            if odd:
                logarithmic = logarithmic + 0.5 * own / radius
        total = total + logarithmic[..., None] * _sums(zeta, self.outward, self.inward)
        return total * self.sign_changing(z)[..., None]

    def primitive(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ): Laurent series and logarithms."""
        outward, inward, residues = self.integrals()
        logarithms = namespace(z).log(z[..., None] - self.centres)
        return _sums(self.circles.coordinates(z), outward, inward) + logarithms @ residues

    def integrals(self) -> tuple[Complex[Array, "k 3"], Complex[Array, "holes l 3"], Complex[Array, "holes 3"]]:
        """Coefficients of the integrals of p², q² and pq: `outward`, `inward`, and those of log(z − c_j)."""
        whole, parts = self.products()
        count = max(len(whole), parts.shape[1])
        k, xp = arange(count + 1, whole, start=1)[:, None], namespace(whole)
        outward = xp.concat([xp.zeros_like(whole[:1]), whole / k[: len(whole)]])
        scaled = self.circles.radii[:, None, None] * parts
        return outward, -scaled[:, 1:] / k[: parts.shape[1] - 1], scaled[:, 0]

    def products(self) -> tuple[Complex[Array, "k 3"], Complex[Array, "holes l 3"]]:
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
        values, xp = self.on_circles(n), namespace(self.outward)
        p, q = values[..., 0], values[..., 1]
        root = self.circles.squared_root(self.circles.circles(n), self.antiperiodic)
        spectra = xp.fft.fft(xp.stack([p * p, q * q, p * q], axis=-1) * root[..., None], axis=1) / n
        return spectra[0, :ahead], spectra[1:, 1 : 2 * (j + 1)]

    def on_circles(self, n: int) -> Complex[Array, "m n 2"]:
        """Values of p and q without the factors √(z − c_j), at the points of `CircularDomain.circles`."""
        return namespace(self.outward).moveaxis(sums_on_circles(self.circles, self.own, n), 0, -1)

    @property
    def own(self) -> Complex[Array, "2 m k"]:
        """Coefficients of the powers k ≥ 0 of each circle's coordinate. Those of k = 0 are 0 for holes."""
        xp = namespace(self.outward)
        outward, inward = self.outward.mT[:, None], xp.moveaxis(self.inward, -1, 0)
        count = max(outward.shape[-1], inward.shape[-1] + 1)
        rows = padded(outward, 0, count - outward.shape[-1]), padded(inward, 1, count - 1 - inward.shape[-1])
        return xp.concat(rows, axis=1)

    def config(self) -> dict[str, Any]:
        """Numbers of terms, the holes, and which of them are antiperiodic."""
        return {
            "outward": len(self.outward),
            "inward": self.inward.shape[1],
            "centres": [[centre.real, centre.imag] for centre in self.centres.tolist()],
            "log_radii": self.log_radii.tolist(),
            "antiperiodic": list(self.antiperiodic),
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> LaurentSeries:
        """A series of zeros with the given sizes."""
        centres = np.array([complex(*centre) for centre in config["centres"]], dtype=np.complex128)
        holes = CircularDomain(centres=centres, log_radii=np.array(config["log_radii"], dtype=np.float64))
        return cls(
            blank(int(config["outward"]), 2),
            blank(len(centres), int(config["inward"]), 2),
            holes,
            antiperiodic=config["antiperiodic"],
        )

    def sign_changing(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts"]:
        """The product of √(z − c_j) over the holes around which p and q change their sign."""
        return sign_changing(z, self.centres[list(self.antiperiodic)])


def sums_on_circles(domain: CircularDomain, own: Complex[Array, "*rows m k"], n: int) -> Complex[Array, "*rows m n"]:
    """Σ_j Σ_k c_jk ζ_j^k at n > k equal steps of every circle, ζ_j the coordinate of circle j."""
    if domain.rims == 1:
        return namespace(own).fft.ifft(own, n=n, norm="forward")
    return parts_on_circles(domain, own, n).sum(-2)


def parts_on_circles(domain: CircularDomain, own: Complex[Array, "*rows m k"], n: int) -> Complex[Array, "*rows m m n"]:
    """Σ_k c_jk ζ_j^k at n > k equal steps of every circle i: entry (i, j, step)."""
    (m, count), xp = own.shape[-2:], namespace(own)
    spectrum, each = zeros((*own.shape[:-2], m, m, n), own), xp.arange(m)
    spectrum[..., each, each, :count] = own
    if m > 1:
        # the first hole is concentric with the outer circle: powers of one coordinate are Fourier modes on the other
        k = arange(count, own)
        for there, here in ((0, 1), (1, 0)):
            lagging = own[..., there, :] * domain.radii[0] ** k
            spectrum[..., here, there, 0] = lagging[..., 0]
            spectrum[..., here, there, n - count + 1 :] = xp.flip(lagging[..., 1:], axis=-1)
    parts = xp.fft.ifft(spectrum, norm="forward")
    if m > 2:
        apart = ~np.eye(m, dtype=bool)
        apart[:2, :2] = False
        rows, columns = apart.nonzero()
        zeta = domain.coordinates(domain.circles(n))[columns, rows]
        terms = math.ceil(math.log(ROUND_OFF) / math.log(float(domain.gaps[apart].max()))) + 1
        total = zeros((*own.shape[:-2], len(rows), n), parts)
        for k in reversed(range(min(terms, count))):
            total = total * zeta + own[..., columns, k, None]
        parts[..., rows, columns, :] = total
    return parts


def _sums(
    zeta: Complex[Array, "m *pts"], outward: Complex[Array, "k c"], inward: Complex[Array, "holes l c"]
) -> Complex[Array, "*pts c"]:
    outer, *inner = zeta
    total = power_sums(outer, outward)
    for own, coefficients in zip(inner, inward, strict=True):
        total = total + own[..., None] * power_sums(own, coefficients)
    return total
