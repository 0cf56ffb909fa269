"""Crossing faces against rational arithmetic, crossing edges against all pairs; real meshes, invariance, cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import combinations
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.deadline import time_limit
from spinor_geom.errors import OptionError, OutOfTimeError, SelfCrossingLoopError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import (
    MOST_CROSSINGS,
    edges_through,
    intersections_between,
    is_graph,
    is_star,
    loop_crossings,
    require_simple,
    self_intersections,
)
from tests.mesh.test_find_loops import grid
from tests.strategies import SEEDS, RigidMotion, rigid_motions, smooth_loops

Point: TypeAlias = tuple[Fraction, ...]
BOTH = np.array([[0, 1, 2], [3, 4, 5]])


# --- rational arithmetic ----------------------------------------------------------------------------------------------


def rational(points: np.ndarray) -> list[Point]:
    return [tuple(Fraction(x) for x in point) for point in points.tolist()]


def minus(a: Point, b: Point) -> Point:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def dot(a: Point, b: Point) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def cross(a: Point, b: Point) -> Point:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def clipped(polygon: Sequence[Point], height: Callable[[Point], Fraction], *, plane: bool = False) -> list[Point]:
    """The part of a convex polygon where a linear function is not negative, or where it is zero."""
    heights = [height(p) for p in polygon]
    part = []
    for p, q, a, b in zip(polygon, (*polygon[1:], polygon[0]), heights, (*heights[1:], heights[0]), strict=True):
        if a == 0 or (a > 0 and not plane):
            part.append(p)
        if a * b < 0:
            part.append(tuple(x + a / (a - b) * (y - x) for x, y in zip(p, q, strict=True)))
    return part


def inside_reaches(f: list[Point], g: list[Point]) -> bool:
    """Whether the inside of triangle f has a point of triangle g: g is cut down to f, its middle then lies inside."""
    normal = cross(minus(f[1], f[0]), minus(f[2], f[0]))
    has_area = any(cross(minus(g[1], g[0]), minus(g[2], g[0])))
    if not any(normal) or not (has_area or any(dot(normal, minus(p, f[0])) for p in g)):
        return False
    part = clipped(g, lambda p: dot(normal, minus(p, f[0])), plane=True)
    inwards = [cross(normal, minus(f[(k + 1) % 3], f[k])) for k in range(3)]
    for k in range(3):
        if part:
            part = clipped(part, lambda p, k=k: dot(inwards[k], minus(p, f[k])))
    if not part:
        return False
    middle = tuple(sum(x, Fraction(0)) / len(part) for x in zip(*part, strict=True))
    return all(dot(inwards[k], minus(middle, f[k])) > 0 for k in range(3))


def cross_exactly(f: np.ndarray, g: np.ndarray) -> bool:
    a, b = rational(f), rational(g)
    return inside_reaches(a, b) or inside_reaches(b, a)


def meet_exactly(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether segments ab and cd have a common point."""
    u, v, w = minus(b, a), minus(d, c), minus(c, a)
    normal = cross(u, v)
    if any(normal):
        s, t = (dot(cross(w, x), normal) / dot(normal, normal) for x in (v, u))
        return dot(w, normal) == 0 and 0 <= s <= 1 and 0 <= t <= 1
    start, end = sorted((dot(w, u), dot(minus(d, a), u)))
    return not any(cross(w, u)) and end >= 0 and start <= dot(u, u)


def crossings_exactly(points: np.ndarray) -> list[list[int]]:
    p, count = rational(points), len(points)
    edges = [(p[i], p[(i + 1) % count]) for i in range(count)]
    pairs = []
    for i in range(count):
        for j in range(i + 1, count):
            if (j - i) % count in (1, count - 1):
                a, b, c = p[i], p[j], p[(j + 1) % count]
                if j - i > 1:
                    a, b, c = p[j], p[i], p[1]
                u, v = minus(b, a), minus(c, b)
                met = not any(cross(u, v)) and dot(u, v) < 0
            else:
                met = meet_exactly(*edges[i], *edges[j])
            if met:
                pairs.append([i, j])
    return pairs


# --- faces ------------------------------------------------------------------------------------------------------------


@given(seed=SEEDS, reach=st.integers(1, 3))
def test_two_triangles_cross_as_in_rational_arithmetic(seed: int, reach: int) -> None:
    # small whole coordinates: most pairs share corners or sides, touch, lie in a plane, or have no area
    random = np.random.default_rng(seed)
    for triangles in random.integers(-reach, reach + 1, size=(12, 2, 3, 3)).astype(float):
        expected = [[0, 0]] if cross_exactly(*triangles) else []
        assert intersections_between(triangles[0], BOTH[:1], triangles[1], BOTH[:1]).tolist() == expected
        assert len(self_intersections(triangles.reshape(-1, 3), BOTH)) == len(expected)


def crossings_in_rational_arithmetic(triangles: np.ndarray) -> list[list[int]]:
    return [[i, j] for i, j in combinations(range(len(triangles)), 2) if cross_exactly(triangles[i], triangles[j])]


