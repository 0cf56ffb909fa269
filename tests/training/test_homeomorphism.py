"""The homeomorphisms of the circle and the losses between curves."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.training.rmsprop import CircleHomeomorphism, boundary_loss


def bent(seed=0, strength=3.0):
    """A homeomorphism that is far from the identity."""
    psi = CircleHomeomorphism(generator=torch.Generator().manual_seed(seed))
    with torch.no_grad():
        psi.layers[-1].weight.mul_(10 * strength)
        psi.shift.fill_(0.3)
    return psi


def samples(n=200, low=-1.5, high=2.5):
    return torch.linspace(low, high, n, dtype=torch.float64)


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(0.1, 5))
def test_it_increases_by_one_each_turn(seed, strength):
    psi, t = bent(seed, strength), samples()
    with torch.no_grad():
        value = psi(t)
        assert (torch.diff(value) > 0).all()
        torch.testing.assert_close(psi(t + 1), value + 1, rtol=0, atol=1e-12)
        assert float(psi(torch.zeros(1, dtype=torch.float64))) == pytest.approx(0.3, abs=1e-15)


def test_it_is_the_integral_of_its_density():
    psi = bent()
    nodes, weights = np.polynomial.legendre.leggauss(200)
    t = torch.tensor([0.0, 0.2, 0.55, 0.9, 1.0], dtype=torch.float64)
    with torch.no_grad():
        along = t[:, None] * torch.from_numpy((nodes + 1) / 2)
        integral = t * (psi.density(along.reshape(-1)).reshape(along.shape) @ torch.from_numpy(weights / 2))
        # the density is piecewise smooth, and taken as linear on 512 pieces
        torch.testing.assert_close(psi(t), integral / integral[-1] + 0.3, rtol=0, atol=1e-4)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_inverse_inverts_it(seed):
    psi, s = bent(seed), samples()
    with torch.no_grad():
        torch.testing.assert_close(psi(psi.inverse(s)), s, rtol=0, atol=1e-12)
        torch.testing.assert_close(psi.inverse(psi(s)), s, rtol=0, atol=1e-11)


def test_gradients_of_the_inverse_are_those_of_finite_differences():
    psi = bent()
    # off the ends of the pieces, where the second derivative jumps
    s = samples(7, 0.05, 0.93).requires_grad_()
    psi.inverse(s).sum().backward()
    step = 1e-6
    with torch.no_grad():
        by_s = (psi.inverse(s + step) - psi.inverse(s - step)) / (2 * step)
        torch.testing.assert_close(s.grad, by_s, rtol=1e-4, atol=0)
        for parameter in (psi.shift, psi.layers[-1].weight, psi.layers[2].bias):
            flat, gradient = parameter.view(-1), parameter.grad.view(-1)
            index = int(gradient.abs().argmax())
            before = float(flat[index])
            flat[index] = before + step
            above = float(psi.inverse(s).sum())
            flat[index] = before - step
            below = float(psi.inverse(s).sum())
            flat[index] = before
            assert float(gradient[index]) == pytest.approx((above - below) / (2 * step), rel=1e-4)


def test_losses_of_known_curves():
    t = torch.arange(64, dtype=torch.float64) / 64 * 2 * np.pi
    zero = torch.zeros_like(t)
    circle, velocity = torch.stack([t.cos(), t.sin(), zero], -1), torch.stack([-t.sin(), t.cos(), zero], -1)
    lifted = circle + torch.tensor([0.0, 0.0, 2.0])
    turned = [(7 * velocity, 0), (-velocity, 2), (circle, 1)]
    for other, expected in turned:
        loss = boundary_loss((circle, velocity), (circle, other), tangent_weight=1)
        assert float(loss) == pytest.approx(expected, abs=1e-15)
    assert float(boundary_loss((circle, velocity), (lifted, circle), tangent_weight=0.5)) == pytest.approx(4.5)
    assert float(boundary_loss((circle, velocity), (lifted, circle), tangent_weight=0)) == pytest.approx(4)
