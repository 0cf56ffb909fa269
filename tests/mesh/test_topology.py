"""Half-edges, watertightness, components, coincident vertices."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.mesh.find_loops import Sheets
from spinor_geom.mesh.topology import (
    HalfEdges,
    coincident_vertices,
    face_components,
    is_watertight_with,
)
from tests.closed import is_watertight
from tests.strategies import SEEDS


def test_a_mesh_is_watertight_until_a_face_is_missing_turned_or_too_many(tetrahedron: np.ndarray) -> None:
    assert is_watertight(tetrahedron)
    turned = np.vstack([tetrahedron[:1, ::-1], tetrahedron[1:]])
    nothing = np.empty((0, 3), dtype=np.int64)
    for faces in (tetrahedron[:3], turned, np.vstack([tetrahedron, [[0, 1, 4], [1, 0, 4]]]), nothing):
        assert not is_watertight(faces)
    assert not is_watertight_with(nothing, np.zeros(0, dtype=bool), nothing)


@given(seed=SEEDS, count=st.integers(0, 12), copies=st.integers(0, 2))
def test_added_faces_are_judged_as_those_of_one_mesh(seed: int, count: int, copies: int) -> None:
    rng = np.random.default_rng(seed)
    faces = np.array(trimesh.creation.icosphere(1).faces)
    removed = np.isin(np.arange(len(faces)), rng.choice(len(faces), count, replace=False))
    added = faces[removed][: count - rng.integers(0, 2) if count else 0]
    if len(added) and rng.integers(0, 2):
        added[0] = added[0, :: rng.choice([1, -1])]
    mesh = np.concatenate([faces[~removed], faces[rng.integers(0, len(faces), copies)]])
    unclosed = Sheets.of(np.zeros((42, 3)), mesh).unclosed(mesh, 42)
    assert is_watertight_with(mesh, unclosed, added) == is_watertight(np.concatenate([mesh, added]))


def test_faces_of_an_edge_with_three_faces_are_one_component() -> None:
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 6, 7], [6, 5, 8]])
    np.testing.assert_array_equal(face_components(fan), [0, 0, 0, 1, 1])


@given(rows=st.lists(st.tuples(*[st.sampled_from([0.0, -0.0, 1.0])] * 3), max_size=40))
def test_coincident_vertices_equal_a_direct_search(rows: list[tuple[float, ...]]) -> None:
    points = np.array(rows).reshape(-1, 3)
    expected = [rows.index(row) for row in rows]  # −0.0 == 0.0 in tuples too
    np.testing.assert_array_equal(coincident_vertices(points), expected)


@pytest.mark.parametrize("count", [5, 200])
def test_half_edges_of_one_edge_are_adjacent_lowest_first(count: int) -> None:
    faces = np.random.default_rng(count).integers(0, count, size=(40, 3))
    half_edges = HalfEdges.of(faces)
    ends = np.sort(np.stack([half_edges.origin, half_edges.target], axis=1), axis=1)
    np.testing.assert_array_equal(half_edges.order, np.lexsort(ends.T[::-1]))
    groups = np.split(half_edges.order, half_edges.starts[1:-1])
    assert all((ends[group] == ends[group[0]]).all() for group in groups)
    assert len(groups) == len(np.unique(ends, axis=0)) == len(half_edges.counts)
