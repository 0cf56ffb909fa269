"""The plan of a loop, and the one rule by which its routes are run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from spinor_geom import deadline, gallery
from spinor_geom.errors import DomainError, FirstFillError, OutOfTimeError, SingularMatrixError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.plateau import Cauchy, Laurent, solve_plateau
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plan import (
    Route,
    Task,
    nearest_surface,
    plan,
)
from spinor_geom.plateau.route_result import Found, NoneBetweenError
from tests.loops import CONVEX, noisy_ellipse, planar
from tests.plateau.rims import TETRAHEDRON, coaxial, facing, ring, sampled

SMOOTH = gallery.twisted_circle().sample(40)
SKEW = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 1), (1, 1, 0), (0, 1, 1)], corners=[0, 1, 2, 3])
SEEN = gallery.schwarz_d_quadrilateral().sample(40)
# a saddle of seven points
FEW = BoundaryLoop.from_points(
    [(np.cos(t), np.sin(t), 0.3 * np.cos(2 * t)) for t in 2 * np.pi * np.arange(7) / 7], corners=()
)


def rough_pair() -> list[BoundaryLoop]:
    """Two rims, one above the other, whose points are moved by a sixth of an edge."""
    rng = np.random.default_rng(1)
    return [
        BoundaryLoop.from_points(one.points + 0.016 * rng.normal(size=(64, 3)), corners=())
        for one in (sampled(curve, 64) for curve in coaxial(0.4))
    ]


def finger() -> BoundaryLoop:
    """A smooth ring with a finger half an edge wide and five edges long."""
    t = 2 * np.pi * np.arange(200) / 200
    ring = np.column_stack([np.cos(t), np.sin(t), 0.3 * np.cos(2 * t)])
    out = np.array([(-1 - 0.028 * k, 0.008, 0.3) for k in range(1, 7)])
    return BoundaryLoop.from_points(np.concatenate([ring[:100], out, out[::-1] * [1, -1, 1], ring[101:]]), corners=())


def narrow() -> BoundaryLoop:
    """A smooth loop of 40 points that nearly touches itself: its waist is a third of an edge wide."""
    t = 2 * np.pi * np.arange(40) / 40
    return BoundaryLoop.from_points(
        np.column_stack([np.cos(t), np.sin(t) * (0.03 + np.cos(t) ** 2), 0.2 * np.sin(2 * t)]), corners=()
    )


def task_of(loop, *, model="auto", between="auto", tolerance=1e-3, on_iteration=None) -> Task:
    loops = [loop] if isinstance(loop, (BoundaryLoop, ClosedCurve)) else loop
    return Task.of(loops, Options(model=model, tolerance=tolerance, between=between), on_iteration)


# --- the plan ---------------------------------------------------------------------------------------------------------

HARMONIC = (Route.ON_UNFOLDING, Route.ON_FLATTENING, Route.BY_NETWORK)
ROUGH = (Route.ON_FLATTENING, Route.ON_UNFOLDING, Route.BY_NETWORK)
FREE = (Route.ON_UNFOLDING, Route.ON_FLATTENING, Route.THROUGH_POINTS, Route.BY_NETWORK)
NARROW = (Route.THROUGH_POINTS, Route.ON_UNFOLDING, Route.ON_FLATTENING, Route.BY_NETWORK)
PLANS = {
    "smooth": (SMOOTH, {}, (Route.ON_UNIT_DISK, *HARMONIC)),
    "smooth, free": (SMOOTH, {"between": "free"}, (Route.ON_UNIT_DISK, *FREE)),
    "smooth, free, narrow": (narrow(), {"between": "free"}, (Route.ON_UNIT_DISK, *NARROW)),
    "a curve in formulas": (gallery.tennis_seam(0.8), {}, (Route.ON_UNIT_DISK, *HARMONIC)),
    "long": (gallery.ellipse(4.0, 0.3).sample(64), {}, HARMONIC),
    "rough": (noisy_ellipse(100), {}, ROUGH),
    "rough, free": (noisy_ellipse(100), {"between": "free"}, (Route.THROUGH_POINTS,)),
    "rough, free, many": (noisy_ellipse(1600, amount=0.2), {"between": "free"}, ROUGH),
    "few, free": (FEW, {"between": "free"}, (Route.THROUGH_POINTS,)),
    "few": (FEW, {}, (Route.ON_UNIT_DISK, *HARMONIC)),
    "narrow finger, free": (finger(), {"between": "free"}, (Route.THROUGH_POINTS,)),
    "plane": (gallery.ellipse(8.0).sample(64), {}, (Route.IN_PLANE, *HARMONIC)),
    "plane, with corners": (planar(CONVEX, 20), {"between": "free"}, (Route.IN_PLANE, Route.BY_NETWORK)),
    "plane, by a network": (planar(CONVEX, 20), {"model": "cauchy"}, (Route.BY_NETWORK,)),
    "corners": (SKEW, {"between": "free"}, (Route.BY_NETWORK,)),
    "corners that are seen": (SEEN, {}, (Route.BY_NETWORK,)),
    "corners that are seen, free": (SEEN, {"between": "free"}, (Route.BY_NETWORK, Route.THROUGH_POINTS)),
    "by a network": (SMOOTH, {"model": Cauchy(degree=20)}, (Route.BY_NETWORK,)),
    "power series": (SMOOTH, {"model": "series"}, (Route.ON_UNIT_DISK,)),
    "power series, with corners": (SKEW, {"model": "series"}, (Route.ON_UNIT_DISK,)),
    "several": (coaxial(0.5), {}, (Route.ON_CIRCLES, Route.BY_NETWORK)),
    "several, by a network": (coaxial(0.5), {"model": "cauchy"}, (Route.BY_NETWORK,)),
    "several, in series": (coaxial(0.5), {"model": "series"}, (Route.ON_CIRCLES,)),
    "several, rough": (rough_pair(), {}, (Route.THROUGH_POINTS, Route.ON_CIRCLES, Route.BY_NETWORK)),
    "several, rough, smooth": (rough_pair(), {"between": "smooth"}, (Route.ON_CIRCLES, Route.BY_NETWORK)),
    "several, rough, by modulus": (rough_pair(), {"model": Laurent()}, (Route.ON_CIRCLES, Route.BY_NETWORK)),
    "three": (facing(TETRAHEDRON[:3]), {"between": "free"}, (Route.ON_CIRCLES,)),
    "several, plane": ((ring(1.0, 0.0), ring(0.5, 0.0)), {}, (Route.IN_PLANE, Route.ON_CIRCLES, Route.BY_NETWORK)),
    "trained": (SMOOTH, {"model": "mlp"}, (Route.BY_TRAINING,)),
}


@pytest.mark.parametrize(("loop", "options", "routes"), PLANS.values(), ids=PLANS)
def test_plans(loop, options, routes):
    assert plan(task_of(loop, **options)) == routes


def test_rims_that_a_cone_parts_have_no_plan():
    with pytest.raises(NoneBetweenError, match="a cone parts them"):
        plan(task_of(coaxial(1.0)))


def test_a_plan_can_be_read():
    assert '<Route.ON_UNIT_DISK: "Douglas\'s slide on the unit disk">' in str(plan(task_of(SMOOTH)))


# --- how it is run ----------------------------------------------------------------------------------------------------


@dataclass
class Fake:
    """A route to a given disk, so many times as far from Γ as it is, or to an error; it takes one step."""

    answer: Found | Exception
    farther: float = 1.0
    asked: list[Task] = field(default_factory=list)

    def surface(self, task: Task) -> Found:
        self.asked.append(task)
        task.steps.take("Douglas-Newton", 1.0)
        if isinstance(self.answer, Exception):
            raise self.answer
        return replace(self.answer, misfit=self.answer.misfit.enlarged(self.farther))


def found(route: Route) -> Found:
    return route.surface(task_of(SMOOTH))


MET = found(Route.ON_UNIT_DISK)
FAILURES = [DomainError("folded"), FirstFillError("no fill"), SingularMatrixError(size=3), SurfaceError("branched")]


def test_the_first_route_that_meets_the_tolerance_is_the_last():
    first, second = Fake(MET), Fake(MET)
    task = task_of(SMOOTH)
    assert nearest_surface((first, second), task).surface_at is MET.surface_at
    assert (len(first.asked), len(second.asked)) == (1, 0)


@pytest.mark.parametrize("failure", FAILURES, ids=lambda error: type(error).__name__)
def test_a_route_that_fails_leaves_the_word_to_the_next(failure):
    heard = []
    task = task_of(SMOOTH, on_iteration=heard.append)
    disk = nearest_surface((Fake(failure), Fake(MET)), task)
    assert disk.surface_at is MET.surface_at
    # its steps count
    assert [step.index for step in task.solution(disk).history] == [1, 2]
    assert tuple(heard) == task.solution(disk).history


@pytest.mark.parametrize("failure", FAILURES, ids=lambda error: type(error).__name__)
def test_a_poor_disk_stands_where_the_next_route_fails(failure):
    task = task_of(SMOOTH)
    assert nearest_surface((Fake(MET, farther=1e9), Fake(failure)), task).surface_at is MET.surface_at
    assert len(task.steps.history) == 2
    with pytest.raises(type(failure)):
        nearest_surface((Fake(DomainError("crowded")), Fake(failure)), task_of(SMOOTH))


def test_of_failures_that_of_a_surface_is_told():
    with pytest.raises(SurfaceError, match="branched"):
        nearest_surface((Fake(SurfaceError("branched")), Fake(DomainError("folded"))), task_of(SMOOTH))


@pytest.mark.parametrize("farther", [(1e9, 1e8), (1e8, 1e9)])
def test_the_nearest_surface_is_taken_where_none_meets_the_tolerance(farther):
    task = task_of(SMOOTH)
    disk = nearest_surface([Fake(MET, farther=times) for times in farther], task)
    assert disk.misfit.rms == 1e8 * MET.misfit.rms
    assert len(task.steps.history) == 2


def test_a_second_domain_is_not_tried_where_the_first_led_to_a_surface():
    """It would take the steps that the network needs."""
    first, second = Fake(replace(MET, route="flattened"), farther=1e9), Fake(MET)
    assert nearest_surface((first, second), task_of(SMOOTH)).route == "flattened"
    assert not second.asked


def test_time_that_is_over_ends_the_plan():
    second = Fake(MET)
    with deadline.time_limit(0), pytest.raises(OutOfTimeError):
        nearest_surface((second,), task_of(SMOOTH))
    assert not second.asked


def test_another_error_is_no_failure_of_a_route():
    with pytest.raises(RuntimeError, match="broken"):
        nearest_surface((Fake(RuntimeError("broken")), Fake(MET)), task_of(SMOOTH))


def test_the_limit_on_steps_holds_for_the_whole_plan():
    heard = []
    solution = solve_plateau(SMOOTH, tolerance=1e-15, max_iterations=5, on_iteration=heard.append)
    assert tuple(heard) == solution.history
    assert [step.index for step in heard] == [1, 2, 3, 4, 5]
    assert "limit on steps" in solution.reason
