"""Operations on arrays that the array API lacks."""

import numpy as np
import pytest

from spinor_geom.arrays import (
    cholesky,
    cholesky_solve,
    cross,
    distinct,
    gram,
    median,
    modulo_one,
    norm,
    shifted,
    solve_lower,
)


@pytest.mark.parametrize("by", [1, -1, 3])
@pytest.mark.parametrize("shape", [(7,), (2, 3, 5)])
def test_rows_are_shifted_around_closed_curves(shape, by):
    import torch

    x = np.random.default_rng(0).normal(size=shape)
    np.testing.assert_array_equal(shifted(x, by), np.roll(x, by, axis=-1))
    np.testing.assert_array_equal(shifted(x, by, axis=0), np.roll(x, by, axis=0))
    np.testing.assert_array_equal(shifted(torch.from_numpy(x), by), np.roll(x, by, axis=-1))


@pytest.mark.parametrize("shape", [(1,), (6,), (2, 5)])
def test_medians_of_rows(shape):
    x = np.random.default_rng(0).normal(size=shape)
    np.testing.assert_array_equal(median(x), np.median(x, axis=-1))


def test_distinct_numbers_ascend():
    numbers = np.array([[3, 1, 3], [2, 1, -7]])
    np.testing.assert_array_equal(distinct(numbers), [-7, 1, 2, 3])
    assert distinct(numbers[:0]).shape == (0,)


def test_parameters_just_below_a_whole_turn_stay_below_one():
    s = np.array([0.25, 1.0, -1.0, 3.5, -1e-17, -1e-300, 1 - 1e-16, np.nan])
    np.testing.assert_array_equal(modulo_one(s), [0.25, 0, 0, 0.5, 0, 0, 1 - 1e-16, np.nan])


def test_lengths_and_products_of_rows():
    import torch

    rng = np.random.default_rng(0)
    u, v = rng.normal(size=(2, 4, 5, 3))
    np.testing.assert_array_equal(cross(u, v), np.cross(u, v))
    # sums of three squares in another order
    np.testing.assert_allclose(norm(u + 1j * v), np.linalg.norm(u + 1j * v, axis=-1), rtol=1e-15)
    np.testing.assert_allclose(norm(torch.from_numpy(u)), norm(u), rtol=1e-15)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.complex64, np.complex128])
def test_triangular_factors_keep_the_precision_and_solve(dtype, order):
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(9, 5, 2)) @ [1, 1j if np.dtype(dtype).kind == "c" else 0]
    rows = np.array(rows, dtype=dtype, order=order)
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
