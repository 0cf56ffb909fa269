"""Minimal annuli between two rims: known areas, rims without a minimal annulus, and invariance."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinor_geom import ArraySurface, solve_plateau
from spinor_geom.arrays import NUMPY
from spinor_geom.errors import (
    LoopsMeetError,
    LoopTooShortError,
    MeshFileError,
    MeshShapeError,
    NonFiniteVertexError,
    OptionError,
    PeriodError,
    RepeatedPointError,
    UnknownMeshTypeError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import Laurent, NoConnectedSurface
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network.network_route import NetworkSolver
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.capacity_path import all_on_path
from spinor_geom.plateau.rims.energy import RimsProblem
from spinor_geom.plateau.rims.rims_route import RimsSolver
from spinor_geom.plateau.rims.starts import Rim, start_between
from tests.plateau.rims import CATENOIDS, SKEW_AREA, coaxial, linked, ring, sampled, skew


@cache
def catenoid(h):
    return solve_plateau(coaxial(h, phase=1.0))


@cache
def wavy():
    first, second = skew()
    return solve_plateau((sampled(first, 60), sampled(second, 48)))


# --- known areas ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", CATENOIDS)
def test_catenoids_between_circles_in_formulas(h):
    solution = catenoid(h)
    assert abs(solution.area / CATENOIDS[h][0] - 1) < 1e-12
    assert abs(solution.surface.area() / CATENOIDS[h][0] - 1) < 1e-12
    # triangles of Ω between curved boundaries: 1e-7 for the longest
    assert abs(solution.area_in_domain / CATENOIDS[h][0] - 1) < 1e-5
    assert solution.converged
    assert solution.route == "annulus"
    assert solution.stability.verdict == "stable"
    assert solution.annulus.spin == "periodic"
    assert solution.annulus.period < 1e-14
    assert abs(solution.annulus.disk_area / (2 * np.pi) - 1) < 1e-12


def test_rims_with_waves():
    assert abs(wavy().area / SKEW_AREA - 1) < 1e-5
    exact = solve_plateau(skew())
    assert abs(exact.area / SKEW_AREA - 1) < 1e-12
    assert exact.is_area_minimum


def test_area_of_a_plane_ring_is_the_difference():
    plane = solve_plateau((ring(1.0, 0.0), ring(0.2, 0.0, centre=(0.5, 0.1))))
    assert plane.route == "plane"
    assert abs(plane.area / (np.pi * 0.96) - 1) < 1e-13
    slender = solve_plateau((ring(0.2, 0.0, centre=(2.5, 0.1)), ring(1.0, 0.0, stretch=4.0)))
    assert abs(slender.area / (np.pi * 3.96) - 1) < 1e-13
    # the outer boundary of Ω is the second loop that was given
    assert slender.rims[0].loop.perimeter > slender.rims[1].loop.perimeter


# --- critical distance and stability ----------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [0.7, 1.0])
def test_circles_too_far_apart_have_no_annulus(h):
    answer = solve_plateau(coaxial(h))
    assert isinstance(answer, NoConnectedSurface)
    assert "no annulus" in answer.reason
    assert abs(answer.area / (2 * np.pi) - 1) < 1e-12
    assert answer.to_dict()["disk_area"] == pickle.loads(pickle.dumps(answer)).area == answer.area
    assert solve_plateau(coaxial(h), all_solutions=True) == ()


def test_douglas_condition_distinguishes_minima_from_local_ones():
    # equal at h = 0.5277
    assert catenoid(0.5).is_area_minimum
    assert not catenoid(0.6).is_area_minimum
    assert catenoid(0.6).stability.verdict == "stable"


def test_unstable_catenoid_on_request():
    stable, unstable = solve_plateau(coaxial(0.5), all_solutions=True)
    for solution, area, index in zip((stable, unstable), CATENOIDS[0.5], (0, 1), strict=True):
        assert abs(solution.area / area - 1) < 1e-9
        assert solution.stability.index == index
    kept = solve_plateau(coaxial(0.5), unstable="keep", model=Laurent(modulus=4.0))
    assert abs(kept.area / unstable.area - 1) < 1e-12
    left = solve_plateau(coaxial(0.5), model=Laurent(modulus=4.0))
    assert abs(left.area / stable.area - 1) < 1e-12


def test_an_unstable_annulus_of_a_network_is_left_for_a_stable_one(monkeypatch):
    stable, unstable = solve_plateau(coaxial(0.5), all_solutions=True)
    problem = PlateauProblem.of(coaxial(0.5), Options(model=Laurent(modulus=4.0), unstable="keep"))
    poor = replace(RimsSolver(problem=problem).on_circles(), route="annular network")
    monkeypatch.setattr(NetworkSolver, "solve", lambda *_: poor)
    left = solve_plateau(coaxial(0.5), model="cauchy")
    assert abs(left.area / stable.area - 1) < 1e-12
    assert "replaces an unstable" in left.reason
    assert abs(solve_plateau(coaxial(0.5), model="cauchy", unstable="keep").area / unstable.area - 1) < 1e-12


@pytest.mark.parametrize("h", [0.5, 0.66])
def test_inertia_of_the_energy_is_the_index_of_the_area(h):
    rims = []
    for number, formula in enumerate(coaxial(h)):
        curve = BoundaryCurve.from_formula(formula)
        ways = tuple(CurveTensors.of(way, NUMPY) for way in (curve, curve.reversed()))
        rims.append(Rim(number=number, directions=ways))
    start = start_between(*rims, 48, backward=True)
    problem = RimsProblem(curves=start.surface.curves)
    surface = problem.stationary(replace(start.surface, fixed_moduli=True), tolerance=1e-6)
    assert [critical.index for critical in all_on_path(problem, surface)] == [0, 1]


def test_just_above_the_critical_distance_no_fold_is_overlooked():
    # h* = 0.66274…: both critical points are 2 % of the modulus apart at 0.6627 and gone at 0.6628
    counts = {}
    for h in (0.6627, 0.6628):
        counts[h] = len(solve_plateau(coaxial(h), all_solutions=True))
    assert counts == {0.6627: 2, 0.6628: 0}


# --- what must not matter ---------------------------------------------------------------------------------------------


def test_numbering_order_position_and_scale_do_not_matter():
    first, second = (sampled(c, n) for c, n in zip(skew(), (60, 48), strict=True))
    rotation = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    area = wavy().area
    pairs = {
        "shifted": (first, BoundaryLoop.from_points(np.roll(second.points, 11, axis=0), corners=())),
        "reversed": (first.reversed(), second),
        "swapped": (second, first),
    }
    for name, pair in pairs.items():
        # the nodes fall on other points of the rims
        assert abs(solve_plateau(pair).area / area - 1) < 1e-8, name
    moved = [BoundaryLoop.from_points(250 * loop.points @ rotation.T + 1e3, corners=()) for loop in (first, second)]
    assert abs(solve_plateau(moved).area / (250**2 * area) - 1) < 1e-8


def test_spinors_of_linked_rims_change_their_sign():
    solution = solve_plateau(linked())
    assert solution.annulus.spin == "antiperiodic"
    assert solution.boundary_residual.rms_per_edge < 1e-3
    surface = solution.surface
    assert abs(surface.area() / solution.area - 1) < 1e-10
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-4
    z = solution.domain.triangulation.points[solution.domain.triangulation.boundary_size :]
    assert np.abs(surface.mean_curvature(z)).max() * np.sqrt(solution.area) < 1e-10
    p = surface.spinors(np.array([-0.9 + 1e-9j, -0.9 - 1e-9j]))
    assert np.abs(p[0] + p[1]).max() < 1e-6
    normals = surface.normal(np.array([-0.9 + 1e-9j, -0.9 - 1e-9j]))
    assert np.abs(normals[0] - normals[1]).max() < 1e-6
    assert surface.branch_points() == ()


# --- the surface ------------------------------------------------------------------------------------------------------


def test_surface_closes_and_lies_on_both_rims():
    solution = wavy()
    surface = solution.surface
    assert np.abs(surface.periods().real).max() < 1e-13
    for rim in solution.rims:
        away = np.linalg.norm(surface.position(rim.points_in_domain()) - rim.loop.points, axis=1)
        assert away.max() < 1e-3 * rim.loop.mean_edge_length
    # by paths around either side of the hole
    by_quadrature = ArraySurface(
        surface.model, surface.domain, surface.constant, spinor_map=surface.spinor_map, quadrature="simpson", order=64
    )
    z = solution.domain.triangulation.points
    assert np.abs(by_quadrature.position(z) - surface.position(z)).max() < 1e-8
    assert np.abs(surface.mean_curvature(z)).max() < 1e-10


def test_associates_close_only_without_flux():
    with pytest.raises(PeriodError, match="does not close around hole 0"):
        catenoid(0.5).surface.associate(np.pi / 2)
    assert abs(catenoid(0.5).surface.associate(np.pi).area() / catenoid(0.5).area - 1) < 1e-12
    flat = solve_plateau((ring(1.0, 0.0), ring(0.3, 0.0))).surface
    assert abs(flat.associate(0.7).area() / (np.pi * 0.91) - 1) < 1e-12


# --- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("what", "error"),
    [
        (np.zeros((5, 3)), RepeatedPointError),
        (np.zeros((2, 3)), LoopTooShortError),
        (np.zeros((5, 2)), MeshShapeError),
        (np.full((5, 3), np.nan), NonFiniteVertexError),
        (None, UnknownMeshTypeError),
        ("ab", MeshFileError),
        (3, UnknownMeshTypeError),
        ([], OptionError),
    ],
)
def test_what_is_no_curve_is_refused(what, error):
    with pytest.raises(error):
        solve_plateau(what)
    if isinstance(what, np.ndarray):
        with pytest.raises(error):
            solve_plateau((ring(1.0, 0.0), what))


def test_points_are_rims_as_their_loops_are():
    first, second = (sampled(one, 40) for one in coaxial(0.5))
    wanted = solve_plateau((first, second))
    found = solve_plateau([first.points, second.points.tolist()])
    assert found.area == wanted.area
    assert solve_plateau(first.points).area == solve_plateau([first]).area == solve_plateau(first).area


def test_rims_that_meet_are_refused():
    with pytest.raises(LoopsMeetError, match="meet"):
        solve_plateau((sampled(ring(1.0, 0.0), 40), sampled(ring(1.0, 0.0, centre=(0.5, 0.0)), 40)))


@pytest.mark.parametrize(
    ("radius", "height", "x"), [(0.2, 0.05, 0.5), pytest.param(0.1, 0.1, 0.0, marks=pytest.mark.slow)]
)
def test_a_small_rim_over_a_large_one_is_joined_to_it(radius, height, x):
    # of few nodes on each, all of those on the small one fall into one place, where nothing is left to span
    large, small = ring(1.0, 0.0, stretch=2.0), ring(radius, height, centre=(x, 0.1))
    solution = solve_plateau([sampled(large, 80), sampled(small, 24)])
    assert solution.converged
    # nearly the plane region between them
    assert solution.area == pytest.approx(np.pi * (2 - radius**2), rel=3e-3)


def squares(h, *, turn=0.0, edges=1):
    """Two squares over each other, one of them turned, with so many edges a side."""
    around = np.array([-1 - 1j, 1 - 1j, 1 + 1j, -1 + 1j])
    share = np.arange(edges) / edges
    places = (around[:, None] + share * (np.roll(around, -1) - around)[:, None]).ravel()
    rims = ((places, h), (places * np.exp(1j * np.radians(turn)), -h))
    points = [np.stack([p.real, p.imag, np.full(len(p), z)], axis=1) for p, z in rims]
    return [BoundaryLoop.from_points(some, corners=range(0, len(some), edges)) for some in points]


@pytest.mark.parametrize(
    ("turn", "edges", "area"), [(30.0, 1, 7.11727), pytest.param(30.0, 8, 7.11727, marks=pytest.mark.slow)]
)
def test_squares_turned_against_each_other_are_met_at_their_corners(turn, edges, area):
    # on circles corners stay between the two nodes where few nodes had them, 5e-2 of an edge off
    solution = solve_plateau(squares(0.5, turn=turn, edges=edges))
    assert solution.boundary_residual.rms_per_edge < 1e-4
    # the same of one point a side and of eight
    assert abs(solution.area / area - 1) < 1e-5
    for rim in solution.rims:
        corners = rim.boundary.vertices[rim.boundary.corners]
        away = np.linalg.norm(solution.surface.position(corners)[:, None] - rim.loop.points[rim.loop.corners], axis=2)
        assert away.min(axis=1).max() < 1e-3
