"""solve_plateau against areas and surfaces that are known."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from spinor_geom import gallery
from spinor_geom.errors import OptionError
from spinor_geom.mesh import interpolation
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import Cauchy, Iteration, solve_plateau
from tests.loops import CONVEX, L_SHAPE, noisy_ellipse, planar, polygon_area, ramp, slit
from tests.plateau.solved import CURVES, SURFACES, distance_to_surface, recovered, spanned

SMALL = gallery.twisted_circle().sample(40)


@pytest.mark.parametrize(("name", "area"), [("tennis seam", 4.36461878664500), ("twisted circle", 3.32087142904707)])
def test_areas_of_smooth_curves(name, area):
    solution = spanned(name)
    assert solution.converged
    assert abs(solution.area / area - 1) < 1e-8
    assert solution.stability.verdict == "stable"


def test_alternating_steps_of_an_analytic_curve_converge_faster_than_a_spline():
    errors = []
    for n in (16, 32, 64):
        s = (np.arange(n) + 0.2 * (-1.0) ** np.arange(n)) / n
        solution = solve_plateau(
            BoundaryLoop.from_points(CURVES["twisted circle"].point(s)), tolerance=1e-5, between="smooth"
        )
        errors.append(abs(solution.area / CURVES["twisted circle"].disks[0].area - 1))
    assert errors[0] < 1e-4  # the cubic spline's is 2.5e-3
    assert errors[-1] < 2e-7


def test_area_converges_at_order_four_where_the_spline_is_cubic(monkeypatch):
    # no analytic curves
    monkeypatch.setattr(interpolation, "MOST_UNEVEN", 0.0)
    counts, errors = (16, 24, 32, 48), []
    for n in counts:
        # long and short steps in turn, as no smooth parameter has them
        s = (np.arange(n) + 0.2 * (-1.0) ** np.arange(n)) / n
        solution = solve_plateau(
            BoundaryLoop.from_points(CURVES["twisted circle"].point(s)), tolerance=1e-5, between="smooth"
        )
        assert solution.curve.kind == "cubic"
        errors.append(abs(solution.area / CURVES["twisted circle"].disks[0].area - 1))
    assert 3.5 < -np.polyfit(np.log(counts), np.log(errors), 1)[0] < 4.5


@pytest.mark.parametrize("name", ["tennis seam", "twisted circle"])
@pytest.mark.parametrize("points", [32, 64, 128])
def test_area_of_analytic_curves_comes_down_to_rounding_errors(name, points):
    solution = spanned(name, points, 1e-8)
    assert abs(solution.area / CURVES[name].disks[0].area - 1) < 2e-13


@pytest.mark.parametrize(("name", "ratio", "error"), [("ellipse 2:1", 2, 1e-11), ("ellipse 8:1", 8, 1e-6)])
def test_plane_ellipses_stay_plane(name, ratio, error):
    solution = spanned(name, tolerance=1e-8)
    # at the tips of the 8:1 ellipse 128 points are far apart for the radius of curvature of 1/8
    assert abs(solution.area / (np.pi * ratio) - 1) < error
    assert solution.converged
    assert solution.boundary_residual.max_per_edge < 1e-7
    mesh = solution.domain.triangulation
    assert np.abs(solution.surface.position(mesh.points)[:, 2]).max() < 1e-11
    assert np.abs(np.abs(solution.surface.normal(mesh.points)[:, 2]) - 1).max() < 1e-11


def test_long_saddle_is_followed():
    solution = spanned("saddle 8:1")
    assert solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-6
    # more than the ellipse below it, less than the graph z = 0.6·(x/8)·y over it
    nodes, weights = np.polynomial.legendre.leggauss(30)
    radius, angle = (nodes[:, None] + 1) / 2, 2 * np.pi * np.arange(60) / 60
    stretch = np.sqrt(1 + 0.36 * radius**2 * (np.cos(angle) ** 2 + (np.sin(angle) / 8) ** 2))
    graph = 8 * np.pi * (weights[:, None] * radius * stretch).sum() / 60
    # at the tips the spline through 128 points encloses a little more than the curve
    assert 8 * np.pi < solution.area < graph * (1 + 1e-6)


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


def test_tennis_seam_below_its_loss_of_stability_ends_on_a_stable_disk():
    """At a = 0.75 the symmetric disk of area 4.66976 has index 1; two mirror images of area 4.66497 are stable."""
    solution = solve_plateau(gallery.tennis_seam(0.75).sample(128))
    stable, symmetric = gallery.tennis_seam(0.75).disks
    assert solution.converged
    which = stable if abs(solution.area - stable.area) < abs(solution.area - symmetric.area) else symmetric
    assert abs(solution.area / which.area - 1) < 1e-6
    assert solution.stability.verdict == ("stable" if which is stable else "unstable")
    assert solution.stability.index == (0 if which is stable else 1)


def test_enneper_before_its_loss_of_stability():
    solution = solve_plateau(gallery.enneper(0.9).rim(96))
    assert solution.stability.verdict == "stable"
    assert abs(solution.area / gallery.enneper(0.9).area - 1) < 2e-6


def test_enneper_beyond_its_loss_of_stability_is_identified_by_its_area():
    """For R = 1.1 the disk with the known area has index 1; if another disk is found, its index must be correct."""
    known = gallery.enneper(1.1)
    solution = solve_plateau(known.rim(96))
    if abs(solution.area / known.area - 1) < 1e-4:
        assert solution.stability.verdict == "unstable"
        assert solution.stability.index == 1
    else:
        assert solution.area < known.area
        assert solution.stability.verdict == "stable"
    assert solution.converged


@pytest.mark.parametrize("turns", [0.95, 2.2])
def test_helical_ramps(turns):
    solution = solve_plateau(ramp(turns), tolerance=1e-2)
    assert solution.converged
    assert solution.boundary_residual.max_per_edge < 0.2


def test_slit_one_triangle_wide():
    solution = solve_plateau(slit())
    assert solution.converged
    assert abs(solution.area / (45 * 0.87) - 1) < 1e-8


def test_noisy_rim():
    solution = solve_plateau(noisy_ellipse(amount=0.15), tolerance=1e-2)
    assert solution.converged
    assert 0 < solution.boundary_residual.rms_per_edge < 1e-2


def test_triangle():
    loop = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 0), (0, 1, 0)], corners=[0, 1, 2])
    solution = solve_plateau(loop)
    assert abs(solution.area - 0.5) < 1e-9


def test_long_loop_is_thinned_but_followed_at_every_point():
    loop = SURFACES["Enneper"].rim(400)
    solution = solve_plateau(loop)
    assert solution.converged
    assert abs(solution.area / SURFACES["Enneper"].area - 1) < 1e-8
    rim = solution.surface.position(solution.loop_points_in_domain())
    assert np.linalg.norm(rim - loop.points, axis=1).max() < 1e-2 * loop.mean_edge_length


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


def test_matching_increases_over_one_turn():
    t, s = spanned("tennis seam").matching.T
    assert (np.diff(t) > 0).all()
    assert (np.diff(s) >= 0).all()
    assert s[-1] - s[0] <= 1


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


def test_residual_ratios():
    residual = spanned("tennis seam").boundary_residual
    loop = CURVES["tennis seam"].sample(128)
    assert residual.rms_per_edge == residual.rms / loop.mean_edge_length
    assert residual.max_per_edge == residual.max / loop.mean_edge_length
    assert residual.rms_per_diagonal == residual.rms / loop.diagonal
    assert residual.max_per_diagonal == residual.max / loop.diagonal
    assert residual.rms < residual.max


def test_tolerance_that_cannot_be_met_is_reported():
    loop = noisy_ellipse(40, amount=0.3)
    solution = solve_plateau(loop, tolerance=1e-12, model=Cauchy(degree=4))
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge > 1e-12
    assert "above the tolerance 1.0e-12" in solution.reason
    assert "features" in solution.reason


def test_stages_of_the_network_are_timed():
    solution = solve_plateau(SMALL, model="cauchy")
    assert solution.route == "network"
    assert set(solution.solve_timings) == {"first fill", "flattening", "features", "fit", "surface"}


@pytest.mark.parametrize("unstable", ["leave", "keep"])
def test_checks_are_made_when_they_are_read(unstable):
    solution = solve_plateau(gallery.tennis_seam(0.8).sample(48), unstable=unstable)
    # whether a disk is to be left is the solver's own question
    assert ("stability" in solution.timings) == (unstable == "leave")
    assert "certificates" not in solution.timings
    assert solution.to_dict()["timings"].keys() == {*solution.solve_timings, "stability", "certificates"}
    assert solution.timings == solution.to_dict()["timings"]  # made once


@pytest.mark.parametrize("model", ["auto", "cauchy"])
def test_limit_on_steps_is_reported(model):
    solution = solve_plateau(gallery.tennis_seam(0.8).sample(48), tolerance=1e-9, max_iterations=2, model=model)
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


def test_thread_count_is_restored_after_an_error():
    def fail(step):
        raise RuntimeError("stop")

    before = torch.get_num_threads()
    with pytest.raises(RuntimeError, match="stop"):
        solve_plateau(SMALL, on_iteration=fail)
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("model", ["auto", "cauchy"])
def test_two_runs_are_equal_bit_for_bit(model):
    first, second = solve_plateau(SMALL, model=model), solve_plateau(SMALL, model=model)
    assert first.area == second.area
    state = second.surface.state_dict()
    assert all(torch.equal(tensor, state[name]) for name, tensor in first.surface.state_dict().items())


def test_solution_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        spanned("tennis seam").area = 1.0


# --- options ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": -1e-3}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"tolerance": None}, "tolerance"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"device": "abacus"}, "abacus cannot be used"),
        ({"device": "meta"}, "meta cannot be used"),
        ({"device": 1.5}, "1.5 cannot be used"),
        ({"model": "perceptron"}, "'perceptron'"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        solve_plateau(SMALL, **options)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        *(("degree", bad) for bad in (0, 2.5, np.inf, "3")),
        *(("pole_offset", bad) for bad in (0.0, np.nan, np.inf, "1")),
    ],
)
def test_bad_model_options_are_refused(name, bad):
    with pytest.raises(OptionError, match=name):
        Cauchy(**{name: bad})


def test_misspelt_option_is_a_type_error():
    with pytest.raises(TypeError, match="tolerence"):
        solve_plateau(SMALL, tolerence=1e-3)


def test_model_options_reach_the_network():
    solution = solve_plateau(SMALL, model=Cauchy(degree=10, pole_offset=2.0))
    assert solution.surface.model.config()["degree"] == 10
    assert solution.converged
