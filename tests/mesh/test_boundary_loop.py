"""BoundaryLoop: measures against known shapes, corners, bad input, invariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.errors import (
    LoopTooShortError,
    MeshShapeError,
    NonFiniteVertexError,
    OptionError,
    RepeatedPointError,
    SpinorGeomError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners, measure, straight_edges, turning_angles
from spinor_geom.plateau.roughness import has_stray_corners
from tests.fill.shapes import circle
from tests.strategies import RigidMotion, rigid_motions, rough_loops, smooth_loops


def polygon_sides(corners: list[tuple[float, ...]], per_side: int) -> np.ndarray:
    """Points of a closed polygon with every side cut into `per_side` equal edges, from its first corner."""
    ends = np.array(corners, dtype=float)
    steps = np.arange(per_side)[:, None] / per_side
    sides = [a + steps * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    return np.concatenate(sides)


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


class TestFromPoints:
    def test_closing_point_is_dropped(self) -> None:
        loop = BoundaryLoop.from_points([*SQUARE, SQUARE[0]])
        assert len(loop) == 4
        np.testing.assert_array_equal(loop.vertex_ids, [0, 1, 2, 3])
        loop = BoundaryLoop.from_points(SQUARE, corners=np.array([0, 2]))
        np.testing.assert_array_equal(loop.corners, [True, False, True, False])

    def test_points_are_a_read_only_copy(self) -> None:
        points = circle(12)
        loop = BoundaryLoop.from_points(points)
        points[0] = 7
        assert loop.points[0, 0] == 1
        assert not loop.points.flags.writeable
        assert not loop.corners.flags.writeable


@pytest.mark.parametrize(
    ("points", "corners", "error", "fields"),
    [
        (SQUARE[:2], "auto", LoopTooShortError, {}),
        ([*SQUARE[:2], SQUARE[0]], "auto", LoopTooShortError, {}),
        ([], "auto", LoopTooShortError, {}),
        ([*SQUARE[:3], SQUARE[2], SQUARE[3]], "auto", RepeatedPointError, {"index": 2}),
        ([*SQUARE, SQUARE[0], SQUARE[0]], "auto", RepeatedPointError, {"index": 4}),
        ([*SQUARE[:3], (0, np.nan, 0)], "auto", NonFiniteVertexError, {"vertex": 3}),
        (np.zeros((5, 2)), "auto", MeshShapeError, {}),
        (np.zeros(9), "auto", MeshShapeError, {}),
        ([["a", "b", "c"]] * 3, "auto", MeshShapeError, {}),
        *((SQUARE, corners, OptionError, {}) for corners in ([4], [-1], [0.5], "all")),
    ],
)
def test_what_is_no_loop_is_refused(points: Any, corners: Any, error: type[SpinorGeomError], fields: dict) -> None:
    with pytest.raises(error) as caught:
        BoundaryLoop.from_points(points, corners=corners)
    assert fields.items() <= caught.value.fields.items()


@pytest.mark.parametrize(
    "broken",
    [
        {"vertex_ids": np.arange(3)},
        {"corners": np.zeros(4)},
        {"corners": [True]},
        {"seam_edges": np.zeros((1, 3), int)},
        {"points": np.zeros((4, 2))},
    ],
)
def test_fields_of_wrong_shape_are_refused(broken: dict[str, np.ndarray]) -> None:
    whole = {"points": np.array(SQUARE), "vertex_ids": np.arange(4), "corners": np.zeros(4, bool)}
    with pytest.raises(MeshShapeError):
        BoundaryLoop(**(whole | broken))


class TestMeasures:
    def test_rectangle(self) -> None:
        loop = BoundaryLoop.from_points([(0, 0, 1), (4, 0, 1), (4, 1, 1), (0, 1, 1)])
        np.testing.assert_array_equal(loop.edge_lengths, [4, 1, 4, 1])
        assert loop.perimeter == 10
        assert loop.mean_edge_length == 2.5
        assert loop.diagonal == pytest.approx(np.sqrt(17), rel=1e-15)
        assert loop.elongation == pytest.approx(4, rel=1e-14)
        np.testing.assert_allclose(loop.centroid, [2, 0.5, 1], atol=1e-15)
        np.testing.assert_allclose(loop.area_vector, [0, 0, 4], atol=1e-14)
        np.testing.assert_allclose(loop.plane.normal, [0, 0, 1], atol=1e-15)
        assert loop.plane.rms_distance == pytest.approx(0, abs=1e-15)

    def test_a_loop_without_length_has_measures(self) -> None:
        loop = BoundaryLoop(points=np.ones((4, 3)), vertex_ids=np.arange(4), corners=np.zeros(4, bool))
        np.testing.assert_array_equal(loop.centroid, [1, 1, 1])
        assert loop.perimeter == loop.diagonal == 0
        assert loop.elongation == np.inf

    def test_wave_about_a_plane_has_its_rms(self) -> None:
        wave = circle(400, bend=0.01, waves=4)
        # the cosine's mean square is 1/2; the speed, that weights the points, varies by 8e-4
        assert BoundaryLoop.from_points(wave).plane.rms_distance == pytest.approx(0.01 / np.sqrt(2), rel=1e-3)

    def test_reversed_keeps_the_first_point(self) -> None:
        loop = BoundaryLoop(
            points=circle(4),
            vertex_ids=np.array([5, 7, 2, 9]),
            corners=np.array([True, True, False, False]),
            slit_fraction=0.25,
            seam_edges=np.array([[7, 2]]),
        )
        back = loop.reversed()
        np.testing.assert_array_equal(back.vertex_ids, [5, 9, 2, 7])
        np.testing.assert_array_equal(back.corners, [True, False, False, True])
        np.testing.assert_array_equal(back.seam_edges, [[2, 7]])
        assert back.slit_fraction == 0.25
        np.testing.assert_array_equal(back.reversed().points, loop.points)
        np.testing.assert_allclose(loop.plane.normal, [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(back.plane.normal, [0, 0, -1], atol=1e-12)

    @given(points=smooth_loops(), motion=rigid_motions(), exponent=st.integers(-6, 6))
    def test_motion_and_scale(self, points: np.ndarray, motion: RigidMotion, exponent: int) -> None:
        scale = 10.0**exponent
        loop, moved = BoundaryLoop.from_points(points), BoundaryLoop.from_points(motion(points * scale))
        # coordinates of size 10 + scale carry 1e-15 of their size as noise
        noise = 1e-13 * (10 + scale) / scale
        assert moved.perimeter == pytest.approx(loop.perimeter * scale, rel=noise)
        assert moved.elongation == pytest.approx(loop.elongation, rel=10 * noise)
        assert moved.plane.rms_distance == pytest.approx(loop.plane.rms_distance * scale, abs=noise * scale)
        np.testing.assert_allclose(moved.centroid, motion(loop.centroid * scale), atol=noise * scale)
        np.testing.assert_allclose(moved.plane.normal, motion.rotation @ loop.plane.normal, atol=1000 * noise)

    @given(points=rough_loops(), start=st.integers(0, 200))
    def test_starting_point_does_not_matter(self, points: np.ndarray, start: int) -> None:
        loop, rolled = BoundaryLoop.from_points(points), BoundaryLoop.from_points(np.roll(points, -start, axis=0))
        np.testing.assert_array_equal(np.roll(rolled.corners, start), loop.corners)
        assert rolled.perimeter == pytest.approx(loop.perimeter, rel=1e-14)
        np.testing.assert_allclose(rolled.centroid, loop.centroid, atol=1e-14)
        np.testing.assert_allclose(rolled.plane.normal, loop.plane.normal, atol=1e-10)


class TestCorners:
    def test_turning_angles_of_a_regular_polygon(self) -> None:
        np.testing.assert_allclose(turning_angles(circle(9)), 2 * np.pi / 9, rtol=1e-14)

    @pytest.mark.parametrize("per_side", [2, 3, 5, 20])
    def test_square_has_four(self, per_side: int) -> None:
        found = np.flatnonzero(detect_corners(polygon_sides(SQUARE, per_side)))
        np.testing.assert_array_equal(found, np.arange(4) * per_side)

    def test_fewer_than_eight_points_have_none(self) -> None:
        triangle = polygon_sides([(0, 0, 0), (5, 0, 0), (0, 1, 0)], 3)
        assert detect_corners(triangle).any()
        assert not detect_corners(np.delete(triangle, [1, 4], axis=0)).any()

    @pytest.mark.parametrize(("degrees", "count"), [(34, 0), (36, 1), (90, 1), (150, 1)])
    def test_a_kink_counts_from_35_degrees(self, degrees: float, count: int) -> None:
        # the two tangents from a point to the unit circle, and the far arc between them
        half = np.radians(degrees) / 2
        arc = np.linspace(half, 2 * np.pi - half, 300)
        rim = np.stack([np.cos(arc), np.sin(arc), 0 * arc], axis=1)
        tip = np.array([1 / np.cos(half), 0, 0])
        steps = np.linspace(0, 1, 4, endpoint=False)[:, None]
        points = np.vstack([tip + steps * (rim[0] - tip), rim[:-1], rim[-1] + steps * (tip - rim[-1])])
        assert turning_angles(points)[0] == pytest.approx(np.radians(degrees))
        np.testing.assert_array_equal(np.flatnonzero(detect_corners(points)), [0] * count)

    @pytest.mark.parametrize("step", [-2, -1, 1, 2])
    def test_a_turn_beside_another_is_no_corner(self, step: int) -> None:
        points = polygon_sides([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], 10)
        assert detect_corners(points)[10]
        # a quarter of an edge inwards: it turns there by 28°, more than a quarter of the corner's angle
        points[10 + step] += [-0.1, 0.0, 0.0] if step > 0 else [0.0, 0.1, 0.0]
        assert not detect_corners(points)[10]

    @settings(max_examples=50)
    @given(points=rough_loops())
    def test_noisy_rim_does_not_become_a_polygon(self, points: np.ndarray) -> None:
        # large turns alone between four small ones are an accident here, rarer than one point in 20
        assert detect_corners(points).sum() <= len(points) / 20 + 1

    @pytest.mark.parametrize(
        ("per_side", "rise", "degrees"),
        [
            ((6, 6, 6), (0.2, 0.2, 0.2), 12),
            ((4, 4, 4, 4), (0.0, 0.15, -0.15, 0.15), 9),
            ((5, 7, 5), (0.2, -0.2, 0.2), 11),
        ],
    )
    def test_coarse_arcs_with_corners(self, per_side: tuple[int, ...], rise: tuple[float, ...], degrees: float) -> None:
        # parabolas over the sides of a regular polygon; half of the points turn by more than a quarter of 35°
        k = len(per_side)
        ends = circle(k)
        sides = []
        for a, b, count, height in zip(ends, np.roll(ends, -1, axis=0), per_side, rise, strict=True):
            t = np.arange(count)[:, None] / count
            sides.append(a + t * (b - a) + 4 * t * (1 - t) * height * np.array([(b - a)[1], -(b - a)[0], 0.5]))
        points = np.concatenate(sides)
        assert np.median(turning_angles(points)) > np.radians(degrees)
        expected = np.cumsum((0, *per_side[:-1]))
        np.testing.assert_array_equal(np.flatnonzero(detect_corners(points)), expected)
        assert not has_stray_corners(BoundaryLoop.from_points(points))
        rough = points + np.random.default_rng(0).normal(scale=0.02, size=points.shape)
        assert not detect_corners(rough).any()

    def test_zig_zag_has_none(self) -> None:
        points = circle(60)
        points[::2] *= 1.1
        assert turning_angles(points).min() > np.radians(35)
        assert not detect_corners(points).any()

    def test_edge_of_length_zero_makes_no_corner(self) -> None:
        points = np.repeat(polygon_sides(SQUARE, 5), [2] + [1] * 19, axis=0)
        np.testing.assert_array_equal(np.flatnonzero(detect_corners(points)), [6, 11, 16])

    def test_edges_below_rounding_give_no_warning(self) -> None:
        points = circle(16, 1.0)
        points[4] *= 1.5
        assert not detect_corners(np.insert(points, 1, points[1] + [1e-20, 1e-17, 5e-18], axis=0)).any()


@pytest.mark.parametrize("count", [12, 48, 4800])
def test_smooth_curves_and_polygons_have_no_straight_lines_between_curves(count: int) -> None:
    # turns of 0 at points of inflection, and hardly more beside them
    t = 2 * np.pi * np.arange(count) / count
    eight = np.column_stack([np.sin(t), np.sin(2 * t), np.cos(t)])
    for points in (eight, polygon_sides(circle(24), count // 12)):
        assert not straight_edges(points, np.zeros(len(points), dtype=bool)).any()


def test_measures_of_many_loops_are_those_of_each() -> None:
    random = np.random.default_rng(2)
    counts = (3, 5, 3, 12, 5)
    loops = [BoundaryLoop.from_points(random.normal(size=(count, 3))) for count in counts]
    loops.append(BoundaryLoop.from_points(np.outer(range(5), [1.0, 0, 0])))  # collinear
    measure(loops)
    for loop in loops:
        alone = BoundaryLoop.from_points(loop.points)
        for name in ("edge_lengths", "perimeter", "diagonal", "centroid", "elongation", "height"):
            assert getattr(loop, name) == pytest.approx(getattr(alone, name), rel=1e-13), name
        np.testing.assert_allclose(loop.plane.normal, alone.plane.normal, rtol=0, atol=1e-13)
        assert not loop.edge_lengths.flags.writeable


@pytest.mark.parametrize(("width", "count"), [(0.1, 96), (0.15, 48), (0.15, 96), (0.2, 48), (0.25, 64)])
def test_sharp_bends_of_smooth_curves_are_no_corners(width: float, count: int) -> None:
    # equal arcs, a point at each tip, where the turns are 2, 2, 7, 22 and 50, or 2, 3, 6, 24 and 114 degrees
    t = np.linspace(0, 2 * np.pi, 20001)
    arc = np.append(0, np.cumsum(np.linalg.norm(np.diff([np.cos(t), width * np.sin(t), 0.2 * np.cos(2 * t)]), axis=0)))
    t = np.interp(np.arange(count) / count * arc[-1], arc, t)
    points = np.column_stack([np.cos(t), width * np.sin(t), 0.2 * np.cos(2 * t)])
    assert np.degrees(turning_angles(points)).max() > 35
    assert not detect_corners(points).any()
