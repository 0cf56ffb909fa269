"""Inconsistent faces are reported for the loops that they touch, and do not change other loops."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from spinor_geom.errors import NonManifoldEdgeError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import Sheets, find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import circle, tube

SIDES, RINGS = 12, 6
FAR = 2 * SIDES * 2  # a face between the third ring and the fourth
Pair = tuple[np.ndarray, np.ndarray]
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
OCTAHEDRON = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def flipped(face: int) -> Pair:
    vertices, faces = tube(SIDES, RINGS)
    faces[face] = faces[face, ::-1]
    return vertices, faces


# copies of a face, by the places of its corners
COPIES = {"copied": [1, 2, 0], "copied backwards": [2, 1, 0], "with a vertex twice": [0, 1, 1]}


def with_copy(kind: str, face: int) -> Pair:
    vertices, faces = tube(SIDES, RINGS)
    return vertices, np.vstack([faces, faces[face, COPIES[kind]]])


def with_a_fin(face: int) -> Pair:
    vertices, faces = tube(SIDES, RINGS)
    a, _, c = faces[face]  # a diagonal, which has two faces
    return np.vstack([vertices, [[5.0, 0, 1]]]), np.vstack([faces, [a, c, len(vertices)]])


COPIED, COPIED_BACKWARDS, A_VERTEX_TWICE = (partial(with_copy, kind) for kind in COPIES)
DEFECTS: list[Callable[[int], Pair]] = [flipped, COPIED, COPIED_BACKWARDS, A_VERTEX_TWICE, with_a_fin]


def same(loop: BoundaryLoop, other: BoundaryLoop) -> bool:
    return np.array_equal(loop.vertex_ids, other.vertex_ids)


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_far_away_changes_no_loop_and_is_not_reported(defect: Callable[[int], Pair]) -> None:
    loops = find_boundary_loops(TriangleMesh(*defect(FAR)))
    clean = find_boundary_loops(TriangleMesh(*tube(SIDES, RINGS)))
    kept = [loop for loop in loops if len(loop) == SIDES]
    assert all(map(same, kept, clean))
    assert all(loop.obstacle is None and loop.remarks == () for loop in kept)
    # the fin has an outline of its own
    assert len(loops) == (3 if defect is with_a_fin else 2)


@pytest.mark.parametrize(
    ("defect", "words"),
    [
        (flipped, r"1 of the 12 faces .* face 0\b"),
        (COPIED, r"\(0, 120\)"),
        (COPIED_BACKWARDS, r"\(0, 120\)"),
        (A_VERTEX_TWICE, r"face 120 \(0, 1, 1\)"),
        (with_a_fin, r"\(13, 0\)"),
    ],
)
def test_a_defect_at_a_loop_is_reported_there_only(defect: Callable[[int], Pair], words: str) -> None:
    loops = [loop for loop in find_boundary_loops(TriangleMesh(*defect(0))) if len(loop) == SIDES]
    clean = find_boundary_loops(TriangleMesh(*tube(SIDES, RINGS)))
    assert all(map(same, loops, clean))
    assert all(loop.obstacle is None for loop in loops)
    (remark,) = loops[0].remarks
    assert re.search(words, remark), remark
    assert loops[1].remarks == ()
    assert loops[0].reversed().remarks == loops[0].remarks


def test_faces_of_opposite_directions_at_an_edge_are_joined_before_flatter_ones() -> None:
    # the first and the last face lie in a plane and run along the edge (0, 1) in the same direction
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -0.5, 0.9], [0.5, -1, 0]])
    twin = Sheets.of(vertices, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])).twin
    np.testing.assert_array_equal(twin, [3, -1, -1, 0, -1, -1, -1, -1, -1])


def test_a_loop_follows_most_of_the_faces_beside_it() -> None:
    clean = find_boundary_loops(TriangleMesh(*tube(SIDES, RINGS)))[0]
    vertices, faces = tube(SIDES, RINGS)
    beside = np.flatnonzero(np.isin(faces, clean.vertex_ids).sum(axis=1) == 2)
    for count in (5, 7):
        turned = faces.copy()
        turned[beside[:count]] = turned[beside[:count], ::-1]
        loop = find_boundary_loops(TriangleMesh(vertices, turned))[0]
        assert same(loop, clean) is (count < 6)
        assert same(loop.reversed(), clean) is (count > 6)


def test_edges_of_very_many_faces_are_not_compared_in_pairs() -> None:
    # a book of 100 pages: each has its own outline, along the back of the book
    count = 100
    pages = circle(count, height=0.5)
    faces = np.column_stack([np.zeros(count, int), np.ones(count, int), np.arange(count) + 2])
    loops = find_boundary_loops(TriangleMesh(np.vstack([[[0, 0, 0], [0, 0, 1]], pages]), faces))
    assert len(loops) == count
    assert all(isinstance(loop.obstacle, NonManifoldEdgeError) for loop in loops)
    # nor are all of them named for each of the loops
    assert all(len(str(loop.obstacle)) < 200 for loop in loops)
    assert "has 100 faces" in str(loops[0].obstacle)


def test_each_loop_names_the_ignored_faces_that_touch_it() -> None:
    # two triangles apart, each with a copy and with faces that use a vertex twice, which are numbered alternately
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 0, 0], [9, 1, 0], [9, 0, 1]])
    faces = [[0, 1, 2], [3, 4, 5], [4, 4, 3], [2, 2, 1], [1, 2, 0], [5, 3, 4], [5, 5, 5], [0, 0, 0], [1, 1, 2]]
    remarks = {
        tuple(sorted(loop.vertex_ids.tolist())): loop.remarks
        for loop in find_boundary_loops(TriangleMesh(vertices, np.array(faces)))
    }
    for ring, count, first, copies in (
        ((0, 1, 2), 3, "face 3 (2, 2, 1)", (0, 4)),
        ((3, 4, 5), 2, "face 2 (4, 4, 3)", (1, 5)),
    ):
        degenerate, copied = remarks[ring]
        assert degenerate.startswith(f"{count} faces that use a vertex twice touch the loop, first {first}")
        assert copied.startswith(f"1 faces beside the loop have copies, first faces {copies}")


@pytest.mark.parametrize(
    ("faces", "rings"),
    [
        # two closed tetrahedra over a common edge (4 faces there), and a triangle apart that has the only loop
        ([*TETRAHEDRON, *np.array([0, 1, 4, 5])[TETRAHEDRON], [6, 7, 8]], [[6, 8, 7]]),
        # a wall inside an octahedron
        ([*OCTAHEDRON, [0, 2, 1], [0, 1, 3]], []),
        ([], []),
        # vertices in no face
        ([[2, 3, 4], [4, 3, 5]], [[2, 4, 5, 3]]),
    ],
)
def test_inner_walls_and_loose_vertices_are_allowed(faces: list, rings: list[list[int]]) -> None:
    vertices = np.random.default_rng(0).uniform(size=(9, 3))
    found = find_boundary_loops(TriangleMesh(vertices, np.reshape(faces, (-1, 3)).astype(int)))
    assert [np.roll(loop.vertex_ids, -loop.vertex_ids.argmin()).tolist() for loop in found] == rings
