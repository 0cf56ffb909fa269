"""Minimal surfaces over frames of CAD edges: known areas, rims on the edges, directions, rigid motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spinor_geom import gallery, solve_plateau
from spinor_geom.errors import LoopsMeetError, SelfCrossingCurveError
from spinor_geom.plateau.solution import PlateauSolution
from tests.systems import OnUse

cad = OnUse("build123d")

SEAM = gallery.tennis_seam(0.8)


def through(points: np.ndarray) -> Any:
    """A closed cubic spline, twice continuously differentiable."""
    return cad.Edge.make_spline([tuple(p) for p in points.tolist()], periodic=True)


def polygon(points: np.ndarray) -> Any:
    return cad.Wire.make_polygon([tuple(p) for p in points.tolist()])


def ring(radius: float, height: float) -> Any:
    return cad.Wire.make_circle(radius).move(cad.Location((0, 0, height)))


def rim_distance(solution: PlateauSolution) -> float:
    """Largest distance of the boundary from the edges, per diagonal."""
    return solution.boundary_residual.max / solution.boundary_residual.diagonal


def test_seam_of_a_tennis_ball_as_a_spline() -> None:
    """A spline through n points is (2π/n)⁴ off the seam, and has jumps of the third derivative."""
    solution = solve_plateau(through(SEAM.sample(200).points), tolerance=1e-6)
    assert (solution.route, solution.converged) == ("disk", True)
    assert solution.area == pytest.approx(SEAM.disks[0].area, rel=1e-6)
    assert rim_distance(solution) < 1e-7


@pytest.mark.parametrize("tolerance", [1e-3, 1e-7])
def test_all_points_of_a_spline_are_given_whatever_the_tolerance(tolerance: float) -> None:
    """A tolerance that the first route missed was met by a surface through some points, 2 % larger."""
    solution = solve_plateau(through(SEAM.sample(40).points), tolerance=tolerance)
    assert solution.route != "vertices"
    assert solution.area == pytest.approx(4.3645025, rel=1e-6)  # by 5,000 nodes


def test_fillets_between_straight_edges_in_space() -> None:
    """Γ″ jumps where arcs meet lines; a surface of ten times as many nodes differs by less."""
    corners = np.array([[1, 1, 0.5], [-1, 1, -0.5], [-1, -1, 0.5], [1, -1, -0.5]])
    ahead, back = (np.roll(corners, step, axis=0) - corners for step in (-1, 1))
    ahead, back = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (ahead, back))
    edges = []
    for k in range(4):
        first, last = corners[k] + back[k] / 2, corners[k] + ahead[k] / 2
        after = corners[(k + 1) % 4] + back[(k + 1) % 4] / 2
        edges.append(cad.Edge.make_tangent_arc(tuple(first), tuple(-back[k]), tuple(last)))
        edges.append(cad.Edge.make_line(tuple(last), tuple(after)))
    solution = solve_plateau(edges, tolerance=1e-5)
    assert solution.converged
    assert not solution.loop.corners.any()
    assert rim_distance(solution) < 1e-6
    assert solution.area == pytest.approx(4.0905700, rel=1e-6)


def test_normals_follow_the_right_hand_rule_about_the_wire() -> None:
    wire = polygon(np.array([[0.0, 0, 0], [1, 0, 0.1], [1, 1, 0], [0, 1, 0.1]]))
    for shape, sign in ((wire, 1), (wire.wrapped.Reversed(), -1)):
        assert np.sign(solve_plateau(shape).loop.area_vector[2]) == sign


def test_curves_that_cross_say_where() -> None:
    with pytest.raises(SelfCrossingCurveError, match=r"near \((0.4[0-9]*), \1, 0.0\)"):
        solve_plateau(polygon(np.array([[0.0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]])))
    with pytest.raises(LoopsMeetError):
        solve_plateau([ring(1, 0), cad.Wire.make_circle(1).move(cad.Location((0.5, 0, 0)))])
