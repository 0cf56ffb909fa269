"""Factors L D Lᵀ of sparse matrices."""

import numpy as np
import pytest
import trimesh
from scipy.sparse import block_diag, csc_array, eye_array
from scipy.sparse.linalg import splu

from spinor_geom.deadline import time_limit
from spinor_geom.errors import OutOfTimeError, SingularMatrixError
from spinor_geom.mesh.elimination import Elimination
from spinor_geom.mesh.operators import graph_laplacian


def bent(level: int) -> csc_array:
    """A bilaplacian of the inner vertices of a mesh, with the pattern of the equations of a bent patch."""
    laplacian = graph_laplacian(np.asarray(trimesh.creation.icosphere(level).faces))
    return csc_array((laplacian @ laplacian)[12:, 12:])


MATRICES = {
    "one": csc_array(np.array([[2.0]])),
    "diagonal": csc_array(eye_array(7)),
    "dense": csc_array(np.eye(30) + 1),
    "indefinite": csc_array(np.array([[1.0, 2, 0], [2, 1, 3], [0, 3, 1]])),
    "mesh": bent(2),
    "two pieces": csc_array(block_diag([bent(2), np.eye(3) + 1])),
    "fine mesh": bent(3),
}


@pytest.mark.parametrize("name", MATRICES)
def test_systems_are_solved(name: str) -> None:
    matrix, rng = MATRICES[name], np.random.default_rng(0)
    elimination = Elimination.of(matrix)
    np.testing.assert_array_equal(np.sort(elimination.order), np.arange(matrix.shape[0]))
    scale = np.exp(rng.normal(size=matrix.shape[0]))
    other = csc_array(matrix.multiply(scale).multiply(scale[:, None]))  # other numbers in the same pattern
    for each in (matrix, other):
        factors = elimination.factored(each)
        for shape in ((len(scale),), (len(scale), 3)):
            wanted = rng.normal(size=shape)
            # condition numbers are up to 1e6
            np.testing.assert_allclose(factors.solve(each @ wanted), wanted, rtol=1e-8, atol=1e-8)


def test_the_order_fills_in_as_little_as_that_of_superlu() -> None:
    matrix = bent(4)
    best = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    filled = int(Elimination.of(matrix).starts[-1]) + matrix.shape[0]
    assert filled < 1.1 * best.L.nnz  # measured is 1.0; without elements that are absorbed it is 1.3


@pytest.mark.parametrize("values", [[[1.0, 1, 0], [1, 1, 0], [0, 0, 1]], [[np.nan, 1, 0], [1, 1, 0], [0, 0, 1]]])
def test_a_singular_matrix_is_an_error(values: list[list[float]]) -> None:
    matrix = csc_array(np.array(values))
    with pytest.raises(SingularMatrixError):
        Elimination.of(matrix).factored(matrix)


def test_a_factorisation_is_not_begun_if_it_would_exceed_the_time_limit() -> None:
    matrix = csc_array(eye_array(10**6))  # estimated at 6 seconds
    elimination = Elimination.of(matrix)
    with time_limit(1.0), pytest.raises(OutOfTimeError):
        elimination.factored(matrix)
