"""Wanted edge lengths in plane regions, and their refinement."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain.delaunay import constrained_delaunay
from spinor_geom.domain.sizes import SizeField
from spinor_geom.errors import OptionError, SpinorGeomError
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
    found, sizes = large_field.over(large).sizes(scale * (z + 3 - 2j)), field.over(polygon).sizes(z)
    np.testing.assert_allclose(found, scale * sizes, rtol=1e-9)


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


CIRCLE = np.exp(2j * np.pi * np.arange(12) / 12)
BAD_FIELDS = {
    "neighbours of none": {"neighbours": 0},
    "more neighbours than are kept": {"neighbours": 9},
    "growth is NaN": {"growth": np.nan},
    "growth is negative": {"growth": -1.0},
    "decay is NaN": {"decay": np.nan},
    "fewer lengths than samples": {"lengths": np.full(2, 0.1)},
    "lengths of two columns": {"lengths": np.full((3, 2), 0.1)},
    "a length of zero": {"lengths": np.array([0.1, 0.0, 0.1])},
    "complex lengths": {"lengths": np.full(3, 0.1 + 0j)},
    "a sample is NaN": {"samples": np.array([0, np.nan, 0.1j])},
    "samples as text": {"samples": np.array(["0", "1", "2"])},
}


@pytest.mark.parametrize("wrong", BAD_FIELDS.values(), ids=BAD_FIELDS.keys())
def test_a_field_takes_only_what_the_kernel_can_read(wrong):
    right = {"samples": np.array([0, 0.1, 0.1j]), "lengths": np.full(3, 0.1)}
    SizeField(**right)
    with pytest.raises(OptionError):
        SizeField(**{**right, **wrong})


BAD_REFINEMENTS = {
    "a vertex that does not exist": {"faces": [[0, 1, 12]]},
    "a negative vertex": {"faces": [[0, 1, -1]]},
    "faces of four": {"faces": [[0, 1, 2, 3]]},
    "faces of reals": {"faces": [[0.0, 1.0, 2.0]]},
    "fewer spacings than seeds": {"seeds": (np.array([0, 0.1j]), np.array([0.1]))},
    "a seed is infinite": {"seeds": (np.array([np.inf + 0j]), np.array([0.1]))},
    "a negative number of points": {"max_points": -1},
}


@pytest.mark.parametrize("wrong", BAD_REFINEMENTS.values(), ids=BAD_REFINEMENTS.keys())
def test_a_refinement_takes_only_what_the_kernel_can_read(wrong):
    region = SizeField().over(CIRCLE)
    right = {"faces": constrained_delaunay(region.points, (12,)), "seeds": None, "max_points": 100, "seconds": np.inf}
    region.refined(**right)
    with pytest.raises(OptionError):
        region.refined(**{**right, **wrong})


def test_a_boundary_is_finite():
    with pytest.raises(OptionError, match="boundary must be finite"):
        SizeField().over(np.array([0, 1, np.nan]))


def test_a_boundary_on_a_line_is_an_error():
    with pytest.raises(SpinorGeomError, match="refine of the compiled part failed"):
        SizeField().over(np.linspace(-1, 1, 12) + 0j).refined(np.array([[0, 1, 2]]), None, 100, np.inf)


@pytest.mark.parametrize("most", [2**28, 2**40])
def test_points_beyond_32_bit_indices_are_refused(most):
    region = SizeField().over(CIRCLE)
    with pytest.raises(MemoryError):
        region.refined(constrained_delaunay(region.points, (12,)), None, most, np.inf)