@given(seed=SEEDS)
def test_triangles_with_common_vertices_cross_as_in_rational_arithmetic(seed: int) -> None:
    random = np.random.default_rng(seed)
    vertices = random.integers(-2, 3, size=(5, 3)).astype(float)
    faces = np.array([random.permutation(5)[:3] for _ in range(8)])
    faces = np.unique(np.sort(faces, axis=1), axis=0)
    faces = random.permuted(faces, axis=1)
    assert self_intersections(vertices, faces).tolist() == crossings_in_rational_arithmetic(vertices[faces])


@given(seed=SEEDS, scale=st.sampled_from([2.0**-40, 2.0**-20, 1.0, 2.0**30]))
def test_a_soup_crosses_as_in_rational_arithmetic_at_any_scale(seed: int, scale: float) -> None:
    vertices = scale * np.random.default_rng(seed).normal(size=(9, 3))
    faces = np.array([[0, 1, 2], [2, 3, 4], [4, 5, 6], [6, 7, 8], [8, 0, 4]])
    assert self_intersections(vertices, faces).tolist() == crossings_in_rational_arithmetic(vertices[faces])


@given(motion=rigid_motions(), scale=st.floats(1e-6, 1e6), seed=SEEDS)
def test_counts_do_not_change_under_motion_and_scale(motion: RigidMotion, scale: float, seed: int) -> None:
    vertices, faces = crumpled(seed)
    pairs = self_intersections(vertices, faces)
    assert len(pairs)
    np.testing.assert_array_equal(self_intersections(scale * motion(vertices), faces), pairs)
    half = len(faces) // 2
    between = pairs[(pairs[:, 0] < half) & (pairs[:, 1] >= half)] - [0, half]
    np.testing.assert_array_equal(intersections_between(vertices, faces[:half], vertices, faces[half:]), between)
    flipped = intersections_between(vertices, faces[half:], vertices, faces[:half])
    assert sorted(map(tuple, flipped[:, ::-1].tolist())) == sorted(map(tuple, between.tolist()))


@settings(max_examples=4)
@given(seed=SEEDS)
def test_all_pairs_of_a_crumpled_sheet_are_found(seed: int) -> None:
    vertices, faces = crumpled(seed, size=4)
    expected = [
        [i, j]
        for i in range(len(faces))
        for j in range(i + 1, len(faces))
        if boxes_meet(vertices[faces[i]], vertices[faces[j]]) and cross_exactly(vertices[faces[i]], vertices[faces[j]])
    ]
    assert self_intersections(vertices, faces).tolist() == expected


def boxes_meet(f: np.ndarray, g: np.ndarray) -> bool:
    return bool(((f.min(axis=0) <= g.max(axis=0)) & (g.min(axis=0) <= f.max(axis=0))).all())


def crumpled(seed: int, size: int = 9) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = grid(size - 1, size - 1)
    return vertices + 0.7 * np.random.default_rng(seed).normal(size=vertices.shape), faces


# --- graphs -----------------------------------------------------------------------------------------------------------


@given(points=smooth_loops(min_points=12, max_points=40), height=st.floats(-3, 3))
def test_a_graph_does_not_cross_itself(points: np.ndarray, height: float) -> None:
    vertices = np.vstack([points, points.mean(axis=0) + np.array([0, 0, height])])
    rim = np.arange(len(points))
    faces = np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), len(rim))])
    if is_graph(vertices, faces, len(rim)):
        assert len(self_intersections(vertices, faces)) == 0


# --- polygons ---------------------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(seed=SEEDS, count=st.integers(3, 9), reach=st.integers(1, 3), flat=st.booleans())
def test_edges_meet_as_in_rational_arithmetic(seed: int, count: int, reach: int, flat: bool) -> None:
    points = np.random.default_rng(seed).integers(-reach, reach + 1, size=(count, 3)).astype(float)
    if flat:
        points[:, 2] = 0
    if (points == np.roll(points, -1, axis=0)).all(axis=1).any():
        return
    assert loop_crossings(points).tolist() == crossings_exactly(points)


@pytest.mark.parametrize("count", [64, 65, 200, 1001])
def test_a_figure_eight_crosses_once(count: int) -> None:
    t = 2 * np.pi * (np.arange(count) + 0.3) / count
    eight = np.column_stack([np.sin(t), np.sin(t) * np.cos(t), np.zeros(count)])
    ((i, j),) = loop_crossings(eight).tolist()
    for edge in (i, j):
        assert eight[edge, 0] * eight[(edge + 1) % count, 0] < 0
    lifted = eight + [0, 0, 1e-9] * np.cos(t)[:, None]
    assert len(loop_crossings(lifted)) == 0


def test_a_polygon_that_turns_back_is_found_and_a_sharp_one_is_not() -> None:
    spike = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0], [1, 0, 0], [1, 1, 0.0]])
    assert [1, 2] in loop_crossings(spike).tolist()
    # back onto the edge before, whose tip edge 3 then starts from
    spike[3] = [2, 0, 0]
    assert loop_crossings(spike).tolist() == [[1, 2], [1, 3]]
    assert loop_crossings(np.roll(spike, -2, axis=0)).tolist() == [[0, 4], [1, 4]]
    spike[3] = [2, 1e-6, 0]
    assert len(loop_crossings(spike)) == 0


