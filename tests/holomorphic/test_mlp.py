"""ComplexMLP: entire, bounded at the start, the same on every path through it; and every model is holomorphic."""

import json

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic import (
    MODELS,
    CauchyNetwork,
    ComplexMLP,
    HolomorphicModel,
    LaurentSeries,
    PowerSeries,
    rebuild,
)
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.mlp import disk_around
from spinor_geom.surface import SpinorSurface
from spinor_geom.training import RMSprop

STEP = 1e-5
CIRCLE = torch.from_numpy(np.exp(2j * np.pi * np.arange(1000) / 1000))


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def complex_normal(*shape, seed=0):
    return torch.randn(*shape, dtype=torch.complex128, generator=seeded(seed))


def inner_points(count=40, radius=0.8):
    rng = np.random.default_rng(0)
    return torch.from_numpy(radius * np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count)))


def cauchy_network():
    network = CauchyNetwork.orthonormal_on(
        CIRCLE[::5],
        torch.ones(200, dtype=torch.float64),
        poles=1.4 * CIRCLE[::50],
        scales=torch.full((20,), 0.4, dtype=torch.float64),
        degree=6,
    )
    with torch.no_grad():
        network.readout.copy_(complex_normal(*network.readout.shape))
    return network


def interpolant():
    z, dz, _ = FourierBoundary.circle().grid(60)
    return CauchyInterpolant(torch.from_numpy(z), torch.from_numpy(dz), complex_normal(60, 2))


# one of every kind in the registry
EVERY_KIND = {
    "series": PowerSeries(complex_normal(9, 2)),
    "cauchy": cauchy_network(),
    "cauchy-interpolant": interpolant(),
    "laurent": LaurentSeries(complex_normal(6, 2), complex_normal(1, 5, 2), CircularDomain.annulus(3.0)),
    "mlp": ComplexMLP(generator=seeded()),
}
NETWORKS = {
    "paper": ComplexMLP(depth=10, generator=seeded()),
    "one layer": ComplexMLP(depth=1, width=7, generator=seeded()),
    "sin": ComplexMLP(activation="sin", generator=seeded()),
    "sinh": ComplexMLP(depth=4, activation="sinh", generator=seeded()),
    "elsewhere": ComplexMLP(center=3 - 2j, radius=4.0, generator=seeded()),
}
every_network = pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS.keys())


def cauchy_riemann_error(function, z):
    """Largest |f_x + i f_y| by central differences, as a share of the largest derivative."""
    by_x = (function(z + STEP) - function(z - STEP)) / (2 * STEP)
    by_y = (function(z + 1j * STEP) - function(z - 1j * STEP)) / (2 * STEP)
    return float((by_x + 1j * by_y).abs().max() / torch.maximum(by_x.abs().max(), by_y.abs().max()))


class Perceptron:
    """A network with an activation of any kind, to show what the check says of those that are not holomorphic."""

    def __init__(self, activation):
        self.activation = activation
        self.inner, self.outer = complex_normal(8, seed=1), complex_normal(8, 2, seed=2)

    def value(self, z):
        return self.activation(z[..., None] * self.inner + 0.3) @ self.outer


def mod_relu(a):
    return torch.relu(a.abs() - 0.1) * a / a.abs()


# --- holomorphic ------------------------------------------------------------------------------------------------------


def test_every_kind_of_the_registry_is_made_here():
    assert {kind: type(model) for kind, model in EVERY_KIND.items()} == MODELS


@pytest.mark.parametrize("model", [*EVERY_KIND.values(), *NETWORKS.values()], ids=[*EVERY_KIND, *NETWORKS])
def test_cauchy_riemann_equations_hold_for_every_model(model):
    with torch.no_grad():
        assert cauchy_riemann_error(model.value, inner_points()) < 1e-6
        assert cauchy_riemann_error(model.features, inner_points()) < 1e-6
        assert cauchy_riemann_error(model.derivative, inner_points()) < 1e-6


NOT_HOLOMORPHIC = {
    "conj": torch.conj,
    "modReLU": mod_relu,
    "modulus": lambda a: a * a.abs(),
    "by parts": lambda a: torch.complex(a.real.relu(), a.imag),
}


