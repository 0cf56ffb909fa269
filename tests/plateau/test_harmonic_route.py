"""The harmonic route: smooth loops to 1e-8, rough ones to the tolerance, for any position and first point."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spinor_geom import gallery
from spinor_geom.errors import DomainError, SurfaceError
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.harmonic import harmonic_route
from spinor_geom.plateau.harmonic.harmonic_route import HarmonicSolver
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.surface.formulas import phi
from tests.loops import noisy_ellipse


def harmonic_solver(loop, *, tolerance, max_steps=300):
    """The route alone, at unit size."""
    return HarmonicSolver(problem=PlateauProblem.of([loop], Options(tolerance=tolerance, max_iterations=max_steps)))


def measured(surface, curve, steps):
    """RMS by arc length and largest distance between a surface's boundary and Γ, both ways.

    At many steps of an analytic ∂Ω: p and q are integrated along it; where that starts comes from a few positions of
    the surface. Of each point of the boundary and of each of Γ that is farther off the distance counts.
    """
    z, dz, _ = surface.domain.boundary.grid(steps)
    p, q = np.array(surface.spinors(z)).T
    spectrum = np.fft.fft(phi(p, q) * dz[:, None], axis=0)
    frequency = np.fft.fftfreq(steps, 1 / steps)
    frequency[0] = 1
    spectrum[0] = 0
    r = np.fft.ifft(spectrum / (2j * np.pi * frequency)[:, None], axis=0).real
    some = slice(None, None, steps // 16)
    offset = surface.position(z[some]) - r[some]
    middle = np.median(offset, axis=0)
    r = r + middle
    step = np.linalg.norm(np.roll(r, -1, axis=0) - r, axis=1)
    distance = np.linalg.norm(r - curve.point(curve.nearest(r)), axis=1)
    rms = np.sqrt(np.average(distance**2, weights=step + np.roll(step, 1)))
    # where p and q are resolved so are positions
    assert np.median(np.abs(offset - middle)) < max(1e-6 * np.ptp(r), 0.2 * rms)
    # Γ's own points, as far as those of the boundary can tell
    passed = cKDTree(r).query(curve.point(np.arange(steps) / steps))[0]
    passed[passed < 2 * step.max()] = 0
    return max(rms, np.sqrt(np.mean(passed**2))), max(distance.max(), passed.max())


# --- accuracy ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [128, 256])
@pytest.mark.parametrize("ratio", [2.0, 4.0, 8.0])
def test_ellipses(ratio, points):
    solver = harmonic_solver(gallery.ellipse(ratio).sample(points), tolerance=1e-8)
    found = solver.on_unit_disk() if ratio == 2 else solver.on_flattening()
    assert found.misfit.rms < 1e-8 * solver.problem.unit.mean_edge_length
    if points == 256:  # a spline of degree 5 or more
        diagonal = np.hypot(2 * ratio, 2)
        assert abs(found.area * diagonal**2 / (np.pi * ratio) - 1) < 1e-8
    rms, largest = measured(found.surface, solver.problem.curve, 8000)
    assert rms < 1.5 * found.misfit.rms + 1e-12
    assert largest < 1.5 * found.misfit.max + 1e-11


@pytest.mark.parametrize(
    ("curve", "route", "model"),
    [
        (gallery.tennis_seam(0.8), "disk", PowerSeries),
        (gallery.twisted_circle(), "disk", PowerSeries),
        (gallery.ellipse(4.0, 0.3), "flattened", CauchyInterpolant),
    ],
    ids=["seam", "twisted circle", "saddle"],
)
def test_smooth_loops_meet_a_sharp_tolerance(curve, route, model):
    solution = solve_plateau(curve.sample(128), tolerance=1e-8)
    assert solution.converged
    assert solution.route == route
    assert isinstance(solution.array_surface.model, model)
    assert solution.boundary_residual.rms_per_edge < 1e-8
    assert all(step.method == "Douglas-Newton" for step in solution.history)
    # holomorphic p and q, so minimal. The boundary's nodes lie too near for derivatives there
    inner = solution.domain.triangulation.points[solution.domain.triangulation.boundary_size :]
    z = inner[:: len(inner) // 10]
    scale = np.sqrt(np.abs(solution.surface.gauss_curvature(z)).max())
    assert np.abs(solution.surface.mean_curvature(z)).max() < 1e-6 * scale


@pytest.mark.parametrize(("ratio", "seed"), [(1.0, 0), (2.0, 1), (6.0, 2)])
def test_noisy_loops(ratio, seed):
    """15 % of an edge of noise on 120 points."""
    solution = solve_plateau(noisy_ellipse(120, ratio, 0.15, seed), between="smooth")
    assert solution.converged
    assert solution.route == "flattened"
    rms, largest = measured(solution.surface, solution.curve, 8 * len(solution.matching))
    assert rms < 1e-3 * solution.loop.mean_edge_length
    assert abs(rms / solution.boundary_residual.rms - 1) < 0.1
    assert abs(largest / solution.boundary_residual.max - 1) < 0.4


# --- honesty ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (5, 10, 15))])
def test_reported_residual_of_random_curves_is_the_measured_one(first):
    """The surfaces of strongly folded curves after few steps."""
    found_some = 0
    for seed in range(first, first + 5):
        solver = harmonic_solver(gallery.random_curve(seed).sample(80), tolerance=1e-2, max_steps=25)
        try:
            found = solver.on_flattening()
        except (DomainError, SurfaceError):
            continue
        found_some += 1
        assert len(solver.problem.steps.history) <= 25
        rms, largest = measured(found.surface, solver.problem.curve, 8 * len(found.matchings[0]))
        if found.misfit.rms <= solver.problem.allowed:
            # the solver samples the boundary at half as many points as `measured`, four to each of the shortest waves,
            # so that a crest may be an eighth of a wave from a sample; far below the tolerance a few bends have most of
            # the distance
            negligible = 1e-4 * solver.problem.allowed
            assert abs(rms - found.misfit.rms) < 0.02 * found.misfit.rms + negligible, seed
            share = 1 - np.cos(np.pi / 8)
            assert abs(largest - found.misfit.max) < share * found.misfit.max + negligible, seed
        # what is far from Γ is not projected on the part of it that is nearest
        assert found.misfit.rms / 2 < rms < 1.5 * found.misfit.rms, seed
    assert found_some >= 3


def test_narrow_fingers_are_not_left_out():
    """Four edges long and a tenth of an edge wide: without it the boundary would also be near to Γ everywhere."""
    solution = solve_plateau(gallery.random_curve(16).sample(120))
    assert solution.converged
    assert solution.boundary_residual.max_per_edge < 1e-2
    rms, largest = measured(solution.surface, solution.curve, 8 * len(solution.matching))
    assert rms < 1e-3 * solution.loop.mean_edge_length
    assert largest < 1e-2 * solution.loop.mean_edge_length
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-3


def test_crowded_disk_is_replaced_by_a_domain_made_for_the_loop():
    """The loop is just short enough that the disk is tried."""
    solution = solve_plateau(gallery.ellipse(2.4).sample(200), tolerance=1e-8)
    assert solution.converged
    assert abs(solution.area / (2.4 * np.pi) - 1) < 1e-8


def test_domains_far_from_conformal_are_left_to_the_surface_through_the_points(monkeypatch):
    # four sides of a wavy square without corners, which neighbours do not predict
    side = np.linspace(-1, 1, 25)[:-1]
    edge = np.ones_like(side)
    x, y = np.r_[side, edge, -side, -edge], np.r_[-edge, side, edge, -side]
    loop = np.c_[x, y, 0.38 * (np.sin(6 * x + 1) + np.sin(8 * y + 3 * x))]
    solver = harmonic_solver(BoundaryLoop.from_points(loop), tolerance=1e-3)
    monkeypatch.setattr(harmonic_route, "_advance", lambda fits: pytest.fail(f"an attempt with {fits[0].nodes} nodes"))
    found = solver.on_flattening()
    assert 1 < solver.problem.excess(found.misfit) < 1000
    assert "would not meet the tolerance" in found.limit
