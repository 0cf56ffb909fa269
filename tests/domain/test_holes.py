"""Domains with holes: triangulation, boundary, inside and outside."""

import numpy as np
import pytest

from spinor_geom.domain import PlaneDomain
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import DomainError, OptionError

ANGLE = 2 * np.pi * np.arange(40) / 40
OUTER = 2 * np.cos(ANGLE) + 1j * np.sin(ANGLE)


def hole(centre, radius, count=16):
    return centre + radius * np.exp(-2j * np.pi * np.arange(count) / count)


def meshed(outer, *holes):
    return triangulate_polygon(outer, holes=holes)


def shoelace(polygon):
    return 0.5 * (np.conj(polygon) * np.roll(polygon, -1)).imag.sum()


@pytest.mark.parametrize("holes", [(hole(0.5, 0.3),), (hole(-0.8, 0.2), hole(0.9, 0.35, 12), hole(0.0, 0.1, 5))])
def test_triangles_tile_what_is_left(holes):
    mesh = meshed(OUTER, *holes)
    np.testing.assert_array_equal(mesh.points[: mesh.boundary_size], np.concatenate([OUTER, *holes]))
    assert mesh.rims == tuple(map(len, (OUTER, *holes)))
    a, b, c = mesh.points[mesh.faces].T
    areas = 0.5 * (np.conj(b - a) * (c - a)).imag
    assert areas.min() > 0
    assert abs(areas.sum() - sum(map(shoelace, (OUTER, *holes)))) < 1e-13
    assert len(mesh.points) - len(mesh.edges) + len(mesh.faces) == 1 - len(holes)
    assert mesh.angles.min() > 20


NO_HOLES = [(hole(0.5, 0.3)[::-1], "clockwise"), (hole(1.9, 0.3), "not simple"), (hole(4.0, 0.3), "not inside")]
NO_HOLES += [(hole(0.0, 5.0), "not"), (np.array([0.1, 0.2 + 0j]), "at least 3")]


@pytest.mark.parametrize(("bad", "message"), NO_HOLES)
def test_what_is_no_hole_is_refused(bad, message):
    with pytest.raises(DomainError, match=message):
        meshed(OUTER, bad)


def test_radii_that_are_none_are_refused():
    for inner, outer, n in ((1.0, 0.5, 64), (0.0, 1.0, 64), (0.9, 1.0, 6)):
        with pytest.raises(OptionError, match="an annulus needs"):
            PlaneDomain.annulus(inner, outer, n)
