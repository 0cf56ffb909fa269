"""Every holomorphic model: holomorphic, with the correct derivative, and unchanged by saving and loading."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from spinor_geom.arrays import NUMPY, Place, to_numpy
from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import StorageError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.holomorphic.model import HolomorphicModel, IntegrableModel, rebuild
from spinor_geom.holomorphic.poles import place_poles
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.module import as_module
from tests.holomorphic.test_arnoldi import nodes
from tests.holomorphic.test_mlp import seeded

ANGLES = 2 * np.pi * np.arange(60) / 60
ELLIPSE = PlaneDomain.from_boundary(2 * np.cos(ANGLES) + 1j * np.sin(ANGLES))
STEP = 1e-5


def complex_normal(*shape, seed=0):
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.normal(size=shape) + 1j * rng.normal(size=shape))


def cauchy_network(degree=12):
    z, weight = nodes(2.0, 60, 8)
    poles = place_poles(ELLIPSE)
    positions, scales = torch.from_numpy(poles.positions), torch.from_numpy(poles.scales)
    network = CauchyNetwork.orthonormal_on(z, weight, poles=positions, scales=scales, degree=degree)
    return replace(network, readout=complex_normal(*network.readout.shape))


def interpolant(count=60):
    # the ellipse's own parameter
    z, dz, _ = FourierBoundary(np.array([0.5, 0, 1.5]), count).grid(count)
    return CauchyInterpolant(torch.from_numpy(z), torch.from_numpy(dz), complex_normal(count, 2))


MODELS = {
    "series": PowerSeries(complex_normal(9, 2), center=0.3 - 0.1j, radius=2.5),
    "constant": PowerSeries(complex_normal(1, 2)),
    "cauchy": cauchy_network(),
    "cauchy-interpolant": interpolant(),
    "laurent": LaurentSeries(complex_normal(6, 2), complex_normal(1, 5, 2), CircularDomain.annulus(6.0)),
    "mlp": ComplexMLP(radius=2.0, generator=seeded()),
    "mlp of ten layers": ComplexMLP(depth=10, radius=2.0, generator=seeded()),
    "mlp of one layer": ComplexMLP(depth=1, width=7, radius=2.0, generator=seeded()),
    "mlp of sines": ComplexMLP(activation="sin", center=1 + 2j, radius=4.0, generator=seeded()),
    "mlp of hyperbolic sines": ComplexMLP(depth=4, activation="sinh", radius=2.0, generator=seeded()),
}
MADE = {name: as_module(model) for name, model in MODELS.items()}
every_model = pytest.mark.parametrize("model", MADE.values(), ids=MADE.keys())


def saved(model):
    return {name: tensor.numpy() for name, tensor in model.state_dict().items()}


def inner_points(count=40, seed=0):
    """Points of the ellipse, a tenth or more away from its boundary."""
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0, 2 * np.pi, count), 0.85 * np.sqrt(rng.uniform(size=count))
    return torch.from_numpy(radius * (2 * np.cos(angle) + 1j * np.sin(angle)))


def cauchy_riemann_error(function, z):
    """Largest |f_x + i f_y| by central differences, as a share of the largest derivative."""
    by_x = (function(z + STEP) - function(z - STEP)) / (2 * STEP)
    by_y = (function(z + 1j * STEP) - function(z - 1j * STEP)) / (2 * STEP)
    scale = torch.maximum(by_x.abs().max(), by_y.abs().max())
    return float((by_x + 1j * by_y).abs().max() / scale.clamp(min=1e-3))


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
def test_models_meet_the_protocol(model):
    assert isinstance(model, HolomorphicModel)
    assert isinstance(as_module(model), torch.nn.Module)
    assert isinstance(model, IntegrableModel) == (model.kind in ("series", "laurent"))


@every_model
def test_cauchy_riemann_equations_hold(model):
    with torch.no_grad():
        assert cauchy_riemann_error(model.value, inner_points()) < 1e-6
        assert cauchy_riemann_error(model.derivative, inner_points()) < 1e-6


@every_model
def test_derivative_equals_that_of_autodiff(model):
    for k in range(2):
        z = inner_points().requires_grad_()
        # PyTorch's gradient of the real part of a holomorphic f is the conjugate of f′
        (gradient,) = torch.autograd.grad(model.value(z)[:, k].real.sum() + 0 * z.real.sum(), z)
        derivative = model.derivative(z.detach())[:, k].detach()
        scale = float(derivative.abs().max().clamp(min=1))
        torch.testing.assert_close(gradient.conj().resolve_conj(), derivative, rtol=0, atol=1e-10 * scale)


def test_a_cauchy_network_is_linear_in_its_features():
    network, z = MADE["cauchy"], inner_points()
    with torch.no_grad():
        value = network.value(z)
        scale = float(value.abs().max())
        torch.testing.assert_close(value, network.features(z) @ network.readout, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
def test_arrays_of_numpy_give_the_same_to_rounding(model):
    if isinstance(model, ComplexMLP):
        pytest.skip("it is a module of torch only")
    z, place = inner_points(), Place(torch.device("cpu"))
    for name in ("value", "derivative", "primitive"):
        if hasattr(model, name):
            exact = to_numpy(getattr(model.at(place), name)(z))
            # the network's polynomials and units are 600 times as large as their sums: either is off by 1e-12
            atol = 3e-12 * np.abs(exact).max()
            np.testing.assert_allclose(getattr(model.at(NUMPY), name)(z.numpy()), exact, rtol=0, atol=atol)


@every_model
def test_saved_model_is_rebuilt_bit_for_bit(model):
    config = json.loads(json.dumps(model.config()))
    again = as_module(rebuild(model.kind, config, saved(model)))
    with torch.no_grad():
        assert torch.equal(again.value(inner_points()), model.value(inner_points()))
        assert torch.equal(again.derivative(inner_points()), model.derivative(inner_points()))


def test_unknown_kind_is_refused():
    with pytest.raises(StorageError, match=r"'spline'; known: cauchy, cauchy-interpolant, laurent, mlp, series"):
        rebuild("spline", {}, {})


@every_model
def test_state_that_does_not_fit_is_refused(model):
    with pytest.raises(StorageError, match="does not fit"):
        rebuild(model.kind, {}, saved(model))
    state = saved(model)
    state.popitem()
    with pytest.raises(StorageError, match="does not fit"):
        rebuild(model.kind, model.config(), state)


@pytest.mark.parametrize("degree", [5, 40])
def test_features_of_a_cauchy_network_are_orthonormal_on_the_boundary(degree):
    network = cauchy_network(degree)
    z, weight = nodes(2.0, 60, 8)
    with torch.no_grad():
        features = network.features(z)
    gram = features.mH @ (weight[:, None] * features)
    # directions down to 1e-12 of the largest are kept, and lose that many digits
    assert float((gram - torch.eye(len(gram))).abs().max()) < 1e-4
    wide = network.mixing.abs().sum(0) < 1e4
    assert wide.sum() > 20
    assert float((gram - torch.eye(len(gram)))[wide][:, wide].abs().max()) < 1e-10


def test_cauchy_network_reproduces_a_function_with_a_pole_near_the_boundary():
    z, weight = nodes(2.0, 60, 8)

    def target(points):
        return torch.stack([1 / (points - 2.15), torch.exp(points)], dim=-1)

    network = cauchy_network(20)
    network = replace(network, readout=network.features(z).mH @ (weight[:, None] * target(z)))
    inside = inner_points()
    # the pole lies 0.15 outside the tip. One unit a vertex follows it
    assert float((network.value(inside) - target(inside)).abs().max()) < 1e-6


def test_a_network_changes_its_sign_around_each_of_its_branches():
    branches = torch.tensor([0.4 + 0.1j, -0.5 - 0.2j], dtype=torch.complex128)
    ring = 0.9 * torch.exp(2j * torch.pi * torch.arange(64, dtype=torch.float64) / 64)
    network = CauchyNetwork.of_raw_features(
        ring,
        hessenberg=arnoldi_hessenberg(ring, torch.full((64,), 1 / 64, dtype=torch.float64), 3),
        poles=torch.tensor([1.5, -0.4 + 1.4j], dtype=torch.complex128),
        scales=torch.ones(2, dtype=torch.float64),
        readout=torch.ones(6, 2, dtype=torch.complex128) * torch.tensor([1.0, 1j]),
        branches=branches,
    )
    again = CauchyNetwork.from_config(network.config()).with_arrays(network.arrays)
    near = branches[:, None] + 0.05 * ring
    values = again.value(near)
    # the sign of each sample's neighbour, followed around each branch
    jumps = (values * values.roll(-1, 1).conj()).real.sum(-1) < 0
    assert jumps.sum(1).tolist() == [1, 1]
    z = torch.tensor([0.1, 0.6j, -0.3 + 0.2j], dtype=torch.complex128)
    slope = (again.value(z + STEP) - again.value(z - STEP)) / (2 * STEP)
    torch.testing.assert_close(again.derivative(z), slope, rtol=1e-7, atol=1e-7)
