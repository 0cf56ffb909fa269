"""The surface of a fit: its paths avoid the poles, and the residual contains the error of paths that do not."""

import pickle

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import DomainError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.network import fitted, network_route
from spinor_geom.plateau.network.gauss_newton import Fit
from spinor_geom.plateau.network.network_route import NetworkSolver
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem, start_indices


@pytest.mark.parametrize("order", [1, 2])
def test_residual_contains_the_errors_of_the_surface_s_paths(monkeypatch, order):
    monkeypatch.setattr(fitted, "PATH_ORDER", order)
    loop = gallery.twisted_circle().sample(48)
    solution = solve_plateau(loop, model="cauchy", max_iterations=20)
    boundary = solution.domain.boundary
    r = solution.surface.position(boundary.point(np.arange(480) / 480))
    away = np.linalg.norm(r - solution.curve.point(solution.curve.nearest(r)), axis=1)
    measured = np.sqrt(np.mean(away**2))
    assert measured > 1e-5 * loop.mean_edge_length
    # the way along Γ is not a distance from it: at most twice as large on this curve
    assert 0.5 * measured < solution.boundary_residual.rms < 4 * measured


def test_corners_do_not_make_a_polygon_rough():
    loop = gallery.schwarz_prism(1.5).sample(64)
    assert np.count_nonzero(loop.corners) == 8
    network = NetworkSolver(problem=PlateauProblem.of([loop], Options()))
    # a ninth of its points are corners of 90°: with them it would count as rough
    assert not network._is_rough


def curved_square(with_bump: bool) -> BoundaryLoop:
    """Four arcs between corners. The first one may have a narrow bump, where its points are dense."""
    ends = np.exp(0.5j * np.pi * np.arange(5))
    near = np.linspace(-1, 1, 120)[:-1]
    even, dense = np.arange(40) / 40, (1 + np.sign(near) * np.abs(near) ** 2.2) / 2
    sides = []
    for side, t in enumerate([dense if with_bump else even, even, even, even]):
        plane = ends[side] + (ends[side + 1] - ends[side]) * t
        height = 0.2 * np.sin(np.pi * t) * (-1) ** side
        bump = 0.05 * np.exp(-(((t - 0.5) / 0.02) ** 2)) * (with_bump and side == 0)
        sides.append(np.stack([plane.real, plane.imag, height + bump], axis=1))
    return BoundaryLoop.from_points(
        np.concatenate(sides), corners=np.cumsum([0, *(len(side) for side in sides[:3])]).tolist()
    )


@pytest.mark.parametrize("with_bump", [False, True])
def test_networks_of_smooth_loops_with_corners_are_small(with_bump):
    loop = curved_square(with_bump)
    # the time of a fit grows with the cube of the number of poles
    assert len(start_indices(loop)) <= 0.81 * len(loop)
    solution = solve_plateau(loop)
    # with points of equal distance along the loop the bump is missed, and the fit does not converge
    assert (solution.route, solution.converged) == ("network", True)


def test_sharp_corners_between_a_bent_side_and_straight_ones_of_one_edge_are_met():
    # beside undivided ones Ω had kinks, and the residual was 2e-3. With weights by arc length a corner was 5e-6 of the
    # diagonal from the frame, with any number of features
    t = np.arange(21)[:, None] / 21
    bent = (1 - t) ** 3 * [-2.16, 0.45, 0.24] + 3 * t * (1 - t) ** 2 * [-1.58, 0.46, 0.22]
    bent += 3 * t**2 * (1 - t) * [-1.7, -0.44, 0.22] + t**3 * [-0.81, -0.8, 0.32]
    loop = BoundaryLoop.from_points(np.vstack([bent, [-0.81, -0.8, 0.32], [1.02, -0.42, -0.15]]), corners=[0, 21, 22])
    assert solve_plateau(loop).to_nurbs().converged


def frame_with_an_obtuse_corner():
    """Two straight sides and three bent ones of 11 points, with angles of 40° to 116°."""
    rng = np.random.default_rng(102)
    count = int(rng.integers(3, 9))
    turn = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    radii = rng.uniform(0.7, 1.3, count), rng.uniform(0.7, 1.3, count)
    ends = np.column_stack([np.cos(turn) * radii[0], np.sin(turn) * radii[1], rng.uniform(-0.4, 0.4, count)])
    u = (np.linspace(0, 1, int(rng.integers(8, 33)), endpoint=False))[:, None]
    sides = []
    for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True):
        if rng.random() < 0.4:
            sides.append(a[None])
        else:
            bends = rng.normal(size=(2, 3)) * np.linalg.norm(b - a) * 0.2
            sides.append(a + u * (b - a) + np.sin(np.pi * u) * bends[0] + np.sin(2 * np.pi * u) * bends[1] / 2)
    return BoundaryLoop.from_points(np.concatenate(sides), corners=np.cumsum([0, *map(len, sides[:-1])]))


def test_a_corner_of_the_domain_is_moved_to_that_of_the_curve(monkeypatch):
    def fails(*_):
        raise DomainError("no finer disk")

    monkeypatch.setattr(network_route, "finer_disk", fails)
    # the first fit is 7e-3 of an edge from the frame, with any number of features
    assert solve_plateau(frame_with_an_obtuse_corner()).converged


def test_the_boundary_of_a_rescaled_domain_has_the_lengths_of_the_surface():
    solver = NetworkSolver(problem=PlateauProblem.of([frame_with_an_obtuse_corner()], Options()))
    first = solver._fitted_from(solver.first_surface)
    stage, readout, slide = first.stage.rescaled(first.fit, offset=1.0)
    scale = (np.abs(stage.problem.features[: stage.problem.nodes] @ readout) ** 2).sum(axis=1)
    assert np.quantile(np.abs(np.log(scale)), 0.9) < 0.02  # splines between 35 vertices, and least squares
    assert Fit.at(stage.problem, readout, slide).residual < 1e-3
    # poles move with the corners: only the rest of the fields changes the surface
    near = np.abs(stage.panels.z[:, None] - stage.domain.vertices[stage.domain.corners]).min(axis=1) < 1e-5
    assert np.abs(stage.flexible_problem.fields[near]).max() < 1e-3


def test_a_solution_is_continued_on_its_domain():
    solution = solve_plateau(frame_with_an_obtuse_corner())
    nearer = solution.solved_to(1e-4)
    assert nearer.converged
    assert "flattening" not in nearer.solve_timings
    assert len(pickle.dumps(nearer)) < 1e6  # without the features
