"""Names of the gallery: each gives its surface."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spinor_geom.errors import OptionError
from spinor_geom.gallery import SURFACES, KnownCurve, KnownPatch, KnownSurface, named_surface

FORMULAS = ("associate", "catenoid", "enneper", "helicoid", "henneberg", "random-polynomial")
# relative errors of the area that 96 points of the boundary allow
BOUNDARIES = {
    **{"twisted-circle": 1e-9, "tennis-seam": 1e-8, "schwarz-h": 1e-8, "scherk": 1e-6, "schwarz-prism": 1e-6},
    **{f"schwarz-{kind}-{polygon}": 1e-7 for kind in "dp" for polygon in ("hexagon", "quadrilateral")},
}
WITHOUT_AREA = ("ellipse", "horseshoe", "l-shape")
SECONDS_LONG = ("horseshoe", "scherk", "schwarz-d-hexagon", "schwarz-h", "schwarz-p-hexagon", "schwarz-prism")


def some_slow(names):
    return [pytest.param(name, marks=pytest.mark.slow) if name in SECONDS_LONG else name for name in names]


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_has_its_area(name):
    known = SURFACES[name]()
    assert isinstance(known, KnownSurface)
    assert named_surface(name).area() == pytest.approx(known.area, rel=1e-9)


@pytest.mark.parametrize("name", some_slow(BOUNDARIES))
def test_a_boundary_stands_for_the_disk_that_it_bounds(name):
    known = SURFACES[name]()
    assert isinstance(known, (KnownCurve, KnownPatch))
    area = known.area if isinstance(known, KnownPatch) else known.disks[0].area
    assert named_surface(name).area() == pytest.approx(area, rel=BOUNDARIES[name])


@pytest.mark.parametrize("name", some_slow(WITHOUT_AREA))
def test_a_curve_whose_area_is_not_known_is_met(name):
    curve = SURFACES[name]()
    assert isinstance(curve, KnownCurve)
    surface = named_surface(name)
    met = surface.position(surface.domain.point(np.arange(512) / 512))
    gamma = curve.point(np.arange(1 << 14) / (1 << 14))
    assert cKDTree(gamma).query(met)[0].max() < 1e-3 * np.linalg.norm(np.ptp(gamma, axis=0))


def test_an_unknown_name_lists_all():
    with pytest.raises(OptionError, match=r"no surface 'enneppr'.*catenoid.*twisted-circle"):
        named_surface("enneppr")
