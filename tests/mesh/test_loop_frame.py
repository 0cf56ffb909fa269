"""Frames of loops: the same local coordinates for copies of a polygon, and coordinates outside."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loop_frame import LoopFrame, first_point, first_points
from spinor_geom.plateau.solve import solve_plateau
from tests.fill.copies import POLYGONS, motions
from tests.fill.shapes import circle


def local(points: np.ndarray) -> np.ndarray:
    frame = LoopFrame.of(BoundaryLoop.from_points(points))
    steps = -np.arange(len(points)) if frame.is_backward else np.arange(len(points))
    return frame.local(points[(frame.first + steps) % len(points)])


@pytest.mark.parametrize("name", POLYGONS)
def test_copies_have_the_same_local_coordinates(name: str) -> None:
    rng = np.random.default_rng(1)
    points = POLYGONS[name](rng)
    for _, move in motions(rng):
        copy = np.roll(move(points), rng.integers(len(points)), axis=0)
        # a few steps of the rounding, 1.5e-11: a coordinate may lie between two multiples
        np.testing.assert_allclose(local(copy), local(points), atol=1e-10)
        np.testing.assert_allclose(local(copy[::-1]), local(points), atol=1e-10)


@pytest.mark.parametrize("name", POLYGONS)
def test_outside_inverts_local(name: str) -> None:
    points = POLYGONS[name](np.random.default_rng(2))
    frame = LoopFrame.of(BoundaryLoop.from_points(points))
    there = frame.local(points)
    np.testing.assert_allclose(frame.outside(there), points, atol=1e-10 * frame.size)
    np.testing.assert_allclose(frame.inverse.outside(points), there, atol=1e-10)
    np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-14)


def test_a_point_beside_decides_where_a_polygon_is_symmetric() -> None:
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    for k in range(4):
        place = first_point(np.roll(square, k, axis=0), np.tile([0.3, 0.1, -1.0], (4, 1)))[0]
        np.testing.assert_array_equal(np.roll(square, k, axis=0)[place], square[2])


@pytest.mark.parametrize("name", ["circle", "zigzag"])
def test_points_beside_the_edges_decide_the_direction_of_a_symmetric_polygon(name: str) -> None:
    points = POLYGONS[name](np.random.default_rng(3))
    start = 1.2 * points - [0, 0, 1]  # each nearer to the start of its edge
    loop = dataclasses.replace(BoundaryLoop.from_points(points), beside=start)
    assert LoopFrame.of(loop).is_backward != LoopFrame.of(loop.reversed()).is_backward


def test_deviations_from_symmetry_beyond_rounding_decide() -> None:
    points = POLYGONS["circle"](np.random.default_rng(3))
    points = points + 1e-10 * np.random.default_rng(4).normal(size=points.shape)
    expected = local(points)
    for k in range(len(points)):
        np.testing.assert_array_equal(local(np.roll(points, k, axis=0)), expected)
        np.testing.assert_array_equal(local(np.roll(points, k, axis=0)[::-1]), expected)


@pytest.mark.parametrize("beside", [[0.0, -1e24, 0.0], [1e12, 3e11, 1.0], [0.3, 1e10, 1e-3]])
def test_axes_are_orthonormal_however_far_the_point_beside_is(beside: list[float]) -> None:
    t = 2 * np.pi * np.arange(8) / 8 + 1.1
    loop = BoundaryLoop.from_points(np.column_stack([np.cos(t), np.sin(t), 1 + 0 * t]))
    axes = LoopFrame.of(dataclasses.replace(loop, beside=np.tile(beside, (8, 1)))).axes
    assert abs(axes @ axes.T - np.eye(3)).max() < 1e-14


def test_sequences_decide_where_lengths_at_one_point_do_not() -> None:
    # two equal longest edges; after one of them the next edges are longer
    angle = np.cumsum([0, 5, 4, 3, 2, 5, 3, 3.5, 2.5, 2]) * 2 * np.pi / 30
    points = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])[:-1]
    expected, backward = first_point(points)
    for k in range(len(points)):
        assert first_point(np.roll(points, k, axis=0)) == ((expected + k) % len(points), backward)


def test_ties_of_many_polygons_are_broken_as_those_of_each() -> None:
    random = np.random.default_rng(5)
    # multiples of 1/2 give many equal lengths. Some of the polygons are symmetric
    many = random.integers(0, 3, (300, 6, 3)) / 2.0
    many[::3, 3:] = -many[::3, :3]
    beside = random.integers(0, 2, (300, 6, 3)) * 1.0
    first, is_backward = first_points(many, beside)
    alone = [first_point(points, near) for points, near in zip(many, beside, strict=True)]
    assert list(zip(first.tolist(), is_backward.tolist(), strict=True)) == alone


def test_long_symmetric_polygons_have_a_first_point() -> None:
    assert first_point(circle(20_000)) == (0, False)


@pytest.mark.parametrize("is_backward", [False, True])
def test_surfaces_between_loops_are_placed_outside_a_frame(is_backward: bool) -> None:
    centre, shifts = np.array([5.0, 3.0, 1.0]), ([0.6, 0.0, 0.1], [-0.5, -0.2, 0.0])
    inner = [circle(20, 0.3)[::-1] + shift for shift in shifts]
    loops = [BoundaryLoop.from_points(3 * points + centre) for points in (circle(40, 1.5, bend=0.1), *inner)]
    frame = dataclasses.replace(LoopFrame.of(*loops), is_backward=is_backward)
    found = solve_plateau([frame.loop(loop) for loop in loops])
    placed = pickle.loads(pickle.dumps(found.placed_by(frame, *loops)))
    rims = np.concatenate([rim.loop.points for rim in placed.rims])
    assert [len(rim.loop) for rim in placed.rims] == [len(loops[number]) for number in placed.annulus.order]
    away = placed.array_surface.position(placed.loop_points_in_domain()) - rims
    assert np.abs(away).max() < placed.tolerance * placed.boundary_residual.mean_edge
    assert placed.area == pytest.approx(found.area * frame.size**2)
    assert placed.annulus.disk_area == pytest.approx(found.annulus.disk_area * frame.size**2)
    nearer = placed.solved_to(placed.tolerance / 10)
    assert nearer.area == pytest.approx(placed.area, rel=1e-6)
    np.testing.assert_array_equal(nearer.rims[0].loop.points, placed.rims[0].loop.points)
