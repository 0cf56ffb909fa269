"""The list of routes of a loop, and the rule by which they are run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from spinor_geom import deadline, gallery
from spinor_geom.errors import DomainError, FirstFillError, OutOfTimeError, SingularMatrixError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.plateau import Cauchy, Laurent, solve_plateau
from spinor_geom.plateau.harmonic.harmonic_route import UNIT_DISK
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plan import _lower_on_circles, nearest_surface, plan
from spinor_geom.plateau.problem import PlateauProblem
from spinor_geom.plateau.rims.rims_route import RimsSolver
from spinor_geom.plateau.route_result import NoConnectedSurfaceError, RouteResult
from spinor_geom.plateau.vertices.vertex_route import THROUGH_POINTS
from tests.fill.shapes import circle
from tests.loops import CONVEX, noisy_ellipse, planar, uneven
from tests.plateau.rims import TETRAHEDRON, coaxial, facing, ring, sampled

SMOOTH = gallery.twisted_circle().sample(40)
SKEW = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 1), (1, 1, 0), (0, 1, 1)], corners=[0, 1, 2, 3])
SEEN = BoundaryLoop.from_points(gallery.schwarz_d_quadrilateral().sample(40).points)
# a saddle of seven points
T = 2 * np.pi * np.arange(7) / 7
FEW = BoundaryLoop.from_points(np.stack([np.cos(T), np.sin(T), 0.3 * np.cos(2 * T)], axis=1), corners=())


def rough_pair() -> list[BoundaryLoop]:
    """Two rims, one above the other, whose points are moved by a sixth of an edge."""
    rng = np.random.default_rng(1)
    rims = (sampled(curve, 64).points for curve in coaxial(0.4))
    return [BoundaryLoop.from_points(points + 0.016 * rng.normal(size=(64, 3)), corners=()) for points in rims]


def finger() -> BoundaryLoop:
    """A smooth ring with a finger half an edge wide and five edges long."""
    ring = circle(200, bend=0.3)
    out = np.array([(-1 - 0.028 * k, 0.008, 0.3) for k in range(1, 7)])
    return BoundaryLoop.from_points(np.concatenate([ring[:100], out, out[::-1] * [1, -1, 1], ring[101:]]), corners=())


def problem_of(loop, *, model="auto", between="free", tolerance=1e-3, on_iteration=None) -> PlateauProblem:
    loops = [loop] if isinstance(loop, (BoundaryLoop, ClosedCurve)) else loop
    return PlateauProblem.of(loops, Options(model=model, tolerance=tolerance, between=between), on_iteration)


# --- the plan ---------------------------------------------------------------------------------------------------------

SMOOTH_ONLY = {"between": "smooth"}
HARMONIC = ("flattened", "network")
FREE = (*HARMONIC, "vertices")
ROUGH = ("vertices", "flattened")
PLANS = {
    "smooth": (SMOOTH, SMOOTH_ONLY, ("disk", *HARMONIC)),
    "smooth, free": (SMOOTH, {}, ("disk", *FREE)),
    "a curve in formulas": (gallery.tennis_seam(0.8), {}, ("disk", *HARMONIC)),
    "long": (gallery.ellipse(4.0, 0.3).sample(64), {}, FREE),
    "rough": (noisy_ellipse(100), SMOOTH_ONLY, HARMONIC),
    "rough, free": (noisy_ellipse(100), {}, ROUGH),
    "uneven, free": (uneven(64), {}, ("disk", *FREE)),
    "rough, free, many": (noisy_ellipse(1600, amount=0.2), {}, HARMONIC),
    "few, free": (FEW, {}, ROUGH),
    "few": (FEW, SMOOTH_ONLY, ("disk", *HARMONIC)),
    "narrow finger, free": (finger(), {}, ("disk", *FREE)),
    "plane": (gallery.ellipse(8.0).sample(64), SMOOTH_ONLY, ("plane", *HARMONIC)),
    "plane, with corners": (planar(CONVEX, 20), {}, ("plane", "network")),
    "plane, by a network": (planar(CONVEX, 20), {"model": "cauchy"}, ("network",)),
    "corners": (SKEW, {}, ("network",)),
    "corners that are seen": (SEEN, SMOOTH_ONLY, ("network",)),
    "corners that are seen, free": (SEEN, {}, ("network", "vertices")),
    "by a network": (SMOOTH, {"model": Cauchy(degree=20)}, ("network",)),
    "power series": (SMOOTH, {"model": "series"}, ("disk",)),
    "power series, with corners": (SKEW, {"model": "series"}, ("disk",)),
    "several": (coaxial(0.5), {}, ("circles", "network")),
    "several, by a network": (coaxial(0.5), {"model": "cauchy"}, ("network",)),
    "several, in series": (coaxial(0.5), {"model": "series"}, ("circles",)),
    "several, rough": (rough_pair(), {}, ("vertices", "circles", "network")),
    "several, rough, smooth": (rough_pair(), SMOOTH_ONLY, ("circles", "network")),
    "several, rough, by modulus": (rough_pair(), {"model": Laurent()}, ("circles", "network")),
    "three": (facing(TETRAHEDRON[:3]), {}, ("circles", "network on circles")),
    "several, with corners": ((planar(CONVEX, 20), *coaxial(0.5)), {}, ("network on circles", "circles")),
    "several, plane": ((ring(1.0, 0.0), ring(0.5, 0.0)), {}, ("plane", "circles", "network")),
    "trained": (SMOOTH, {"model": "mlp"}, ("trained",)),
}


@pytest.mark.parametrize(("loop", "options", "routes"), PLANS.values(), ids=PLANS)
def test_plans(loop, options, routes):
    assert tuple(route.name for route in plan(problem_of(loop, **options))) == routes


def test_rims_that_a_cone_parts_have_no_plan():
    with pytest.raises(NoConnectedSurfaceError, match="opposite halves of a cone"):
        plan(problem_of(coaxial(1.0)))


# --- how it is run ----------------------------------------------------------------------------------------------------


@dataclass
class Fake:
    """A route that returns a given disk with a multiple of its distance from Γ, or raises an error, after one step."""

    answer: RouteResult | Exception
    farther: float = 1.0
    name: str = "disk"
    asked: list[PlateauProblem] = field(default_factory=list)

    def solve(self, problem: PlateauProblem) -> RouteResult:
        self.asked.append(problem)
        problem.steps.take("Douglas-Newton", 1.0)
        if isinstance(self.answer, Exception):
            raise self.answer
        return replace(self.answer, misfit=self.answer.misfit.enlarged(self.farther))


MET = UNIT_DISK.solve(problem_of(SMOOTH))
FAILURES = [DomainError("folded"), FirstFillError("no fill"), SingularMatrixError(size=3), SurfaceError("branched")]


def test_the_first_route_that_meets_the_tolerance_is_the_last():
    first, second = Fake(MET), Fake(MET)
    problem = problem_of(SMOOTH)
    assert nearest_surface((first, second), problem).surface_at is MET.surface_at
    assert (len(first.asked), len(second.asked)) == (1, 0)


@pytest.mark.parametrize("failure", FAILURES, ids=lambda error: type(error).__name__)
def test_after_a_route_that_fails_the_next_one_is_run(failure):
    steps = []
    problem = problem_of(SMOOTH, on_iteration=steps.append)
    disk = nearest_surface((Fake(failure), Fake(MET)), problem)
    assert disk.surface_at is MET.surface_at
    # its steps count
    assert [step.index for step in problem.solution(disk).history] == [1, 2]
    assert tuple(steps) == problem.solution(disk).history


@pytest.mark.parametrize(
    "failure", [*FAILURES, NoConnectedSurfaceError("collapsed")], ids=lambda error: type(error).__name__
)
def test_a_poor_disk_is_kept_if_the_next_route_fails(failure):
    problem = problem_of(SMOOTH)
    assert nearest_surface((Fake(MET, farther=1e9), Fake(failure)), problem).surface_at is MET.surface_at
    assert len(problem.steps.history) == 2
    with pytest.raises(type(failure)):
        nearest_surface((Fake(DomainError("crowded")), Fake(failure)), problem_of(SMOOTH))


def test_of_several_failures_that_of_a_surface_is_raised():
    with pytest.raises(SurfaceError, match="branched"):
        nearest_surface((Fake(SurfaceError("branched")), Fake(DomainError("folded"))), problem_of(SMOOTH))


@pytest.mark.parametrize("farther", [(1e9, 1e8), (1e8, 1e9)])
def test_the_nearest_surface_is_taken_where_none_meets_the_tolerance(farther):
    problem = problem_of(SMOOTH)
    disk = nearest_surface([Fake(MET, farther=times) for times in farther], problem)
    assert disk.misfit.rms == 1e8 * MET.misfit.rms
    assert len(problem.steps.history) == 2


def test_a_surface_through_points_is_measured_from_the_curve_that_they_show():
    problem = problem_of(SMOOTH)
    missed = 2e-3 * problem.unit.mean_edge_length / MET.misfit.rms
    # it passes through the points, but between them it is a hundredth of an edge from the curve
    through = Fake(THROUGH_POINTS.solve(problem))
    assert nearest_surface((Fake(MET, farther=missed), through), problem).route == "disk"
    assert nearest_surface((Fake(MET, farther=100 * missed), through), problem).route == "vertices"


def test_time_that_is_over_ends_the_plan():
    second = Fake(MET)
    with deadline.time_limit(0), pytest.raises(OutOfTimeError):
        nearest_surface((second,), problem_of(SMOOTH))
    assert not second.asked


def test_the_limit_on_steps_holds_for_the_whole_plan():
    steps = []
    solution = solve_plateau(SMOOTH, tolerance=1e-15, max_iterations=5, on_iteration=steps.append)
    assert tuple(steps) == solution.history
    assert [step.index for step in steps] == [1, 2, 3, 4, 5]
    assert "limit on steps" in solution.reason


def test_a_search_for_a_lower_annulus_is_no_verdict(monkeypatch):
    def none(*_, **__):
        raise NoConnectedSurfaceError("no minimum")

    rings = [ring(1.0, -0.3), ring(1.0, 0.3)]
    solution = solve_plateau(rings)
    monkeypatch.setattr(RimsSolver, "on_circles", none)
    assert _lower_on_circles(PlateauProblem.of(rings, Options()), solution) is None
