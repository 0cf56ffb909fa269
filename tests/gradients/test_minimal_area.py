"""`minimal_area` as a torch function: against differences, arguments, and errors."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import spinor_geom
from spinor_geom.errors import OptionError, UncertainGradientWarning
from tests.gradients.cases import LIFT, QUADRILATERAL, RING, enneper_boundary, wavy


def tensor(points):
    return torch.tensor(points, requires_grad=True)


def test_value_and_gradient_are_those_of_the_solution():
    points = tensor(wavy(64))
    area = spinor_geom.minimal_area(points)
    solution = spinor_geom.solve_plateau(wavy(64), between="quintic", tolerance=1e-6)
    assert area.item() == solution.area
    (3 * area).backward()
    assert np.array_equal(points.grad.numpy(), 3 * solution.area_gradient[0])


GENERIC = {"uniform": wavy(48), "uneven": wavy(60, uneven=1), "few": wavy(10)}
GENERIC |= {"rough": wavy(40) + 0.01 * np.random.default_rng(0).normal(size=(40, 3))}
# nodes of the unit disk are far apart on the narrow part of the first. The second bounds two disks, of equal area
X, Y = np.cos(2 * np.pi * np.arange(80) / 80), np.sin(2 * np.pi * np.arange(80) / 80)
GENERIC |= {"narrow": np.stack([X * (X + 0.3), Y * (X + 0.6), 0.8 * Y], axis=1), "two disks": enneper_boundary(1.3)}


@pytest.mark.parametrize("points", GENERIC.values(), ids=GENERIC)
def test_area_and_gradient_are_smooth_in_generic_directions(points):
    # of kinds of curves that are chosen by the points, the first and the last two change with such moves
    move = np.random.default_rng(3).normal(size=points.shape)
    move *= np.linalg.norm(np.diff(points, axis=0), axis=1).mean() / np.linalg.norm(move, axis=1).mean()

    def value_and_gradient(size):
        moved = tensor(points + size * move)
        area = spinor_geom.minimal_area(moved)
        area.backward()
        return area.item(), moved.grad.numpy()

    here, gradient = value_and_gradient(0)
    _, beside = value_and_gradient(1e-5)
    assert np.linalg.norm(beside - gradient) < 1e-4 * np.linalg.norm(gradient)
    steps = 0.02 / 2 ** np.arange(3)
    remainders = [abs(value_and_gradient(h)[0] - here - h * (gradient * move).sum()) for h in steps]
    assert abs(np.polyfit(np.log(steps), np.log(remainders), 1)[0] - 2) < 0.1


def test_named_corners_and_float32():
    points = torch.tensor(QUADRILATERAL, dtype=torch.float32, requires_grad=True)
    spinor_geom.minimal_area(points, corners=[0, 1, 2, 3]).backward()
    loop = spinor_geom.BoundaryLoop.from_points(QUADRILATERAL, corners=range(4))
    (gradient,) = spinor_geom.solve_plateau(loop, tolerance=1e-6).area_gradient
    assert points.grad.dtype == torch.float32
    assert points.grad.numpy() == pytest.approx(gradient, abs=1e-6)


def test_missed_curve_warns():
    # on the disk, where power series converge slowly at the bend
    bent = wavy(24) * [1, 1, 2]
    with pytest.warns(UncertainGradientWarning, match="has not converged"):
        spinor_geom.minimal_area(tensor(bent), model="series", tolerance=1e-16)


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (wavy(32), {}, "must be a real tensor"),
        ([torch.tensor(RING), RING], {}, "must be a real tensor"),
        (torch.arange(9).reshape(3, 3), {}, "must be a real tensor"),
        ([], {}, "got no rim"),
        ([torch.tensor(RING - LIFT), torch.tensor(RING + LIFT)], {"corners": [()]}, "one entry for each of 2 rims"),
        (torch.tensor(wavy(32)[[*range(32), 0]]), {}, "equal to the first"),
    ],
)
def test_wrong_arguments(points, options, message):
    with pytest.raises(OptionError, match=message):
        spinor_geom.minimal_area(points, **options)
