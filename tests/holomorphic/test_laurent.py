"""Laurent series: values, derivatives, integrals and residues, with a root and without."""

import numpy as np
import pytest
import torch

from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.holomorphic import LaurentSeries

SIZES = [(3, 2), (1, 1), (1, 5), (40, 35)]


def series(k, j, *, antiperiodic, seed=0):
    rng = np.random.default_rng(seed)
    outward, inward = (torch.from_numpy(rng.normal(size=(n, 2)) + 1j * rng.normal(size=(n, 2))) for n in (k, j))
    # as the coefficients of a series that converges on a slightly larger annulus
    return LaurentSeries(
        outward * 0.8 ** torch.arange(k)[:, None],
        inward * 0.8 ** torch.arange(j)[:, None],
        inner=0.3,
        outer=1.2,
        antiperiodic=antiperiodic,
    )


def points(count=30):
    rng = np.random.default_rng(1)
    # off the negative axis, where roots and logarithms jump
    return torch.from_numpy(rng.uniform(0.35, 1.15, count) * np.exp(1j * rng.uniform(-3, 3, count)))


every_series = pytest.mark.parametrize(
    "made", [series(*size, antiperiodic=root) for size in SIZES for root in (False, True)], ids=str
)


@every_series
def test_derivative_and_integrals_by_differences(made):
    z, step = points(), 1e-5
    with torch.no_grad():
        slope = (made.value(z + step) - made.value(z - step)) / (2 * step)
        torch.testing.assert_close(made.derivative(z), slope, rtol=1e-6, atol=1e-6)
        p, q = made.value(z).unbind(-1)
        integrand = torch.stack([p * p, q * q, p * q], dim=-1)
        back = (made.primitive(z + step) - made.primitive(z - step)) / (2 * step)
        torch.testing.assert_close(back, integrand, rtol=1e-6, atol=1e-6)


@every_series
def test_features_and_residues(made):
    z = points()
    with torch.no_grad():
        weights = torch.cat([made.outward, made.inward])
        torch.testing.assert_close(made.features(z) @ weights, made.value(z), rtol=1e-12, atol=1e-12)
        circle = 0.7 * torch.exp(2j * np.pi * torch.arange(256, dtype=torch.float64) / 256)
        p, q = made.value(circle).unbind(-1)
        mean = (torch.stack([p * p, q * q, p * q], dim=-1) * circle[:, None]).mean(dim=0)
        torch.testing.assert_close(made.residues(), mean, rtol=1e-12, atol=1e-12)


def test_catenoid_is_two_terms():
    # p = 1, q = −1/z: ∫ pq dz = −log z
    made = LaurentSeries(
        torch.tensor([[1.0, 0.0]], dtype=torch.complex128),
        torch.tensor([[0.0, -2.0]], dtype=torch.complex128),
        inner=0.5,
    )
    z = points()
    with torch.no_grad():
        torch.testing.assert_close(made.primitive(z), torch.stack([z, -1 / z, -torch.log(z)], dim=-1))


def test_antiperiodic_spinors_jump_where_their_products_do_not():
    made = series(3, 2, antiperiodic=True)
    above, below = torch.tensor([-0.7 + 1e-12j, -0.7 - 1e-12j], dtype=torch.complex128)
    with torch.no_grad():
        torch.testing.assert_close(made.value(above), -made.value(below))


def test_sizes_that_are_none_are_refused():
    one = torch.ones(1, 2, dtype=torch.complex128)
    with pytest.raises(OptionError, match="0 < inner < outer"):
        LaurentSeries(one, one, inner=1.0)
    with pytest.raises(DtypeError, match="inward"):
        LaurentSeries(one, one.real, inner=0.5)
    with pytest.raises(DtypeError, match="K ≥ 1"):
        LaurentSeries(one[:0], one, inner=0.5)
