"""The gallery's surfaces agree with their own closed formulas and refuse parameters for which there is none."""

import numpy as np
import pytest

from spinor_geom.errors import OptionError
from spinor_geom.gallery import catenoid, enneper, helicoid, plane_disk, polynomial


def test_catenoid_rims_are_unit_circles_at_the_given_height():
    known = catenoid(0.5)
    neck = known.position(np.array(0j))[0]
    edge = known.surface.domain.boundary.vertices[known.surface.domain.boundary.corners].real.max()
    rim = known.position(edge + 1j * np.linspace(0, 2 * np.pi, 9))
    np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), 1.0, atol=1e-14)
    np.testing.assert_allclose(rim[:, 2], 0.5, atol=1e-14)
    assert abs(neck - 0.848337938094979002) < 1e-14


def test_no_catenoid_beyond_the_critical_height():
    catenoid(0.66274)
    for height in (0.66275, 1.0, 0.0, -0.5):
        with pytest.raises(OptionError, match=r"0\.6627"):
            catenoid(height)


@pytest.mark.parametrize("make", [enneper, plane_disk, lambda r: polynomial([1], [0], radius=r), lambda r: helicoid(r)])
@pytest.mark.parametrize("size", [0.0, -1.0, np.inf, np.nan, "1"])
def test_sizes_must_be_positive(make, size):
    with pytest.raises(OptionError):
        make(size)
