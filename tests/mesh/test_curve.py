"""BoundaryCurve: interpolation, smoothness, convergence, corners, nearest point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.errors import RepeatedPointError
from spinor_geom.mesh import BoundaryCurve, BoundaryLoop
from tests.strategies import SEEDS, RigidMotion, rigid_motions, rough_loops, smooth_loops

L_SHAPE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]])


def circle(count: int) -> np.ndarray:
    t = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)


def curve_of(points: np.ndarray, corners: list[int] | None = None) -> BoundaryCurve:
    return BoundaryCurve.from_loop(BoundaryLoop.from_points(points, corners="auto" if corners is None else corners))


def jump(curve: BoundaryCurve, order: str, at: np.ndarray) -> np.ndarray:
    """Change of a derivative across parameters, from the polynomial pieces themselves."""
    a, b, c, _ = curve.coefficients
    h = np.diff(curve.breaks)[:, None]
    end, start = {
        "first": ((3 * a * h + 2 * b) * h + c, c),
        "second": (6 * a * h + 2 * b, 2 * b),
        "third": (6 * a, 6 * a),
    }[order]
    return np.linalg.norm(start[at] - end[at - 1], axis=1)


class TestInterpolation:
    @settings(deadline=None, max_examples=30)
    @given(points=rough_loops(), corners=st.lists(st.integers(0, 23), max_size=5))
    def test_passes_through_the_vertices_to_the_last_bit(self, points: np.ndarray, corners: list[int]) -> None:
        curve = curve_of(points, corners)
        np.testing.assert_array_equal(curve.point(curve.breaks[:-1]), points)
        np.testing.assert_allclose(curve.point(np.nextafter(curve.breaks[1:], 0)), np.roll(points, -1, 0), atol=1e-12)

    def test_breaks_are_chord_lengths(self) -> None:
        curve = curve_of(np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]]))
        np.testing.assert_allclose(curve.breaks, [0, 3 / 12, 7 / 12, 1], rtol=1e-15)

    @settings(deadline=None, max_examples=30)
    @given(points=rough_loops())
    def test_without_corners_twice_continuously_differentiable(self, points: np.ndarray) -> None:
        curve = curve_of(points, [])
        vertices = np.arange(len(points))
        scale = np.abs(curve.coefficients[1]).max()
        assert jump(curve, "first", vertices).max() < 1e-12 * scale
        assert jump(curve, "second", vertices).max() < 1e-9 * scale

    def test_parameters_are_taken_mod_one(self) -> None:
        curve = curve_of(circle(20))
        s = np.array([[0.2, 0.7], [0.0, 0.999]])
        np.testing.assert_allclose(curve.point(s + 3), curve.point(s), atol=1e-14)
        np.testing.assert_allclose(curve.derivative(s - 2), curve.derivative(s), atol=1e-12)
        np.testing.assert_allclose(curve.point(np.array(-1e-18)), curve.point(np.array(0.0)), atol=1e-14)

    @pytest.mark.parametrize("shape", [(), (5,), (2, 3), (0,)])
    def test_shape_of_the_values_follows_the_parameters(self, shape: tuple[int, ...]) -> None:
        curve = curve_of(circle(20))
        for method in (curve.point, curve.derivative, curve.second_derivative):
            assert method(np.full(shape, 0.3)).shape == (*shape, 3)

    def test_derivatives_agree_with_differences(self) -> None:
        curve = curve_of(circle(20))
        s = (curve.breaks[:-1] + curve.breaks[1:]) / 2
        step = 1e-5  # central differences are exact on quadratics; on cubics off by step² times the third derivative
        slope = (curve.point(s + step) - curve.point(s - step)) / (2 * step)
        bend = (curve.derivative(s + step) - curve.derivative(s - step)) / (2 * step)
        np.testing.assert_allclose(curve.derivative(s), slope, atol=1e-6)
        np.testing.assert_allclose(curve.second_derivative(s), bend, atol=1e-6)

    def test_equal_neighbours_are_refused(self) -> None:
        points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]])
        loop = BoundaryLoop(points=points, vertex_ids=np.arange(4), corners=np.zeros(4, bool))
        with pytest.raises(RepeatedPointError) as caught:
            BoundaryCurve.from_loop(loop)
        assert caught.value.fields == {"index": 1}


class TestConvergence:
    def test_circle_is_approximated_at_order_four(self) -> None:
        counts = np.array([16, 32, 64, 128])
        s = np.linspace(0, 1, 1000, endpoint=False)
        errors = [np.abs(np.linalg.norm(curve_of(circle(count)).point(s), axis=1) - 1).max() for count in counts]
        assert np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(-4, abs=0.1)

    def test_length_of_a_circle(self) -> None:
        # 256 vertices: the spline's error (2π/256)⁴/384 is 1e-9
        assert curve_of(circle(256)).length() == pytest.approx(2 * np.pi, rel=1e-8)

    def test_length_is_at_least_the_perimeter(self) -> None:
        points = circle(12) + np.random.default_rng(0).normal(size=(12, 3)) * 0.1
        loop = BoundaryLoop.from_points(points)
        assert BoundaryCurve.from_loop(loop).length() > loop.perimeter


class TestCorners:
    def test_straight_sides_stay_straight(self) -> None:
        curve = curve_of(L_SHAPE, list(range(6)))
        assert curve.length() == pytest.approx(8, rel=1e-14)
        middle = curve.point((curve.breaks[:-1] + curve.breaks[1:]) / 2)
        np.testing.assert_allclose(middle, (L_SHAPE + np.roll(L_SHAPE, -1, axis=0)) / 2, atol=1e-14)

    def test_corner_parameters(self) -> None:
        curve = curve_of(L_SHAPE, [1, 3])
        np.testing.assert_allclose(curve.corner_parameters, [2 / 8, 4 / 8])
        assert len(curve_of(circle(20)).corner_parameters) == 0

    @pytest.mark.parametrize("corners", [[0], [7], [3, 20], [0, 1, 2, 12], [39]])
    def test_tangent_jumps_at_corners_only(self, corners: list[int]) -> None:
        points = circle(40) + 0.05 * np.random.default_rng(1).normal(size=(40, 3))
        curve = curve_of(points, corners)
        others = np.delete(np.arange(40), corners)
        assert jump(curve, "first", np.array(corners)).min() > 0.1
        assert jump(curve, "first", others).max() < 1e-11
        assert jump(curve, "second", others).max() < 1e-8

    def test_sides_are_not_a_knot_splines(self) -> None:
        points = circle(40) + 0.05 * np.random.default_rng(2).normal(size=(40, 3))
        curve = curve_of(points, [5, 25])
        # the third derivative does not jump at the first and last inner vertex of a side
        quiet, loud = np.array([6, 24, 26, 4]), np.array([10, 15, 30])
        scale = np.abs(curve.coefficients[0]).max()
        assert jump(curve, "third", quiet).max() < 1e-9 * scale
        assert jump(curve, "third", loud).min() > 1e-3 * scale

    def test_side_of_two_edges_is_a_parabola(self) -> None:
        curve = curve_of(circle(6), [0, 2])
        np.testing.assert_allclose(curve.coefficients[0, :2], 0, atol=1e-10)
        assert np.abs(curve.coefficients[1, :2]).max() > 1

    def test_one_corner_gives_an_open_spline_back_to_itself(self) -> None:
        # a drop with a right angle at t = 0, smooth elsewhere
        t = 2 * np.pi * np.arange(200) / 200
        drop = np.stack([np.sin(t / 2), np.sin(t) / 2, 0 * t], axis=1)
        curve = curve_of(drop)
        np.testing.assert_array_equal(np.flatnonzero(curve.corners), [0])
        before, after = curve.derivative(np.array([1 - 1e-12, 0.0]))
        cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
        # tangents (−1/2, 1/2) and (1/2, 1/2)
        assert cosine == pytest.approx(0, abs=1e-5)

    @pytest.mark.parametrize("start", [0, 3, 11])
    def test_starting_vertex_does_not_change_the_curve(self, start: int) -> None:
        points = circle(24) * [2, 1, 1] + 0.05 * np.random.default_rng(3).normal(size=(24, 3))
        corners = np.array([2, 9, 17])
        curve = curve_of(points, corners.tolist())
        rolled = curve_of(np.roll(points, -start, axis=0), ((corners - start) % 24).tolist())
        s = np.linspace(0, 1, 100)
        np.testing.assert_allclose(rolled.point(s - curve.breaks[start]), curve.point(s), atol=1e-12)


class TestInvariance:
    @settings(deadline=None, max_examples=30)
    @given(points=smooth_loops(), motion=rigid_motions())
    def test_motion_moves_the_curve(self, points: np.ndarray, motion: RigidMotion) -> None:
        s = np.linspace(0, 1, 50)
        moved = curve_of(motion(points), [0, 10]).point(s)
        np.testing.assert_allclose(moved, motion(curve_of(points, [0, 10]).point(s)), atol=1e-11)

    @settings(deadline=None, max_examples=30)
    @given(points=smooth_loops())
    def test_reversed_loop_is_the_same_curve_run_back(self, points: np.ndarray) -> None:
        loop = BoundaryLoop.from_points(points, corners=[0, 7])
        s = np.linspace(0.01, 0.99, 50)
        forth, back = BoundaryCurve.from_loop(loop), BoundaryCurve.from_loop(loop.reversed())
        np.testing.assert_allclose(back.point(1 - s), forth.point(s), atol=1e-12)


class TestNearest:
    @settings(deadline=None, max_examples=30)
    @given(points=smooth_loops(), seed=SEEDS)
    def test_points_of_the_curve_find_themselves(self, points: np.ndarray, seed: int) -> None:
        curve = curve_of(points)
        s = np.random.default_rng(seed).uniform(size=100)
        found = curve.nearest(curve.point(s))
        np.testing.assert_allclose(curve.point(found), curve.point(s), atol=1e-12)

    @settings(deadline=None, max_examples=30)
    @given(points=rough_loops(), seed=SEEDS)
    def test_no_denser_sampling_finds_a_nearer_point(self, points: np.ndarray, seed: int) -> None:
        curve = curve_of(points)
        queries = points[:20] + 0.1 * np.random.default_rng(seed).normal(size=(20, 3))
        found = np.linalg.norm(curve.point(curve.nearest(queries)) - queries, axis=1)
        dense = curve.point(np.linspace(0, 1, 40 * len(points), endpoint=False))
        best = np.linalg.norm(dense[:, None] - queries, axis=-1).min(axis=0)
        # two parts of the curve equally near within the spacing of 8 samples a piece may be swapped
        spacing = BoundaryLoop.from_points(points).edge_lengths.max() / 8
        assert (found**2 <= best**2 + spacing**2).all()
        assert (found <= best + 1e-9).mean() >= 0.8

    def test_offset_is_perpendicular_to_the_curve(self) -> None:
        curve = curve_of(circle(50) * [2, 1, 1])
        queries = circle(37) * [2.2, 1.1, 0] + [0, 0, 0.1]
        s = curve.nearest(queries)
        tangent = curve.derivative(s) / np.linalg.norm(curve.derivative(s), axis=1, keepdims=True)
        np.testing.assert_allclose(((queries - curve.point(s)) * tangent).sum(axis=1), 0, atol=1e-13)

    def test_outside_a_corner_the_corner_is_nearest(self) -> None:
        curve = curve_of(L_SHAPE, list(range(6)))
        found = curve.nearest(np.array([[-1.0, -0.5, 0], [2.5, -0.1, 1], [0.9, 0.9, 0]]))
        np.testing.assert_allclose(found[:2], [0, 2 / 8], atol=1e-15)
        np.testing.assert_allclose(curve.point(found[2:]), [[1, 1, 0]], atol=0.1 + 1e-12)

    def test_result_lies_in_the_unit_interval(self) -> None:
        points = circle(10)
        found = curve_of(points).nearest(points[:1] + np.array([1e-3, -1e-18, 0]))
        assert ((found >= 0) & (found < 1)).all()

    def test_no_points_give_no_parameters(self) -> None:
        assert curve_of(circle(10)).nearest(np.empty((0, 3))).shape == (0,)
