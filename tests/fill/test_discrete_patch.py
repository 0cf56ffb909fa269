"""Loops without an exact surface: discrete minimal surfaces, triangles over the loop's points, limits of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.deadline import time_limit
from spinor_geom.discrete.first_fill import disk_without_inner_points, minimum_area_triangulation
from spinor_geom.errors import FirstFillError, NoAreaError, OutOfTimeError, SurfaceError, TooManyPointsError
from spinor_geom.fill import discrete_patch as module
from spinor_geom.fill.discrete_patch import discrete_patch
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import Continuity
from spinor_geom.fill.no_holes import require_area
from spinor_geom.fill.solved_loops import solved_loop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.meshing import triangulate
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch
from tests.closed import is_watertight
from tests.fill.shapes import circle, collar, cone


def wavy(count: int, *, noise: float = 0.0) -> np.ndarray:
    points = circle(count, bend=0.4, waves=3)
    return points + noise * (2 * np.pi / count) * np.random.default_rng(0).normal(size=points.shape)


@given(count=st.integers(3, 12))
def test_short_curves_are_spanned_by_triangles_of_least_area(count: int) -> None:
    points = wavy(count)
    np.testing.assert_array_equal(disk_without_inner_points(points), minimum_area_triangulation(points))


@pytest.mark.parametrize("count", [200, 201, 1000, 2500])
def test_long_curves_are_spanned_once_by_triangles_oriented_like_them(count: int) -> None:
    loop = BoundaryLoop.from_points(wavy(count))
    faces = disk_without_inner_points(loop.points)
    assert len(faces) == count - 2
    # with a cone from the other side it closes
    assert is_watertight(np.vstack([faces, cone(loop).faces[:, ::-1]]))
    least = face_areas(wavy(200), disk_without_inner_points(wavy(200))).sum()
    assert face_areas(loop.points, faces).sum() == pytest.approx(least, rel=1e-2)


def test_a_discrete_patch_has_the_loop_as_its_rim_and_lies_over_a_plane_domain() -> None:
    loop = BoundaryLoop.from_points(wavy(40))
    patch, what = discrete_patch(loop, loop.mean_edge_length)
    assert what == "a discrete minimal surface"
    np.testing.assert_array_equal(patch.vertices[:40], loop.points)
    corners = patch.points[patch.faces]
    assert (((corners[:, 1] - corners[:, 0]).conj() * (corners[:, 2] - corners[:, 0])).imag > 0).all()


def test_where_the_descent_fails_triangles_over_the_points_close_the_hole(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise FirstFillError("it does not unfold")

    monkeypatch.setattr(module, "surface_over_plane", fails)
    _, report = fill_hole(collar(wavy(40), np.array([0, 0, 0.3])), time_limit=1e-9, return_report=True)
    assert report.watertight
    for outcome in report.loops:
        assert outcome.vertices_added == outcome.edges_split
        assert outcome.faces_added == 38 + 2 * outcome.edges_split
        assert outcome.reason.startswith("a triangulation without inner vertices (it does not unfold), because: no")


@pytest.mark.parametrize("corners", [(), (0, 20)])
def test_without_time_a_loop_has_no_exact_surface(corners: tuple[int, ...]) -> None:
    loop = BoundaryLoop.from_points(wavy(40), corners=list(corners))
    (answer,) = solve_plateau_batch([loop], time_limit=1e-9)
    assert isinstance(answer, OutOfTimeError)
    (answer,) = solve_plateau_batch([loop], time_limit=60.0)
    assert isinstance(answer, PlateauSolution)
    assert answer.converged


@pytest.mark.parametrize("continuity", ["C0", "C1"])
def test_without_time_an_exact_surface_is_kept_and_its_mesh_is_coarse(continuity: Continuity) -> None:
    mesh = collar(wavy(400) * [1, 1, 0], np.array([0, 0, 0.3]))
    _, whole = fill_hole(mesh, 0, time_limit=60.0, return_report=True)
    _, report = fill_hole(mesh, 0, time_limit=1e-9, continuity=continuity, return_report=True)
    (full, cut) = (each.loops[0] for each in (whole, report))
    assert (full.converged, full.reason) == (True, "")
    assert full.patch.is_complete
    # a plane surface takes no time
    assert cut.kind == "minimal"
    assert cut.solution.converged
    assert cut.area == full.area
    assert not cut.patch.is_complete
    assert len(cut.patch.vertices) < len(full.patch.vertices) / 2
    assert not cut.converged
    assert not report.complete
    assert "triangles larger than asked for" in cut.reason
    assert "has a coarser mesh than asked for" in cut.shortcomings[0]


def test_a_discrete_patch_has_as_many_vertices_as_its_time_allows() -> None:
    loop = BoundaryLoop.from_points(wavy(40))
    fine, coarse = loop.mean_edge_length / 12, loop.mean_edge_length
    with time_limit(3.0):  # a tenth of it is enough to factor 15,000 vertices
        patch, what = discrete_patch(loop, fine / 4)
    assert not patch.is_complete
    assert "triangles larger than asked for" in what
    assert len(patch.vertices) < 20_000
    with time_limit(1e3):
        assert discrete_patch(loop, coarse)[0].is_complete


@pytest.mark.parametrize(("missed", "is_usable"), [(0.08, True), (0.15, False)])
def test_a_surface_that_misses_its_loop_by_a_tenth_of_an_edge_is_none(missed: float, is_usable: bool) -> None:
    loop = BoundaryLoop.from_points(wavy(40))
    (found,) = solve_plateau_batch([loop])
    assert isinstance(found, PlateauSolution)
    residual = replace(found.boundary_residual, rms=missed * found.boundary_residual.mean_edge)
    answer = solved_loop(loop, replace(found, boundary_residual=residual), 0.0)
    assert isinstance(answer.error, SurfaceError) != is_usable


@pytest.mark.parametrize(("width", "is_refused"), [(0.8e-6, True), (1.25e-6, False)])
def test_a_loop_encloses_no_area_below_a_millionth_of_its_mean_edge(width: float, is_refused: bool) -> None:
    x = np.array([0.0, 1, 2, 3, 2, 1])
    loop = BoundaryLoop.from_points(np.column_stack([x, [0, 0, 0, 0, width, width], 0 * x]), corners=())
    assert loop.mean_edge_length == pytest.approx(1.0)
    found = error_of(loop)
    assert isinstance(found, NoAreaError) == is_refused


def error_of(loop: BoundaryLoop) -> NoAreaError | None:
    try:
        require_area(loop, loop.diagonal / loop.elongation)
    except NoAreaError as error:
        return error
    return None


def test_a_discrete_patch_of_too_many_points_is_refused_before_it_is_made() -> None:
    loop = BoundaryLoop.from_points(wavy(40))
    with pytest.raises(TooManyPointsError, match=r"about .*e\+10 vertices.*longer target_edge_length"):
        discrete_patch(loop, 1e-5)
    for mesh in (collar(wavy(40), np.array([0, 0, 0.5])), collar(wavy(40) * [1, 1, 0], np.array([0, 0, 0.5]))):
        with pytest.raises(TooManyPointsError):
            fill_hole(mesh, target_edge_length=1e-5)


def test_a_rim_too_long_for_its_edges_is_left_open_and_costs_others_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(triangulate, "MOST_POINTS", 1000)
    vertices, faces = collar(wavy(400), np.array([0, 0, 0.5]))
    others, small = collar(wavy(40), np.array([0, 0, 0.5]))
    mesh = np.concatenate([vertices, others + np.array([9, 0, 0])]), np.concatenate([faces, small + len(vertices)])
    _, report = fill_hole(mesh, return_report=True)
    assert {len(outcome.loop): outcome.filled for outcome in report.loops} == {400: False, 40: True}
    assert "give a longer target_edge_length" in next(each.reason for each in report.loops if not each.filled)


@pytest.mark.parametrize("gap", [0.01, 0.001])
def test_plane_combs_have_no_faces_without_area(gap: float) -> None:
    # the teeth's tips and feet lie on two lines, between whose points triangles have no area
    left = 2 * gap * np.arange(6)
    x = np.stack([left, left, left + gap, left + gap], axis=1).ravel()
    teeth = np.column_stack([x, np.tile([0.0, 1.0, 1.0, 0.0], 6), 0 * x])[::-1]
    rim = np.concatenate([teeth, [[0, -0.3, 0], [x.max(), -0.3, 0]]])
    _, report = fill_hole(collar(rim, np.array([0.0, 0.0, 1.0])), loop=0, return_report=True)
    (outcome,) = (one for one in report.loops if one.filled)
    assert (outcome.kind, outcome.intersections) == ("minimal", 0)
    assert face_areas(outcome.patch.vertices, outcome.patch.faces).min() > 0
