"""Orthogonal polynomials by Arnoldi's recurrence, and their Newton form."""

import numpy as np
import pytest
import torch

from spinor_geom.domain import PlaneDomain
from spinor_geom.domain.panels import Panels
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg, arnoldi_polynomials
from spinor_geom.holomorphic.newton import leja_points, newton_derivative, newton_matrix, newton_value

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


def test_recurrence_holds():
    z, weight = nodes(8)
    hessenberg = arnoldi_hessenberg(z, weight, DEGREE)
    basis = arnoldi_polynomials(z, hessenberg)
    torch.testing.assert_close(z[:, None] * basis[:, :-1], basis @ hessenberg, rtol=0, atol=1e-11)
    assert (hessenberg.tril(-2) == 0).all()
    subdiagonal = hessenberg.diagonal(-1)
    assert (subdiagonal.imag == 0).all()
    assert (subdiagonal.real > 0).all()


def test_polynomials_of_the_circle_are_powers():
    z, weight = nodes(1)
    basis = arnoldi_polynomials(0.5 * z, arnoldi_hessenberg(z, weight, 10))
    powers = (0.5 * z)[:, None] ** torch.arange(11)
    # the spline through 120 points is a circle to 1e-7
    torch.testing.assert_close(basis, powers, rtol=0, atol=1e-6)


def test_span_contains_every_polynomial_of_the_degree():
    z, weight = nodes(8)
    basis = arnoldi_polynomials(z, arnoldi_hessenberg(z, weight, 12))
    target = (z - 1) ** 5 * (z + 0.3j) ** 7
    fitted = basis @ (basis.mH @ (weight * target))
    assert float((fitted - target).abs().max() / target.abs().max()) < 1e-12


def test_leja_points_are_distinct_and_begin_at_the_far_end():
    z, _ = nodes(8)
    points = leja_points(z, DEGREE + 1)
    distance = (points[:, None] - points).abs() + 99 * torch.eye(len(points))
    assert float(distance.min()) > 0.01
    assert abs(abs(float(points[0].real)) - 8) < 0.1


@pytest.mark.parametrize("ratio", [1, 8])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_newton_form_has_the_same_values(ratio, scale):
    z, weight = nodes(ratio)
    z = z * scale
    hessenberg = arnoldi_hessenberg(z, weight, DEGREE)
    points = leja_points(z, DEGREE + 1)
    matrix = newton_matrix(points, arnoldi_polynomials(points, hessenberg))
    coefficients = torch.from_numpy(np.random.default_rng(0).normal(size=(DEGREE + 1, 2)) + 0j)
    for where in (z, 0.7 * z, 0.1 * z):
        expected = arnoldi_polynomials(where, hessenberg) @ coefficients
        found = newton_value(where, points, matrix @ coefficients)
        assert float((found - expected).abs().max()) < 1e-10 * float(expected.abs().max().clamp(min=1))


def test_newton_derivative_equals_difference_quotient():
    z, weight = nodes(3)
    points = leja_points(z, 21)
    coefficients = newton_matrix(points, arnoldi_polynomials(points, arnoldi_hessenberg(z, weight, 20)))
    where, h = 0.8 * z, 1e-6
    quotient = (newton_value(where + h, points, coefficients) - newton_value(where - h, points, coefficients)) / (2 * h)
    derivative = newton_derivative(where, points, coefficients)
    assert float((quotient - derivative).abs().max() / derivative.abs().max()) < 1e-7


def test_newton_form_of_a_constant():
    z, _ = nodes(1)
    points = leja_points(z, 1)
    coefficients = newton_matrix(points, torch.ones(1, 1, dtype=torch.complex128)) * 3
    assert (newton_value(z, points, coefficients) == 3).all()
    assert (newton_derivative(z, points, coefficients) == 0).all()
