"""Quadrature rules converge at their known orders."""

import math

import numpy as np
import pytest
from numpy.polynomial import polynomial as poly

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import cumulative_matrix, rule
from spinor_geom.errors import OptionError
from spinor_geom.mesh.piece_polynomials import gauss_nodes


def error(name, n):
    nodes, weights = rule(name, n)
    return abs(weights @ np.exp(nodes) - (math.e - 1))


@pytest.mark.parametrize(("name", "order"), [("trapezoid", 2), ("simpson", 4)])
def test_composite_rules_converge_at_their_order(name, order):
    counts = np.array([4, 8, 16, 32])
    slope = -np.polyfit(np.log(counts), np.log([error(name, int(n)) for n in counts]), 1)[0]
    assert abs(slope - order) < 0.02


@pytest.mark.parametrize("order", [1, 2, 4, 12, 20])
def test_cumulative_integration_is_exact_for_polynomials(order):
    nodes, _ = rule("gauss", order)
    coefficients = np.random.default_rng(order).normal(size=order)  # degree order − 1
    integral = poly.polyval(nodes, poly.polyint(coefficients))
    np.testing.assert_allclose(cumulative_matrix(order) @ poly.polyval(nodes, coefficients), integral, atol=1e-13)


@pytest.mark.parametrize(
    ("name", "n", "message"), [("gauss", 0, "n from 1 to"), ("simpson", 3, "even"), ("romberg", 4, "'romberg'")]
)
def test_bad_rules_are_refused(name, n, message):
    with pytest.raises(OptionError, match=message):
        rule(name, n)


def test_shared_arrays_cannot_be_written_to():
    shared = [*(part for name in ("gauss", "trapezoid", "simpson") for part in rule(name, 4)), cumulative_matrix(4)]
    disk = PlaneDomain.disk()
    shared += gauss_nodes(4)
    for part in (disk, disk.boundary, disk.triangulation):
        values = [getattr(part, name) for name in dir(part)]
        # what is not kept is nobody else's
        kept = [value for name, value in zip(dir(part), values, strict=True) if getattr(part, name) is value]
        shared += [value for value in kept if isinstance(value, np.ndarray)]
    assert len(shared) > 20
    assert not any(array.flags.writeable for array in shared)