@pytest.mark.parametrize("activation", NOT_HOLOMORPHIC.values(), ids=NOT_HOLOMORPHIC.keys())
def test_cauchy_riemann_check_fails_on_activations_that_are_not_holomorphic(activation):
    assert cauchy_riemann_error(Perceptron(torch.exp).value, inner_points()) < 1e-6
    assert cauchy_riemann_error(Perceptron(activation).value, inner_points()) > 1e-2


@pytest.mark.parametrize("activation", ["relu", "modReLU", "tanh", "x"])
def test_activations_that_are_not_entire_are_refused(activation):
    with pytest.raises(OptionError, match=rf"{activation}.*only if it is entire.*exp, sin, sinh"):
        ComplexMLP(activation=activation)


# --- the start --------------------------------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 2**32 - 1),
    depth=st.integers(1, 12),
    width=st.integers(1, 24),
    activation=st.sampled_from(["exp", "sin", "sinh"]),
    gain=st.sampled_from([None, 0.5]),
)
def test_units_are_bounded_on_the_whole_disk_at_every_depth(seed, depth, width, activation, gain):
    network = ComplexMLP(depth=depth, width=width, activation=activation, gain=gain, generator=seeded(seed))
    largest = gain or 1 + 5 / depth
    bound = np.exp(largest) if activation == "exp" else np.sinh(largest)
    with torch.no_grad():
        units = network.features(torch.cat([CIRCLE[::2], 0.5 * CIRCLE[::20], CIRCLE[:1] * 0]))[:, :-1]
        # between the points of the initialisation the units may be a little larger
        assert float(units.abs().max()) < 1.1 * bound


def test_a_start_of_large_weights_overflows():
    network = ComplexMLP(depth=10, generator=seeded())
    with torch.no_grad():
        for weight in network.weights:
            weight.mul_(10)
        assert not network.value(CIRCLE).isfinite().all()


def test_deep_networks_depend_on_z_at_the_start():
    with torch.no_grad():
        value = ComplexMLP(depth=10, generator=seeded()).value(CIRCLE)
    assert float((value - value.mean(0)).abs().amax(0).min()) > 0.2


def test_the_paper_has_ten_layers_of_twenty_units():
    network = ComplexMLP(depth=RMSprop().depth)
    assert (network.depth, network.width, network.activation) == (10, 20, "exp")
    assert [tuple(weight.shape) for weight in network.weights] == [(2, 20, 1), *[(2, 20, 20)] * 9, (2, 1, 20)]


def test_the_same_seed_gives_the_same_network():
    one, same, other = (ComplexMLP(generator=seeded(seed)).value(CIRCLE[:9]) for seed in (5, 5, 6))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_networks_on_a_domain_are_scaled_to_it():
    angle = 2 * np.pi * np.arange(60) / 60
    domain = PlaneDomain.from_boundary(5 + 3j + 2 * np.cos(angle) + 1j * np.sin(angle))
    center, radius = disk_around(domain)
    network = ComplexMLP(center=center, radius=radius, depth=2, generator=seeded())
    assert abs(network.center - (5 + 3j)) < 1e-12
    assert abs(network.radius - 2) < 1e-12
    straight = ComplexMLP(depth=2, generator=seeded())
    z = inner_points()
    torch.testing.assert_close(network.value(5 + 3j + 2 * z), straight.value(z), rtol=0, atol=1e-12)
    torch.testing.assert_close(network.derivative(5 + 3j + 2 * z), straight.derivative(z) / 2, rtol=0, atol=1e-10)


# --- values and derivatives -------------------------------------------------------------------------------------------


# torch compiles some rules of forward mode on first use, by a function that it has itself deprecated
forward_mode = pytest.mark.filterwarnings("ignore:.*torch.jit.script:DeprecationWarning")


@forward_mode
@every_network
def test_derivative_equals_that_of_autodiff(network):
    z = inner_points()
    _, tangent = torch.func.jvp(network.value, (z,), (torch.ones_like(z),))
    tangent, exact = tangent.detach(), network.derivative(z).detach()
    torch.testing.assert_close(tangent, exact, rtol=0, atol=1e-12 * float(exact.abs().max()))


@every_network
def test_networks_meet_the_protocol_and_are_linear_in_their_features(network):
    assert isinstance(network, HolomorphicModel)
    with torch.no_grad():
        features, value = network.features(CIRCLE), network.value(CIRCLE)
    assert features.shape == (1000, 2 * network.width + 1)
    p, q = (layer[0] for layer in network.weights[-1].detach())
    bias = network.biases[-1].detach()
    expected = torch.stack([features[:, : len(p)] @ p + bias[0], features[:, len(p) : -1] @ q + bias[1]], dim=-1)
    torch.testing.assert_close(value, expected, rtol=0, atol=1e-12)


