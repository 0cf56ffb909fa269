"""Signed mean curvature and angles across edges, on meshes where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.bench.holes import plane_square
from spinor_geom.mesh.operators import Bending, BendingForm, crossing_angles
from spinor_geom.mesh.topology import HalfEdges
from tests.fill.shapes import hull


def ball(count: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere through random points, normals outwards."""
    points = np.random.default_rng(count).normal(size=(count, 3))
    return hull(radius * points / np.linalg.norm(points, axis=1, keepdims=True))


def test_a_sphere_through_random_points_has_one_curvature() -> None:
    vertices, faces = ball(2000, 2.5)
    bending = Bending.of(vertices + 7, faces)
    # what is left is the normals' error, second order in the edges; random triangles have areas at their bound here and
    # there, and count less than half
    assert np.median(np.abs(bending.curvature * 2.5 - 1)) < 2e-3
    turned = Bending.of(vertices, faces[:, ::-1])
    np.testing.assert_allclose(turned.curvature, -bending.curvature, rtol=1e-6, atol=1e-9)


def test_a_stretched_metric_changes_the_weights_of_directions() -> None:
    vertices, faces = ball(2000, 2.5)
    bending = Bending.of(vertices, faces, np.tile(np.diag([0.0, 2.0, 0.0]), (len(faces), 1, 1)))
    # on a sphere all directions have the same curvature
    assert np.median(np.abs(bending.curvature * 2.5 - 1)) < 1e-2

    points, faces = plane_square(12)
    angle = points[:, 0] / 6
    cylinder = np.stack([np.sin(angle), points[:, 1] / 6, np.cos(angle)], axis=1)
    middle = 6 * 13 + 6
    for factor in (0.0, 1.0, 3.0):  # stretched along the axis
        curvature = Bending.of(cylinder, faces, np.tile(np.diag([0, factor, 0]), (len(faces), 1, 1))).curvature
        np.testing.assert_allclose(abs(curvature[middle]), (1 + factor) / (2 + factor), rtol=0.02)


@pytest.mark.parametrize("squared_length", [0.0, 0.3])
def test_a_form_is_the_product_of_its_matrices(squared_length: float) -> None:
    vertices, faces = ball(60, 1.0)
    rng, free = np.random.default_rng(1), 40
    vertices[:10] /= 2
    bending, gradient = Bending.of(vertices, faces), Bending.of(vertices, faces[::2])
    weights = np.where(rng.uniform(size=60) < 0.7, rng.uniform(1, 2, 60), 0.0)
    sizes = {"weights": weights, "squared_length": squared_length}
    form = BendingForm(bending=bending, free=free, gradient=gradient.matrix, **sizes)
    slope = bending.laplacian.toarray()[:free] * weights
    whole = slope @ (np.diag(bending.areas) + squared_length * gradient.laplacian.toarray())
    function = rng.normal(size=60)
    np.testing.assert_allclose(form.of(function), whole @ function, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
    stiffness = form.stiffness
    assert stiffness.has_sorted_indices
    np.testing.assert_allclose(stiffness.toarray(), whole @ slope.T / 2, rtol=1e-9, atol=1e-9 * np.abs(whole).max())


@pytest.mark.parametrize("count", [40, 400])
def test_a_stiffness_has_as_many_entries_as_it_needs(count: int) -> None:
    # all vertices of a fan are within two edges of each other, more than there is room for at first
    ring = np.arange(1, count)
    faces = np.stack([np.zeros(count - 1, dtype=int), ring, np.roll(ring, -1)], axis=1)
    angle = 2 * np.pi * ring / (count - 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    bending = Bending.of(np.concatenate([np.zeros((1, 3)), rim]), faces)
    form = BendingForm(bending=bending, free=count, weights=np.ones(count), squared_length=0.0, gradient=bending.matrix)
    laplacian = bending.laplacian.toarray()
    expected = laplacian @ np.diag(bending.areas) @ laplacian / 2
    np.testing.assert_allclose(form.stiffness.toarray(), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 150.0])
def test_the_angle_across_an_edge(angle: float) -> None:
    turn = np.radians(angle)
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(turn), 0, np.sin(turn)]])
    half_edges = HalfEdges.of(np.array([[0, 1, 2], [1, 0, 3]]))
    angles = crossing_angles(half_edges, vertices)
    np.testing.assert_allclose(np.degrees(angles), [angle, 0, 0, angle, 0, 0], atol=1e-9)
