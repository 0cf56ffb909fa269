"""Zeros by the argument principle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import UnplacedZerosError, ZeroOnContourError
from spinor_geom.holomorphic.zeros import find_zeros, zero_inside

DISK = PlaneDomain.disk()


def product(roots):
    def function(z):
        value = np.exp(0.5 * z)
        for root in roots:
            value = value * (z - root)
        return value

    return function


def distinct(points):
    return all(abs(a - b) > 0.02 for i, a in enumerate(points) for b in points[:i])


@given(st.lists(st.complex_numbers(max_magnitude=0.95), max_size=6).filter(distinct))
def test_all_simple_zeros_are_found(roots):
    found = find_zeros(product(roots), DISK)
    assert all(zero.order == 1 for zero in found)
    order = sorted(roots, key=lambda z: min(range(len(found)), key=lambda k: abs(found[k].z - z)) if found else 0)
    # the other zeros shrink the circle on which the moment is taken, and round-off grows with their nearness
    np.testing.assert_allclose([zero.z for zero in found], order, atol=1e-12)


def test_multiple_zeros_are_exact():
    found = find_zeros(product([0.2 + 0.1j] * 3 + [-0.6]), DISK)
    assert [zero.order for zero in found] == [1, 3]
    np.testing.assert_allclose([zero.z for zero in found], [-0.6, 0.2 + 0.1j], atol=1e-13)


def test_zeros_between_the_curve_and_its_polygon_belong_to_the_domain():
    coarse = PlaneDomain.disk(n=8)
    between = 0.99 * np.exp(1j * np.pi / 8)
    assert abs(between) > np.cos(np.pi / 8)
    (zero,) = find_zeros(product([between]), coarse)
    assert abs(zero.z - between) < 1e-12


def test_poles_outside_a_reentrant_domain_are_not_visited():
    square = np.array([0, 2, 2 + 2j, 1.01 + 2j, 1 + 0.2j, 0.99 + 2j, 2j])
    places = np.concatenate([a + (b - a) * np.arange(8) / 8 for a, b in zip(square, np.roll(square, -1), strict=True)])
    corners = np.arange(len(places)) % 8 == 0
    domain = PlaneDomain.from_boundary(places, corners)

    def function(z):
        return (z - (0.5 + 1j)) * (z - (1.5 + 1.5j)) / (z - (1 + 1.5j)) ** 2

    found = find_zeros(function, domain)
    np.testing.assert_allclose([zero.z for zero in found], [0.5 + 1j, 1.5 + 1.5j], atol=1e-12)


@pytest.mark.parametrize("root", [1.0, 1 - 1e-9, np.exp(0.02j)])
def test_zero_on_the_boundary_is_refused(root):
    with pytest.raises(ZeroOnContourError) as error:
        find_zeros(product([root]), DISK)
    assert np.isfinite(error.value.z)


def test_the_zero_function_is_refused():
    with pytest.raises(ZeroOnContourError):
        find_zeros(lambda z: 0 * z, DISK)


def test_count_on_a_circle():
    function = product([0.1, 0.1, 0.5])
    assert zero_inside(function, 0.1 + 0j, 0.2).order == 2
    assert zero_inside(function, 0j, 0.9).order == 3
    assert zero_inside(function, -0.5 + 0j, 0.2).order == 0


@pytest.mark.parametrize("count", [60, 100])
def test_zeros_that_the_values_on_the_boundary_do_not_show_are_found(count):
    # on |z| = 1 the constant 2⁻⁶⁰ is lost in rounding
    found = find_zeros(lambda z: z**count - 0.5**count, DISK)
    assert [zero.order for zero in found] == [1] * count
    np.testing.assert_allclose([zero.z**count * 2.0**count for zero in found], 1, atol=1e-10)


def test_zeros_that_are_counted_but_not_found_are_an_error():
    # it has no zero, but winds once around 0 on the circle
    with pytest.raises(UnplacedZerosError) as error:
        find_zeros(lambda z: np.where(np.abs(z) > 0.9, z, 1), DISK)
    assert error.value.count == 1
