"""Annuli on domains made for their rims: those of Douglas's route, and those whose nodes crowd on a round one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinor_geom import solve_plateau
from spinor_geom.arrays import NUMPY
from spinor_geom.domain.plane_domain import PlaneDomain, panel_breaks
from spinor_geom.domain.quadrature import Panels
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network.discretisation import ModulusFields
from spinor_geom.plateau.network.network_problem import NetworkProblem, path_across
from tests.plateau.rims import SKEW_AREA, ring, sampled, skew


def lifted_ellipse():
    """An ellipse with a small hole near one end, a little above it: a round annulus takes millions of nodes."""
    return sampled(ring(1.0, 0.0, stretch=4.0), 80), sampled(ring(0.2, 0.1, centre=(2.5, 0.1)), 24)


@cache
def slender():
    return solve_plateau(lifted_ellipse())


def test_network_finds_the_annulus_of_the_series():
    rims = [sampled(curve, count) for curve, count in zip(skew(), (60, 48), strict=True)]
    solution = solve_plateau(rims, model="cauchy")
    assert solution.route == "annular network"
    # the fit ends a few ten-thousandths of an edge from the rims
    assert abs(solution.area / SKEW_AREA - 1) < 1e-4
    series = solve_plateau(rims)
    assert series.route == "annulus"
    assert abs(solution.area / series.area - 1) < 1e-4
    assert solution.stability.verdict == "stable"
    assert solution.annulus.spin == "periodic"


def test_small_hole_near_an_end_takes_a_domain_of_its_own():
    solution = slender()
    assert solution.route == "annular network"
    assert solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-4
    # the projection to the plane is the region between the ellipse and the hole
    assert np.pi * 3.96 < solution.area < solution.annulus.disk_area
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-6
    assert solution.is_area_minimum


def test_period_is_closed_and_both_rims_are_met():
    surface, solution = slender().surface, slender()
    assert solution.annulus.period < 1e-13 * solution.boundary_residual.diagonal
    assert np.abs(surface.periods().real).max() == pytest.approx(0.0, abs=1e-13 * solution.boundary_residual.diagonal)
    for rim in solution.rims:
        away = np.linalg.norm(surface.position(rim.points_in_domain()) - rim.loop.points, axis=1)
        assert away.max() < 1e-3 * rim.loop.mean_edge_length
    z = solution.domain.triangulation.points[solution.domain.triangulation.boundary_size :]
    assert np.abs(surface.mean_curvature(z)).max() * np.sqrt(solution.area) < 1e-8


# --- its parts --------------------------------------------------------------------------------------------------------


DOMAIN = PlaneDomain.annulus(0.4, n=48)


def problem_on_annulus(branches=()):
    panels = Panels.around(DOMAIN, tuple(map(panel_breaks, DOMAIN.boundaries)), 8)
    poles = np.array([1.4, 1.1j, 0.1], dtype=np.complex128)
    network = CauchyNetwork.orthonormal_on(
        np.asarray(panels.z),
        np.asarray(panels.arc_weights),
        poles=poles,
        scales=np.ones(3, dtype=np.float64),
        degree=3,
        branches=branches,
    )
    curves = tuple(CurveTensors.of(BoundaryCurve.from_loop(sampled(ring(r, 0.0), 24)), NUMPY) for r in (1.0, 0.4))
    corners = np.empty(0), np.empty(0)
    return panels, NetworkProblem.on_panels(DOMAIN, panels, network, curves, corners), network


def test_integrals_go_along_both_boundaries_and_across():
    panels, problem, _ = problem_on_annulus()
    z = np.asarray(np.append(panels.z, path_across(DOMAIN, 0)[0]))
    integral = problem.integrate((z**3 * problem.dz)[:, None])[:, 0]
    expected = np.asarray(panels.z) ** 4 / 4
    difference = integral - expected
    assert np.abs(difference - difference[0]).max() < 1e-13
    around = problem.around_hole((problem.dz / z)[:, None])
    assert abs(complex(around[0, 0]) + 2j * np.pi) < 1e-12


@pytest.mark.parametrize("branches", [(), (0.05 + 0.02j,)])
def test_derivative_of_a_network_around_a_hole(branches):
    _, _, network = problem_on_annulus(branches)
    real, imag = np.random.default_rng(0).normal(size=(2, *network.readout.shape))
    network = replace(network, readout=real + 1j * imag)
    z, h = np.array([0.7, -0.1 + 0.6j, 0.5j]), 1e-5
    difference = (network.value(z + h) - network.value(z - h)) / (2 * h)
    assert np.abs(difference - network.derivative(z)).max() < 1e-6
    assert np.abs(network.features(z) @ network.readout - network.value(z)).max() < 1e-10
    # across the cut of the root both change their sign
    cut = -0.7 + 0.02j + 1e-12j * np.array([1.0, -1.0], dtype=np.float64)
    above, below = network.value(cut)
    assert np.abs(above + (1 if branches else -1) * below).max() < 1e-8


def test_hole_grows_along_its_field():
    panels, _, _ = problem_on_annulus()
    field = ModulusFields.of_hole(DOMAIN, panels)
    grown = field.moved(DOMAIN, np.array([0.1]))
    radius = np.abs(grown.holes[0].vertices)
    assert np.ptp(radius) < 1e-2 * radius.mean()
    assert radius.mean() > 0.4
    # nowhere on the outer boundary
    assert not field.nodes[: 48 * 8].any()
