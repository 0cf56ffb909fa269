"""Charts of the gallery: their boundaries, their areas, zero mean curvature, and exact distances."""

import math

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import OptionError
from tests.systems import every_second

KNOWN = [gallery.schwarz_d_quadrilateral(), gallery.schwarz_d_hexagon()]
KNOWN += [gallery.schwarz_p_hexagon(), gallery.schwarz_p_quadrilateral()]
KNOWN += [gallery.schwarz_prism(0.7), gallery.schwarz_h(0.3), gallery.scherk(2.0), gallery.l_shape()]
KNOWN += [gallery.enneper(0.8), gallery.henneberg(), gallery.associate(turn=math.pi / 2), gallery.random_polynomial(1)]
by_name = pytest.mark.parametrize("known", every_second(KNOWN), ids=lambda known: known.name)


def loop_of(known, n):
    return known.sample(n) if isinstance(known, gallery.KnownCurve) else known.rim(n)


@by_name
def test_the_rim_lies_on_the_chart(known):
    # a corner where the tangents are infinite is met to the root of the round-off beside it
    assert known.chart.distances(loop_of(known, 64).points).max() < 1e-10


@by_name
def test_distances_are_those_along_the_normal(known):
    chart = known.chart
    z = chart.lattice(200)
    t = chart.tangents(z)
    normal = np.cross(t[:, 0], t[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    away = 1e-3
    np.testing.assert_allclose(chart.distances(chart.position(z)), 0, atol=1e-12)
    np.testing.assert_allclose(chart.distances(chart.position(z) + away * normal), away, atol=1e-12)


@by_name
def test_charts_are_minimal(known):
    """Mean curvature by central differences of the tangents, where they are regular."""
    chart, step = known.chart, 1e-4
    z = chart.lattice(60)
    x, y = np.moveaxis(chart.tangents(z), 1, 0)
    normal = np.cross(x, y)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    xx, xy = np.moveaxis(chart.tangents(z + step) - chart.tangents(z - step), 1, 0) / (2 * step)
    yy = (chart.tangents(z + 1j * step) - chart.tangents(z - 1j * step))[:, 1] / (2 * step)
    dot = lambda a, b: np.einsum("nk,nk->n", a, b)  # noqa: E731
    e, f, g = dot(x, x), dot(x, y), dot(y, y)
    twice = (g * dot(xx, normal) - 2 * f * dot(xy, normal) + e * dot(yy, normal)) / (e * g - f**2)
    bend = np.abs(dot(xx, normal) / e) + np.abs(dot(yy, normal) / g)
    # differences of order step², relative to the curvatures that cancel
    assert np.median(np.abs(twice)) < 1e-5 * (np.median(bend) + 1)


@pytest.mark.parametrize("a", [0.2, 0.3, 0.9])
def test_the_straight_side_of_schwarz_h_is_straight(a):
    known = gallery.schwarz_h(a)
    # by too few nodes 1e-6 beside it, and the area as much off
    side = known.chart.position(known.sides[3](np.linspace(0, 1, 20)))
    along = (side[-1] - side[0]) / np.linalg.norm(side[-1] - side[0])
    assert np.linalg.norm(np.cross(side - side[0], along), axis=1).max() < 1e-12


def test_henneberg_s_formula_is_that_of_its_spinors():
    known = gallery.henneberg(2.5, 0.9)
    z = 0.9 * np.exp(2j * np.pi * np.arange(50) / 50)
    np.testing.assert_allclose(known.surface.position(z), known.position(z), atol=1e-13)
    assert not known.surface.branch_points()


@pytest.mark.parametrize(
    "make",
    [
        lambda: gallery.schwarz_h(1.0),
        # its area was that of another sheet
        lambda: gallery.schwarz_h(0.05),
        lambda: gallery.schwarz_prism(0.0),
        lambda: gallery.henneberg(1.5, 0.6),
        lambda: gallery.associate(reach=0.0),
        lambda: gallery.random_polynomial(0, degree=0),
    ],
)
def test_sizes_that_do_not_exist_are_refused(make):
    with pytest.raises(OptionError):
        make()
