"""Rough rims: exact minimal surfaces through their points, with Γ free between them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spinor_geom as sg
from spinor_geom.bench.ragged import CUT, ragged_hole
from spinor_geom.domain.quadrature import cumulative_matrix, rule
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.poles import polygon_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.vertices.through_points import NODES, Basis
from spinor_geom.plateau.vertices.vertex_route import disk_through_points
from spinor_geom.surface.array_surface import ArraySurface
from tests.fill.shapes import bowl_below


def cap(subdivisions: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere whose faces above a height are removed: its rim runs along triangles, in zigzags."""
    return bowl_below(height, subdivisions)


def rim_of(subdivisions: int, height: float) -> BoundaryLoop:
    vertices, faces = cap(subdivisions, height)
    (loop,) = sg.boundary_loops((vertices, faces))
    return loop


def zigzag(n: int, *, teeth: float, seed: int = 0) -> np.ndarray:
    """A wavy circle whose points are moved by a share of the edge, alternately to and fro, in random directions."""
    random = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    points = np.column_stack([np.cos(t), np.sin(t), 0.2 * np.sin(2 * t)])
    return points + teeth * 2 * np.pi / n * random.standard_normal((n, 3))


def distance_of_points(solution: sg.PlateauSolution) -> np.ndarray:
    """Distances of the loop's points from the surface at their points of Ω, in mean edges, by public methods."""
    found = np.asarray(solution.surface.position(solution.loop_points_in_domain()))
    return np.linalg.norm(found - solution.loop.points, axis=1) / solution.loop.mean_edge_length


# nearer to ∂Ω Cauchy's formula has errors of 1e-10, and panels of their own, which very near points need, of 1e-7
@pytest.mark.parametrize(("depth", "tolerance"), [(1.0, 1e-12), (0.3, 1e-9), (1e-3, 1e-7)])
def test_positions_inside_a_rough_rim_are_exact(depth: float, tolerance: float) -> None:
    solution = sg.solve_plateau(zigzag(30, teeth=0.3), between="free")
    surface, boundary = solution.array_surface, solution.domain.boundary
    # beside the middles of the edges, at a share of the distance to the root
    edges = boundary.point((boundary.parameters[1:] + boundary.parameters[:-1]) / 2)
    z = edges + depth * 0.5 * (surface.root - edges)
    z = z[solution.domain.contains(z)]
    # by quadrature with twice as many nodes, along other paths
    fine = ArraySurface(surface.model, surface.domain, surface.constant, spinor_map=surface.spinor_map, order=32)
    assert np.abs(surface.positions_inside(z)[0] - fine.position(z)).max() < tolerance * solution.loop.diagonal


@pytest.mark.parametrize(("subdivisions", "height"), [(2, 0.5), (3, 0.5), (4, 0.85)])
def test_the_rims_of_caps_cut_along_triangles_are_met(subdivisions: int, height: float) -> None:
    solution = sg.solve_plateau(rim_of(subdivisions, height), between="free")
    assert solution.route == "vertices"
    assert solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-3
    # the residual is measured on other nodes than the fit's, and positions by other paths than along ∂Ω
    assert np.sqrt(np.mean(distance_of_points(solution) ** 2)) < 1e-3
    assert solution.rims[0].bulge < 1.0 * solution.loop.mean_edge_length


def test_a_rim_that_little_damping_does_not_reach_is_met_in_every_orientation() -> None:
    """With three times as much its points keep 6e-3 of an edge, turned in four of five ways."""
    hole = ragged_hole(CUT[58])
    for seed in range(3):
        turned = hole.vertices @ Rotation.random(random_state=seed).as_matrix().T
        (loop,) = (loop for loop in sg.boundary_loops((turned, hole.faces)) if len(loop) == len(hole.loops[0]))
        solution = sg.solve_plateau(loop, between="free")
        assert solution.route == "vertices"
        assert solution.converged


@pytest.mark.slow
def test_rims_cut_along_triangles_are_met_by_films_that_cross_nothing() -> None:
    residuals, crossings = [], 0
    for hole in map(ragged_hole, CUT[::3]):
        _, report = sg.fill_hole((hole.vertices, hole.faces), loop=hole.rim_indices, return_report=True)
        (outcome,) = (one for one in report.loops if one.requested)
        residuals.append(outcome.solution.boundary_residual.rms_per_edge)
        crossings += outcome.intersections
    assert np.quantile(residuals, 0.9) < 1e-3
    assert crossings == 0


