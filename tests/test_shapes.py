"""The plugin that checks the shapes in annotations finds wrong ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Complex, Float, Int

from tests.shapes import CALLS, arrays_checked, fields_checked, pytest_runtest_setup

ONES = np.ones((4, 3))


@arrays_checked
def centroids(
    points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"] | None = None
) -> Float[np.ndarray, "n 3"]:
    return points if faces is None else points[faces].mean(axis=1)


@arrays_checked
def joined(*parts: Float[np.ndarray, "_ 3"], sizes: list[Complex[np.ndarray, " n"]] | None = None) -> None:
    pass


@fields_checked
@dataclass(frozen=True, kw_only=True)
class Mesh:
    vertices: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]


def test_what_fits_is_let_through() -> None:
    assert centroids(ONES) is ONES
    assert len(centroids(ONES, np.arange(12).reshape(4, 3) % 4)) == 4
    joined(ONES, ONES[:2], sizes=[np.ones(2, dtype=complex)])
    assert Mesh(vertices=ONES, normals=ONES).vertices is ONES


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda: centroids(ONES.T), r"points .* got \(3, 4\) of float64"),
        (lambda: centroids(np.ones((4, 3), dtype=int)), "points"),
        (lambda: centroids(ONES, faces=np.zeros((4, 2), dtype=int)), "faces"),
        (lambda: centroids(ONES, np.array([[0, 1, 2]])), r"return .* got \(1, 3\)"),  # n has one value in a call
        (lambda: joined(ONES, ONES.T), "parts"),
        (lambda: joined(sizes=[np.ones(2)]), "sizes"),
        (lambda: Mesh(vertices=ONES, normals=ONES[:2]), "normals"),
    ],
)
def test_what_does_not_fit_is_an_error(call, what: str) -> None:
    with pytest.raises(TypeError, match=what):
        call()


def test_the_first_calls_of_each_test_are_checked() -> None:
    pytest_runtest_setup()
    for _ in range(CALLS):
        centroids(ONES)
    assert centroids(ONES.T).shape == (3, 4)
    pytest_runtest_setup()
    with pytest.raises(TypeError, match="points"):
        centroids(ONES.T)
