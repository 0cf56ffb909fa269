"""Frames with at most four corners become one patch whose lines follow the frame."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import spinor_geom
from spinor_geom.adapters.open_cascade import read_shape
from spinor_geom.gallery import curves
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.nurbs import nurbs_surface, strips
from spinor_geom.nurbs.corner_patches import CornerPatches
from spinor_geom.nurbs.rims import Rim
from tests.open_cascade import free_wires, is_valid

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def frame(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return SQUARE * [random.uniform(1, 4), 1, 1] + random.uniform(-0.35, 0.35, (4, 3))


@pytest.mark.parametrize("corners", list(map(frame, range(3))))
def test_frames_with_four_corners_are_one_patch(corners: np.ndarray) -> None:
    solution = spinor_geom.solve_plateau(curves.polygon(corners))
    surface = solution.to_nurbs()
    assert surface.converged
    assert len(surface.patches) == 1
    assert abs(surface.area / solution.area - 1) < 1e-8
    at, ((rim),) = np.linspace(0, 1, 9)[:, None], surface.boundary_curves
    for curve, start, end in zip(rim, corners, np.roll(corners, -1, axis=0), strict=True):
        assert np.abs(curve.point(at[:, 0]) - (start + at * (end - start))).max() < 1e-7  # lines follow the frame
    assert is_valid(surface.shell())
    assert free_wires(surface.shell()) == (1, 0, 4)


ARCH = np.linspace(-1, 1, 33)[:, None]
ABOVE, BELOW = [5, 0, 0] * ARCH + [0, 1, 0] * (1 - ARCH**2), [-5, 0, 0] * ARCH + [0, -1, 1] * (1 - ARCH**2)


@pytest.mark.parametrize("sides", [[ABOVE, BELOW], [ABOVE, [[5, 0, 0]], [[1, -4, 0]]]], ids=["lens", "triangle"])
def test_surfaces_over_two_or_three_sides_are_one_patch(sides: list[np.ndarray]) -> None:
    points = np.concatenate([np.asarray(side)[: max(1, len(side) - 1)] for side in sides])
    starts = np.cumsum([0, *(max(1, len(side) - 1) for side in sides)])[:-1].tolist()
    points += [0, 0, 0.02] * (points[:, :1] + points[:, 1:2]) ** 2
    solution = spinor_geom.solve_plateau(BoundaryLoop.from_points(points, corners=starts))
    surface = solution.to_nurbs(tolerance=1e-5)
    assert surface.converged
    assert len(surface.patches) == 1
    assert abs(surface.area / solution.area - 1) < 1e-6
    assert is_valid(surface.shell())
    assert free_wires(surface.shell()) == (1, 0, len(sides))


@pytest.mark.parametrize("degrees", [10, 5])
def test_a_patch_with_a_sharp_angle_meets_its_frame(degrees: float, tmp_path: Path) -> None:
    tip = np.radians(degrees)
    corners = np.array([[0, 0, 0], [10, 0, 0], [12, 1, 2], [10 * np.cos(tip), 10 * np.sin(tip), 0]])
    solution = spinor_geom.solve_plateau(curves.polygon(corners))
    surface = replace(solution, solved_to=None).to_nurbs()  # no nearer solution: Ω cannot be divided at the tip
    assert len(surface.patches) == 1
    assert not surface.converged
    assert surface.deviations.rim < 1e-9 * surface.deviations.diagonal
    surface.save(tmp_path / "film.step")
    assert is_valid(read_shape(tmp_path / "film.step"))


@pytest.mark.parametrize(("degrees", "is_one"), [(8, True), (20, True), (60, False)])
def test_a_single_sharp_corner_is_a_pole_of_one_patch(degrees: float, is_one: bool, tmp_path: Path) -> None:
    a = np.linspace(-1, 1, 65)[:-1]  # a bent drop: its tip at -1, its nose at 0
    drop = np.column_stack([20 * a**2, 20 * np.tan(np.radians(degrees / 2)) * a * (1 - a**2), 8 * a**2 * (1 - a**2)])
    solution = spinor_geom.solve_plateau(BoundaryLoop.from_points(drop, corners=[0]), tolerance=1e-5)
    surface = solution.to_nurbs()
    assert surface.converged
    assert (len(surface.patches) == 1) == is_one
    assert abs(surface.area / solution.area - 1) < 1e-6
    surface.save(tmp_path / "film.step")
    shape = read_shape(tmp_path / "film.step")
    assert is_valid(shape)
    assert free_wires(shape)[:2] == (1, 0)


def test_a_disk_is_divided_where_one_patch_would_be_folded() -> None:
    """One side has a peak: lines between equal shares of opposite sides cross its flank."""
    x = np.concatenate([np.linspace(0, 0.1, 4)[:-1], np.linspace(0.1, 0.3, 40), np.linspace(0.3, 1, 8)[1:]])
    for height, is_folded in ((0.7, True), (0.0, False)):
        side = np.column_stack([x, height * np.exp(-(((x - 0.2) / 0.06) ** 2)), 0 * x])
        points, n = np.concatenate([side, [[1, 1, 0], [0, 1, 0]]]), len(x)
        solution = spinor_geom.solve_plateau(BoundaryLoop.from_points(points, corners=[0, n - 1, n, n + 1]))
        found = CornerPatches.of(solution.domain, Rim.all_of(solution))
        assert (found is None or len(found.quads) > 1) == is_folded


def test_a_dart_is_two_patches_on_both_sides_of_its_reentrant_corner(tmp_path: Path) -> None:
    """Tips of 10°, which a ring of patches along the rim cannot pass."""
    corners = np.array([[-1, 0, 0], [0, np.tan(np.radians(20)), 0.02], [0.9, 0, 0], [0, np.tan(np.radians(30)), 0]])
    solution = spinor_geom.solve_plateau(curves.polygon(corners))
    surface = solution.to_nurbs(tolerance=1e-5)
    assert surface.converged
    assert len(surface.patches) == 2
    assert len(surface.seams) == 1
    assert abs(surface.area / solution.area - 1) < 1e-5  # the tolerance
    surface.save(tmp_path / "film.step")
    shape = read_shape(tmp_path / "film.step")
    assert is_valid(shape)
    assert free_wires(shape) == (1, 0, 4)


def test_positions_are_continuous_at_corners() -> None:
    """Integrals along segments, which end near poles there, jump by 2e-8 of the diagonal."""
    solution = spinor_geom.solve_plateau(curves.polygon(frame(0)))
    (rim,) = Rim.all_of(solution)
    t = rim.on_boundary(rim.corners)
    inside = rim.boundary.point(t) * (1 - 1e-12) + 1e-12 * solution.domain.triangulation.points.mean()
    assert np.abs(rim.positions_inside(inside) - rim.positions(t)).max() < 1e-9 * solution.diagonal


def test_a_patch_that_was_cut_short_is_kept_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is still time, but less than several patches would take."""
    solution = spinor_geom.solve_plateau(curves.polygon(frame(0)))
    for module in (nurbs_surface, strips):
        monkeypatch.setattr(module, "seconds_left", lambda: 1e-6)
    surface = solution.to_nurbs()
    assert len(surface.patches) == 1
    assert not surface.converged
    assert abs(surface.area / solution.area - 1) < 1e-3
