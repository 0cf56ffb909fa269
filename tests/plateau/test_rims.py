"""Minimal surfaces between three rims and more: known areas, symmetries, and invariance."""

from functools import cache

import numpy as np
import pytest

from spinor_geom import ArraySurface, mesh_patch, solve_plateau
from spinor_geom.arrays import NUMPY
from spinor_geom.errors import UnresolvedRimsError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import NoConnectedSurface
from spinor_geom.plateau.annulus import _partitions
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.rims import rims_route
from spinor_geom.plateau.rims.starts import Rim, projected_starts
from tests.plateau.rims import CATENOIDS, KNOIDS, TETRAHEDRON, coaxial, facing, knoid, knoid_curves, polygon, ring


@cache
def trinoid():
    return solve_plateau(knoid(3, 0.5))


@cache
def four():
    return solve_plateau(facing(TETRAHEDRON))


# --- known areas ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("k", "rho"), [case for case, (_, index) in KNOIDS.items() if index == 0])
def test_stable_pieces_of_knoids(k, rho):
    solution = solve_plateau(knoid(k, rho))
    assert abs(solution.area / KNOIDS[k, rho][0] - 1) < 1e-12
    assert abs(solution.surface.area() / solution.area - 1) < 1e-12
    # by triangles of Ω: other roundings turn Ω and its triangles, which are off by 1e-7 to 4e-7
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-5
    assert solution.converged
    assert solution.route == "circles"
    assert (solution.stability.verdict, solution.stability.index) == ("stable", 0)
    assert solution.annulus.period < 1e-14
    assert solution.self_intersections == 0


def test_a_piece_of_a_knoid_between_curves_in_formulas():
    solution = solve_plateau(knoid_curves(3, 0.5))
    assert abs(solution.area / KNOIDS[3, 0.5][0] - 1) < 1e-13
    assert solution.boundary_residual.max_per_diagonal < 1e-14


@pytest.mark.parametrize(("k", "rho"), [case for case, (_, index) in KNOIDS.items() if index > 0])
def test_unstable_pieces_of_knoids_are_left_for_less_area(k, rho):
    solution = solve_plateau(knoid(k, rho))
    assert solution.area < KNOIDS[k, rho][0] * (1 - 1e-6)
    assert solution.stability.verdict == "stable"


