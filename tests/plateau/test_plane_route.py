"""Plane loops: the surface is exactly the region that they bound."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spinor_geom import gallery
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.plane_route import lie_in_plane
from tests.loops import CONVEX, L_SHAPE, planar, polygon_area

STAR = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(14) * np.pi / 7, [3.0, 1.0] * 7, strict=True)]


def moved(loop: BoundaryLoop, seed: int, scale: float) -> BoundaryLoop:
    rotation = Rotation.random(random_state=seed).as_matrix()
    points = scale * (loop.points @ rotation.T) + [1, -2, 3]
    return BoundaryLoop.from_points(points, corners=np.flatnonzero(loop.corners) if loop.corners_given else "auto")


@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE, STAR], ids=["convex", "L", "star"])
@settings(max_examples=3)
@given(seed=st.integers(0, 1000), scale=st.floats(1e-3, 1e3))
def test_polygons_are_exact(corners, seed, scale):
    solution = solve_plateau(moved(planar(corners, 40), seed, scale), tolerance=1e-10)
    assert solution.route == "plane"
    assert solution.converged
    assert abs(solution.area / (scale**2 * polygon_area(corners)) - 1) < 1e-11
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-11
    assert solution.stability.verdict == "stable"


@pytest.mark.parametrize(("ratio", "points"), [(2, 100), (8, 100), (32, 400)])
def test_ellipses_are_as_good_as_their_spline(ratio, points):
    loop = moved(gallery.ellipse(ratio).sample(points), 3, 7.0)
    solution = solve_plateau(loop, tolerance=1e-8)
    assert (solution.route, solution.converged) == ("plane", True)
    t = np.linspace(0, 1, 1000)
    on_curve = solution.surface.position(solution.domain.boundary.point(t))
    assert np.abs(on_curve - solution.curve.point(t)).max() < 1e-12 * loop.diagonal
    assert abs(solution.area / (49 * np.pi * ratio) - 1) < 1e-7 * (400 / points) ** 4


def test_float32_rounds_no_loop_out_of_its_plane():
    loop = moved(planar(L_SHAPE, 40), 4, 1.0)
    points = loop.points.astype(np.float32).astype(np.float64)
    rounded = BoundaryLoop.from_points(points, corners=np.flatnonzero(loop.corners))
    assert solve_plateau(rounded).route == "plane"
    # unless more is asked for than float32 holds
    assert lie_in_plane([rounded], allowed=1e-7)
    assert not lie_in_plane([rounded], allowed=1e-10)


def test_normals_follow_the_loop():
    loop = planar(L_SHAPE, 40)
    turned = BoundaryLoop.from_points(loop.points[::-1])
    for either, up in ((loop, 1.0), (turned, -1.0)):
        solution = solve_plateau(either)
        assert np.allclose(solution.surface.normal(solution.domain.triangulation.points), [0, 0, up], atol=1e-14)


def test_the_loops_points_are_found_in_the_domain():
    solution = solve_plateau(moved(planar(STAR, 60), 1, 2.0))
    on_rim = solution.surface.position(solution.loop_points_in_domain())
    assert np.abs(on_rim - solution.loop.points).max() < 1e-13 * solution.loop.diagonal


def test_a_spline_that_crosses_itself_goes_elsewhere():
    # two long thin lobes: the spline through so few points swings across itself
    plane = [(0, 0), (10, 0.02), (10, 0.03), (0.1, 0.05), (10, 0.07), (10, 0.08), (0, 0.1)]
    points = np.pad(np.array(plane), ((0, 0), (0, 1)))
    assert solve_plateau(BoundaryLoop.from_points(points), between="smooth").route != "plane"
    assert solve_plateau(BoundaryLoop.from_points(points, corners=())).route != "plane"


def test_few_points_are_the_vertices_of_a_polygon():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    frame = [(0, 0), (3, 0), (3, 3), (0, 3)]
    cross = [(1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)]
    around = np.pad(np.array(square, dtype=float), ((0, 0), (0, 1)))
    for corners, area in ((square, 1.0), (frame, 9.0), (cross, 5.0)):
        points = np.pad(np.array(corners, dtype=float), ((0, 0), (0, 1)))
        solution = solve_plateau(points)
        assert (solution.route, solution.area) == ("plane", pytest.approx(area, rel=1e-12))
        assert solve_plateau(points, between="smooth").area > 1.1 * area
        named = BoundaryLoop.from_points(points, corners=())
        assert solve_plateau(named).area > 1.1 * area
    between = solve_plateau(
        [np.pad(np.array(frame, dtype=float), ((0, 0), (0, 1))), around + np.array([1.0, 1.0, 0.0])]
    )
    assert between.area == pytest.approx(8.0, rel=1e-12)


def test_a_sliver_of_three_points_is_met_by_its_curve() -> None:
    # its curve hurries along the long sides
    sliver = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 0), (0.8286, 0.1816, 0)], corners=[])
    solution = solve_plateau(sliver)
    assert solution.route == "plane"
    assert solution.boundary_residual.rms_per_edge < 1e-13


@pytest.mark.parametrize("gap", [1e-2, 1e-3, 1e-4])
def test_a_comb_of_few_points_whose_spline_crosses_itself_is_the_polygon_where_only_the_points_are_given(gap):
    x = gap * np.arange(24)
    tips = np.column_stack([x, np.tile([1.0, 1.0, 0.0, 0.0], 6), 0 * x])
    comb = np.concatenate([tips[:22], [[x[21], -0.5, 0], [0, -0.5, 0]]])[::-1]
    loop = moved(BoundaryLoop.from_points(comb), 0, 1.0)
    solution = solve_plateau(loop, between="free")
    assert solution.route == "plane"
    assert solution.converged
    assert solution.area == pytest.approx(polygon_area(comb[:, :2]), rel=1e-9)
