"""Frames with two to four corners become one patch whose lines follow the frame."""

import numpy as np
import pytest

import spinor_geom
from spinor_geom.gallery import curves
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.open_cascade import free_wires, is_valid

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def frame(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return SQUARE * [random.uniform(1, 4), 1, 1] + random.uniform(-0.35, 0.35, (4, 3))


@pytest.mark.parametrize("corners", [*map(frame, range(3)), SQUARE], ids=["0", "1", "2", "plane"])
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


@pytest.mark.parametrize("angle", [3, 15, 40])
def test_sharp_triangles_are_one_patch(angle: float) -> None:
    turn = np.radians(angle)
    solution = spinor_geom.solve_plateau(
        curves.polygon([[0, 0, 0], [9, 0, 0], [10 * np.cos(turn), 10 * np.sin(turn), 0]])
    )
    surface = solution.to_nurbs()
    assert len(surface.patches) == 1
    assert surface.area == pytest.approx(45 * np.sin(turn), rel=1e-12)
    assert is_valid(surface.shell())
    assert free_wires(surface.shell()) == (1, 0, 3)


def test_surfaces_between_two_arcs_are_one_patch() -> None:
    t = np.linspace(-1, 1, 33)
    arcs = [np.column_stack([5 * t, 1 - t**2, 0 * t]), np.column_stack([-5 * t, t**2 - 1, 1 - t**2])]
    points = np.concatenate([arc[:-1] for arc in arcs])
    solution = spinor_geom.solve_plateau(BoundaryLoop.from_points(points, corners=[0, 32]))
    surface = solution.to_nurbs(tolerance=1e-5)
    assert surface.converged
    assert len(surface.patches) == 1
    assert abs(surface.area / solution.area - 1) < 1e-6
    assert free_wires(surface.shell()) == (1, 0, 2)


def test_frames_that_a_single_patch_would_fold_over_get_several() -> None:
    """One side has a peak: lines between equal shares of opposite sides cross its flank."""
    x = np.concatenate([np.linspace(0, 0.1, 4)[:-1], np.linspace(0.1, 0.3, 40), np.linspace(0.3, 1, 8)[1:]])
    side = np.column_stack([x, 0.7 * np.exp(-(((x - 0.2) / 0.06) ** 2)), 0 * x])
    points = np.concatenate([side, [[1, 1, 0], [0, 1, 0]]])
    n = len(points)
    solution = spinor_geom.solve_plateau(BoundaryLoop.from_points(points, corners=[0, n - 3, n - 2, n - 1]))
    surface = solution.to_nurbs(tolerance=1e-4)
    assert len(surface.patches) > 1
    assert abs(surface.area / solution.area - 1) < 1e-5
