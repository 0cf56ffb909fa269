"""Signed mean curvature and angles across edges, on meshes where they are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from spinor_geom.mesh.operators import Bending, crossing_angles
from spinor_geom.mesh.topology import HalfEdges


def ball(count: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere through random points, normals outwards."""
    points = np.random.default_rng(count).normal(size=(count, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    a, b, c = (points[faces[:, k]] for k in range(3))
    inwards = np.einsum("fk,fk->f", np.cross(b - a, c - a), a) < 0
    return points, np.where(inwards[:, None], faces[:, ::-1], faces)


def test_a_sphere_through_random_points_has_one_curvature() -> None:
    vertices, faces = ball(2000, 2.5)
    bending = Bending.of(vertices + 7, faces)
    # what is left is the normals' error, second order in the edges; random triangles have areas at their bound here and
    # there, and count less than half
    assert np.median(np.abs(bending.curvature * 2.5 - 1)) < 2e-3
    turned = Bending.of(vertices, faces[:, ::-1])
    np.testing.assert_allclose(turned.curvature, -bending.curvature, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 150.0])
def test_the_angle_across_an_edge(angle: float) -> None:
    turn = np.radians(angle)
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(turn), 0, np.sin(turn)]])
    half_edges = HalfEdges.of(np.array([[0, 1, 2], [1, 0, 3]]))
    angles = crossing_angles(half_edges, vertices)
    np.testing.assert_allclose(np.degrees(angles), [angle, 0, 0, angle, 0, 0], atol=1e-9)


def test_closed_vertices_have_two_faces_at_every_edge_one_in_each_direction() -> None:
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert not HalfEdges.of(tetrahedron).unclosed(4).any()
    assert HalfEdges.of(tetrahedron[:3]).unclosed(4).tolist() == [True, False, True, True]
    flipped = np.concatenate([tetrahedron[:3], tetrahedron[3:, ::-1]])
    assert HalfEdges.of(flipped).unclosed(4).tolist() == [True, False, True, True]
    twice = np.concatenate([tetrahedron, tetrahedron[:1]])
    assert HalfEdges.of(twice).unclosed(4).tolist() == [True, True, True, False]
