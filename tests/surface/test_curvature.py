"""Curvature by automatic differentiation of positions."""

import numpy as np
import torch

from spinor_geom.domain import PlaneDomain
from spinor_geom.gallery import catenoid, helicoid, polynomial
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.curvature import mean_curvature
from spinor_geom.surface.spinor_surface import SpinorSurface
from tests.surface.points import inside


def fundamental_forms(position, z):
    """I and II of r = position(x + iy) at single points, and the normal."""

    def of_pair(xy):
        return position(torch.complex(xy[..., 0], xy[..., 1]))

    xy = torch.view_as_real(z)
    slopes = torch.func.vmap(torch.func.jacfwd(of_pair))(xy)
    bends = torch.func.vmap(torch.func.jacfwd(torch.func.jacfwd(of_pair)))(xy)
    normal = torch.nn.functional.normalize(torch.linalg.cross(slopes[..., 0], slopes[..., 1]), dim=-1)
    return slopes.mT @ slopes, torch.einsum("nk,nkij->nij", normal, bends), normal


def test_sphere_has_curvature_towards_its_inner_normal():
    def sphere(x, y):
        return 2 * torch.stack([torch.sin(x) * torch.cos(y), torch.sin(x) * torch.sin(y), torch.cos(x)], dim=-1)

    x, y = torch.tensor([0.3, 1.0, 2.0], dtype=torch.float64), torch.tensor([0.1, 2.0, -1.0], dtype=torch.float64)
    # it bends away from the outer normal
    np.testing.assert_allclose(mean_curvature(sphere, x, y), -0.5, atol=1e-14)


def test_forms_by_formula_equal_those_by_autodiff_of_the_position():
    known = polynomial([1, 0.3j, 0.2], [0.1, 1, -0.4j, 0.2])
    surface = SpinorSurface.of(known.surface).requires_grad_(False)
    z = torch.from_numpy(inside(surface.domain, 150))
    first, second, normal = fundamental_forms(surface.position, z)
    scale = surface.conformal_factor(z).square()[:, None, None]
    np.testing.assert_allclose(first / scale, np.broadcast_to(np.eye(2), first.shape), atol=1e-13)
    np.testing.assert_allclose(second, surface.second_fundamental_form(z), atol=1e-12)
    np.testing.assert_allclose(normal, surface.normal(z), atol=1e-13)
    gauss = torch.linalg.det(second) / torch.linalg.det(first)
    np.testing.assert_allclose(gauss, surface.gauss_curvature(z), atol=1e-12)


def test_mean_curvature_by_formula_is_that_by_autodiff_where_the_rule_is_coarse():
    known = polynomial([1, 0.3j, 0.2], [0.1, 1, -0.4j, 0.2])
    for rule, order, tolerance in (("trapezoid", 16, 0.05), ("simpson", 4, 0.05)):
        exact = known.surface
        surface = ArraySurface(exact.model, exact.domain, exact.constant, quadrature=rule, order=order)
        z = inside(surface.domain, 150)
        mean, by_autodiff = surface.mean_curvature(z), SpinorSurface.of(surface).mean_curvature(z)
        assert np.abs(by_autodiff).max() > 1e-8  # errors of the rule, not of rounding
        # the second derivatives have errors of the rule too
        np.testing.assert_allclose(mean, by_autodiff, atol=tolerance * np.abs(by_autodiff).max())


def test_exact_surfaces_have_no_mean_curvature():
    for known in (polynomial([1], [0, 1]), polynomial([1, 0.5], [0.2, 0.4, 0.3]), catenoid(0.5), helicoid(2.0, 1.0)):
        z = inside(known.surface.domain, 300)
        scale = np.sqrt(-known.surface.gauss_curvature(z)).max()  # the size of the principal curvatures
        assert np.abs(known.surface.mean_curvature(z)).max() < 1e-12 * max(scale, 1.0)


class NotHolomorphic(torch.nn.Module):
    """p = 1, q = z̄: the integral of φ over a segment then is no minimal surface."""

    kind = "not holomorphic"

    def value(self, z):
        return torch.stack([torch.ones_like(z), z.conj()], dim=-1)


def test_a_model_that_is_not_holomorphic_shows_its_mean_curvature():
    surface = SpinorSurface(NotHolomorphic(), PlaneDomain.disk(n=32))
    z = inside(surface.domain, 50)
    assert np.median(np.abs(surface.mean_curvature(z))) > 1e-2
