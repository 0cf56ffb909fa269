"""Curves in formulas: minimal disks to rounding error on the unit disk, and by every other route."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.surface.formulas import phi

SMOOTH = [gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75)]


@pytest.mark.parametrize("curve", SMOOTH, ids=lambda curve: curve.name)
def test_smooth_curves_are_met_to_rounding_error(curve):
    solution = solve_plateau(curve, model="series", unstable="keep")
    assert solution.route == "disk"
    assert isinstance(solution.array_surface.model, PowerSeries)
    assert solution.boundary_residual.max_per_diagonal < 1e-13
    # the start leads to the symmetric disk, which is unstable at a = 0.75
    known = curve.disks[-1]
    assert solution.stability.verdict == ("unstable" if known.stable is False else "stable")
    assert abs(solution.area / known.area - 1) < 1e-13
    assert abs(solution.area_in_domain / solution.area - 1) < 1e-4
    z = np.exp(2j * np.pi * np.arange(97) / 97)
    velocity = phi(*np.array(solution.surface.spinors(z)).T)
    assert np.abs((velocity * velocity).sum(-1)).max() < 1e-13 * np.square(np.abs(velocity)).sum(-1).max()
    on_boundary = solution.surface.position(z)
    nearest = solution.curve.point(solution.curve.nearest(on_boundary))
    assert np.abs(on_boundary - nearest).max() < 1e-13


def test_steps_at_a_saddle_end_before_rounding_errors_lead_away():
    assert len(solve_plateau(gallery.tennis_seam(0.75), model="series", unstable="keep").history) < 15


def test_series_stay_series_where_the_unit_disk_has_no_room_for_a_stable_one():
    solution = solve_plateau(gallery.tennis_seam(0.6), model="series")
    assert isinstance(solution.array_surface.model, PowerSeries)
    assert solution.stability.verdict == "unstable"
    assert "no better one was found among power series; model='auto' searches further" in solution.reason


@pytest.mark.parametrize(
    "curve", [gallery.ellipse(8.0, 0.5), gallery.schwarz_d_hexagon()], ids=["long", "with corners"]
)
def test_curves_that_do_not_suit_the_disk_are_refused(curve):
    with pytest.raises(DomainError, match="power series on the disk"):
        solve_plateau(curve, model="series")


@pytest.mark.parametrize(
    ("curve", "route", "error"),
    [
        (gallery.ellipse(4.0), "plane", 1e-12),
        (gallery.ellipse(32.0), "plane", 1e-12),
        (gallery.tennis_seam(0.8), "disk", 1e-8),
        (gallery.schwarz_d_quadrilateral(), "network", 1e-6),
        (gallery.scherk(2.0), "network", 1e-5),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_every_route_takes_formulas(curve, route, error):
    solution = solve_plateau(curve, tolerance=1e-4)
    assert (solution.route, solution.converged) == (route, True)
    assert abs(solution.area / curve.disks[0].area - 1) < error


def test_any_object_with_the_three_formulas_will_do():
    seam = gallery.tennis_seam(0.8)
    formulas = ClosedCurve(
        point=lambda s: 5 * seam.point(s) + [1, 2, 3],
        derivative=lambda s: 5 * seam.derivative(s),
        second_derivative=lambda s: 5 * seam.second_derivative(s),
    )
    solution = solve_plateau(formulas, model="series")
    assert abs(solution.area / (25 * seam.disks[0].area) - 1) < 1e-13
