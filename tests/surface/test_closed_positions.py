"""Positions in closed form, and by quadrature along paths."""

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.gallery import enneper
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.spinor_surface import SpinorSurface
from tests.strategies import SEEDS
from tests.surface.points import inside


class Plain(torch.nn.Module):
    """A model's p and q without its closed integrals."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def value(self, z):
        return self.model.value(z)


def by_quadrature(surface):
    return SpinorSurface(Plain(surface.model), surface.domain, surface.constant, spinor_map=surface.spinor_map)


def random_surface(seed, terms=9):
    rng = np.random.default_rng(seed)
    coefficients = torch.tensor(rng.normal(size=(terms, 2, 2)) @ [1, 1j])
    return SpinorSurface(PowerSeries(coefficients), PlaneDomain.disk(n=32), rng.normal(size=3))


def test_closed_positions_are_those_of_gauss_s_rule_on_power_series_alone():
    surface = enneper(1.0).surface
    assert surface.has_closed_positions
    assert not by_quadrature(surface).has_closed_positions
    simpson = SpinorSurface(surface.model, surface.domain, quadrature="simpson", order=8)
    assert not simpson.has_closed_positions


@given(SEEDS, st.floats(-4, 4), st.floats(1e-3, 1e3))
def test_closed_positions_equal_quadrature_on_every_surface_of_the_model(seed, angle, scale):
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    surface = random_surface(seed).associate(angle).transform(rotation, scale, scale * np.arange(3.0))
    z = inside(surface.domain, 40, seed)
    expected = by_quadrature(surface).position(z)
    np.testing.assert_allclose(surface.position(z), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


# --- by quadrature ----------------------------------------------------------------------------------------------------


def test_positions_of_a_few_points_are_those_of_many():
    boundary = FourierBoundary(np.array([0.1j, 0.5, 0.2, 1.5, 0.1]), 64)
    z, dz, _ = (torch.from_numpy(row) for row in boundary.grid(128))
    model = CauchyInterpolant(z, dz, torch.stack([torch.exp(z), 0.3 * z], dim=-1))
    surface = SpinorSurface(model, PlaneDomain.inside(boundary), (1.0, 2.0, 3.0))
    points = inside(surface.domain, 50)
    together = surface.position(points)
    alone = np.stack([surface.position(point) for point in points])
    rounding = 8 * np.finfo(float).eps * np.abs(together).max()
    np.testing.assert_allclose(alone, together, rtol=0, atol=rounding)
    # the paths of all vertices are the same again
    with torch.no_grad():
        np.testing.assert_allclose(surface.position(torch.from_numpy(points)), together, rtol=0, atol=rounding)
