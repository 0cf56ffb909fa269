"""Positions of many points inside Ω, by Cauchy's formula where the surface has no closed ones."""

import numpy as np
import pytest
import torch
from scipy.special import erfi

from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.domain.plane_domain import SplineBoundary
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.surface.spinor_surface import SpinorSurface
from tests.sizes import constant_size

BOUNDARY = FourierBoundary(np.array([0.1j, 0.6, 0.2, 1.5, 0.1]), 64)


@pytest.fixture(scope="module")
def surface():
    z, dz, _ = (torch.from_numpy(row) for row in BOUNDARY.grid(192))
    model = CauchyInterpolant(z, dz, torch.stack([torch.exp(z), 0.3 * z - 0.2], dim=-1))
    return SpinorSurface(model, PlaneDomain.inside(BOUNDARY), (1.0, 2.0, 3.0))


@pytest.fixture(scope="module")
def points():
    return triangulate_polygon(BOUNDARY.point(np.arange(80) / 80), constant_size(0.1)).points[80:]


def test_positions_by_the_fast_sums(surface, points):
    # many points, and some so near to the boundary that the panels there are short: sums over them are not direct
    t = (np.arange(5000) + 0.5) / 5000
    inwards = 1j * BOUNDARY.derivative(t) / np.abs(BOUNDARY.derivative(t))
    many = np.concatenate([points, BOUNDARY.point(t) + 0.01 * inwards])
    few = many[::40]
    np.testing.assert_allclose(surface.positions_inside(many)[0][::40], surface.position(few), rtol=0, atol=1e-10)


@pytest.mark.parametrize("depth", [0.3, 1e-2, 1e-4, 1e-8])
def test_points_near_the_boundary_lose_nothing(surface, depth):
    t = np.arange(7) / 7
    normal = 1j * BOUNDARY.derivative(t) / np.abs(BOUNDARY.derivative(t))
    z = BOUNDARY.point(t) + 0.1 * depth * normal
    assert np.abs(surface.positions_inside(z)[0] - surface.position(z)).max() < 1e-10


def test_a_domain_without_inner_vertices_has_its_constant_at_the_boundary():
    square = SplineBoundary.through(np.array([0, 1, 1 + 1j, 1j]), np.ones(4, dtype=bool))
    domain = PlaneDomain.inside(square)

    class Gaussian(torch.nn.Module):
        def value(self, z):
            return torch.stack([torch.exp(z * z / 2), torch.zeros_like(z)], dim=-1)

    surface = SpinorSurface(Gaussian(), domain)
    z = np.array([0.5 + 0.5j, 0.9 + 0.2j, 0.01 + 0.99j])
    integral = np.sqrt(np.pi) / 2 * (erfi(z) - erfi(surface.root))
    expected = np.column_stack([integral.real, (-1j * integral).real, 0 * z.real])
    assert np.abs(surface.positions_inside(z)[0] - expected).max() < 1e-9