@every_network
def test_transforms_of_torch_agree(network):
    z = inner_points(8)
    network.requires_grad_(False)
    torch.testing.assert_close(torch.func.vmap(network.value)(z), network.value(z), rtol=0, atol=1e-12)
    _, pull = torch.func.vjp(network.value, z)
    ones = torch.ones(8, 2, dtype=torch.complex128)
    # torch's cotangents of a holomorphic f are those of the conjugate derivative
    torch.testing.assert_close(pull(ones)[0], network.derivative(z).sum(-1).conj(), rtol=0, atol=1e-10)
    network.requires_grad_(True)
    network.value(z).abs().sum().backward()
    assert all(bool(parameter.grad.isfinite().all()) for parameter in network.parameters())
    network.zero_grad()


@pytest.mark.parametrize("shape", [(), (5,), (2, 3), (0,), (3, 0, 2)])
def test_points_of_any_shape(shape):
    network = ComplexMLP(generator=seeded())
    z = torch.full(shape, 0.3 + 0.1j, dtype=torch.complex128)
    assert network.value(z).shape == (*shape, 2)
    assert network.derivative(z).shape == (*shape, 2)
    assert network.features(z).shape == (*shape, 41)


def test_points_in_single_precision_are_answered_in_it():
    network = ComplexMLP(depth=10, generator=seeded())
    z = inner_points()
    with torch.no_grad():
        single = network.value(z.to(torch.complex64))
        assert single.dtype == torch.complex64
        torch.testing.assert_close(single.to(torch.complex128), network.value(z), rtol=0, atol=1e-5)


def test_saved_network_is_rebuilt_bit_for_bit():
    network = ComplexMLP(depth=4, width=9, activation="sin", center=1 + 2j, radius=3.0, generator=seeded())
    again = rebuild("mlp", json.loads(json.dumps(network.config())), network.state_dict())
    assert torch.equal(again.value(CIRCLE), network.value(CIRCLE))
    assert torch.equal(again.derivative(CIRCLE), network.derivative(CIRCLE))


def test_surface_of_a_network_comes_back_from_its_file(tmp_path):
    surface = SpinorSurface(ComplexMLP(generator=seeded()), PlaneDomain.disk())
    surface.save(tmp_path / "surface.safetensors")
    again = SpinorSurface.load(tmp_path / "surface.safetensors")
    z = inner_points().numpy()
    np.testing.assert_array_equal(again.position(z), surface.position(z))


@forward_mode
def test_linearisation_is_that_of_the_parameters():
    network = ComplexMLP(depth=3, width=5, generator=seeded())
    z = inner_points(7)
    linear = network.linearised(z)
    parameters = {name: parameter.detach() for name, parameter in network.named_parameters()}

    def value(some):
        return torch.func.functional_call(_Value(network), {f"network.{name}": t for name, t in some.items()}, (z,))

    v = complex_normal(7, 2, seed=3)
    changes = linear.pulled_back(v)
    tangent = dict(zip(parameters, changes, strict=True))
    _, pushed = torch.func.jvp(value, (parameters,), (tangent,))
    expected = torch.stack([linear.kernel()[k] @ v[:, k] for k in range(2)], dim=-1)
    torch.testing.assert_close(pushed, expected, rtol=1e-10, atol=1e-10)
    with torch.no_grad():
        torch.testing.assert_close(linear.value, network.value(z), rtol=0, atol=1e-13)


class _Value(torch.nn.Module):
    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, z):
        return self.network.value(z)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"depth": 0}, "at least one"),
        ({"width": 0}, "at least one"),
        ({"radius": 0.0}, "positive"),
        ({"gain": -1.0}, "gain"),
    ],
)
def test_bad_sizes_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        ComplexMLP(**options)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_devices_agree():
    here, there = ComplexMLP(depth=10, generator=seeded()), ComplexMLP(depth=10, generator=seeded()).cuda()
    with torch.no_grad():
        torch.testing.assert_close(there.value(CIRCLE.cuda()).cpu(), here.value(CIRCLE), rtol=0, atol=1e-10)
