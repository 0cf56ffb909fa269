"""Names of the gallery."""

from __future__ import annotations

import pytest

from spinor_geom.errors import OptionError
from spinor_geom.gallery import SURFACES, KnownSurface, named_surface


@pytest.mark.parametrize("name", SURFACES)
def test_a_name_makes_its_surface(name: str) -> None:
    known = SURFACES[name]()
    if isinstance(known, KnownSurface):
        assert named_surface(name).area() == pytest.approx(known.area, rel=1e-9)


@pytest.mark.parametrize("name", ["tennis-seam", "schwarz-d-quadrilateral"])
def test_a_curve_stands_for_the_disk_that_it_bounds(name: str) -> None:
    known = SURFACES[name]()
    assert named_surface(name).area() == pytest.approx(known.disks[0].area, rel=1e-7)  # of 96 points


def test_an_unknown_name_lists_all() -> None:
    with pytest.raises(OptionError, match=r"no surface 'enneppr'.*catenoid.*twisted-circle"):
        named_surface("enneppr")
