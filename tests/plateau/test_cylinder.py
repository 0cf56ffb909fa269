"""Dirichlet's form of the cylinder: known energies, its derivatives, its matrix."""

import math

import numpy as np
import pytest
import torch

from spinor_geom.plateau.cylinder import CylinderForm


def samples(n=32, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(2, n, 3)))


def form(modulus, like, order=0):
    return CylinderForm.of(math.log(modulus), like, order=order)


@pytest.mark.parametrize("k", [1, 3])
def test_energy_of_a_harmonic_function(k):
    # u = cosh(k(x − m)) cos kθ on [0, m]: ∫|∇u|² = ∮ u ∂u/∂ν = πk sinh km cosh km
    m, n = 0.7, 16
    t = torch.arange(n, dtype=torch.float64) / n
    wave = torch.cos(2 * np.pi * k * t)
    x = torch.stack([math.cosh(k * m) * wave, wave])[..., None]
    energy = float((x * form(m, x)(x)).sum()) * 2 * np.pi / n
    assert energy == pytest.approx(np.pi * k * math.sinh(k * m) * math.cosh(k * m), rel=1e-13)


def test_second_rim_runs_the_other_way():
    # sin kθ has the sign of the direction: u = sin θ on both rims is −sin 2πt on the second
    n = 16
    wave = torch.sin(2 * np.pi * torch.arange(n, dtype=torch.float64) / n)
    same = torch.stack([wave, -wave])[..., None]
    m = 1.3
    energy = 0.5 * float((same * form(m, same)(same)).sum()) * 2 * np.pi / n
    # u = cosh(x − m/2)/cosh(m/2) sin θ
    assert energy == pytest.approx(np.pi * math.tanh(m / 2), rel=1e-13)


@pytest.mark.parametrize("modulus", [0.05, 1.0, 30.0])
def test_matrix_is_the_form_and_has_constants_as_its_kernel(modulus):
    x = samples()
    lam = form(modulus, x)
    torch.testing.assert_close(lam.matrix() @ x.reshape(-1, 3), lam(x).reshape(-1, 3), rtol=0, atol=1e-9 / modulus)
    assert float(lam(torch.ones_like(x)).abs().max()) < 1e-12 / modulus
    assert float(torch.linalg.eigvalsh(lam.matrix()).min()) > -1e-12 / modulus


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("modulus", [0.2, 1.0, 4.0])
def test_derivatives_by_the_logarithm_of_the_modulus(modulus, order):
    x, step = samples(), 1e-5
    ahead, back = (CylinderForm.of(math.log(modulus) + sign * step, x, order=order - 1)(x) for sign in (1, -1))
    # central differences of a smooth function: the error is of the second order in the step
    torch.testing.assert_close((ahead - back) / (2 * step), form(modulus, x, order)(x), rtol=1e-6, atol=1e-6)