@pytest.mark.parametrize(("height", "found"), [(0.0, True), (1e-6, False)])
def test_a_long_edge_is_compared_with_the_short_ones_it_passes(height: float, found: bool) -> None:
    t = 2 * np.pi * np.arange(2001) / 2000
    circle = np.column_stack([np.cos(t), np.sin(t), np.sin(t / 2)])
    # from the end of the circle, which lies over its start, up and back past the vertex on the far side
    far = np.array([[30.0, 0, -1], [-1, 30, 1 + height], [-1, -30, 1 + height]])
    circle[-1, 2] = -0.1
    crossings = loop_crossings(np.concatenate([circle, far]))
    assert crossings.tolist() == ([[999, 2002], [1000, 2002]] if found else [])


@given(seed=SEEDS, count=st.integers(5, 20), turns=st.integers(1, 2), motion=rigid_motions())
def test_stars_are_simple_where_they_wind_once(seed: int, count: int, turns: int, motion: RigidMotion) -> None:
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * turns * (np.arange(count) + 0.5 * rng.random(count)) / count
    radius = 1 + rng.random(count)
    points = motion(np.stack([radius * np.cos(t), radius * np.sin(t), np.zeros(count)], axis=1))
    # a plane curve that winds twice crosses itself
    assert (len(loop_crossings(points)) == 0) == (turns == 1)
    several = np.stack([points, rng.normal(size=points.shape), np.ones_like(points)])
    np.testing.assert_array_equal(is_star(several), [is_star(own) for own in several])
    assert not is_star(several[2])


def test_the_search_for_crossing_edges_of_a_tangle_ends() -> None:
    points = np.random.default_rng(0).normal(size=(30_000, 3)) * [1, 1, 0]
    assert MOST_CROSSINGS <= len(loop_crossings(points)) < 4 * MOST_CROSSINGS  # of 10⁸
    with pytest.raises(SelfCrossingLoopError, match=r"at least [0-9]{6} such pairs were found"):
        require_simple(BoundaryLoop.from_points(points))


def test_the_search_for_crossing_faces_has_a_time_limit() -> None:
    vertices = np.random.default_rng(0).normal(size=(600, 3))
    faces = np.arange(600).reshape(-1, 3)
    with time_limit(-1):
        with pytest.raises(OutOfTimeError):
            self_intersections(vertices, faces)
        with pytest.raises(OutOfTimeError):
            intersections_between(vertices, faces, vertices, faces)


def test_faces_that_may_cross_are_finite() -> None:
    with pytest.raises(OptionError, match="corners must be finite"):
        self_intersections(np.array([[np.inf] * 3, [-np.inf] * 3, *np.eye(3)]), np.array([[0, 1, 2], [2, 3, 4]]))


def fan(angles: list[float], lift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Faces around a vertex, in order of the angles of the others; open."""
    around = np.column_stack([np.cos(angles), np.sin(angles), lift * np.arange(len(angles))])
    k = np.arange(1, len(angles))
    return np.vstack([np.zeros(3), around]), np.column_stack([np.zeros_like(k), k, k + 1])


def test_faces_around_a_vertex_cross_where_they_overlap_though_all_are_oriented_alike() -> None:
    once, twice = np.arange(6) * np.radians(70.0), np.arange(7) * np.radians(70.0)
    assert not len(self_intersections(*fan(once.tolist())))
    # the sixth face, from 350° to 420°, lies on the first
    assert self_intersections(*fan(twice.tolist())).tolist() == [[0, 5]]
    # a closed fan that goes around twice
    vertices, faces = fan((np.arange(9) * np.radians(80.0)).tolist())
    assert len(self_intersections(vertices[:-1], np.where(faces == 9, 1, faces))) >= 8


@pytest.mark.parametrize("turn", range(3))
def test_edges_through_triangles(turn):
    triangle = np.roll(np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), turn, axis=0)
    cases = [
        ([1, 1, -1], [1, 1, 1], True),
        ([1, 1, 0], [1, 1, 1], True),  # an end inside
        ([1, 1, 1], [1, 1, 2], False),
        ([3, 3, -1], [3, 3, 1], False),
        ([2, 0, -1], [2, 0, 1], False),  # through a side
        ([0, 0, -1], [0, 0, 1], False),  # through a corner
        ([-1, 1, 0], [5, 1, 0], False),  # in the plane
        ([0, 0, 0], [1, 1, 1], False),
    ]
    starts, ends, meets = zip(*cases, strict=True)
    starts, ends = np.array(starts, dtype=float), np.array(ends, dtype=float)
    triangles = np.broadcast_to(triangle, (len(cases), 3, 3))
    for one, other in ((starts, ends), (ends, starts)):
        assert edges_through(one, other, triangles).tolist() == list(meets)
