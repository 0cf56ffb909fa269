"""solve_plateau against areas and surfaces that are known."""

import json

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import OptionError
from spinor_geom.mesh import interpolation
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import Cauchy, Iteration, Laurent, solve_plateau
from tests.loops import CONVEX, L_SHAPE, planar, polygon_area
from tests.plateau.solved import CURVES, SURFACES, distance_to_surface, recovered, spanned

SMALL = gallery.twisted_circle().sample(40)


def test_area_converges_at_order_four_where_the_spline_is_cubic(monkeypatch):
    # no analytic curves
    monkeypatch.setattr(interpolation, "MOST_UNEVEN", 0.0)
    counts, errors = (16, 24, 32, 48), []
    for n in counts:
        # long and short steps in turn, as no smooth parameter has them
        s = (np.arange(n) + 0.2 * (-1.0) ** np.arange(n)) / n
        loop = BoundaryLoop.from_points(CURVES["twisted circle"].point(s))
        solution = solve_plateau(loop, tolerance=1e-5, between="smooth")
        assert solution.curve.kind == "cubic"
        errors.append(abs(solution.area / CURVES["twisted circle"].disks[0].area - 1))
    assert 3.5 < -np.polyfit(np.log(counts), np.log(errors), 1)[0] < 4.5


@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE], ids=["convex", "L"])
def test_the_network_gives_plane_polygons_their_exact_area(corners):
    solution = solve_plateau(planar(corners, 60), model="cauchy")
    assert abs(solution.area / polygon_area(corners) - 1) < 1e-10
    assert solution.boundary_residual.max_per_diagonal < 1e-8
    assert solution.stability.verdict == "stable"
    assert solution.stability.total_curvature < 1e-8


@pytest.mark.parametrize("name", SURFACES)
def test_known_patches_are_recovered_from_their_own_boundary(name):
    known, solution = SURFACES[name], recovered(name)
    assert solution.converged
    mesh = known.surface.domain.triangulation
    points = known.position(mesh.points[mesh.boundary_size :])
    assert distance_to_surface(points, solution.surface).max() < 1e-6 * solution.loop.diagonal
    # the spline cuts off a share of the area at the rim
    assert abs(solution.area / known.area - 1) < 1e-6


@pytest.mark.parametrize("name", ["Enneper", "half catenoid"])
def test_recovered_normals_have_the_known_side(name):
    known, solution = SURFACES[name], recovered(name)
    middle = known.surface.domain.triangulation.points[known.surface.domain.root]
    found = solution.domain.triangulation.points
    near = found[np.linalg.norm(solution.surface.position(found) - known.position(np.array(middle)), axis=1).argmin()]
    cosine = solution.surface.normal(near) @ known.surface.normal(np.array(middle))
    assert cosine > 0.9


@pytest.mark.parametrize("name", ["Enneper", "half helicoid"])
def test_mean_curvature_vanishes_inside(name):
    surface = recovered(name).surface
    z = surface.domain.triangulation.points[surface.domain.triangulation.boundary_size :]
    scale = np.sqrt(np.abs(surface.gauss_curvature(z)).max())
    assert np.abs(surface.mean_curvature(z)).max() < 1e-6 * scale


# --- what the solution says of itself ---------------------------------------------------------------------------------


@pytest.mark.parametrize("solve", [lambda: spanned("tennis seam"), lambda: recovered("half catenoid")])
def test_loop_points_in_domain_run_around_it_and_meet_the_loop(solve):
    solution = solve()
    z = solution.loop_points_in_domain()
    assert len(z) == len(solution.loop)
    assert (np.conj(z) * np.roll(z, -1)).imag.sum() > 0
    boundary = solution.domain.boundary
    dense = boundary.point(np.arange(20000) / 20000)
    assert np.abs(z[:, None] - dense).min(axis=1).max() < 1e-3 * solution.domain.diameter
    gap = np.linalg.norm(solution.surface.position(z) - solution.loop.points, axis=1)
    assert gap.max() < 1e-3 * solution.loop.mean_edge_length


def test_solution_is_json_ready():
    solution = spanned("twisted circle")
    entry = json.loads(json.dumps(solution.to_dict()))
    assert entry["vertices"] == 128
    assert entry["area"] == solution.area
    assert entry["residual"]["rms_per_edge"] == solution.boundary_residual.rms_per_edge
    assert entry["stability"]["verdict"] == "stable"
    assert entry["converged"] is True
    assert entry["route"] == solution.route == "disk"
    assert set(entry["timings"]) == {"slide", "lift", "surface", "stability", "certificates"}
    assert entry["iterations"] == len(solution.history)


