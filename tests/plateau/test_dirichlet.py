"""Dirichlet's form against functions whose conjugates and energies are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import FourierBoundary
from tests.plateau.slides import DISK, PEANUT, ellipse, even, form_of
from tests.strategies import analytic_boundaries


def real_and_imaginary(w):
    return np.array(np.stack([w.real, w.imag], axis=1))


def energy(form, x):
    """½ ∫ x·Λx dθ."""
    return np.pi / len(x) * float((x * form(x)).sum())


def harmonic_pair(boundary, n, function, derivative):
    """Boundary values of the real and the imaginary part of a holomorphic function, and their images under Λ."""
    z, dz, _ = boundary.grid(n)
    # the conjugate of Re f is Im f, that of Im f is −Re f
    slope = -1j * derivative(z) * dz / (2 * np.pi)
    return real_and_imaginary(function(z)), real_and_imaginary(slope)


# --- known functions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [128, 512], ids=lambda n: f"{n} samples")
@pytest.mark.parametrize("power", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("ratio", [2.0, 4.0, 8.0])
def test_powers_on_ellipses(ratio, power, samples):
    form = form_of(ellipse(ratio), 128)
    x, expected = harmonic_pair(
        form.boundary, samples, lambda z: (z / ratio) ** power, lambda z: power * (z / ratio) ** (power - 1) / ratio
    )
    assert float(np.abs(form(x) - expected).max()) < 1e-12 * float(np.abs(expected).max())


@pytest.mark.parametrize("ratio", [2.0, 4.0, 8.0])
def test_error_falls_exponentially_in_the_steps_of_the_kernel(ratio):
    errors = []
    for n in (16, 32, 64):
        form = form_of(ellipse(ratio), n)
        x, expected = harmonic_pair(form.boundary, n, np.exp, np.exp)
        errors.append(float(np.abs(form(x) - expected).max() / np.abs(expected).max()))
    assert errors[1] < 4 * errors[0] ** 1.5 + 1e-12
    assert errors[2] < 4 * errors[1] ** 1.5 + 1e-12


@pytest.mark.parametrize("form", [DISK, form_of(FourierBoundary.circle(2.5), 64)], ids=["disk", "as any domain"])
def test_on_a_disk_it_multiplies_fourier_series_by_their_frequency(form):
    t = even(64)
    for k in range(32):
        x = np.stack([np.cos(2 * np.pi * k * t), np.sin(2 * np.pi * k * t)], axis=1)
        np.testing.assert_allclose(form(x), k * x, rtol=0, atol=1e-12)


# --- properties -------------------------------------------------------------------------------------------------------


@given(boundary=analytic_boundaries(), seed=st.integers(0, 1000))
def test_form_is_symmetric_and_positive_but_for_constants(boundary, seed):
    form = form_of(boundary, 128)
    assert form.error < 1e-9
    # smooth functions on more samples than the kernel has
    t, random = even(192), np.random.default_rng(seed)
    angles = 2 * np.pi * t[:, None] * np.arange(1, 9)
    waves = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
    x, y = (waves @ np.array(random.normal(size=(16, 1))) for _ in "xy")
    one_way, other_way = float((x * form(y)).sum()), float((y * form(x)).sum())
    scale = float(np.linalg.norm(x) * np.linalg.norm(form(y)))
    assert abs(one_way - other_way) < 1e-12 * scale
    assert energy(form, x) > 0
    assert float(np.abs(form(np.ones((192, 1)))).max()) < 1e-11


@given(
    boundary=analytic_boundaries(),
    shift=st.floats(0, 1),
    stretch=st.floats(0, 0.5),
    turn=st.floats(0, 2 * np.pi),
    size=st.floats(0.1, 10),
)
def test_energy_does_not_depend_on_the_parameter_or_the_position_of_the_boundary(boundary, shift, stretch, turn, size):
    def values(z):
        return real_and_imaginary(np.exp(z) + 0.3 * z**3)

    n, fine = 192, np.arange(1024) / 1024
    other = fine + shift + stretch * np.sin(2 * np.pi * fine) / (2 * np.pi)
    k = np.arange(-80, 81)
    moved = np.fft.fft(size * np.exp(1j * turn) * boundary.point(other))[k] / 1024
    moved[80] += 3 - 2j
    again = FourierBoundary(moved, 64)
    first = energy(form_of(boundary, n), values(boundary.grid(n)[0]))
    back = (again.grid(n)[0] - 3 + 2j) / (size * np.exp(1j * turn))
    assert abs(energy(form_of(again, n), values(back)) / first - 1) < 1e-9


@pytest.mark.parametrize(("n", "most"), [(32, 1.0), (64, 0.1), (128, 1e-3), (256, 1e-5), (512, 1e-10)])
def test_measure_bounds_the_error_where_a_domain_has_a_waist(n, most):
    form = form_of(PEANUT, n)
    assert np.array_equal(form.correction, form.correction.T)
    x, expected = harmonic_pair(PEANUT, n, np.exp, np.exp)
    error = float(np.abs(form(x) - expected).max() / np.abs(expected).max())
    assert error < form.error + 1e-11
    assert form.error < most