@pytest.mark.parametrize("holes", [2, 5, 12])
def test_plane_regions_with_holes(holes):
    places = [(-0.5 + 0.33 * (i % 4), -0.4 + 0.4 * (i // 4)) for i in range(holes)]
    rims = [ring(1.0, 0.0), *(ring(0.1, 0.0, centre=place) for place in places)]
    solution = solve_plateau(rims[::-1])
    assert solution.route == "plane"
    assert abs(solution.area / (np.pi * (1 - 0.01 * holes)) - 1) < 1e-13
    assert solution.annulus.order[0] == holes
    patch = mesh_patch(solution)
    assert _euler(patch.faces) == 1 - holes


def test_plane_rims_inside_each_other_have_no_surface():
    answer = solve_plateau([ring(radius, 0.0) for radius in (1.0, 0.6, 0.3)])
    assert isinstance(answer, NoConnectedSurface)
    assert "in one plane" in answer.reason


# --- symmetric surfaces -----------------------------------------------------------------------------------------------


def test_rims_too_far_apart_have_no_surface():
    answer = solve_plateau(facing(TETRAHEDRON, away=1.5))
    assert isinstance(answer, NoConnectedSurface)
    assert "surface degenerates" in answer.reason
    assert len(answer.disks) == 4
    assert answer.area == pytest.approx(4 * np.pi / 4, rel=1e-12)
    assert answer.to_dict()["disk_area"] == answer.area


def test_a_spent_search_says_so(monkeypatch):
    monkeypatch.setattr(rims_route, "DENSE", 200)
    monkeypatch.setattr(rims_route, "_SETTLED", 0.0)
    with pytest.raises(UnresolvedRimsError, match="limit of 200 nodes"):
        solve_plateau(facing(TETRAHEDRON), model="series")


def test_rims_whose_circles_cross_have_starts():
    # triangles around a centre: circles of their mean widths cross
    corners = 0.9 * TETRAHEDRON - 0.1 * TETRAHEDRON[:, None]
    faces = [polygon(np.delete(own, k, axis=0), 6) for k, own in enumerate(corners)]
    curves = [BoundaryCurve.from_loop(face) for face in faces]
    ways = ([CurveTensors.of(way, NUMPY) for way in (curve, curve.reversed())] for curve in curves)
    rims = [Rim(number=k, directions=tuple(both)) for k, both in enumerate(ways)]
    assert len(projected_starts(rims, 32)) == 2


@pytest.mark.slow
def test_douglas_condition_is_reported_for_every_partition():
    # more area than the disks, and no two of the rims have an annulus; on more points the search for one takes longer
    stable = solve_plateau(knoid(3, 0.5, count=16))
    assert stable.stability.verdict == "stable"
    assert list(stable.annulus.partition_areas) == [((0,), (1,), (2,))]
    assert not stable.is_area_minimum
    # a catenoid and a disk far beside it
    answer = solve_plateau((*coaxial(0.25), ring(0.3, 0.0, centre=(5.0, 0.0))))
    assert isinstance(answer, NoConnectedSurface)
    areas = answer.partition_areas
    assert set(areas) == {((0,), (1,), (2,)), ((0, 1), (2,))}
    assert areas[(0,), (1,), (2,)] == answer.area == pytest.approx(2.09 * np.pi, rel=1e-12)
    assert areas[(0, 1), (2,)] == pytest.approx(CATENOIDS[0.25][0] + 0.09 * np.pi, rel=1e-12)


def test_partitions_of_many_rims_have_one_surface_beside_one_disk():
    assert len(set(_partitions(4))) == 14
    assert _partitions(5)[:2] == [((0,), (1,), (2,), (3,), (4,)), ((0,), (1, 2, 3, 4))]
    assert len(_partitions(5)) == 6


# --- what must not matter ---------------------------------------------------------------------------------------------


def test_order_direction_start_position_and_scale_do_not_matter():
    loops = knoid(3, 0.5)
    rotation = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    tries = {
        "swapped": (loops[2], loops[0], loops[1]),
        "reversed": (loops[0], loops[1].reversed(), loops[2]),
        "shifted": (BoundaryLoop.from_points(np.roll(loops[0].points, 11, axis=0), corners=()), *loops[1:]),
    }
    for name, some in tries.items():
        assert abs(solve_plateau(some).area / trinoid().area - 1) < 1e-10, name
    for scale in (1e-6, 1e6):
        moved = [BoundaryLoop.from_points(scale * (x.points @ rotation.T + 3), corners=()) for x in loops]
        assert abs(solve_plateau(moved).area / (scale**2 * trinoid().area) - 1) < 1e-10


# --- the surface ------------------------------------------------------------------------------------------------------


def test_surface_closes_and_lies_on_all_rims():
    surface = four().surface
    assert np.abs(surface.periods().real).max() < 1e-14
    for rim in four().rims:
        away = np.linalg.norm(surface.position(rim.points_in_domain()) - rim.loop.points, axis=1)
        assert away.max() < 1e-4 * rim.loop.mean_edge_length
    # by paths around any side of the holes
    by_quadrature = ArraySurface(
        surface.model, surface.domain, surface.constant, spinor_map=surface.spinor_map, quadrature="gauss", order=24
    )
    z = four().domain.triangulation.points
    assert np.abs(by_quadrature.position(z) - surface.position(z)).max() < 1e-8
    assert np.abs(surface.mean_curvature(z[four().domain.triangulation.boundary_size :])).max() < 1e-8


def _euler(faces):
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces)
