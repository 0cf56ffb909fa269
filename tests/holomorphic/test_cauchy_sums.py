"""Fast sums of Cauchy kernels: equal to the direct sums for all positions of the points."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import FourierBoundary
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums, fast_sums
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.surface.module import as_module
from tests.strategies import SEEDS, analytic_boundaries

ELLIPSE = FourierBoundary(np.array([0.3, 0, 1.7]), 64)


def direct(sources, strengths, targets):
    return (strengths / (sources[:, None] - targets[:, None, None])).sum(axis=1)


def check_sums(sources, strengths, targets):
    """Equal to round-off of the terms, many times a term's own: 1e-12 of the sum of their absolute values."""
    scale = (np.abs(strengths) / np.abs(sources[:, None] - targets[:, None, None])).sum(axis=1)
    expected = direct(sources, strengths, targets)
    for sums in (cauchy_sums, fast_sums):
        assert (np.abs(sums(sources, strengths, targets) - expected) < 1e-12 * scale).all()


def random_complex(rng, *shape):
    return rng.normal(size=(*shape, 2)) @ [1, 1j]


@pytest.mark.parametrize("n", [1, 3, 8, 9, 100, 513])
@pytest.mark.parametrize("targets", [1, 5, 400])
def test_any_numbers_of_sources_and_targets(n, targets):
    rng = np.random.default_rng(n)
    sources = ELLIPSE.point(np.arange(n) / n)
    check_sums(sources, random_complex(rng, n, 2), 2 * random_complex(rng, targets))


@given(boundary=analytic_boundaries(), seed=SEEDS, n=st.integers(50, 800))
def test_targets_beside_and_far_from_random_curves(boundary, seed, n):
    rng = np.random.default_rng(seed)
    sources = boundary.grid(max(n, len(boundary.coefficients)))[0]
    beside = rng.choice(sources, 300) + random_complex(rng, 300) * 10 ** rng.uniform(-8, 0, 300)
    crowd = rng.choice(sources, 1) * 0.5 + 1e-3 * random_complex(rng, 300)
    check_sums(sources, random_complex(rng, len(sources), 3), np.concatenate([beside, crowd]))


def test_sources_at_one_point_and_targets_at_one_point():
    rng = np.random.default_rng(0)
    check_sums(np.ones(40, dtype=complex), random_complex(rng, 40, 2), np.full(60, 3 + 1j))
    check_sums(ELLIPSE.point(np.arange(40) / 40), random_complex(rng, 40, 2), np.full(60, 0.2 + 0.1j))


@pytest.mark.parametrize("sums", [cauchy_sums, fast_sums])
def test_sums_at_a_source_are_not_finite_and_the_others_are(sums):
    sources = ELLIPSE.point(np.arange(100) / 100)
    targets = np.append(sources[17], 0.1 * np.arange(5))
    finite = np.isfinite(sums(sources, np.ones((100, 1)), targets)).all(axis=1)
    assert finite.tolist() == [False, *[True] * 5]
    # the last source is there again where the last leaves are filled up
    assert not np.isfinite(sums(sources, np.ones((100, 1)), sources)).any()
    # a single one is a cluster without extent
    assert not np.isfinite(sums(sources[:1], np.ones((1, 1)), sources[:1])).any()


# --- in the interpolant -----------------------------------------------------------------------------------------------


def model_and_points():
    z, dz, _ = (torch.from_numpy(row) for row in ELLIPSE.grid(800))
    model = CauchyInterpolant(z, dz, torch.stack([torch.exp(z), z**3], dim=-1))
    rng = np.random.default_rng(0)
    return as_module(model), torch.from_numpy(ELLIPSE.point(rng.uniform(size=800)) * rng.uniform(0, 1, 800))


def test_values_at_many_points_are_exact():
    module, inner = model_and_points()
    model = module.untracked
    points = np.concatenate([inner.numpy(), model.nodes[::7], model.nodes[:9] * (1 - 1e-14)]).reshape(-1, 2)
    plain = np.stack([np.exp(points), points**3], axis=-1)
    np.testing.assert_allclose(model.value(points), plain, rtol=0, atol=1e-11)
    # at the nodes to the last bit
    np.testing.assert_array_equal(model.value(model.nodes), model.values)


def test_points_that_are_not_finite_do_not_change_the_values_at_others():
    module, points = model_and_points()
    some = points[:2].numpy()
    with np.errstate(all="ignore"):
        value = module.untracked.value(np.append(some, [complex("nan"), complex("inf")]))
    assert np.isfinite(value).all(axis=-1).tolist()[:3] == [True, True, False]
    np.testing.assert_allclose(value[:2], module.untracked.value(some), rtol=1e-14)
