"""The Cauchy network: polynomials and Cauchy units as one shared hidden layer, with two linear read-outs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, complex_of, namespace, place_of, triangular_factor, zeros
from spinor_geom.deadline import require_time
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg, arnoldi_polynomials, barycentric_weights, leja_points
from spinor_geom.holomorphic.array_model import ArrayModel, blank
from spinor_geom.holomorphic.blocks import in_blocks, require_complex
from spinor_geom.holomorphic.cauchy_sums import direct_sums
from spinor_geom.holomorphic.interpolant import interpolated, interpolated_slope

# of a factorisation or a Gram matrix of features at nodes, per node and squared number of features
FACTOR_SECONDS = 6e-10


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CauchyNetwork(ArrayModel):
    """p and q as linear combinations of polynomials and Cauchy units d_k/(z − ζ_k) with poles ζ_k outside Ω.

    It is a complex-valued network with one hidden layer and activation σ(u) = 1/u. Its features are usually mixed so
    that they are orthonormal on ∂Ω. Fits then converge in few steps. For each hole around which p and q change their
    sign all features have a factor √(z − c), c in the hole. Its sign jumps where z − c is real and negative. p², q²
    and pq are continuous.

    Shape:
        hessenberg: (degree + 1, degree), recurrence of the polynomials.
        poles: (K,), scales: (K,): ζ_k and d_k.
        mixing: (degree + 1 + K, n), from raw to mixed features.
        leja: (degree + 1,), points at which polynomials are interpolated.
        at_leja: (degree + 1, degree + 1), the orthogonal polynomials there, one in each column.
        branch: (b,), the points c.
        readout: (n, 2), the trainable coefficients of p and q.
    """

    kind: ClassVar[str] = "cauchy"
    trained: ClassVar[tuple[str, ...]] = ("readout",)
    fixed: ClassVar[tuple[str, ...]] = ("hessenberg", "poles", "scales", "mixing", "branch", "leja", "at_leja")

    hessenberg: Complex[Array, "d1 d"]
    poles: Complex[Array, " k"]
    scales: Float[Array, " k"]
    mixing: Complex[Array, "r n"]
    leja: Complex[Array, " d1"]
    at_leja: Complex[Array, "d1 d1"]
    branch: Complex[Array, " b"]
    readout: Complex[Array, "n 2"]

    def __post_init__(self) -> None:
        """Raises DtypeError if poles, mixing or read-out are not complex."""
        require_complex(poles=self.poles, mixing=self.mixing, readout=self.readout)

    @classmethod
    def orthonormal_on(
        cls,
        z: Complex[Array, " n"],
        weight: Float[Array, " n"],
        *,
        poles: Complex[Array, " k"],
        scales: Float[Array, " k"],
        degree: int,
        branches: Sequence[complex] = (),
    ) -> CauchyNetwork:
        """A network with zero read-outs and features orthonormal in ⟨f, g⟩ = Σ weight·conj(f)·g.

        The nodes z are usually on ∂Ω, and the scales the distances of the poles from it. The positive weights are
        normalised to sum 1. `degree` is that of the polynomials. `branches` has a point c in each hole around which p
        and q change their sign. Singular vectors of the raw features below 1e-8 times the largest singular value
        are dropped, because p and q lose digits if large coefficients cancel.

        Raises an OutOfTimeError if the estimated time is longer than what is left of the time limit.
        """
        require_complex(nodes=z, poles=poles)
        weight = weight / weight.sum()
        hessenberg = arnoldi_hessenberg(z, weight, degree)
        raw = raw_features(z, hessenberg, poles, scales)
        xp, at = namespace(z), place_of(z).put(np.array(branches, dtype=np.complex128))
        root = xp.sqrt(weight)[:, None] * sign_changing(z, at)[:, None]
        require_time(FACTOR_SECONDS * raw.shape[0] * raw.shape[1] ** 2)
        # QR first: the SVD then works on a small square matrix
        _, s, vh = xp.linalg.svd(triangular_factor(raw * root), full_matrices=False)
        keep = s > 1e-8 * s[0]
        mixing, layer = vh.mT.conj()[:, keep] / s[keep], _polynomials(z, hessenberg)
        readout = zeros((mixing.shape[1], 2), mixing)
        return cls(poles=poles, scales=scales, mixing=mixing, branch=at, readout=readout, **layer)

    @classmethod
    def of_raw_features(
        cls,
        z: Complex[Array, " n"],
        *,
        hessenberg: Complex[Array, "d1 d"],
        poles: Complex[Array, " k"],
        scales: Float[Array, " k"],
        readout: Complex[Array, "r 2"],
        branches: Complex[Array, " b"] | None = None,
    ) -> CauchyNetwork:
        """A network whose features are the polynomials of a recurrence, then the units, without mixing.

        The points z are on all of ∂Ω. `branches` has a point in each hole around which p and q change their sign.
        """
        mixing, layer = place_of(z).put(np.eye(len(readout), dtype=np.complex128)), _polynomials(z, hessenberg)
        branches = poles[:0] if branches is None else branches
        return cls(poles=poles, scales=scales, mixing=mixing, readout=readout, branch=branches, **layer)

    def sign_changing(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts"]:
        """The product of √(z − c), a factor of p and q without zeros in Ω."""
        return sign_changing(z, self.branch)

    def features(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts n"]:
        """The hidden layer at z: p and q are linear in it."""
        raw = raw_features(z, self.hessenberg, self.poles, self.scales)
        return (self.sign_changing(z)[..., None] * raw) @ self.mixing

    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z))."""
        return self.sign_changing(z)[..., None] * self._rational(z)

    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""
        if not len(self.branch):
            return self._rational_derivative(z)
        logarithmic = (0.5 / (z[..., None] - self.branch)).sum(-1)[..., None] * self._rational(z)
        return self.sign_changing(z)[..., None] * (self._rational_derivative(z) + logarithmic)

    def _rational(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        polynomial, units = self._coefficients()

        def part(some: Complex[Array, " n"]) -> Complex[Array, "n 2"]:
            whole = interpolated(some, self.leja, self._leja_weights, polynomial)
            return whole - direct_sums(self.poles, units, some)

        return in_blocks(part, z, width=len(self.leja) + len(self.poles))

    def _rational_derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        polynomial, units = self._coefficients()

        def part(some: Complex[Array, " n"]) -> Complex[Array, "n 2"]:
            return -((some[:, None] - self.poles) ** -2) @ units

        whole = in_blocks(
            lambda some: interpolated_slope(some, self.leja, self._leja_weights, polynomial), z, width=len(self.leja)
        )
        return whole + in_blocks(part, z, width=len(self.poles))

    @cached_property
    def _leja_weights(self) -> Complex[Array, " d1"]:
        return barycentric_weights(self.leja)

    def _coefficients(self) -> tuple[Complex[Array, "d1 2"], Complex[Array, "k 2"]]:
        """Values of the polynomial parts of p and q at the Leja points, and their coefficients of 1/(z − ζ_k)."""
        raw = self.mixing @ self.readout
        split = len(self.leja)
        # the recurrence takes O(degree²) operations per point, interpolation O(degree)
        return self.at_leja @ raw[:split], self.scales[:, None] * raw[split:]

    def config(self) -> dict[str, Any]:
        """Degree and numbers of poles, of mixed features, and of holes around which p and q change their sign."""
        return {
            "degree": self.hessenberg.shape[1],
            "poles": len(self.poles),
            "features": self.mixing.shape[1],
            "antiperiodic": len(self.branch),
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> CauchyNetwork:
        """A network of zeros with the given sizes."""
        degree, poles, features = int(config["degree"]), int(config["poles"]), int(config["features"])
        return cls(
            hessenberg=blank(degree + 1, degree),
            poles=blank(poles),
            scales=blank(poles, dtype=np.float64),
            mixing=blank(degree + 1 + poles, features),
            leja=blank(degree + 1),
            at_leja=blank(degree + 1, degree + 1),
            branch=blank(int(config["antiperiodic"])),
            readout=blank(features, 2),
        )


def _polynomials(z: Complex[Array, " n"], hessenberg: Complex[Array, "d1 d"]) -> dict[str, Array]:
    """The arguments of `CauchyNetwork` that describe its polynomials."""
    leja = leja_points(z, len(hessenberg))
    return {"hessenberg": hessenberg, "leja": leja, "at_leja": arnoldi_polynomials(leja, hessenberg)}


def sign_changing(z: Complex[Array, "*pts"], branch: Complex[Array, " b"]) -> Complex[Array, "*pts"]:
    """The product of √(z − c) for all points c."""
    return namespace(z).sqrt(z[..., None] - branch).prod(-1)


def raw_features(
    z: Complex[Array, "*pts"],
    hessenberg: Complex[Array, "d1 d"],
    poles: Complex[Array, " k"],
    scales: Float[Array, " k"],
) -> Complex[Array, "*pts r"]:
    """The polynomials Q_0 … Q_d and the units d_k/(z − ζ_k)."""
    return namespace(z).concat([arnoldi_polynomials(z, hessenberg), cauchy_units(z, poles, scales)], axis=-1)


def cauchy_units(
    z: Complex[Array, "*pts"], poles: Complex[Array, " k"], scales: Float[Array, " k"]
) -> Complex[Array, "*pts k"]:
    """The units d_k/(z − ζ_k)."""

    def part(some: Complex[Array, " n"]) -> Complex[Array, "n k"]:
        return complex_of(*_inverse_differences(some, poles, scales))

    return in_blocks(part, z, width=max(1, len(poles)))


def _inverse_differences(
    z: Complex[Array, " n"], other: Complex[Array, " k"], factors: Float[Array, " k"] | float = 1.0
) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Real and imaginary parts of factors/(z − ζ_k), several times faster than complex division."""
    x, y = z.real[:, None] - other.real, other.imag - z.imag[:, None]
    inverse = factors / (x * x + y * y)
    return x * inverse, y * inverse
