"""The reported residual equals an independent evaluation of the returned surface."""

import numpy as np
import pytest

from spinor_geom.plateau import solve_plateau
from tests.loops import noisy_ellipse, ramp
from tests.plateau.solved import recovered, spanned


def measured(solution, samples=5000):
    """RMS and largest distance of the surface's boundary from Γ, by arc length of ∂Ω, from public methods alone."""
    boundary = solution.domain.boundary
    # midpoints: no sample of any Gauss rule, and none on a vertex
    t = (np.arange(samples) + 0.5) / samples
    r = solution.surface.position(boundary.point(t))
    distance = np.linalg.norm(r - solution.curve.point(solution.curve.nearest(r)), axis=1)
    weight = np.abs(boundary.derivative(t))
    return np.sqrt((weight * distance**2).sum() / weight.sum()), distance.max()


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
    rms, largest = measured(solution)
    reported = solution.boundary_residual
    # positions are integrated inside Ω, the report's along ∂Ω: they differ by the quadrature's error
    rounding = 1e-9 * solution.loop.diagonal
    assert abs(rms - reported.rms) < 0.1 * reported.rms + rounding
    assert abs(largest - reported.max) < 0.2 * reported.max + 10 * rounding


@pytest.mark.parametrize("name", ["half catenoid", "half helicoid"])
def test_reported_residual_with_corners_is_not_too_small(name):
    solution = recovered(name)
    rms, _ = measured(solution)
    assert rms < 1.2 * solution.boundary_residual.rms + 1e-8 * solution.loop.diagonal


def test_surface_passes_through_the_loop_points_within_the_residual():
    solution = spanned("tennis seam")
    gap = np.linalg.norm(solution.surface.position(solution.loop_points_in_domain()) - solution.loop.points, axis=1)
    assert gap.max() < 1e-4 * solution.loop.mean_edge_length
