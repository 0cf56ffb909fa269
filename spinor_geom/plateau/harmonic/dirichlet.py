"""The Dirichlet-to-Neumann map of plane domains with one analytic boundary, and of disks with round holes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import circulant

from spinor_geom.arrays import Array, Place, arange, contiguous, namespace, place_of
from spinor_geom.deadline import require_time
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF


@dataclass(frozen=True, kw_only=True, eq=False)
class DirichletForm:
    """The Dirichlet-to-Neumann map Λ of Ω: boundary values x(t) ↦ ∂x*/∂θ, θ = 2πt, with x* the conjugate of x.

    ½ ∫ x·Λx dθ is the Dirichlet energy of the harmonic function with boundary values x. It does not depend on the
    parameter of ∂Ω. On the disk Λ multiplies Fourier coefficients by |k|. On an analytic ∂Ω it differs from that by an
    operator with a smooth kernel, which acts on low frequencies only, so that a small matrix suffices for any number of
    samples. That operator comes from the Cauchy kernel without its singular part, a cotangent, by the trapezoidal rule.

    Source: Kress, "Linear Integral Equations" (2014), sections 7 and 12, for the integral equation.
    """

    boundary: FourierBoundary  # ∂Ω
    # smooth part of the Cauchy kernel on c equal steps, with the weight 1/c, and Λ − |k|. None on the disk
    kernel: Complex[Array, "c c"] | None
    correction: Float[Array, "c c"] | None
    # The larger of two errors. That of Λz = −i dz/dθ, relative to the largest |dz/dθ|, does not detect parts of ∂Ω that
    # face each other closely. The asymmetry of the correction, relative to the largest entry of |k|, is 0 on symmetric
    # domains such as ellipses.
    error: float

    @classmethod
    @lru_cache(maxsize=16)
    def of_disk(cls, vertices: int) -> DirichletForm:
        """Λ of the unit disk, z(t) = e^{2πit}, with a number of vertices on ∂Ω."""
        return cls(boundary=FourierBoundary.circle(1.0, vertices), kernel=None, correction=None, error=0.0)

    @classmethod
    def of(cls, boundary: FourierBoundary, n: int, place: Place) -> DirichletForm:
        """Λ of any Ω, for an even n that resolves the kernel. The cost is O(n³).

        Raises:
            OutOfTimeError: time ran out.
        """
        z, dz, ddz = boundary.grid(n)
        kernel = _smooth_kernel(z, dz) / n
        np.fill_diagonal(kernel, ddz / (4 * np.pi * dz * n))
        k = np.arange(n // 2 + 1)
        k[-1] = 0
        # column j is the conjugate of e_j on the disk
        disk = circulant(np.fft.irfft(-1j * np.sign(k), n=n))
        require_time()  # the solution takes seconds for thousands of steps
        # a real density μ gives the boundary values (½ + Im kernel) μ and their conjugate (½ H − Re kernel) μ
        conjugate = np.linalg.solve((0.5 * np.eye(n) + kernel.imag).T, (0.5 * disk - kernel.real).T).T
        slope = np.fft.irfft((1j * k)[:, None] * np.fft.rfft(conjugate - disk, axis=0), n=n, axis=0)
        asymmetry = float(np.abs(slope - slope.T).max()) / (n / 4)
        correction = (slope + slope.T) / 2
        form = cls(boundary=boundary, kernel=place.put(kernel), correction=place.put(correction), error=asymmetry)
        on = replace(form, correction=correction)
        off = 2 * np.pi * on(np.stack([z.real, z.imag], axis=1)) - np.stack([dz.imag, -dz.real], axis=1)
        return replace(form, error=max(asymmetry, float(np.abs(off).max() / np.abs(dz).max())))

    @property
    def is_disk(self) -> bool:
        """Whether Ω is the unit disk, parametrised by angle."""
        return self.correction is None

    def __call__(self, x: Float[Array, "*batch n k"]) -> Float[Array, "*batch n k"]:
        """Λ applied to columns of samples at t = j/n."""
        xp = namespace(x)
        # transformed as rows, because on some processors the rounding of a column depends on the number of columns
        return xp.moveaxis(self.on_rows(contiguous(xp.moveaxis(x, -1, 0))), 0, -1)

    def on_rows(self, x: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
        """Λ applied to rows of samples at t = j/n."""
        n, xp = x.shape[-1], namespace(x)
        spectrum = xp.fft.rfft(x)
        result = spectrum * frequencies(n, place_of(x))
        if self.correction is not None:
            count = len(self.correction)
            half = count // 2
            # BLAS is far slower on narrow columns, and the matrix is symmetric. It is read once for all rows
            low = xp.fft.irfft(spectrum[..., :half], n=count).reshape(-1, count) @ self.correction
            result[..., :half] += xp.fft.rfft(low).reshape(*x.shape[:-1], -1)[..., :half]
        return xp.fft.irfft(result, n=n)


@lru_cache(maxsize=64)
def frequencies(n: int, place: Place) -> Float[Array, " k"]:
    """Frequencies of the real Fourier transform of n values."""
    return place.put(np.arange(n // 2 + 1, dtype=np.float64))


def _smooth_kernel(z: Complex[np.ndarray, " n"], dz: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n n"]:
    """z'(τ)/(2π(z(τ) − z(t))) − ½cot(π(τ − t)) at equal steps without diagonal: the smooth part of the kernel."""
    step = np.arange(len(z)) / len(z)
    step[0] = 0.5
    difference = z - z[:, None]
    np.fill_diagonal(difference, 1)
    return np.asarray(dz / (2 * np.pi) / difference - circulant(0.5 / np.tan(np.pi * step)).T)


