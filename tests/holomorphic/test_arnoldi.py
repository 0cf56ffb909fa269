"""Orthogonal polynomials by Arnoldi's recurrence, and their interpolation at Leja points."""

import numpy as np
import pytest
import torch

from spinor_geom.domain import PlaneDomain
from spinor_geom.domain.quadrature import Panels
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg, arnoldi_polynomials, barycentric_weights, leja_points
from spinor_geom.holomorphic.interpolant import interpolated, interpolated_slope

DEGREE = 40


def nodes(ratio, count=120, order=4):
    t = 2 * np.pi * np.arange(count) / count
    domain = PlaneDomain.from_boundary(ratio * np.cos(t) + 1j * np.sin(t))
    panels = Panels.on(domain.boundary, domain.boundary.parameters, order)
    return torch.from_numpy(panels.z), torch.from_numpy(panels.arc_weights / panels.arc_weights.sum())


def gram_error(basis, weight):
    gram = basis.mH @ (weight[:, None] * basis)
    return float((gram - torch.eye(len(gram))).abs().max())


@pytest.mark.parametrize("ratio", [1, 8])
def test_polynomials_are_orthonormal_on_a_thin_ellipse(ratio):
    z, weight = nodes(ratio)
    basis = arnoldi_polynomials(z, arnoldi_hessenberg(z, weight, DEGREE))
    assert gram_error(basis, weight) < 1e-12
    # powers of z, each normalised, lose all digits there
    powers = z[:, None] ** torch.arange(DEGREE + 1)
    powers = powers / (weight[:, None] * powers.abs() ** 2).sum(0).sqrt()
    if ratio == 8:
        assert float(torch.linalg.cond(powers)) > 1e12


@pytest.mark.parametrize("ratio", [1, 8])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_interpolation_has_the_same_values(ratio, scale):
    z, weight = nodes(ratio)
    z = z * scale
    hessenberg = arnoldi_hessenberg(z, weight, DEGREE)
    points = leja_points(z, DEGREE + 1)
    coefficients = torch.from_numpy(np.random.default_rng(0).normal(size=(DEGREE + 1, 2)) + 0j)
    values = arnoldi_polynomials(points, hessenberg) @ coefficients
    for where in (z, 0.7 * z, 0.1 * z):
        expected = arnoldi_polynomials(where, hessenberg) @ coefficients
        found = interpolated(where, points, barycentric_weights(points), values)
        assert float((found - expected).abs().max()) < 1e-10 * float(expected.abs().max().clamp(min=1))


def test_slope_of_the_interpolation_equals_difference_quotient():
    z, weight = nodes(3)
    points = leja_points(z, 21)
    values = arnoldi_polynomials(points, arnoldi_hessenberg(z, weight, 20))[:, 15:17]
    where, h = 0.8 * z, 1e-6
    of = (points, barycentric_weights(points), values)
    quotient = (interpolated(where + h, *of) - interpolated(where - h, *of)) / (2 * h)
    derivative = interpolated_slope(where, *of)
    assert float((quotient - derivative).abs().max() / derivative.abs().max()) < 1e-7
