"""Random collars: each rim is closed, or left open for a correct reason."""

from __future__ import annotations

import re
import time
import warnings
from typing import Literal

import numpy as np
import pytest

from spinor_geom import fill_hole
from spinor_geom.errors import ImperfectFillWarning, SpinorGeomError
from tests.fill.shapes import circle

# why a rim may stay open: it is no hole, or has no surface at all
REASONS = re.compile("border of a sheet|encloses no area|lie in one place|zero-width|seam|other side|outline of")


def collar(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A ring of triangles around a rim of 5 to 40 points: smooth, zigzag, slit, or with repeated points."""
    random = np.random.default_rng(seed)
    n = int(random.integers(5, 41))
    t = 2 * np.pi * (np.arange(n) + 0.3 * random.uniform(-1, 1, n)) / n
    radius = 1 + random.choice([0.0, 0.2, 0.6]) * random.uniform(-1, 1) * (-1.0) ** np.arange(n)
    width = random.choice([1.0, 0.3, 0.02, 0.0])
    height = 0.4 * random.uniform(-1, 1)
    rim = np.column_stack([radius * np.cos(t), width * radius * np.sin(t), height * np.sin(2 * t)])
    rim += random.choice([0.0, 0.05, 0.3, 1.0]) * 2 * np.pi / n * random.standard_normal((n, 3))
    if random.random() < 0.15:
        rim[int(random.integers(1, n))] = rim[int(random.integers(n))]
    outer = np.column_stack([3 * np.cos(t), 3 * np.sin(t), np.full(n, -2.0)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    below = np.column_stack([i + n, np.full(n, 2 * n), j + n])
    faces = np.vstack([np.column_stack([i, i + n, j]), np.column_stack([j, i + n, j + n]), below])
    scale = 10.0 ** random.integers(-6, 7)
    return scale * np.vstack([rim, outer, [[0, 0, -4]]]), faces


def holds(seed: int) -> float:
    """Fills one collar and checks the result. Returns the seconds."""
    vertices, faces = collar(seed)
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImperfectFillWarning)
        try:
            filled, report = fill_hole((vertices, faces), time_limit=5.0, return_report=True)
        except SpinorGeomError as error:
            raise AssertionError(f"seed {seed}: refused whole: {error}") from error
    seconds = time.perf_counter() - start
    np.testing.assert_array_equal(filled[0][: len(vertices)], vertices)
    np.testing.assert_array_equal(filled[1][: len(faces)], faces)
    assert np.isfinite(filled[0]).all(), seed
    for outcome in report.loops:
        if not outcome.filled:
            assert REASONS.search(outcome.reason), (seed, outcome.reason)
    assert report.watertight == all(outcome.filled for outcome in report.loops), seed
    return seconds


def ring(radius: float, height: float, *, repeated: int = 1) -> np.ndarray:
    """12 points on a circle, the first of them several times."""
    return circle(12, radius, height)[np.maximum(np.arange(12) - repeated + 1, 0)]


@pytest.mark.parametrize(
    ("rings", "shift"),
    [
        ([ring(1, 0), ring(0, -1)], 0.0),
        ([ring(1, 0), ring(0, -1), ring(0, -1)], 0.0),
        ([ring(1, 0), ring(1, 0), ring(1, -1)], 0.0),
        ([ring(1, 0, repeated=3), ring(2, -1)], 0.0),
        ([ring(1, 0), ring(2, -1)], 1e15),
    ],
    ids=["a ring in a point", "two rings in a point", "two equal rings", "repeated points", "far from the origin"],
)
@pytest.mark.parametrize("continuity", ["C0", "C1"])
def test_degenerate_collars(rings: list[np.ndarray], shift: float, continuity: Literal["C0", "C1"]) -> None:
    i, j = np.arange(12), (np.arange(12) + 1) % 12
    band = np.concatenate([np.stack([i, i + 12, j], axis=1), np.stack([j, i + 12, j + 12], axis=1)])
    faces = np.concatenate([band + 12 * k for k in range(len(rings) - 1)])
    mesh = np.vstack(rings) + shift, faces
    (vertices, _), report = fill_hole(mesh, continuity=continuity, time_limit=1, return_report=True)
    assert np.isfinite(vertices).all()
    assert all(outcome.filled or outcome.reason for outcome in report.loops)


def test_random_collars_are_closed_or_refused_for_a_reason() -> None:
    for seed in range(8):
        holds(seed)
