"""The reported residual equals an independent evaluation of the returned surface."""

import pickle
import re

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.misfit import LOCAL_TOLERANCES
from tests.loops import noisy_ellipse, planar, ramp
from tests.plateau.rims import circle, knoid
from tests.plateau.solved import measured, spanned
from tests.systems import every_second


@pytest.mark.parametrize(
    "solve",
    [lambda: solve_plateau(noisy_ellipse(), tolerance=1e-2, between="smooth"), lambda: spanned("saddle 8:1")],
    ids=["noisy", "saddle"],
)
def test_reported_residual_is_the_measured_one(solve):
    solution = solve()
    rms, largest = measured(solution.surface, solution.curve)
    reported = solution.boundary_residual
    # positions are integrated inside Ω, the report's along ∂Ω: they differ by the quadrature's error
    rounding = 1e-9 * solution.loop.diagonal
    assert abs(rms - reported.rms) < 0.1 * reported.rms + rounding
    assert abs(largest - reported.max) < 0.2 * reported.max + 10 * rounding


TRIANGLE = BoundaryLoop.from_points([(0, 0, 0), (5, 0, 0), (0, 1, 0)], corners=range(3))
HEXAGON = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], corners=range(6))
QUADRILATERAL = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 0), (1, 1, 0.6), (0, 1, 0)], corners=range(4))
# a loop or several, options, and the route on which the surface is found
ROUTES = {
    "plane": (TRIANGLE, {}, "plane"),
    "disk": (gallery.enneper(0.8).rim(24), {}, "disk"),
    "series": (gallery.tennis_seam(0.6).sample(48), {"model": "series"}, "disk"),
    "flattened": (ramp(0.9, 80), {}, "flattened"),
    "vertices": (noisy_ellipse(40), {}, "vertices"),
    "sides": (HEXAGON, {}, "network"),
    "quadrilateral": (QUADRILATERAL, {}, "network"),
    "corners": (planar([(0, 0), (3, 0), (3, 1)], 10), {"model": "cauchy"}, "network"),
    "network": (gallery.tennis_seam(0.6).sample(48), {"model": "cauchy"}, "network"),
    "annulus": ([circle((0, 0, h), (0, 0, 1), 1.0, 24) for h in (0.0, 0.5)], {}, "annulus"),
    "annular network": (
        [circle((0, 0, h), (0, 0, 1), 1.0, 24) for h in (0.0, 0.5)],
        {"model": "cauchy"},
        "annular network",
    ),
    "circles": (knoid(3, 0.4, 32), {}, "circles"),
}


@pytest.mark.parametrize("tolerance", every_second([1e-2, 1e-6]))
@pytest.mark.parametrize("name", ROUTES)
def test_flag_and_reason_agree_with_the_residual(name: str, tolerance: float) -> None:
    rims, options, route = ROUTES[name]
    solution = solve_plateau(rims, tolerance=tolerance, max_iterations=20, **options)
    residual = solution.boundary_residual
    assert solution.route == route or tolerance < 1e-2
    assert solution.tolerance == tolerance
    is_met = residual.rms_per_edge <= tolerance and residual.max_per_local_edge <= LOCAL_TOLERANCES * tolerance
    assert solution.converged == is_met
    sentence = r"residual (\S+) of the mean edge after \d+ steps(, above the tolerance (\S+):|, but|;|$)"
    reported = re.match(sentence, solution.reason)
    # the sentence has two digits
    assert float(reported[1]) == float(f"{residual.rms_per_edge:.1e}")
    assert reported[3] is None or float(reported[3]) == tolerance
    assert ("above" in solution.reason) == (not is_met)
    mean_edge = sum(rim.loop.perimeter for rim in solution.rims) / sum(len(rim.loop) for rim in solution.rims)
    # sums of lengths in another order
    assert abs(residual.mean_edge / mean_edge - 1) < 1e-12
    again = pickle.loads(pickle.dumps(solution))
    assert (again.area, again.route, again.reason) == (solution.area, solution.route, solution.reason)
    # made by the copy itself
    assert np.array_equal(again.surface.position(0.5 + 0.2j), solution.surface.position(0.5 + 0.2j), equal_nan=True)
    if solution.annulus is not None:
        assert again.annulus.disk_area == solution.annulus.disk_area
