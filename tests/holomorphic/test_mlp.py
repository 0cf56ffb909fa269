"""ComplexMLP: initial weights, scaling and linearisation; test_models tests what all models have in common."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.mlp import ComplexMLP, disk_around

CIRCLE = torch.from_numpy(np.exp(2j * np.pi * np.arange(1000) / 1000))


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def complex_normal(*shape, seed=0):
    return torch.randn(*shape, dtype=torch.complex128, generator=seeded(seed))


def inner_points(count=40, radius=0.8):
    rng = np.random.default_rng(0)
    return torch.from_numpy(radius * np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count)))


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
        units = network.linearised(torch.cat([CIRCLE[::2], 0.5 * CIRCLE[::20], CIRCLE[:1] * 0])).inputs[-1]
        # between the points of the initialisation the units may be a little larger
        assert float(units.abs().max()) < 1.1 * bound


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


BAD = [({"depth": 0}, "depth"), ({"depth": np.inf}, "depth"), ({"width": 0.5}, "width")]
BAD += [({"radius": 0.0}, "positive"), ({"gain": -1.0}, "gain")]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_sizes_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        ComplexMLP(**options)
