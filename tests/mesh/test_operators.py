"""The libigl operators have the signs, units and sums their docstrings state."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from scipy.sparse import csc_array, eye_array

from spinor_geom.deadline import time_limit
from spinor_geom.errors import NoFacesError, NonFiniteVertexError, OutOfTimeError
from spinor_geom.mesh.operators import (
    cotangent_laplacian,
    face_areas,
    factor_symmetric,
    graph_laplacian,
    internal_angles,
    intrinsic_angles,
    mass_matrix,
    mollified_edge_lengths,
    mollified_laplacian,
    nearest_on_mesh,
    vertices_to_factor,
)
from tests.strategies import HoledDisk, holed_disks

RIGHT_TRIANGLE = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])
FACE = np.array([[0, 1, 2]])


def test_right_triangle() -> None:
    assert face_areas(RIGHT_TRIANGLE, FACE) == pytest.approx([1.0])
    np.testing.assert_allclose(internal_angles(RIGHT_TRIANGLE, FACE), [[np.pi / 2, np.arctan(0.5), np.arctan(2)]])
    # off-diagonal −½ cot of the opposite angle: 0 opposite the right angle, cot of the others 2 and ½
    expected = np.array([[1.25, -0.25, -1.0], [-0.25, 0.25, 0], [-1.0, 0, 1.0]])
    np.testing.assert_allclose(cotangent_laplacian(RIGHT_TRIANGLE, FACE).toarray(), expected, atol=1e-15)


@given(disk=holed_disks())
def test_laplacian_is_symmetric_semidefinite_with_zero_rows(disk: HoledDisk) -> None:
    laplacian = cotangent_laplacian(disk.mesh.vertices, disk.mesh.faces)
    scale = np.abs(laplacian.data).max()
    assert np.abs((laplacian - laplacian.T).toarray()).max() <= 1e-12 * scale
    assert np.abs(laplacian @ np.ones(laplacian.shape[0])).max() <= 1e-11 * scale
    assert np.linalg.eigvalsh(laplacian.toarray()).min() >= -1e-11 * scale


def test_mollified_laplacian_of_faces_without_area_is_finite_and_positive() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0, 0, 0], [0, 1e-9, 0], [0, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [3, 0, 5], [0, 4, 1]])
    eigenvalues = np.linalg.eigvalsh(mollified_laplacian(vertices, faces).toarray())
    # the faces are connected: only the constants have no energy
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]
    assert eigenvalues[1] > 1e-4  # a needle and a flat face hold by weak cotangents
    angles = intrinsic_angles(mollified_edge_lengths(vertices, faces))
    np.testing.assert_allclose(angles.sum(axis=1), np.pi)


@pytest.mark.parametrize("scale", [1e-69, 1e-20, 1e69])
def test_mollified_laplacian_is_the_same_at_any_scale(scale: float) -> None:
    vertices, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0.4, 1, 0], [0.4, 0.5, 0.3]]), np.array([[0, 1, 3], [1, 2, 3]])
    difference = mollified_laplacian(scale * vertices, faces) - mollified_laplacian(vertices, faces)
    assert np.abs(difference.data).max(initial=0.0) < 1e-9
    assert np.isfinite(mollified_laplacian(0 * vertices, faces).data).all()


def test_the_laplacian_of_a_graph_has_degrees_on_its_diagonal_and_rows_of_sum_zero() -> None:
    laplacian = graph_laplacian(np.array([[0, 1, 2], [0, 2, 3]])).toarray()
    np.testing.assert_array_equal(np.diag(laplacian), [3, 2, 3, 2])
    np.testing.assert_array_equal(laplacian.sum(axis=1), 0)
    assert laplacian[1, 3] == 0
    assert graph_laplacian(np.zeros((0, 3), dtype=np.int64)).shape == (0, 0)


@pytest.mark.parametrize("faces", [np.zeros((0, 3), dtype=np.int64), FACE], ids=["no faces", "an unused vertex"])
@pytest.mark.parametrize(
    "matrix",
    [
        cotangent_laplacian,
        mollified_laplacian,
        *(partial(mass_matrix, kind=kind) for kind in ("voronoi", "barycentric")),
    ],
    ids=["cotangent", "mollified", "voronoi", "barycentric"],
)
def test_matrices_have_a_row_for_every_vertex(matrix: Callable[..., csc_array], faces: np.ndarray) -> None:
    found = matrix(np.vstack([RIGHT_TRIANGLE, np.ones((2, 3))]), faces)
    assert found.shape == (5, 5)
    assert found[:, 3:].nnz == 0
    assert (found.nnz > 0) == (len(faces) > 0)


@pytest.mark.parametrize("points", [[[np.nan, 0, 0]], [[0, 0, 0], [np.inf, 0, 0]], [[1e200, 0, 0]]])
def test_the_nearest_face_of_a_point_at_infinity_is_an_error(points: list[list[float]]) -> None:
    with pytest.raises(NonFiniteVertexError, match=f"vertex {len(points) - 1} "):
        nearest_on_mesh(np.array(points), RIGHT_TRIANGLE, FACE)


def test_a_mesh_without_faces_has_no_nearest_point() -> None:
    with pytest.raises(NoFacesError):
        nearest_on_mesh(RIGHT_TRIANGLE, RIGHT_TRIANGLE, np.zeros((0, 3), dtype=np.int64))


def test_a_factorisation_is_not_begun_if_it_would_exceed_the_time_limit() -> None:
    few, many = (csc_array(eye_array(count)) for count in (10, 10**6))  # estimated at 1e-6 and 6 seconds
    with time_limit(1.0):
        factor_symmetric(few)
        with pytest.raises(OutOfTimeError):
            factor_symmetric(many)
    # estimates are upper bounds, and finite ones for the meshes that a limit allows
    assert 7 * vertices_to_factor(6.0) == pytest.approx(10**6, rel=1e-9)
    assert vertices_to_factor(-1.0) == 0
