"""CauchyInterpolant: exact at its nodes, exponentially accurate in Ω, up to ∂Ω."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.domain import FourierBoundary
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.surface.module import as_module
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
def test_entire_functions_are_reproduced_in_the_domain_and_on_its_boundary(boundary, depth):
    model = interpolating(boundary, 192)
    z = points_inside(boundary, depth)
    with torch.no_grad():
        assert float((model.value(z) - functions(z)).abs().max()) < 1e-12 * float(functions(z).abs().max())


@pytest.mark.parametrize("depth", [1.0, 0.5, 0.1, 1e-2])
@every_boundary
def test_derivatives_of_entire_functions(boundary, depth):
    model = interpolating(boundary, 192)
    z = points_inside(boundary, depth)
    with torch.no_grad():
        error = float((model.derivative(z) - derivatives(z)).abs().max())
    # rounding errors of the values are divided by the distance from the nodes
    assert error < 1e-12 / depth * float(functions(z).abs().max())


@every_boundary
def test_derivatives_at_the_nodes_are_the_limits_there(boundary):
    model = interpolating(boundary, 192)
    with torch.no_grad():
        z = torch.stack([model.nodes, points_inside(boundary, 0.5, count=192)])
        error = float((model.derivative(z) - derivatives(z)).abs().max())
    # the nodes lie 1/200 of ∂Ω apart
    assert error < 1e-10 * float(functions(z).abs().max())


@every_boundary
def test_error_falls_exponentially_in_the_number_of_nodes(boundary):
    z = points_inside(boundary, 0.02)
    with torch.no_grad():
        errors = [float((interpolating(boundary, n).value(z) - functions(z)).abs().max()) for n in (8, 16, 32, 64)]
    for before, after in pairwise(errors):
        assert after < 0.1 * before + 1e-13
    assert errors[-1] < 1e-5 * errors[0]


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


@settings(max_examples=15)
@given(boundary=analytic_boundaries(), seed=SEEDS, depth=st.floats(1e-6, 0.99))
def test_polynomials_on_random_domains(boundary, seed, depth):
    c = torch.tensor(np.random.default_rng(seed).normal(size=(2, 6, 2)) @ [1, 1j])

    def polynomials(z):
        return (z[:, None] ** torch.arange(6)) @ c.T

    z = points_inside(boundary, depth)
    with torch.no_grad():
        error = interpolating(boundary, 256, polynomials).value(z) - polynomials(z)
    assert float(error.abs().max()) < 1e-9


def test_constants_are_reproduced_whatever_the_nodes():
    random = np.random.default_rng(0)
    nodes, weights = (torch.tensor(random.normal(size=(20, 2)) @ [1, 1j]) for _ in range(2))
    model = CauchyInterpolant(nodes, weights, torch.full((20, 2), 2 - 3j, dtype=torch.complex128))
    z = torch.tensor(random.normal(size=(50, 2)) @ [1, 1j])
    with torch.no_grad():
        assert float((model.value(z) - (2 - 3j)).abs().max()) < 1e-12


# --- as a model -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (7,), (2, 3), (0,), (2, 0)])
def test_shape_and_dtype_follow_the_points(shape):
    model = interpolating(BOUNDARIES["2:1"], 32)
    z = torch.full(shape, 0.2 + 0.1j, dtype=torch.complex128)
    with torch.no_grad():
        for values in (model.value(z), model.derivative(z)):
            assert values.shape == (*shape, 2)
            assert values.dtype == torch.complex128
        single = CauchyInterpolant(*(t.to(torch.complex64) for t in (model.nodes, model.weights, model.values)))
        assert single.value(z.to(torch.complex64)).dtype == torch.complex64


def test_values_of_a_module_are_a_copy():
    values = torch.ones(8, 2, dtype=torch.complex128)
    z, dz, _ = (torch.from_numpy(row) for row in FourierBoundary.circle().grid(8))
    module = as_module(CauchyInterpolant(z, dz, values))
    values[:] = 5
    assert (module.values == 1).all()
