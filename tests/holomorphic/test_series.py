"""PowerSeries: closed integrals of its squares, and series of thousands of terms."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.holomorphic.series import PowerSeries, power_moments, power_sums
from tests.strategies import SEEDS


def random_series(terms, seed=0, **place):
    rng = np.random.default_rng(seed)
    return PowerSeries(torch.tensor(rng.normal(size=(terms, 2, 2)) @ [1, 1j]), **place)


def points_in_disk(count, seed=0, center=0.0, radius=1.0):
    rng = np.random.default_rng(seed)
    z = np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))
    return torch.from_numpy(center + radius * z)


def geometric_series(ratio, terms):
    """p = Σ (ratio·z)^k, and q = p·i."""
    powers = torch.full((terms,), ratio, dtype=torch.complex128) ** torch.arange(terms)
    return PowerSeries(torch.stack([powers, 1j * powers], dim=-1))


# --- the closed integral ----------------------------------------------------------------------------------------------


@given(st.integers(1, 80), SEEDS, st.floats(0.1, 10), st.complex_numbers(max_magnitude=3, allow_nan=False))
def test_integrals_equal_quadrature_along_rays(terms, seed, radius, center):
    series = random_series(terms, seed, center=center, radius=radius)
    z = points_in_disk(20, seed, center, radius)
    # exact for polynomials of the squares' degree
    nodes, weights = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(terms))
    with torch.no_grad():
        p, q = series.value(center + (z - center)[:, None] * (nodes + 1) / 2).unbind(-1)
        steps = (z - center)[:, None] / 2
        expected = torch.stack([((f * g) @ (weights + 0j)) for f, g in ((p, p), (q, q), (p, q))], dim=-1) * steps
        # rounding errors of 2K − 1 coefficients as large as K products of random numbers
        torch.testing.assert_close(series.primitive(z), expected, rtol=0, atol=1e-14 * radius * terms**1.5)


# --- long series ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("terms", [0, 1, 2, 31, 32, 33, 64, 65, 500])
def test_value_equals_the_sum_over_the_powers_whatever_the_number_of_blocks(terms):
    series = random_series(terms) if terms else PowerSeries(torch.zeros(0, 2, dtype=torch.complex128))
    z = points_in_disk(40)
    with torch.no_grad():
        k = torch.arange(terms)
        powers = z[:, None] ** k
        torch.testing.assert_close(series.value(z), powers @ series.coefficients, rtol=0, atol=1e-12)
        slopes = powers[:, : max(terms - 1, 0)] @ (k[:, None] * series.coefficients)[1:]
        torch.testing.assert_close(series.derivative(z), slopes, rtol=0, atol=1e-11 * max(terms, 1))


def test_geometric_series_of_thousands_of_terms():
    series = geometric_series(0.998, 20_000)
    z = points_in_disk(300)
    with torch.no_grad():
        p, exact = series.value(z)[:, 0], 1 / (1 - 0.998 * z)
        torch.testing.assert_close(p, exact, rtol=1e-12, atol=0)
        torch.testing.assert_close(series.derivative(z)[:, 0], 0.998 * exact**2, rtol=1e-11, atol=0)
        integrals = series.primitive(z)
        # ∫ p² = z/(1 − 0.998 z) to the same terms, and q = ip
        torch.testing.assert_close(integrals[:, 0], z * exact, rtol=1e-11, atol=0)
        torch.testing.assert_close(integrals[:, 1:], torch.stack([-z * exact, 1j * z * exact], -1), rtol=1e-11, atol=0)


def test_moments_are_the_transpose_of_sums():
    rng = np.random.default_rng(0)
    # more points and powers than fit in one block
    u = rng.uniform(0, 1, 3000) * np.exp(2j * np.pi * rng.uniform(size=3000))
    weights, coefficients = rng.normal(size=(3000, 3)), rng.normal(size=(75, 2)) + 1j * rng.normal(size=(75, 2))
    moments = power_moments(u, weights, 75)
    assert moments.shape == (3, 75)
    # rounding of sums of 3000 terms
    assert moments @ coefficients == pytest.approx(weights.T @ power_sums(u, coefficients), abs=1e-10)
