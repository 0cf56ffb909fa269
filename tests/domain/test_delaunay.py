"""Constrained Delaunay triangulations into which points are inserted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.domain.delaunay import ConstrainedDelaunay
from spinor_geom.errors import DomainError
from tests.strategies import SEEDS

U = np.array([0, 5, 5 + 4j, 3 + 4j, 3 + 1j, 2 + 1j, 2 + 4j, 4j])


def star(n, rng):
    return rng.uniform(0.6, 1.2, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.5, n)) / n)


def inner_points(count, rng):
    return 0.5 * np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))


def as_set(faces):
    """Faces by their vertices, each from its lowest."""
    return {tuple(np.roll(face, -face.argmin()).tolist()) for face in faces}


@settings(max_examples=30)
@given(st.integers(6, 60), st.integers(0, 80), st.integers(0, 80), SEEDS)
def test_points_added_later_give_the_same_triangles(n, first, later, seed):
    rng = np.random.default_rng(seed)
    polygon, early, late = star(n, rng), inner_points(first, rng), inner_points(later, rng)
    mesh = ConstrainedDelaunay(np.append(polygon, early), [(n,)])
    for some in np.array_split(late, 3):
        mesh.insert(some, np.zeros(len(some), dtype=np.int64))
    expected = ConstrainedDelaunay(np.concatenate([polygon, early, late]), [(n,)]).triangles
    assert as_set(mesh.triangles) == as_set(expected)
    assert len(expected) == 2 * (n + first + later) - 2 - n


@settings(max_examples=20)
@given(st.integers(6, 40), st.integers(1, 60), SEEDS)
def test_neighbours_share_the_edge_and_are_each_other_s(n, count, seed):
    rng = np.random.default_rng(seed)
    mesh = ConstrainedDelaunay(star(n, rng), [(n,)])
    mesh.insert(inner_points(count, rng), np.zeros(count, dtype=np.int64))
    faces, neighbours = mesh.faces, mesh.neighbours
    on_polygon = 0
    for face in mesh.inside:
        for k in range(3):
            a, b, other = faces[face, k], faces[face, (k + 1) % 3], neighbours[face, k]
            if other < 0:
                assert (b - a) % n == 1
                on_polygon += 1
            else:
                assert {a, b} <= set(faces[other].tolist())
                assert face in neighbours[other]
    assert on_polygon == n


def test_walk_stays_inside_the_polygon():
    rng = np.random.default_rng(0)
    rim = np.concatenate([a + (b - a) * np.arange(10) / 10 for a, b in zip(U, np.roll(U, -1), strict=True)])
    mesh = ConstrainedDelaunay(rim, [(len(rim),)])
    left = np.flatnonzero((rim[mesh.triangles].real < 2).all(axis=1))
    start = mesh.inside[left[:1]]
    targets = np.array([1 + 0.5j, 4 + 3j, 2.5 + 3j])
    seen = [mesh.reaches(start, targets[k : k + 1] + 1e-3 * rng.uniform()) for k in range(3)]
    # the other arm lies across the gap, and a point in the gap outside
    assert [bool(s[0]) for s in seen] == [True, False, False]


@pytest.mark.parametrize(
    "points", [[0, 1 + 1j, 1, 1j], [0, 1, 1 + 1j, 1j, 0.5 + 0.5j, 0.5 + 0.5j]], ids=["crossing", "repeated"]
)
def test_what_is_no_simple_polygon_is_refused(points):
    with pytest.raises(DomainError, match="not simple"):
        ConstrainedDelaunay(np.array(points, dtype=complex), [(4,)])


def test_point_that_is_there_already_is_refused():
    mesh = ConstrainedDelaunay(np.array([0, 1, 1 + 1j, 1j, 0.5 + 0.5j]), [(4,)])
    with pytest.raises(DomainError):
        mesh.insert(np.array([0.5 + 0.5j]), np.zeros(1, dtype=np.int64))