def test_the_surface_is_minimal_and_its_two_areas_agree() -> None:
    solution = sg.solve_plateau(rim_of(3, 0.7), between="free")
    z = solution.domain.triangulation.points[solution.domain.triangulation.boundary_size :]
    # |H| times the size of the surface, by automatic differentiation
    assert np.abs(solution.surface.mean_curvature(z)).max() * solution.loop.diagonal < 1e-8
    # that over Ω is by quadrature on its triangles, which the poles beside its edges limit
    assert solution.area_in_domain == pytest.approx(solution.area, rel=1e-3)


def test_gamma_passes_through_the_points_and_keeps_beside_the_edges() -> None:
    loop = rim_of(3, 0.5)
    solution = sg.solve_plateau(loop, between="free")
    curve = solution.curve
    np.testing.assert_array_equal(curve.point(curve.breaks[:-1]), loop.points)
    # Γ is the surface's boundary but for the distances at the points, and the polynomials that stand for it
    share = np.array([0.25, 0.5, 0.75])
    boundary = solution.domain.boundary
    t = boundary.parameters[:-1] + share[:, None] * np.diff(boundary.parameters)
    s = curve.breaks[:-1] + share[:, None] * np.diff(curve.breaks)
    away = np.linalg.norm(np.asarray(solution.surface.position(boundary.point(t))) - curve.point(s), axis=-1)
    assert away.max() < solution.boundary_residual.max + 2e-3 * loop.mean_edge_length


def test_steps_are_reported_and_bounded() -> None:
    loop = rim_of(3, 0.7)
    steps: list[int] = []
    solution = sg.solve_plateau(loop, between="free", on_iteration=lambda step: steps.append(step.index))
    assert steps == list(range(1, len(solution.history) + 1))
    assert {step.method for step in solution.history} == {"Newton"}
    short = sg.solve_plateau(loop, between="free", max_iterations=1)
    assert len(short.history) == 1
    assert not short.converged
    assert "residual" in short.reason


def test_surfaces_far_from_the_points_or_from_the_edges_are_errors() -> None:
    problem = PlateauProblem.of([rim_of(3, 0.7)], Options(max_iterations=20))
    assert disk_through_points(problem).misfit.rms < problem.allowed
    errors = []
    for n, noise, seed in ((24, 2.0, 4), (24, 2.0, 5), (40, 1.0, 0), (40, 1.0, 2)):
        t, edge = 2 * np.pi * np.arange(n) / n, 3 * np.pi / n
        ellipse = np.column_stack([2 * np.cos(t), np.sin(t), 0.2 * np.cos(2 * t)])
        points = ellipse + noise * edge * np.random.default_rng(seed).normal(size=(n, 3))
        loop = BoundaryLoop.from_points(points, corners=())
        try:
            disk_through_points(PlateauProblem.of([loop], Options(max_iterations=20)))
        except SurfaceError as error:
            errors.append(str(error))
    for kind in ("edges away from the points", "edges away from its edges"):
        assert any(kind in error for error in errors)


def test_more_nodes_are_tried_only_after_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes: list[int] = []
    on = Basis.on

    def counted(*rims, **options):
        nodes.append(options["nodes"])
        return on(*rims, **options)

    monkeypatch.setattr("spinor_geom.plateau.vertices.vertex_route.Basis.on", counted)
    monkeypatch.setattr("spinor_geom.plateau.vertices.vertex_route.nearest_through", lambda _, readout, **__: readout)
    sg.solve_plateau(rim_of(3, 0.7), between="free")
    assert nodes == [NODES]


def test_poles_beside_a_polygon_keep_every_edge_at_a_distance() -> None:
    # a star: convex tips and deep notches
    t = 2 * np.pi * np.arange(24) / 24
    polygon = (1 + 0.35 * (-1.0) ** np.arange(24)) * np.exp(1j * t)
    poles = polygon_poles(polygon)
    step = np.roll(polygon, -1) - polygon
    share = np.clip(((poles.positions[:, None] - polygon) * step.conj()).real / np.abs(step) ** 2, 0, 1)
    distance = np.abs(poles.positions[:, None] - polygon - share * step)
    assert (distance / np.abs(step)).min() >= 0.35
    np.testing.assert_allclose(distance.min(axis=1), poles.scales)
    winding = np.angle((np.roll(polygon, -1) - poles.positions[:, None]) / (polygon - poles.positions[:, None])).sum(1)
    assert np.abs(winding).max() < 1e-6
    assert len(poles.positions) > 24


@pytest.mark.parametrize("order", [4, 9])
def test_integrals_to_any_point_are_exact_for_polynomials(order: int) -> None:
    nodes, ends = rule("gauss", order).nodes, (0.1, 0.5, 1.0)
    for power in range(order):
        found = cumulative_matrix(order, ends) @ nodes**power
        np.testing.assert_allclose(found, np.array(ends) ** (power + 1) / (power + 1), atol=1e-14)
