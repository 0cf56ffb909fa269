"""Operations on arrays that the array API lacks."""

import numpy as np
import pytest

from spinor_geom.arrays import shifted


@pytest.mark.parametrize("by", [1, -1, 3])
@pytest.mark.parametrize("shape", [(7,), (2, 3, 5)])
def test_rows_are_shifted_around_closed_curves(shape, by):
    x = np.random.default_rng(0).normal(size=shape)
    np.testing.assert_array_equal(shifted(x, by), np.roll(x, by, axis=-1))
