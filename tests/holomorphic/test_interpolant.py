"""CauchyInterpolant: exact at its nodes, exponentially accurate in Ω, up to ∂Ω."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import FourierBoundary
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from tests.strategies import SEEDS, analytic_boundaries

# half-axes 2 and 1, 8 and 1, by their own angle; a curve without symmetry
BOUNDARIES = {
    "2:1": FourierBoundary(np.array([0.5, 0, 1.5]), 64),
    "8:1": FourierBoundary(np.array([3.5, 0, 4.5]), 64),
    "bent": FourierBoundary(np.array([0.05j, 0.1, 2 - 1j, 1.0, 0.15 + 0.1j]), 64),
}
every_boundary = pytest.mark.parametrize("boundary", BOUNDARIES.values(), ids=BOUNDARIES.keys())


def functions(z):
    """Two entire functions, of moderate size on all the boundaries."""
    return torch.stack([torch.exp(z / 2), torch.cos(z / 3) + z], dim=-1)


def derivatives(z):
    return torch.stack([torch.exp(z / 2) / 2, 1 - torch.sin(z / 3) / 3], dim=-1)


def interpolating(boundary, n, function=functions):
    z, dz, _ = (torch.from_numpy(row) for row in boundary.grid(n))
    return CauchyInterpolant(z, dz, function(z))


def points_inside(boundary, depth, count=60):
    """Points as far from ∂Ω as a share of the way to its centre."""
    z = boundary.point((np.arange(count) + 0.37) / count)
    centre = boundary.coefficients[len(boundary.coefficients) // 2]
    return torch.from_numpy(centre + (1 - depth) * (z - centre))


# --- values -----------------------------------------------------------------------------------------------------------


@every_boundary
def test_nodes_have_their_values_to_the_last_bit(boundary):
    model = interpolating(boundary, 96)
    with torch.no_grad():
        assert torch.equal(model.value(model.nodes), model.values)
        assert torch.equal(model.value(model.nodes[[5, 90]].reshape(2, 1)), model.values[[5, 90]].reshape(2, 1, 2))


@pytest.mark.parametrize("depth", [1.0, 0.5, 0.1, 1e-2, 1e-4, 1e-8, 0.0])
@every_boundary
def test_entire_functions_and_their_derivatives_are_reproduced_in_the_domain_and_on_its_boundary(boundary, depth):
    model = interpolating(boundary, 192)
    z = points_inside(boundary, depth)
    with torch.no_grad():
        size = float(functions(z).abs().max())
        assert float((model.value(z) - functions(z)).abs().max()) < 1e-12 * size
        if depth >= 1e-2:  # rounding errors of the values are divided by the distance from the nodes
            assert float((model.derivative(z) - derivatives(z)).abs().max()) < 1e-12 / depth * size


def test_pole_outside_near_the_boundary_is_resolved_by_nodes_as_near():
    """1/(z − 2.15) beside the ellipse's tip: the error falls like e^(−n·d) with d its distance in the parameter."""
    boundary = BOUNDARIES["2:1"]

    def pole(z):
        return torch.stack([1 / (z - 2.15), 1 / (z - 2.15) ** 2], dim=-1)

    z = points_inside(boundary, 0.01)
    with torch.no_grad():
        errors = [float((interpolating(boundary, n, pole).value(z) - pole(z)).abs().max()) for n in (64, 128, 256)]
    assert errors[1] < 1e-2 * errors[0]
    assert errors[2] < 1e-4 * errors[1]
    assert errors[2] < 1e-9


@given(boundary=analytic_boundaries(), seed=SEEDS, depth=st.floats(1e-6, 0.99))
def test_polynomials_on_random_domains(boundary, seed, depth):
    c = torch.tensor(np.random.default_rng(seed).normal(size=(2, 6, 2)) @ [1, 1j])

    def polynomials(z):
        return (z[:, None] ** torch.arange(6)) @ c.T

    z = points_inside(boundary, depth)
    with torch.no_grad():
        error = interpolating(boundary, 256, polynomials).value(z) - polynomials(z)
    assert float(error.abs().max()) < 1e-9
