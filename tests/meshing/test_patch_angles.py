"""Angles of the triangles of a patch, and between them."""

import numpy as np
import pytest
import trimesh

from spinor_geom.mesh.operators import crossing_angles, internal_angles
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.patch_angles import PatchAngles


def test_angles_are_those_of_the_operators() -> None:
    sphere = trimesh.creation.icosphere(2)
    faces = np.asarray(sphere.faces)
    vertices = sphere.vertices + np.random.default_rng(0).normal(scale=0.05, size=sphere.vertices.shape)
    rim = 12  # the vertices of the icosahedron, which are not neighbours
    found = PatchAngles.of(vertices, faces, np.roll(np.arange(rim), -1))
    np.testing.assert_allclose(found.free, np.degrees(internal_angles(vertices, faces)).min(axis=1), rtol=1e-9)
    assert found.smallest_free == found.free.min()
    assert found.at_rim == np.inf
    half_edges = HalfEdges.of(faces)
    angles = np.degrees(crossing_angles(half_edges, vertices))
    inner = np.minimum(half_edges.origin, half_edges.target) >= rim
    length = np.linalg.norm(vertices[half_edges.origin] - vertices[half_edges.target], axis=1)[inner]
    assert found.folds == (angles > 90).sum()
    assert found.largest_bend == pytest.approx(angles[inner].max(), rel=1e-9)
    assert found.rms_bend == pytest.approx(np.sqrt(np.average(angles[inner] ** 2, weights=length)), rel=1e-9)
    assert found.edge == pytest.approx(length.mean(), rel=1e-9)


@pytest.mark.parametrize(("turn", "folds"), [(80.0, 0), (100.0, 2)])
def test_a_fold_turns_by_more_than_a_right_angle(turn: float, folds: int) -> None:
    bend = np.radians(turn)
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(bend), 0, np.sin(bend)]])
    found = PatchAngles.of(vertices, np.array([[0, 1, 2], [1, 0, 3]]), np.array([3, 2, 0, 1]))
    assert found.folds == folds
    # every angle but the two at the ends of the common edge is between two edges of the rim
    np.testing.assert_allclose([*found.free, found.at_rim], 45)
    assert found.largest_bend == found.rms_bend == found.edge == 0
