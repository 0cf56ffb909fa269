"""Operations on arrays that the array API lacks."""

import numpy as np
import pytest

from spinor_geom.arrays import cholesky, cholesky_solve, gram, shifted, solve_lower


@pytest.mark.parametrize("by", [1, -1, 3])
@pytest.mark.parametrize("shape", [(7,), (2, 3, 5)])
def test_rows_are_shifted_around_closed_curves(shape, by):
    x = np.random.default_rng(0).normal(size=shape)
    np.testing.assert_array_equal(shifted(x, by), np.roll(x, by, axis=-1))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.complex64, np.complex128])
def test_triangular_factors_keep_the_precision_and_solve(dtype, order):
    rng = np.random.default_rng(0)
    rows = np.array(
        (rng.normal(size=(9, 5, 2)) @ [1, 1j]).astype(dtype)
        if np.dtype(dtype).kind == "c"
        else rng.normal(size=(9, 5)),
        dtype=dtype,
        order=order,
    )
    matrix, right = rows.conj().T @ rows, rows[:5, :2]
    tolerance = 1e3 * np.finfo(dtype).eps  # the condition number of the matrix is below 1e2
    lower = gram(rows)
    assert lower.dtype == dtype
    np.testing.assert_allclose(np.tril(lower), np.tril(matrix), atol=tolerance)
    factor = cholesky(lower)
    assert factor.dtype == dtype
    np.testing.assert_allclose(matrix @ cholesky_solve(factor, right), right, atol=tolerance)
    np.testing.assert_allclose(factor @ solve_lower(factor, right), right, atol=tolerance)
    np.testing.assert_allclose(factor.conj().T @ solve_lower(factor, right, adjoint=True), right, atol=tolerance)
    assert cholesky(-lower) is None
