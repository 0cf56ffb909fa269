"""The paper's quadrature along rays: its orders, and the mean curvature of its error."""

import numpy as np
import pytest
import torch

from spinor_geom.domain import PlaneDomain
from spinor_geom.experiments.integration import radial_mean_curvature
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.spinor_surface import SpinorSurface

DISK = PlaneDomain.disk()
# (p, q) = (e^{z/2}, e^{−z/2})-like series, far from polynomials of low degree
SERIES = PowerSeries(torch.tensor([[0.6**k, (-0.5) ** k * 1j**k] for k in range(12)], dtype=torch.complex128))
MODELS = {"series": SERIES, "network": ComplexMLP(depth=2, width=6, generator=torch.Generator().manual_seed(4))}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
ORDERS = pytest.mark.parametrize(("quadrature", "slope", "tolerance"), [("trapezoid", -2, 0.1), ("simpson", -4, 0.2)])


def radial_position(surface, z):
    """Positions by the surface's rule on the whole ray from 0 to each point."""
    return surface.position(np.array(0j)) + surface.integrate(np.zeros_like(z), z)


def points(count=60):
    rng = np.random.default_rng(0)
    return np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))


def fitted_slope(counts, errors):
    return np.polyfit(np.log(counts), np.log(errors), 1)[0]


@every_model
@ORDERS
def test_error_falls_at_the_order_of_the_rule(model, quadrature, slope, tolerance):
    z, counts = points(), [40, 80, 160, 320]
    exact = SpinorSurface(model, DISK, order=24).position(z)
    surfaces = (SpinorSurface(model, DISK, quadrature=quadrature, order=n) for n in counts)
    errors = [np.abs(radial_position(surface, z) - exact).max() for surface in surfaces]
    assert abs(fitted_slope(counts, errors) - slope) < tolerance


@every_model
@ORDERS
def test_mean_curvature_falls_at_the_order_of_the_rule(model, quadrature, slope, tolerance):
    z, counts = points(25), [25, 50, 100, 200] if quadrature == "trapezoid" else [24, 48, 96]
    surfaces = (SpinorSurface(model, DISK, quadrature=quadrature, order=n) for n in counts)
    h = [np.abs(radial_mean_curvature(surface, z)).max() for surface in surfaces]
    assert abs(fitted_slope(counts, h) - slope) < tolerance
