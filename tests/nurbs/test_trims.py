"""Plane surfaces are one plane face, bounded by the curves."""

from pathlib import Path

import numpy as np
import pytest

import spinor_geom
from spinor_geom.adapters.open_cascade import read_shape
from spinor_geom.gallery import curves
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solution import PlateauSolution
from tests.open_cascade import area_of, count, free_wires, is_valid

TURN, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))


def placed(outline: np.ndarray, corners: list[int]) -> BoundaryLoop:
    points = np.column_stack([outline, np.zeros(len(outline))]) @ TURN.T + [5, 6, 7]
    return BoundaryLoop.from_points(points, corners=corners)


def circle(radius: float, count: int = 64) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def cusps() -> PlateauSolution:
    """Between a corner and a circle that touches both its edges."""
    angle = np.linspace(1.5 * np.pi, np.pi, 33)
    arc = 10 + 10 * np.column_stack([np.cos(angle), np.sin(angle)])
    return spinor_geom.solve_plateau(placed(np.concatenate([[[0, 0]], arc]), [0, 1, 33]))


THIN = [[0, 0, 0], [9, 0, 0], [10 * np.cos(0.05), 10 * np.sin(0.05), 0]]
CASES = {
    "thin": (lambda: spinor_geom.solve_plateau(curves.polygon(THIN)), 45 * np.sin(0.05), 1, 3, 1e-13),
    "cusps": (cusps, 100 - 25 * np.pi, 1, 3, 1e-4),
    "L": (lambda: spinor_geom.solve_plateau(curves.l_shape()), 3.0, 1, 6, 1e-14),
    "disk": (lambda: spinor_geom.solve_plateau(placed(circle(2), [])), 4 * np.pi, 1, 1, 1e-6),
    "annulus": (lambda: spinor_geom.solve_plateau([placed(circle(r), []) for r in (1, 2)]), 3 * np.pi, 2, 2, 1e-6),
}


@pytest.mark.parametrize("name", CASES)
def test_plane_surfaces_are_one_plane_face(name: str, tmp_path: Path) -> None:
    solve, area, wires, edges, accuracy = CASES[name]
    solution = solve()
    surface = solution.to_nurbs()
    assert surface.converged is True
    assert len(surface.boundary_curves) == wires
    assert surface.area == pytest.approx(area, rel=accuracy)
    assert surface.area == pytest.approx(solution.area, rel=1e-6)
    surface.save(tmp_path / "face.step")
    for shape in (surface.shell(), read_shape(tmp_path / "face.step")):
        assert is_valid(shape)
        assert count(shape, "face") == 1
        assert free_wires(shape) == (wires, 0, edges)
        assert area_of(shape) == pytest.approx(area, rel=max(accuracy, 1e-5))


def test_ragged_rims_are_followed() -> None:
    angle, random = 2 * np.pi * np.arange(1000) / 1000, np.random.default_rng(0)
    radius = 1 + 0.2 * np.sin(5 * angle) + 0.002 * random.uniform(-1, 1, 1000)
    outline = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    solution = spinor_geom.solve_plateau(placed(outline, []))
    surface = solution.to_nurbs()
    assert surface.converged
    assert surface.area == pytest.approx(solution.area, rel=1e-8)
    ((side,),) = surface.boundary_curves
    at = np.random.default_rng(1).random(5000)
    assert np.abs(side.point(at) - solution.curve.point(at)).max() < 1e-6 * surface.deviations.diagonal


def test_areas_in_cad_of_lines_and_arcs_tangent_to_them() -> None:
    cad = pytest.importorskip("build123d")
    ends = [cad.ThreePointArc((side, -2, 0), (1.1 * side, 0, 0), (side, 2, 0)) for side in (20, -20)]
    lines = [cad.Line((-20, side, 0), (20, side, 0)) for side in (-2, 2)]
    surface = spinor_geom.solve_plateau([*ends, *lines]).to_nurbs()
    assert len(surface.trims[0]) == 4
    # build123d integrates along edges with a fixed number of points: of one spline around the slot it was 1 % off
    assert surface.to_build123d().area == pytest.approx(160 + 4 * np.pi, rel=1e-7)
