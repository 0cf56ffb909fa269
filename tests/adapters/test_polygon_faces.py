from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters.polygon_faces import Polygons, chained, close_seams, seam_representatives
from spinor_geom.mesh.topology import boundary_edges


def polygons(*faces):
    return Polygons.of_sizes(np.concatenate(faces), np.array([len(face) for face in faces]))


def area_vectors(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.cross(b - a, c - a) / 2


def test_quad_with_reflex_corner_is_split_along_its_inner_diagonal():
    arrow = np.array([[0.0, 0, 0], [4, -2, 0], [1, 0, 0], [4, 2, 0]])  # reflex at vertex 2: only 0–2 lies inside
    for turn in range(4):
        corners = np.roll(np.arange(4), turn).tolist()
        triangles, _ = polygons(corners).triangulated(arrow)
        assert (area_vectors(arrow, triangles)[:, 2] > 0).all()
        assert all({0, 2} <= set(triangle) for triangle in triangles.tolist())


def test_fan_of_a_star_shaped_polygon_starts_at_a_vertex_that_sees_all_others():
    # an L: only fans from the reflex corner (1, 1) and from (0, 0) stay inside
    points = np.array([[2.0, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0], [0, 0, 0]])
    triangles, _ = polygons(list(range(6))).triangulated(points)
    assert area_vectors(points, triangles)[:, 2].min() >= 0
    assert area_vectors(points, triangles)[:, 2].sum() == 3.0


@given(st.lists(st.integers(3, 40), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_triangles_have_the_boundary_and_order_of_their_polygons(sizes, seed):
    random = np.random.default_rng(seed)
    vertices = random.normal(size=(sum(sizes), 3))
    corners = random.permutation(len(vertices))
    mixed = Polygons.of_sizes(corners, np.array(sizes))
    triangles, of = mixed.triangulated(vertices)
    assert (np.diff(of) >= 0).all()
    for number, size in enumerate(sizes):
        own = triangles[of == number]
        assert len(own) == size - 2
        ring = mixed[number].tolist()
        edges = {tuple(edge) for edge in boundary_edges(own).tolist()}
        assert edges == set(zip(ring, ring[1:] + ring[:1], strict=True))


@pytest.mark.parametrize(
    ("pieces", "curves"),
    [
        ([[0, 1], [1, 2], [2, 0]], [[0, 1, 2, 0]]),
        ([[1, 0], [1, 2], [3, 2]], [[3, 2, 1, 0]]),
        ([[0, 1, 2, 0]], [[0, 1, 2, 0]]),
        ([[0, 1], [1, 2], [1, 3]], [[0, 1], [1, 2], [1, 3]]),
        ([[0, 1], [2, 3]], [[0, 1], [2, 3]]),
        ([[0, 1], [1, 0]], [[0, 1, 0]]),
    ],
)
def test_polylines_are_chained(pieces, curves):
    found = [curve for _, curve in chained([np.array(piece) for piece in pieces])]
    assert [curve.tolist() for curve in found] == curves


# two triangles on both sides of the edge from (0, 0, 0) to (1, 0, 0), each with its own vertices
SPLIT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, -0.0, 0], [1, -1, 0]])
SIDES = [[0, 1, 2], [3, 4, 5]]


SQUARE = np.concatenate([SPLIT, [[0, -1, 0]]])
THREE = np.concatenate([SPLIT, SPLIT[[1, 0]], [[0, 0, 1.0]]])


@pytest.mark.parametrize(
    ("points", "uv", "faces", "expected"),
    [
        # a seam takes the lowest vertex
        (SPLIT, [0, 0, 0, 1, 1, 0], SIDES, [0, 1, 2, 1, 0, 5]),
        # equal vertices stay apart
        (SPLIT, [0, 0, 0, 0, 0, 0], SIDES, range(6)),
        (SPLIT, None, SIDES, range(6)),
        # a seam that ends at equal vertices is a slit. It may end at a shared vertex
        (SPLIT, [0, 0, 0, 1, 0, 0], SIDES, range(6)),
        (SPLIT, [0, 0, 0, 1, 1, 0], [[0, 1, 2], [3, 0, 5]], [0, 1, 2, 1, 4, 5]),
        # pieces that touch in a vertex, or face each other wrongly
        (SPLIT, [0, 0, 0, 1, 1, 0], [[0, 1, 2], [4, 3, 5]], range(6)),
        (SQUARE, [0, 0, 0, 1, 1, 0, 0], [[0, 1, 2], [4, 6, 5]], range(7)),
        # three edges at one position are ambiguous
        (THREE, range(9), [*SIDES, [6, 7, 8]], range(9)),
    ],
)
def test_seams_join_two_edges_that_differ_in_attributes_only(points, uv, faces, expected):
    attributes = [] if uv is None else [np.array(uv, dtype=float)[:, None]]
    assert seam_representatives(points, polygons(*faces), attributes).tolist() == list(expected)


@given(st.lists(st.lists(st.integers(0, 9), min_size=2, max_size=4), min_size=1, max_size=12))
def test_chaining_keeps_every_segment_and_ends_only_at_junctions(pieces):
    def segments(curves):
        return sorted(sorted(pair) for curve in curves for pair in pairwise(curve))

    curves = [curve.tolist() for _, curve in chained([np.array(piece) for piece in pieces])]
    assert segments(curves) == segments(pieces)
    ends = Counter(end for piece in pieces for end in (piece[0], piece[-1]))
    assert all(ends[end] != 2 for curve in curves if curve[0] != curve[-1] for end in (curve[0], curve[-1]))


def test_sliver_at_a_pole_is_left_out_and_a_broken_face_is_not():
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 1, 2]])
    closed, kept = close_seams(faces, np.array([0, 1, 2, 0]))
    assert closed.tolist() == [[0, 1, 2], [1, 1, 2]]
    assert kept.tolist() == [True, False, True]
