"""The gradient of the area against differences of solves, known areas, and invariants, in every route."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from spinor_geom import gallery, solve_plateau
from spinor_geom.errors import NotDifferentiableError
from spinor_geom.gradients import rim_nodes
from spinor_geom.gradients.area import area_gradient
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.gradients.cases import LINKED, RING, ROUTES, difference, moved, moves_of, names, order_of, solved, wavy

# relative error of gradients and of differences of solves. Networks are fitted to 1e-5 of an edge, whose square counts
ERROR = 1e-6
TURN = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def along(gradients, moves):
    return sum(float((rows * move).sum()) for rows, move in zip(gradients, moves, strict=True))


@pytest.mark.parametrize("name", names())
def test_gradient_equals_differences(name):
    rims, moves, gradients = ROUTES[name], moves_of(name), solved(name).area_gradient
    slope = difference(lambda size: solved(name, moved(rims, moves, size)).area)
    assert abs(along(gradients, moves) - slope) < ERROR * sum(map(np.linalg.norm, gradients))


@pytest.mark.parametrize("name", names("network", "flattened"))
def test_remainder_is_of_second_order_wherever_the_rims_are(name):
    rims = [50 * rim @ TURN.T + [3, -2, 50] for rim in ROUTES[name]]
    moves = [50 * move @ TURN.T for move in moves_of(name)]
    here = solved(name, rims)
    slope = along(here.area_gradient, moves)
    order = order_of(lambda step: abs(solved(name, moved(rims, moves, step)).area - here.area - step * slope))
    assert abs(order - 2) < 0.1  # the terms of third order


@pytest.mark.parametrize("name", [*names(), *LINKED])
def test_rigid_motions_and_scale(name):
    solution, rims = solved(name), (ROUTES | LINKED)[name]
    gradients = solution.area_gradient
    scale = sum(map(np.linalg.norm, gradients))
    assert np.abs(sum(rows.sum(axis=0) for rows in gradients)).max() < ERROR * scale
    torque = sum(np.cross(points, rows).sum(axis=0) for rows, points in zip(gradients, rims, strict=True))
    assert np.abs(torque).max() < ERROR * scale * np.ptp(np.concatenate(rims))
    # the area is homogeneous of degree 2
    assert along(gradients, rims) == pytest.approx(2 * solution.area, rel=ERROR)


@pytest.mark.parametrize("half", [0.1, 0.4, 0.6])
def test_force_of_the_catenoid(half):
    lift = np.array([0, 0, half])
    catenoid = solve_plateau([RING - lift, RING + lift])
    _, above = catenoid.area_gradient
    neck = brentq(lambda c: c * np.cosh(half / c) - 1, 0.5524, 1.0)
    # the circle through 64 points is exact, as is the force on it
    assert above.sum(axis=0) == pytest.approx([0, 0, 2 * np.pi * neck], abs=1e-9)


def test_change_by_the_parameter_of_a_family():
    # the amplitude of the tennis seam, against differences of areas known to 13 digits
    def points(a):
        return gallery.tennis_seam(a).sample(128).points

    def area(a):
        return solve_plateau(points(a), model="series").area

    (gradient,) = solve_plateau(points(0.8), model="series").area_gradient

    def slope(of):
        return (8 * (of(0.801) - of(0.799)) - (of(0.802) - of(0.798))) / 0.012

    # the displacement has an error of order step⁴
    assert (gradient * slope(points)).sum() == pytest.approx(slope(area), rel=1e-8)


@pytest.mark.parametrize(("name", "kind"), [("disk, spline of degree 7", "spline"), ("flattened, rough", "cubic")])
def test_forces_on_single_points_are_resolved(name, kind, monkeypatch):
    solution = solved(name)
    (here,) = area_gradient(solution)
    assert solution.curve.kind == kind
    monkeypatch.setitem(rim_nodes._STEPS, solution.curve.degree, 64)
    (fine,) = area_gradient(solution)
    # the trapezoidal rule across the points, where derivatives of order 7 and 3 jump
    assert np.abs(here - fine).max() < 2e-5 * np.abs(fine).max()


def test_free_curve_between_points_has_no_gradient():
    rough = BoundaryLoop.from_points(wavy(40) + 0.05 * np.random.default_rng(0).normal(size=(40, 3)), corners=[])
    solution = solve_plateau(rough)
    assert solution.route == "vertices"
    with pytest.raises(NotDifferentiableError, match="between='smooth'"):
        area_gradient(solution)
    # with more nodes than where the surface through the points would take less time
    along = solve_plateau(rough, between="quintic", tolerance=1e-6)
    assert along.converged
    assert np.isfinite(along.area_gradient[0]).all()
