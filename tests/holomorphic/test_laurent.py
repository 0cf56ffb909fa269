"""Laurent series: values, derivatives, integrals and residues, with and without square roots."""

import numpy as np
import pytest
import torch

from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import LaurentSeries

SIZES = [(3, 2), (1, 1), (1, 5), (40, 35)]
ROOTS = [(False, False), (True, False), (False, True), (True, True)]


def holes(centres, radii):
    centres = torch.tensor(centres, dtype=torch.complex128)
    return CircularDomain(centres=centres, log_radii=torch.tensor(radii, dtype=torch.float64).log())


ONE, TWO = holes([0.0], [0.25]), holes([0.0, 0.5 + 0.3j], [0.2, 0.15])


def series(k, j, domain, antiperiodic=(), *, seed=0):
    rng = np.random.default_rng(seed)
    outward = torch.from_numpy(rng.normal(size=(k, 2)) + 1j * rng.normal(size=(k, 2)))
    shape = (len(domain.centres), j, 2)
    inward = torch.from_numpy(rng.normal(size=shape) + 1j * rng.normal(size=shape))
    # as the coefficients of a series that converges on a slightly larger domain
    outward, inward = outward * 0.8 ** torch.arange(k)[:, None], inward * 0.8 ** torch.arange(j)[:, None]
    return LaurentSeries(outward, inward, domain, antiperiodic=antiperiodic)


def points(count=30):
    rng = np.random.default_rng(1)
    # off the lines on which roots and logarithms jump
    return torch.from_numpy(rng.uniform(0.3, 0.95, count) * np.exp(1j * rng.uniform(-2.5, 0.0, count)))


every_series = pytest.mark.parametrize(
    "made",
    [series(*size, ONE, (root,)) for size in SIZES for root in (False, True)]
    + [series(*size, TWO, roots) for size in SIZES for roots in ROOTS],
    ids=str,
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
def test_values_residues_and_values_on_circles(made):
    z = points()
    with torch.no_grad():
        expected = z[:, None] ** torch.arange(len(made.outward)) @ made.outward
        for zeta, coefficients in zip(made.circles.coordinates(z)[1:], made.inward, strict=True):
            expected = expected + zeta[:, None] ** torch.arange(1, len(coefficients) + 1) @ coefficients
        expected = expected * made.sign_changing(z)[:, None]
        torch.testing.assert_close(made.value(z), expected, rtol=1e-12, atol=1e-12)
        turn = torch.exp(2j * np.pi * torch.arange(512, dtype=torch.float64) / 512)
        for number, centre in enumerate(made.circles.centres):
            around = 1.1 * made.circles.radii[number] * turn
            p, q = made.value(centre + around).unbind(-1)
            mean = (torch.stack([p * p, q * q, p * q], dim=-1) * around[:, None]).mean(dim=0)
            torch.testing.assert_close(made.integrals()[2][number], mean, rtol=1e-12, atol=1e-11)
        circles = made.circles.circles(100)
        rooted = made.on_circles(100) * made.sign_changing(circles)[..., None]
        torch.testing.assert_close(rooted, made.value(circles), rtol=1e-12, atol=1e-11)


def test_catenoid_is_two_terms():
    # p = 1, q = −1/z: ∫ pq dz = −log z
    outward, inward = (torch.tensor(c, dtype=torch.complex128) for c in ([[1.0, 0.0]], [[[0.0, -4.0]]]))
    made = LaurentSeries(outward, inward, ONE)
    z = points()
    with torch.no_grad():
        torch.testing.assert_close(made.primitive(z), torch.stack([z, -1 / z, -torch.log(z)], dim=-1))


def test_sizes_that_are_none_are_refused():
    one = torch.ones(1, 2, dtype=torch.complex128)
    with pytest.raises(OptionError, match="disjoint"):
        LaurentSeries(one, one[None], holes([0.0], [1.0]))
    with pytest.raises(OptionError, match="disjoint"):
        LaurentSeries(one, one.expand(2, 1, 2), holes([0.0, 0.3], [0.2, 0.2]))
    with pytest.raises(OptionError, match="must be centred at 0"):
        LaurentSeries(one, one.expand(2, 1, 2), holes([0.3, 0.0], [0.1, 0.1]))
    with pytest.raises(DtypeError, match="inward"):
        LaurentSeries(one, one.real[None], ONE)
    with pytest.raises(DtypeError, match="K ≥ 1"):
        LaurentSeries(one[:0], one[None], ONE)
