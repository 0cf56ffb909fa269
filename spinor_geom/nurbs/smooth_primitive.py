"""∫ φ dz along a boundary of Ω without corners, by Fourier series in its parameter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import BSpline

from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums
from spinor_geom.mesh.interpolation import interpolating_spline
from spinor_geom.surface.interior import NullCurve, Places

_FEWEST, _MOST = 256, 1 << 14  # numbers of nodes
# degree of the splines that evaluate the series, and their nodes per node: then they are as accurate
_DEGREE, _FINER = 7, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothPrimitive:
    """∫ φ dz along an analytic boundary of Ω, at equal steps of its parameter t."""

    z: Complex[np.ndarray, " n"]  # the nodes on ∂Ω
    dz: Complex[np.ndarray, " n"]  # dz/dt there
    values: Complex[np.ndarray, "n 3"]  # ∫ φ dz from the first node
    # bound of the coefficients of the upper quarter of the frequencies, relative to the largest one. The relative error
    # is about as large
    accuracy: float

    @classmethod
    def along(cls, boundary: FourierBoundary, phi: NullCurve, accuracy: float) -> SmoothPrimitive | None:
        """The integral of φ with as many nodes as the accuracy needs, or None if `_MOST` are too few."""
        n = _FEWEST
        while n <= _MOST:
            if n > 2 * len(boundary.coefficients):
                z, dz, _ = boundary.grid(n)
                k = np.fft.fftfreq(n, 1 / n)[:, None]
                spectrum = np.fft.fft(phi(z) * dz[:, None], axis=0)
                spectrum = np.divide(spectrum, 2j * np.pi * k, out=np.zeros_like(spectrum), where=k != 0)
                size = np.abs(spectrum).max(axis=1)
                if size[np.abs(k[:, 0]) > 3 * n / 8].max() <= accuracy * size.max():
                    values = np.fft.ifft(spectrum, axis=0)
                    return cls(z=z, dz=dz, values=values - values[0], accuracy=accuracy)
            n *= 2
        return None

    def at(self, t: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]:
        """Displacements Re ∫ φ dz from the first node to parameters in [0, 1), and their derivatives in t."""
        spline, slope = self._splines
        return np.asarray(spline(t)), np.asarray(slope(t))

    def inside(self, z: Places) -> Complex[np.ndarray, "k 3"]:
        """∫ φ dz from the first node to points inside a boundary without holes, undefined at the nodes.

        The trapezoidal rule for Cauchy's formula is divided by the same rule for 1: near ∂Ω their errors cancel.

        Source: Ioakimidis, Papadakis & Perdios, "Numerical evaluation of analytic functions by Cauchy's theorem", BIT
        31 (1991).
        """
        strengths = np.column_stack([self.values, np.ones(len(self.values))]) * self.dz[:, None]
        sums = cauchy_sums(self.z, strengths, z)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(sums[:, :3] / sums[:, 3:])

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline]:
        n, fine = len(self.z), _FINER * len(self.z)
        spectrum = np.fft.rfft(self.values.real, axis=0)
        values = np.fft.irfft(spectrum, n=fine, axis=0) * (fine / n)
        values = np.concatenate([values, values[:1]])
        spline = interpolating_spline(np.linspace(0, 1, fine + 1), values, _DEGREE, bc_type="periodic")
        return spline, spline.derivative()
