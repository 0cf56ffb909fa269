"""Exact patches if p and q are polynomials on a disk, by rational maps from the unit square to parts of the disk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Inexact
from numpy.polynomial import polynomial as poly
from scipy.special import comb

from spinor_geom.arrays import to_numpy
from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.rational_splines import NurbsPatch
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.formulas import null_vector

_HIGHEST = 25  # highest degree that Open CASCADE supports
_NEGLIGIBLE = 1e-13  # largest sum of neglected coefficients of p and q, relative to the largest one
_HALF = 0.5**0.5  # cos 45°. The weights of a quarter of a circle are 1, cos 45°, 1
_CHECKS = np.linspace(0, 1, 8)  # parameters where the error is measured
_SQUARE = 0.5**1.5  # half of the side of the inner square, whose corners are at half of the radius

# corners of the quadrilaterals, counter-clockwise: a ring of four around the square
QUADS = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [7, 4, 5, 6]])


@dataclass(frozen=True, kw_only=True, eq=False)
class PolynomialDisk:
    """A surface r = Re Σ c_k w^k over the unit disk |w| < 1, z = centre + scale·w."""

    coefficients: Complex[np.ndarray, "d1 3"]  # c_0 … c_d
    centre: complex  # of the disk in Ω
    scale: complex  # its radius, times the direction of the boundary's first point

    @classmethod
    def of(cls, surface: ArraySurface) -> PolynomialDisk | None:
        """A surface in this form, or None unless p and q are polynomials on a disk."""
        model = getattr(surface.model, "untracked", surface.model)  # modules of torch hold arrays
        disk = _disk(surface.domain)
        if not isinstance(model, PowerSeries) or disk is None:
            return None
        centre, scale = disk
        terms = to_numpy(model.coefficients) @ to_numpy(surface.spinor_map).T
        left_out = np.append(np.cumsum(np.abs(terms)[::-1], axis=0)[::-1].max(axis=1), 0.0)
        terms = terms[: max(1, int(np.argmax(left_out <= _NEGLIGIBLE * np.abs(terms).max())))]
        p, q = (_shifted(each, (centre - model.center) / model.radius, scale / model.radius) for each in terms.T)
        null = null_vector(np.convolve(p, p), np.convolve(q, q), np.convolve(p, q))
        coefficients = poly.polyint(null, axis=0) * scale
        at_root = poly.polyval((surface.root - centre) / scale, coefficients).real
        coefficients[0] = to_numpy(surface.constant) - at_root
        return cls(coefficients=coefficients, centre=centre, scale=scale)

    @property
    def degree(self) -> int:
        """Degree d of positions as polynomials in w. That of the patches is 2d."""
        return len(self.coefficients) - 1

    @property
    def is_representable(self) -> bool:
        """Whether CAD systems support patches of this degree."""
        return 2 * self.degree <= _HIGHEST

    def patches(self) -> tuple[list[NurbsPatch], float]:
        """The patches on the quadrilaterals of `QUADS`, and their distance from the surface, a rounding error."""
        patches = [self._patch(*each) for each in _MAPS]
        error = 0.0
        for patch, (numerator, weight) in zip(patches, _MAPS, strict=True):
            points = np.stack([numerator.real, numerator.imag, 0 * weight], axis=-1) / weight[..., None]
            w = _bezier_patch(points, weight).grid(_CHECKS, _CHECKS) @ [1, 1j, 0]
            expected = np.moveaxis(poly.polyval(w, self.coefficients).real, 0, -1)
            error = max(error, float(np.linalg.norm(patch.grid(_CHECKS, _CHECKS) - expected, axis=-1).max()))
        return patches, error

    def _patch(self, numerator: Complex[np.ndarray, "i j"], weight: Float[np.ndarray, "i j"]) -> NurbsPatch:
        """Σ c_k w^k with w = numerator/weight, by Horner's rule for the numerators."""
        power = np.ones((1, 1))
        total = self.coefficients[-1][:, None, None]
        for c in self.coefficients[-2::-1]:
            power = _times(power, weight)
            total = np.stack([_times(each, numerator) for each in total]) + c[:, None, None] * power
        return _bezier_patch(np.moveaxis(total.real / power, 0, -1), power)


def _disk(domain: PlaneDomain) -> tuple[complex, complex] | None:
    """Centre and scale of a disk, or None for other domains."""
    boundary = domain.boundary
    if domain.holes or not isinstance(boundary, FourierBoundary):
        return None
    first, middle = boundary.coefficients, len(boundary.coefficients) // 2
    rest = np.delete(first, [middle, middle + 1])
    is_circle = np.abs(rest).sum() <= _NEGLIGIBLE * abs(first[middle + 1])
    return (complex(first[middle]), complex(first[middle + 1])) if is_circle else None


def _shifted(c: Complex[np.ndarray, " k"], start: complex, step: complex) -> Complex[np.ndarray, " k"]:
    """Coefficients in w of Σ c_k (start + step·w)^k."""
    total = c[-1:]
    for each in c[-2::-1]:
        total = np.convolve(total, [start, step])
        total[0] += each
    return total


def _maps() -> list[tuple[Complex[np.ndarray, "_ _"], Float[np.ndarray, "_ _"]]]:
    """Numerators and weights, in Bernstein form, of rational maps from the unit square to the parts of the unit disk.

    The sides of the inner square have the parameters of the adjacent arcs, so that neighbours agree along seams.
    """
    arc = np.array([_HALF * (1 - 1j), 1.0, _HALF * (1 + 1j)])  # from −45° to 45°
    weight = np.array([1.0, _HALF, 1.0])
    side = _SQUARE * (weight + 1j * np.array([-1.0, 0.0, 1.0]))
    ring = np.stack([arc, side], axis=1), np.stack([weight, weight], axis=1)
    along = _SQUARE * np.array([-1.0, 0.0, 1.0])
    inner = np.multiply.outer(along, weight) + 1j * np.multiply.outer(weight, along), np.multiply.outer(weight, weight)
    return [(1j**turn * ring[0], ring[1]) for turn in range(4)] + [inner]


def _times(a: Inexact[np.ndarray, "i j"], b: Inexact[np.ndarray, "k l"]) -> Inexact[np.ndarray, "m n"]:
    """The product of two polynomials in Bernstein form."""
    a, b = a * _binomials(a.shape), b * _binomials(b.shape)
    product = np.zeros(np.add(a.shape, b.shape) - 1, dtype=np.result_type(a, b))
    for (i, j), factor in np.ndenumerate(b):  # of at most 3 × 3
        product[i : i + a.shape[0], j : j + a.shape[1]] += factor * a
    return np.asarray(product / _binomials(product.shape))


def _binomials(shape: tuple[int, ...]) -> Float[np.ndarray, "i j"]:
    rows, columns = (comb(n - 1, np.arange(n)) for n in shape)
    return np.multiply.outer(rows, columns)


def _bezier_patch(points: Float[np.ndarray, "i j 3"], weights: Float[np.ndarray, "i j"]) -> NurbsPatch:
    """A patch without inner knots."""
    u, v = (np.repeat([0.0, 1.0], n) for n in weights.shape)
    return NurbsPatch(control_points=points, weights=weights, knots=(u, v))


_MAPS = _maps()
