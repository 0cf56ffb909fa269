"""Branch points of surfaces."""

import numpy as np
import pytest
import torch
from numpy.polynomial import polynomial as poly

from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import OptionError, ZeroOnContourError
from spinor_geom.gallery import catenoid, enneper, plane_disk
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.holomorphic.zeros import Zero
from spinor_geom.surface import frames
from spinor_geom.surface.branch import with_invariants
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface, weierstrass_phi


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
    # φ is quadratic in p and q
    assert [point.order for point in found] == [2 * order for _, order in expected]
    assert all(point.removable for point in found)
    np.testing.assert_allclose([point.z for point in found], [z for z, _ in expected], atol=1e-12)


def test_order_is_that_of_the_lower_zero():
    (point,) = surface([0, 0, 1], [0, 0, 0, 0.5]).branch_points()
    assert point.order == 4
    assert abs(point.z) < 1e-13


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_spinors_have_removable_branch_points_only_and_weierstrass_enneper_others_too(order):
    power = [0.0] * order + [1.0]
    (of_spinors,) = surface(power, poly.polymul(power, [0.3, 0.2j])).branch_points()
    assert (of_spinors.order, of_spinors.invariant, of_spinors.removable) == (2 * order, 0, True)
    data = torch.zeros(order + 1, 2, dtype=torch.complex128)
    data[order, 0], data[:2, 1] = 1.0, torch.tensor([0.4, 0.7j])
    weierstrass = WeierstrassSurface(PowerSeries(data), PlaneDomain.disk(), torch.zeros(3, dtype=torch.float64))
    (of_f,) = weierstrass.branch_points()
    # the paper's theorem: removable if and only if the order is even
    assert (of_f.order, of_f.invariant, of_f.removable) == (order, order % 2, order % 2 == 0)


def around(center, radius, f):
    """The invariant of a circle on the surface of Weierstrass-Enneper data f and g = z."""
    out = torch.exp(2j * np.pi * torch.arange(128, dtype=torch.float64) / 128)
    z = center + radius * out
    return frames.loop_invariant(weierstrass_phi(f(z), z), 1j * out)


def invariant_of(surface, z):
    """The invariant of a closed curve in Ω."""
    return frames.loop_invariant(surface.null_curve(z), np.roll(z, -1) - np.roll(z, 1))


@pytest.mark.parametrize("center", [1.0, -1.0, 1j, -1j])
def test_henneberg_s_branch_points_are_not_removable(center):
    # f = 1 − z⁻⁴ has a simple zero at each fourth root of unity
    assert around(center, 0.3, lambda z: 1 - z**-4) == 1


def test_the_frame_turns_once_around_the_neck_of_a_catenoid():
    assert around(0.0, 0.5, lambda z: z**-2) == 0


def test_the_invariant_of_curves_in_an_immersed_disk_is_that_of_their_turning_number():
    flat = plane_disk().surface
    t = 2 * np.pi * np.arange(200) / 200
    eight = 0.5 * np.sin(t) + 0.25j * np.sin(2 * t)
    for z, invariant in ((0.7 * np.exp(1j * t), 0), (0.7 * np.exp(2j * t), 1), (eight, 1), (0.7 * np.exp(-3j * t), 0)):
        for surface_below in (flat, enneper(1.0).surface):
            assert invariant_of(surface_below, z) == invariant


def test_curves_sampled_too_coarsely_are_refused():
    with pytest.raises(OptionError, match="more samples"):
        invariant_of(plane_disk().surface, 0.5 * np.exp(2j * np.pi * np.arange(3) / 3))


def test_zeros_of_p_and_q_are_found_apart():
    p, q = surface([0.25, 0, 1.0], poly.polyfromroots([0.3, 0.3, 2.0])).spinor_zeros()
    np.testing.assert_allclose([zero.z for zero in p], [-0.5j, 0.5j], atol=1e-12)
    assert [(zero.order, abs(zero.z - 0.3) < 1e-12) for zero in q] == [(2, True)]
    with pytest.raises(ZeroOnContourError):
        plane_disk().surface.spinor_zeros()  # q = 0


def test_a_branch_point_on_the_boundary_is_named():
    with pytest.raises(ZeroOnContourError, match="boundary") as error:
        surface([-1, 1], [-0.5, 0.5]).branch_points()
    assert abs(error.value.z - 1) < 0.2


def test_circles_around_branch_points_keep_clear_of_holes():
    # φ has a pole in the hole, nearer to the zero than the outer circle is
    def phi(z):
        return weierstrass_phi((z - 0.56) ** 2 / (z - 0.45), 0.3 * z)

    (point,) = with_invariants([Zero(z=0.56, order=2)], phi, PlaneDomain.annulus(0.5))
    assert (point.order, point.invariant) == (2, 0)
