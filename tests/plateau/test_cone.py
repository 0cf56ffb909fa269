"""The cone that separates rims between which there is no minimal annulus."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import NoConnectedSurface
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.rims_route import RimsSolver, parted_by_cone
from spinor_geom.plateau.route_result import NoConnectedSurfaceError
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.plateau.threads import one_thread
from tests.plateau.rims import coaxial, ring, sampled

CRITICAL = 0.662743419349181580975  # of unit circles at heights ±h


def curves(pair):
    of = {True: BoundaryCurve.from_loop, False: BoundaryCurve.from_formula}
    return tuple(of[isinstance(one, BoundaryLoop)](one) for one in pair)


@pytest.mark.parametrize(("share", "parted"), [(0.5, False), (0.99999, False), (1.0003, True), (2.0, True)])
def test_coaxial_circles_are_parted_just_beyond_the_critical_distance(share, parted):
    # the control points of 64 pieces lie 1.2e-4 off the circle
    first, second = curves(coaxial(share * CRITICAL))
    assert parted_by_cone(first, second) == parted
    assert parted_by_cone(second, first) == parted
    assert parted_by_cone(first, second.reversed()) == parted


def test_bulges_between_the_points_count():
    corners = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for kinks, parted in (((0, 1, 2, 3), True), ((), False)):
        pair = (BoundaryLoop.from_points(corners + np.array([0, 0, z]), corners=kinks) for z in (0.7, -0.7))
        assert parted_by_cone(*curves(pair)) == parted


def test_ends_of_a_long_tube_have_no_annulus():
    # tilted and rough, with radii 1.8 and 1.6 and 6.6 apart, like the ends of a piece of a vein
    first, second = (sampled(ring(radius, z), n).points for radius, z, n in ((1.8, 3.3, 29), (1.6, -3.3, 31)))
    rng = np.random.default_rng(3)
    first = first + 0.3 * first[:, :1] * [0, 0, 1] + 0.02 * rng.normal(size=first.shape)
    second = second - 0.4 * second[:, 1:2] * [0, 0, 1] + 0.02 * rng.normal(size=second.shape)
    loops = tuple(BoundaryLoop.from_points(points, corners=()) for points in (first, second))
    answer = solve_plateau(loops)
    assert isinstance(answer, NoConnectedSurface)
    assert "cone" in answer.reason
    assert answer.area == sum(disk.area for disk in answer.disks)
    assert all(disk.converged for disk in answer.disks)
    assert solve_plateau(loops, all_solutions=True) == ()


@pytest.mark.parametrize(
    "pair",
    [coaxial(0.67), coaxial(1.0), (ring(1.2, 0.9, stretch=1.3), ring(0.7, -0.9, centre=(0.2, 0.3)))],
    ids=["just beyond", "far beyond", "eccentric"],
)
def test_the_search_finds_none_where_the_cone_excludes_a_surface(pair):
    assert "cone" in solve_plateau(pair).reason
    # as within solves, overflows of trial steps are ignored
    with one_thread(), pytest.raises(NoConnectedSurfaceError, match="modulus"):
        RimsSolver(problem=PlateauProblem.of(pair, Options())).on_circles()
