"""The reported residual equals an independent evaluation of the returned surface."""

import numpy as np
import pytest

from spinor_geom.plateau import solve_plateau
from tests.loops import noisy_ellipse, ramp
from tests.plateau.solved import measured, recovered, spanned


@pytest.mark.parametrize(
    "solve",
    [
        lambda: solve_plateau(noisy_ellipse(), tolerance=1e-2),
        lambda: solve_plateau(ramp(0.95), tolerance=1e-2),
        lambda: spanned("tennis seam"),
        lambda: spanned("saddle 8:1"),
    ],
    ids=["noisy", "ramp", "seam", "saddle"],
)
def test_reported_residual_is_the_measured_one(solve):
    solution = solve()
    rms, largest = measured(solution.surface, solution.curve)
    reported = solution.boundary_residual
    # positions are integrated inside Ω, the report's along ∂Ω: they differ by the quadrature's error
    rounding = 1e-9 * solution.loop.diagonal
    assert abs(rms - reported.rms) < 0.1 * reported.rms + rounding
    assert abs(largest - reported.max) < 0.2 * reported.max + 10 * rounding


@pytest.mark.parametrize("name", ["half catenoid", "half helicoid"])
def test_reported_residual_with_corners_is_not_too_small(name):
    solution = recovered(name)
    rms, _ = measured(solution.surface, solution.curve)
    assert rms < 1.2 * solution.boundary_residual.rms + 1e-8 * solution.loop.diagonal


def test_surface_passes_through_the_loop_points_within_the_residual():
    solution = spanned("tennis seam")
    gap = np.linalg.norm(solution.surface.position(solution.loop_points_in_domain()) - solution.loop.points, axis=1)
    assert gap.max() < 1e-4 * solution.loop.mean_edge_length
