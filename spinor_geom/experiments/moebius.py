"""Spinors compared up to what leaves a surface as it is: Möbius maps of the disk, and the sign of p and q together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import least_squares

from spinor_geom.surface import SpinorSurface

# points on each of the circles that spinors are compared on, and the circles
_POINTS, _RADII = 64, (1.0, 0.6, 0.25)
# turns that the fit starts from
_STARTS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class MoebiusFit:
    """The Möbius map T of the disk and the sign ± for which p ≈ ±p₀∘T √T′ and q ≈ ±q₀∘T √T′.

    Attributes:
        center: a, T(a) = 0.
        turn: θ, T(z) = e^{iθ}(z − a)/(1 − āz).
        sign: ±1.
        spinor_residual: largest |difference| of p and q, as a share of their largest modulus.
        weierstrass_residual: the same of f = p² in f ≈ f₀∘T T′.
        gauss_residual: largest distance of the normals, which are g on the sphere.
        position_residual: largest distance of the positions, in diagonals of the boundary.
    """

    center: complex
    turn: float
    sign: int
    spinor_residual: float
    weierstrass_residual: float
    gauss_residual: float
    position_residual: float

    def reparametrised(
        self, z: Complex[np.ndarray, " n"]
    ) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """T(z) and ±√T′(z)."""
        w, root = _moved(z, self.turn, self.center)
        return w, self.sign * root


def fit_moebius(found: SpinorSurface, truth: SpinorSurface) -> MoebiusFit:
    """The Möbius map by which a surface over the unit disk is a reparametrisation of another, by least squares."""
    z = np.concatenate([radius * np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS) for radius in _RADII])
    spinors = found.spinors(z)
    size = float(np.abs(spinors).max())

    def difference(parameters: Float[np.ndarray, "3"]) -> Float[np.ndarray, " k"]:
        w, root = _moved(z, parameters[0], _center(parameters))
        flat = (spinors - truth.spinors(w) * root[:, None]).ravel() / size
        return np.concatenate([flat.real, flat.imag])

    # √T′ changes its sign with a turn of T by 2π: two turns are both signs
    starts = 4 * np.pi * np.arange(2 * _STARTS) / (2 * _STARTS)
    rough = min(starts, key=lambda turn: float(np.square(difference(np.array([turn, 0.0, 0.0]))).sum()))
    parameters = least_squares(difference, [rough, 0.0, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    w, root = _moved(z, parameters[0], _center(parameters))
    p, p0 = spinors[:, 0], truth.spinors(w)[:, 0] * root
    diagonal = float(np.linalg.norm(np.ptp(truth.position(z[:_POINTS]), axis=0)))
    half_turns = round(parameters[0] / (2 * np.pi)) % 2
    return MoebiusFit(
        center=_center(parameters),
        turn=float(np.angle(np.exp(1j * parameters[0]))),
        sign=-1 if half_turns else 1,
        spinor_residual=float(np.abs(difference(parameters)).max()),
        weierstrass_residual=float(np.abs(p**2 - p0**2).max() / np.abs(p0**2).max()),
        gauss_residual=float(np.linalg.norm(found.normal(z) - truth.normal(w), axis=-1).max()),
        position_residual=float(np.linalg.norm(found.position(z) - truth.position(w), axis=-1).max()) / diagonal,
    )


def _center(parameters: Float[np.ndarray, "3"]) -> complex:
    outside = complex(parameters[1], parameters[2])
    # every number of the plane is one of the disk
    return outside / math.sqrt(1 + abs(outside) ** 2)


def _moved(
    z: Complex[np.ndarray, " n"], turn: float, a: complex
) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
    """T(z) and √T′(z)."""
    below = 1 - np.conj(a) * z
    return np.exp(1j * turn) * (z - a) / below, np.exp(0.5j * turn) * np.sqrt(1 - abs(a) ** 2) / below
