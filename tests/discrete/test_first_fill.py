"""The minimum-area triangulation without inner points, and its unfolding into the plane."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.discrete import first_fill
from spinor_geom.discrete.first_fill import disk_without_inner_points, minimum_area_triangulation, unfolded_loop
from spinor_geom.domain.polygons import is_simple
from spinor_geom.errors import DomainError, FirstFillError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.fill.shapes import circle
from tests.loops import CONVEX, L_SHAPE, is_disk_on, planar, polygon_area, ramp, slit
from tests.strategies import SEEDS, rough_loops


@cache
def triangulations(first, last):
    """All triangulations of the polygon first, first + 1, …, last by its diagonals."""
    if last - first < 2:
        return ((),)
    return tuple(
        ((first, k, last), *left, *right)
        for k in range(first + 1, last)
        for left in triangulations(first, k)
        for right in triangulations(k, last)
    )


def area(points, triangles):
    i, j, k = np.transpose(triangles)
    return np.linalg.norm(np.cross(points[j] - points[i], points[k] - points[i]), axis=1).sum() / 2


@given(n=st.integers(3, 8), seed=SEEDS)
def test_minimum_area_equals_that_of_all_triangulations_tried(n, seed):
    points = np.random.default_rng(seed).normal(size=(n, 3))
    areas = np.array([area(points, triangles) for triangles in triangulations(0, n - 1)])
    best = triangulations(0, n - 1)[int(areas.argmin())]
    i, j, k = np.transpose(best)
    sides = sum(np.sum((points[a] - points[b]) ** 2, axis=1).sum() for a, b in ((i, j), (j, k), (i, k)))
    found = minimum_area_triangulation(points)
    # the squared diagonals count a ten-thousandth, so that ties have an answer
    assert areas.min() - 1e-12 <= area(points, found) <= areas.min() + 1e-4 * sides


@given(points=rough_loops(max_points=80))
def test_triangulation_is_a_disk_without_inner_vertices(points):
    triangles = minimum_area_triangulation(points)
    assert len(triangles) == len(points) - 2
    assert (np.diff(triangles, axis=1) > 0).all()
    assert is_disk_on(BoundaryLoop.from_points(points), points, triangles)


@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE], ids=["convex", "L"])
def test_plane_polygon_unfolds_to_itself(corners):
    loop = planar(corners, 40)
    assert abs(area(loop.points, minimum_area_triangulation(loop.points)) - polygon_area(corners)) < 1e-12
    flat = unfolded_loop(loop.points)
    z = loop.points @ np.array([1, 1j, 0])
    turn = (flat[1] - flat[0]) / (z[1] - z[0])
    # angles of triangles on a straight side are known to the root of the rounding error of lengths
    np.testing.assert_allclose(flat, flat[0] + turn * (z - z[0]), atol=1e-6)
    assert abs(abs(turn) - 1) < 1e-6


@pytest.mark.parametrize("loop", [slit(), ramp(0.95), ramp(2.2)], ids=["slit", "ramp 0.95", "ramp 2.2"])
def test_strips_unfold_to_simple_polygons_of_nearly_their_edge_lengths(loop):
    flat = unfolded_loop(loop.points)
    assert len(flat) == len(loop)
    assert is_simple(flat)
    ratio = np.abs(np.roll(flat, -1) - flat) / loop.edge_lengths
    # a ramp of more than a turn has to be straightened: on a strip 0.7 wide at radius 3 lengths change by a tenth
    assert np.abs(np.log(ratio)).max() < 0.25


def test_long_loops_keep_every_point():
    flat = unfolded_loop(circle(450))
    assert len(flat) == 450
    assert is_simple(flat)
    # between the 160 points kept, or fewer, the others lie on chords
    assert abs(np.abs(flat - flat.mean()).max() - 1) < 3e-3


@pytest.mark.parametrize("count", [160, 161, 450])
def test_long_loops_are_closed_without_inner_points_by_parts(count):
    points = circle(count)
    faces = disk_without_inner_points(points)
    assert is_disk_on(BoundaryLoop.from_points(points), points, faces)
    # all triangulations of a convex polygon have its area
    assert abs(area(points, faces) / (count / 2 * np.sin(2 * np.pi / count)) - 1) < 1e-12


def test_loop_without_a_simple_unfolding_is_an_error(monkeypatch):
    def fail(*arguments, **options):
        raise DomainError("crossed")

    monkeypatch.setattr(first_fill, "flatten_boundary", fail)
    with pytest.raises(FirstFillError, match="loop of 40 points"):
        unfolded_loop(ramp(0.5, 40).points)
