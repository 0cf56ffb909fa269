"""Branch points of surfaces."""

import numpy as np
import pytest
import torch
from numpy.polynomial import polynomial as poly

from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import ZeroOnContourError
from spinor_geom.gallery import catenoid, enneper, plane_disk
from spinor_geom.holomorphic import PowerSeries
from spinor_geom.surface import SpinorSurface


def surface(p, q, radius=1.0):
    terms = np.zeros((max(len(p), len(q)), 2), dtype=complex)
    terms[: len(p), 0], terms[: len(q), 1] = p, q
    return SpinorSurface(PowerSeries(torch.from_numpy(terms)), PlaneDomain.disk(radius))


@pytest.mark.parametrize("known", [enneper(1.5), plane_disk(), catenoid(0.5)], ids=lambda known: known.name)
def test_regular_surfaces_have_none(known):
    assert known.surface.branch_points() == ()


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([0], [(0, 1)]),
        ([0, 0], [(0, 2)]),
        ([0.3 + 0.2j], [(0.3 + 0.2j, 1)]),
        ([-0.5, 0.3j, 0.3j, 0.3j], [(-0.5, 1), (0.3j, 3)]),
        ([2.0], []),  # outside Ω
    ],
)
def test_common_zeros_are_found_with_their_order(roots, expected):
    common = poly.polyfromroots(roots)
    a, b = np.array([1, 0.4j, 0.1]), np.array([0.3, 1, 0.2])
    found = surface(poly.polymul(common, a), poly.polymul(common, b)).branch_points()
    assert [point.order for point in found] == [order for _, order in expected]
    np.testing.assert_allclose([point.z for point in found], [z for z, _ in expected], atol=1e-12)


def test_order_is_that_of_the_lower_zero():
    (point,) = surface([0, 0, 1], [0, 0, 0, 0.5]).branch_points()
    assert point.order == 2
    assert abs(point.z) < 1e-13


def test_zeros_of_p_and_q_in_different_places_are_regular():
    assert surface([-0.3, 1], [0.3, 1]).branch_points() == ()


def test_metric_has_a_zero_of_twice_the_order():
    known = surface([0, 0, 1], [0, 0, 0, 0.5])
    factor = known.conformal_factor(np.array([1e-2, 1e-3]))
    assert abs(np.log10(factor[0] / factor[1]) - 4) < 1e-3  # λ ~ |z|⁴: p and q have zeros of order 2


def test_a_branch_point_on_the_boundary_is_named():
    with pytest.raises(ZeroOnContourError, match="boundary") as error:
        surface([-1, 1], [-0.5, 0.5]).branch_points()
    assert abs(error.value.z - 1) < 0.2


def test_branch_points_are_the_same_after_a_rotation():
    common = poly.polyfromroots([0.2, -0.4j])
    first = surface(common, poly.polymul(common, [0.1, 1]))
    rotation = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = first.transform(rotation, 3.0, [1.0, 2.0, 3.0]).associate(0.7)
    np.testing.assert_allclose([p.z for p in moved.branch_points()], [p.z for p in first.branch_points()], atol=1e-12)
