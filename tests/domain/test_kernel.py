"""The compiled kernel: what it takes and gives, and what happens without it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import kernel
from spinor_geom.domain.delaunay import constrained_delaunay
from spinor_geom.domain.sizes import SizeField
from spinor_geom.errors import SpinorGeomError
from tests.strategies import SEEDS


def sampled(seed, scale=1.0, shift=0j):
    """A star-shaped polygon and a field with samples on it, scaled and shifted."""
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(4, 60)), int(rng.integers(1, 40))
    polygon = rng.uniform(0.5, 1.2, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.8, n)) / n)
    samples = rng.normal(size=count) + 1j * rng.normal(size=count)
    lengths = 10 ** rng.uniform(-1.5, 0.5, count)
    field = SizeField(decay=0.5, samples=scale * samples + shift, lengths=scale * lengths, neighbours=4)
    return scale * polygon + shift, field, rng.normal(size=50) + 1j * rng.normal(size=50)


@given(SEEDS, st.sampled_from([2.0**-30, 1.0, 2.0**40]))
def test_sizes_scale_with_the_region(seed, scale):
    polygon, field, z = sampled(seed)
    large, large_field, _ = sampled(seed, scale, shift=scale * (3 - 2j))
    np.testing.assert_allclose(
        large_field.over(large).sizes(scale * (z + 3 - 2j)), scale * field.over(polygon).sizes(z), rtol=1e-9
    )


@given(SEEDS)
def test_sizes_are_bounded_by_the_boundary_edges(seed):
    polygon, field, z = sampled(seed)
    edge = np.abs(np.roll(polygon, -1) - polygon)
    own = 0.5 * (edge + np.roll(edge, 1))
    distance = np.abs(z[:, None] - polygon)
    found, nearest = field.over(polygon).sizes(z), distance.argmin(axis=1)
    assert (found <= own[nearest] + field.growth * distance.min(axis=1) + 1e-12).all()
    # the upper bound of a neighbour may be below the lower one
    lowest = np.minimum(own[nearest] - field.decay * distance.min(axis=1), (own + field.growth * distance).min(axis=1))
    assert (found >= np.minimum(lowest, edge.min()) - 1e-12).all()


def test_a_limit_of_no_points_leaves_those_that_split_bridges():
    polygon = np.exp(2j * np.pi * np.arange(40) / 40)
    region = SizeField().over(polygon)
    inner, faces = region.refined(constrained_delaunay(region.points, (40,)), None, 0, np.inf)
    assert len(inner) <= 40
    assert len(faces) == 2 * (40 + len(inner)) - 2 - 40


def test_a_missing_kernel_is_a_typed_error(monkeypatch):
    monkeypatch.setattr(kernel, "EXTENSION_SUFFIXES", [])
    with pytest.raises(SpinorGeomError, match="pip install"):
        kernel.library.__wrapped__()