@dataclass(frozen=True, kw_only=True, eq=False)
class CirclesForm:
    """Λ of the unit disk less round holes, on equal steps of the angle τ of every circle. See `DirichletForm`.

    Each circle has a coordinate ζ that maps its side of the plane to the unit disk: ζ = z for the unit circle,
    ζ = r/(z − c) for a hole. A harmonic function on Ω is the real part of a sum of powers of all coordinates, and of a
    logarithm for each hole. On a circle the normal derivative is |k| on the powers of its own coordinate and −|k| on
    the others. Between two concentric circles Λ multiplies Fourier coefficients. With more circles it differs from |k|
    by an operator with a smooth kernel.
    """

    domain: CircularDomain  # Ω
    steps: int  # n, of every circle
    own: Float[Array, " f"]  # multipliers of a circle's own values, frequencies 0 … n/2
    # multipliers of the conjugate spectrum of the other circle, or None with more than two circles
    other: Float[Array, " f"] | None
    # Λ − |k| on c equal steps of every circle, which resolve it, or None for two circles
    correction: Float[Array, "mc mc"] | None
    error: float  # asymmetry of the correction, relative to the largest entry of |k|

    @classmethod
    def of(cls, domain: CircularDomain, n: int, *, negligible: float = ROUND_OFF) -> CirclesForm:
        """Λ on n equal steps of every circle, n even. Powers below `negligible` on other circles are omitted."""
        if domain.rims == 2:
            own, other = multipliers(-domain.log_radii[:1], n)
            return cls(domain=domain, steps=n, own=own[0], other=other[0], correction=None, error=0.0)
        own = arange(n // 2 + 1, domain.radii)
        powers = math.log(negligible) / math.log(domain.nearness)
        count = n if powers >= n // 2 else 2 * math.ceil(powers)
        coupling = _coupling(domain, count)
        error = float(abs(coupling - coupling.T).max()) / (count / 4)
        return cls(domain=domain, steps=n, own=own, other=None, correction=(coupling + coupling.T) / 2, error=error)

    def __call__(self, x: Float[Array, "*batch m n c"]) -> Float[Array, "*batch m n c"]:
        """Λ applied to columns of samples on all circles."""
        n, xp = self.steps, namespace(x)
        spectrum = xp.fft.rfft(x, axis=-2)
        result = self.own[:, None] * spectrum
        if self.other is not None:
            result = result + self.other[:, None] * xp.flip(spectrum, axis=-3).conj()
        if self.correction is not None:
            m = x.shape[-3]
            count = len(self.correction) // m
            few = count // 2 + (count == n)
            low = xp.fft.irfft(spectrum[..., :few, :], n=count, axis=-2) * (count / n)
            change = (self.correction @ low.reshape(*x.shape[:-3], m * count, x.shape[-1])).reshape(
                *x.shape[:-3], m, count, x.shape[-1]
            )
            result[..., :few, :] += xp.fft.rfft(change, axis=-2)[..., :few, :] * (n / count)
        return xp.fft.irfft(result, n=n, axis=-2)

    def matrix(self) -> Float[Array, "mn mn"]:
        """Λ as a matrix on the samples of all circles, circle by circle."""
        n, m, xp = self.steps, self.domain.rims, namespace(self.own)
        j = place_of(self.own).put(np.arange(n))
        own = xp.fft.irfft(self.own + 0j, n=n)[(j[:, None] - j) % n]
        if self.other is not None:
            other = xp.fft.irfft(self.other + 0j, n=n)[(j[:, None] + j) % n]
            return xp.concat([xp.concat([own, other], axis=1), xp.concat([other, own], axis=1)])
        assert self.correction is not None
        count = len(self.correction) // m
        matrix = self.correction.reshape(m, count, m, count)
        if count < n:
            # interpolated on both sides, times n/c because sums run over n steps
            spectrum = xp.fft.rfft(matrix, axis=1)[:, : count // 2]
            matrix = xp.fft.irfft(spectrum, n=n, axis=1) * (n / count)
            spectrum = xp.fft.rfft(matrix, axis=3)[..., : count // 2]
            matrix = xp.fft.irfft(spectrum, n=n, axis=3)
        matrix, each = xp.asarray(matrix.reshape(m, n, m, n), copy=True), np.arange(m)
        matrix[each, :, each] += own
        return matrix.reshape(m * n, m * n)


def multipliers(modulus: Float[Array, "*m"], n: int) -> tuple[Float[Array, "*m f"], Float[Array, "*m f"]]:
    """Multipliers of the Dirichlet-to-Neumann map of cylinders of modulus m, on n equal steps of both rims.

    Both rims are oriented with the cylinder on their left. For k = 0 … n/2 the multiplier of a rim's own spectrum is
    |k| coth |k|m, that of the other rim's conjugate spectrum −|k| / sinh |k|m (for k = 0: ±1/m).
    """
    m, xp = modulus[..., None], namespace(modulus)
    k = arange(n // 2 + 1, m)
    k[0] = 1
    # coth and 1/sinh of km without overflow
    e, rest = xp.exp(-k * m), -xp.expm1(-2 * k * m)
    own, other = k * (1 + e * e) / rest, -2 * k * e / rest
    own[..., 0], other[..., 0] = 1 / modulus, -1 / modulus
    return own, other


def _coupling(domain: CircularDomain, n: int) -> Float[Array, "mn mn"]:
    """Λ − |k| by collocation of harmonic functions at n equal steps of every circle.

    The functions of a circle are the powers of its coordinate, and 1 (outer circle) or log(|z − c|/r) (holes). Only the
    real part of the highest power is used: its imaginary part is 0 at n equal steps.
    """
    m, zeta = domain.rims, domain.coordinates_on_circles(n)
    xp = namespace(zeta)
    powers = xp.broadcast_to(zeta[:, None], (m, n // 2, *zeta.shape[1:])).cumprod(1)
    first = -xp.log(abs(zeta))[:, None]
    first[0] = 1
    values = xp.concat([first, powers.real, powers.imag[:, :-1]], axis=1)  # coordinate, function, circle, step
    circle = np.arange(m)
    of_others = xp.asarray(values, copy=True)
    of_others[circle, :, circle] = 0
    spectrum = xp.fft.rfft(of_others)
    frequency = arange(spectrum.shape[-1], values)
    # the normal derivative multiplies own powers by |k|, all others by −|k|
    change = xp.fft.irfft(-2 * frequency * spectrum, n=n)
    # the flux of a logarithm: out of Ω at the outer circle, into it at its hole
    change[1:, 0, 0] += 1
    change[circle[1:], 0, circle[1:]] -= 1
    coupling: Array = xp.linalg.solve(values.reshape(m * n, m * n), change.reshape(m * n, m * n)).mT
    return coupling


def derivative(x: Float[Array, "*m n c"]) -> Float[Array, "*m n c"]:
    """dx/dτ of columns at n equal steps of every circle, where that of the highest frequency is 0."""
    n, xp = x.shape[-2], namespace(x)
    k = 1j * arange(n // 2 + 1, x)
    k[-1] = 0
    # transformed as rows: see `DirichletForm.__call__`
    return xp.fft.irfft(k * xp.fft.rfft(contiguous(x.mT)), n=n).mT


def without_highest(x: Float[Array, "*m n c"]) -> Float[Array, "*m n c"]:
    """Columns at n equal steps of every circle, without their highest frequency."""
    n, xp = x.shape[-2], namespace(x)
    return xp.fft.irfft(xp.fft.rfft(x, axis=-2)[..., : n // 2, :], n=n, axis=-2)
