"""The solution does not depend on the position, size and first point of a loop."""

import numpy as np
import pytest
from hypothesis import given, settings

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from tests.plateau.solved import CURVES, distance_to_surface
from tests.strategies import rigid_motions

LOOP = CURVES["tennis seam"].sample(60)
SOLUTION = solve_plateau(LOOP, tolerance=1e-5)
INNER = SOLUTION.domain.triangulation.points[len(LOOP) :: 4]


def solved(points):
    return solve_plateau(BoundaryLoop.from_points(points), tolerance=1e-5)


def same_area(solution, other):
    """Whether areas agree within the error that the residuals allow: at a minimal disk δA = ∮ (δr · conormal) ds."""
    open_ = sum(s.boundary_residual.rms * s.loop.perimeter for s in (solution, other)) / other.area
    assert open_ < 1e-4
    return abs(solution.area / other.area - 1) < open_


@settings(max_examples=3)
@given(motion=rigid_motions())
def test_rigid_motion_moves_the_surface(motion):
    moved = solved(motion(LOOP.points))
    assert same_area(SOLUTION, moved)
    there = motion(SOLUTION.surface.position(INNER))
    assert distance_to_surface(there, moved.surface).max() < 1e-6 * LOOP.diagonal


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_scales_the_surface(scale):
    scaled = solved(scale * LOOP.points)
    assert abs(scaled.area / (scale**2 * SOLUTION.area) - 1) < 1e-6
    assert abs(scaled.boundary_residual.rms / (scale * SOLUTION.boundary_residual.rms) - 1) < 0.5
    assert scaled.converged
    assert scaled.stability.verdict == SOLUTION.stability.verdict
    assert abs(scaled.stability.total_curvature / SOLUTION.stability.total_curvature - 1) < 1e-6
    there = scale * SOLUTION.surface.position(INNER)
    assert distance_to_surface(there, scaled.surface).max() < 1e-6 * scale * LOOP.diagonal


def test_large_scale_far_from_the_origin():
    shift = np.array([1e4, -2e4, 3e4])
    far = solved(LOOP.points + shift)
    # coordinates of 3e4 are rounded to 4e-12
    assert same_area(SOLUTION, far)
    assert distance_to_surface(SOLUTION.surface.position(INNER) + shift, far.surface).max() < 1e-6 * LOOP.diagonal


def test_reversed_loop_gives_the_same_surface_seen_from_behind():
    back = solve_plateau(LOOP.reversed(), tolerance=1e-5)
    assert same_area(SOLUTION, back)
    points = SOLUTION.surface.position(INNER)
    assert distance_to_surface(points, back.surface).max() < 1e-6 * LOOP.diagonal
    z = back.domain.triangulation.points
    middle = int(np.abs(INNER - INNER.mean()).argmin())
    near = z[np.linalg.norm(back.surface.position(z) - points[middle], axis=1).argmin()]
    assert back.surface.normal(near) @ SOLUTION.surface.normal(INNER[middle]) < -0.9