@pytest.mark.parametrize("unstable", ["leave", "keep"])
def test_checks_are_made_when_they_are_read(unstable):
    solution = solve_plateau(gallery.tennis_seam(0.8).sample(48), unstable=unstable)
    # whether a disk is to be left is the solver's own question
    assert ("stability" in solution.timings) == (unstable == "leave")
    assert "certificates" not in solution.timings
    assert solution.to_dict()["timings"].keys() == {*solution.solve_timings, "stability", "certificates"}
    assert solution.timings == solution.to_dict()["timings"]  # made once


def test_limit_on_steps_is_reported():
    solution = solve_plateau(gallery.tennis_seam(0.8).sample(48), tolerance=1e-9, max_iterations=2, model="cauchy")
    assert len(solution.history) == 2
    assert not solution.converged
    assert "limit on steps" in solution.reason


@pytest.mark.parametrize(("model", "method"), [("auto", "Douglas-Newton"), ("cauchy", "Gauss-Newton")])
def test_every_step_is_reported(model, method):
    steps = []
    solution = solve_plateau(SMALL, model=model, on_iteration=steps.append)
    assert tuple(steps) == solution.history
    assert all(isinstance(step, Iteration) for step in steps)
    assert [step.index for step in steps] == list(range(1, len(steps) + 1))
    assert len(steps) >= 2
    assert {step.method for step in steps} == {method}
    if model == "cauchy":  # Newton's method lowers the energy, its gradient may rise
        assert (np.diff([step.residual for step in steps]) < 0).all()


def test_callers_thread_count_is_restored():
    import torch

    before = torch.get_num_threads()
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            seen = []
            solve_plateau(SMALL, on_iteration=lambda step, seen=seen: seen.append(torch.get_num_threads()))
            assert torch.get_num_threads() == count
            assert set(seen) == {1}
    finally:
        torch.set_num_threads(before)


# --- options ----------------------------------------------------------------------------------------------------------


BAD_OPTIONS = [
    *(({name: bad}, name) for name in ("tolerance", "time_limit") for bad in (0.0, -1e-3, float("nan"))),
    ({"tolerance": None}, "tolerance"),
    ({"max_iterations": 0}, "max_iterations"),
    *(({"device": bad}, str(bad)) for bad in ("abacus", "meta", 1.5)),
    ({"model": "perceptron"}, "'perceptron'"),
    ({"unstable": "maybe"}, "'maybe'"),
]
NOT_TOGETHER = [
    ({"model": "mlp", "optimizer": "adam"}, "'adam'"),
    ({"model": "mlp", "all_solutions": True}, "one disk only"),
    ({"model": "series", "all_solutions": True}, "all_solutions"),
    ({"model": "auto", "optimizer": "rmsprop"}, "model='mlp'"),
    ({"model": "cauchy", "warm_start": False}, "model='mlp'"),
    ({"model": Laurent()}, "two or more loops"),
]


@pytest.mark.parametrize(("options", "named"), [*BAD_OPTIONS, *NOT_TOGETHER], ids=lambda value: str(value)[:30])
def test_bad_options_are_refused(options, named):
    with pytest.raises(OptionError, match=named):
        solve_plateau(SMALL, **options)


@pytest.mark.parametrize(
    ("loops", "options", "named"),
    [
        (2, {"model": "cauchy", "all_solutions": True}, "all_solutions"),
        (2, {"model": Cauchy(degree=20), "all_solutions": True}, "all_solutions"),
        (2, {"model": "mlp"}, "one loop only"),
        (3, {"model": "cauchy"}, "one or two loops"),
        (0, {}, "at least one"),
    ],
)
def test_options_that_do_not_suit_several_loops_are_refused(loops, options, named):
    with pytest.raises(OptionError, match=named):
        solve_plateau([BoundaryLoop.from_points(SMALL.points + 5.0 * k) for k in range(loops)], **options)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        *(("degree", bad) for bad in (0, 2.5, np.inf, "3")),
        *(("pole_offset", bad) for bad in (0.0, np.nan, np.inf, "1")),
        ("modulus", -1.0),
    ],
)
def test_bad_model_options_are_refused(name, bad):
    with pytest.raises(OptionError, match=name):
        (Laurent if name == "modulus" else Cauchy)(**{name: bad})


def test_model_options_reach_the_network():
    solution = solve_plateau(SMALL, model=Cauchy(degree=10, pole_offset=2.0))
    assert solution.surface.model.config()["degree"] == 10
    assert solution.converged
