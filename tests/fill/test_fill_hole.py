"""`fill_hole` with the real solver, on small meshes with known results."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.adapters import read_mesh
from spinor_geom.bench.holes import lattice
from spinor_geom.bench.ragged import reported_bowl
from spinor_geom.errors import FirstFillError, ImperfectFillWarning, LoopIndexError, OptionError
from spinor_geom.fill import fill_loop
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau import Cauchy, solve_plateau
from tests.closed import is_watertight
from tests.fill.shapes import as_mesh, collar, folded_quad, tube
from tests.validity import validate

DATA = Path(__file__).parents[2] / "data"


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def disk_with_hole() -> tuple[np.ndarray, np.ndarray]:
    """A ring of 24 × 3 vertices in a plane: an outer rim, and a round hole of radius 1/2."""
    (x, y), faces = lattice(24, 2, wrap_x=True)
    z = (0.5 + y / 4) * np.exp(2j * np.pi * x / 24)
    return np.column_stack([z.real, z.imag, 0 * z.real]), faces[:, ::-1]


def test_the_input_is_an_unchanged_prefix_and_the_result_watertight() -> None:
    vertices, faces = tube()
    before = vertices.copy(), faces.copy()
    filled, report = fill_hole((vertices, faces), return_report=True)
    np.testing.assert_array_equal(vertices, before[0])
    np.testing.assert_array_equal(faces, before[1])
    np.testing.assert_array_equal(filled[0][: len(vertices)], vertices)
    np.testing.assert_array_equal(filled[1][: len(faces)], faces)
    assert report.watertight
    assert report.complete
    assert is_watertight(filled[1])
    assert boundary_loops(filled) == []
    validate(TriangleMesh(*filled))


def test_caps_of_a_tube_are_flat_and_look_outwards() -> None:
    vertices, faces = tube()
    (new_vertices, new_faces), report = fill_hole((vertices, faces), return_report=True)
    patch = new_faces[len(faces) :]
    lower = report.extension.face_loops == 0
    normals = face_normals(new_vertices, patch)
    assert (normals[lower, 2] < 0).all()
    assert (normals[~lower, 2] > 0).all()
    # a plane loop is filled in its plane, to round-off
    assert np.abs(new_vertices[np.unique(patch[lower]), 2]).max() < 1e-12
    assert np.abs(new_vertices[np.unique(patch[~lower]), 2] - 1.0).max() < 1e-12


def test_edge_length_sets_the_size_of_the_patch() -> None:
    counts = [len(fill_hole(tube(), 0, target_edge_length=length)[0]) for length in (0.4, 0.1)]
    assert counts[1] > 4 * (counts[0] - 48) + 48


def test_a_hole_of_four_vertices_with_a_taken_diagonal_closes() -> None:
    for vertices, faces in (folded_quad(), (folded_quad()[0], folded_quad()[1][:, ::-1])):
        (_, new_faces), report = fill_hole((vertices, faces), 0, return_report=True)
        assert report.watertight
        validate(TriangleMesh(report.mesh[0], new_faces))


def test_a_loop_object_is_filled_with_its_own_corners() -> None:
    mesh = as_mesh(tube(4, 2))
    loop = boundary_loops(mesh)[0]
    with_corners = BoundaryLoop(points=loop.points, vertex_ids=loop.vertex_ids, corners=np.ones(4, dtype=bool))
    _, report = fill_hole(mesh, with_corners, return_report=True)
    outcome = report.loops[0]
    assert outcome.filled
    assert outcome.solution.loop.corners.all()
    # with its corners kept the quadrilateral is spanned by the flat square; without them by a round disk
    np.testing.assert_allclose(outcome.solution.area, 2.0, rtol=1e-9)


def test_a_rim_of_a_few_smooth_sides_keeps_its_corners() -> None:
    known = gallery.schwarz_d_quadrilateral()
    points = known.sample(64).points
    mesh = collar(points, 0.1 * (points - points.mean(axis=0)))
    _, report = fill_hole(mesh, loop=1, return_report=True)
    outcome = report.loops[1]
    assert outcome.converged
    assert outcome.area is not None
    assert abs(outcome.area / known.disks[0].area - 1) < 1e-8


def test_a_loop_that_the_solver_fails_on_is_closed_discretely_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails_on_the_first(loops: Iterable[BoundaryLoop], **options: object) -> Iterator[object]:
        for loop in loops:
            if 0 in loop.vertex_ids:
                time.sleep(0.05)
                yield FirstFillError("no disk was found over this loop")
            else:
                yield solve_plateau(loop)

    monkeypatch.setattr("spinor_geom.fill.solved_loops.solve_plateau_batch", fails_on_the_first)
    filled, report = fill_hole(tube(), return_report=True)
    failed, done = report.loops
    assert (failed.kind, failed.solution, failed.converged) == ("discrete", None, False)
    assert failed.reason == "a discrete minimal surface, because: no disk was found over this loop"
    assert done.kind == "minimal"
    # the time of the failed attempt is reported for this loop, not for another one
    assert failed.timings["solve"] >= 0.05
    assert done.timings["solve"] == sum(done.solution.timings.values())
    assert report.watertight
    assert report.closed
    assert not report.complete
    polygon = 16 * np.sin(2 * np.pi / 16) / 2
    assert failed.area == pytest.approx(polygon, rel=1e-9)  # a plane loop's least area
    assert json.loads(json.dumps(report.to_dict(), allow_nan=False))["loops"][0]["kind"] == "discrete"
    assert is_watertight(filled[1])


def test_an_error_that_is_not_ours_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> object:
        raise ZeroDivisionError

    monkeypatch.setattr(fill_loop, "mesh_over_points", broken)
    with pytest.raises(ZeroDivisionError):
        fill_hole(tube())


def test_a_surface_that_is_not_finite_gives_way_to_a_discrete_one(monkeypatch: pytest.MonkeyPatch) -> None:
    real = fill_loop.mesh_over_points

    def with_a_hole(*arguments: Any) -> Any:
        patch = real(*arguments)
        patch.vertices[-1] = np.nan
        return patch

    monkeypatch.setattr(fill_loop, "mesh_over_points", with_a_hole)
    _, report = fill_hole(tube(), return_report=True)
    assert {outcome.kind for outcome in report.loops} == {"discrete"}
    assert "not finite" in report.loops[0].reason
    assert report.watertight


def test_a_missed_tolerance_is_filled_and_reported() -> None:
    rng = np.random.default_rng(5)
    vertices, faces = tube(12, 3)
    vertices = vertices + 0.02 * rng.normal(size=vertices.shape)
    _, report = fill_hole((vertices, faces), tolerance=1e-14, return_report=True)
    for outcome in report.loops:
        assert outcome.filled
        assert not outcome.converged
        assert "tolerance" in outcome.reason
    assert report.watertight
    assert not report.complete


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": 0.0},
        {"tolerance": float("nan")},
        {"max_perimeter": -1.0},
        {"target_edge_length": 0.0},
        {"target_edge_length": float("inf")},
        {"target_edge_length": "fine"},
        {"model": "spline"},
        {"loop": "largest"},
        {"tolerance": "1e-3"},
        {"tolerance": None},
        {"tolerance": True},
        {"max_perimeter": "1"},
        {"max_perimeter": float("inf")},
        {"target_edge_length": None},
        {"time_limit": 0},
        {"time_limit": "soon"},
        *({"merge": merge} for merge in (-1.0, np.nan, "a")),
        *({"continuity": continuity} for continuity in ("C2", None, {0: "C2"}, {"0": "C0"}, {True: "C0"})),
        {"islands": "maybe"},
        *({"bridge": bridge} for bridge in ((1,), (1, 1), ((0, 1), 1), ((0, 1), (1, 2)), 0, np.int64(0), "0")),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        fill_hole(tube(), **options)


@pytest.mark.parametrize("options", [{"loop": 2}, {"bridge": (0, 9)}, {"continuity": {2: "C1"}}, {"loop": -1}])
def test_an_index_of_no_loop_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(LoopIndexError):
        fill_hole(tube(), **options)


def test_the_model_may_be_given_with_its_options() -> None:
    _, report = fill_hole(tube(), 0, model=Cauchy(degree=20), return_report=True)
    assert report.loops[0].converged


def test_the_report_is_json_with_the_documented_fields() -> None:
    _, report = fill_hole(disk_with_hole(), keep_largest=True, return_report=True)
    text = json.dumps(report.to_dict(), allow_nan=False)
    entry = json.loads(text)
    assert entry["complete"] is True
    assert entry["watertight"] is False
    left, done = entry["loops"]
    assert left["requested"] is False
    assert left["residual_rms_per_edge"] is None
    assert done["index"] == 1
    assert done["vertices"] == 24
    assert done["residual_rms_per_edge"] < 1e-3
    assert done["residual_max_per_edge"] >= done["residual_rms_per_edge"]
    assert done["stability"]["verdict"] == "stable"
    np.testing.assert_allclose(done["perimeter"], 24 * np.sin(np.pi / 24), rtol=1e-12)
    assert done["faces_added"] == entry["faces_added"]
    assert {"solve", "mesh", "attributes", "total"} <= set(done["timings"])
    assert {"read", "loops", "fill", "stitch", "total"} == set(entry["timings"])


def test_a_mesh_with_merged_seams_is_filled_where_its_faces_fit() -> None:
    mesh = read_mesh(DATA / "ict_face_neutral.obj").merged()
    loops = boundary_loops(mesh)
    clean = [place for place, loop in enumerate(loops) if not loop.remarks and len(loop) == 36]
    assert len(clean) == 3
    assert sum(loop.obstacle is not None for loop in loops) == 9
    _, report = fill_hole(mesh, clean, return_report=True)
    assert report.complete
    crowded = next(place for place, loop in enumerate(loops) if loop.obstacle is not None)
    _, report = fill_hole(mesh, crowded, return_report=True)
    assert "at most 2 are allowed" in report.loops[crowded].reason
    assert not report.closed


def test_pieces_inside_out_to_each_other_get_patches_that_fit_their_own_rims() -> None:
    vertices, faces = tube(16, 4)
    upper = (faces >= 32).any(axis=1)
    (_, filled), report = fill_hole((vertices, np.where(upper[:, None], faces[:, ::-1], faces)), return_report=True)
    assert report.complete
    assert not any(outcome.remarks for outcome in report.loops)
    first = report.loops[0].faces_added
    turned = np.concatenate([upper, np.zeros(first, bool), np.ones(len(filled) - len(faces) - first, bool)])
    assert is_watertight(np.where(turned[:, None], filled[:, ::-1], filled))


def test_a_clean_fill_warns_of_nothing_and_a_long_list_is_cut() -> None:
    fill_hole(tube())
    lone = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    place = np.arange(8)
    soup = (lone + 3.0 * place[:, None, None]).reshape(-1, 3), np.arange(24).reshape(-1, 3)
    with pytest.warns(ImperfectFillWarning, match=r"loop 0 \(3 vertices\) was left open: .*; and 3 more") as caught:
        fill_hole(soup)
    assert len(caught) == 1
    assert caught[0].filename == __file__


def test_stages_are_reported_loop_by_loop_before_they_begin() -> None:
    stages: list[tuple[int, str]] = []
    fill_hole(tube(), on_stage=lambda place, stage: stages.append((place, stage)))
    assert stages == [(place, stage) for place in (0, 1) for stage in ("exact surface", "mesh", "crossings")]
    stages.clear()
    vertices, faces = tube()
    bent = vertices + 0.1 * vertices[:, [0]] ** 2 * [0, 0, 1]
    with pytest.warns(ImperfectFillWarning):
        fill_hole((bent, faces), 1, time_limit=1e-9, on_stage=lambda place, stage: stages.append((place, stage)))
    assert stages == [(1, stage) for stage in ("exact surface", "mesh", "discrete surface", "crossings")]


@pytest.mark.parametrize(("sides", "differ"), [(16, True), (20, False)])
def test_the_areas_of_surface_and_mesh_are_both_reported(sides: int, differ: bool) -> None:
    # a regular polygon of n sides has 2π²/(3n²) less area than its circle: 2.6 % and 1.6 %
    _, report = fill_hole(tube(sides), 0, return_report=True)
    outcome = report.loops[0]
    assert outcome.mesh_area == pytest.approx(sides * np.sin(2 * np.pi / sides) / 2, rel=1e-9)
    assert outcome.area == pytest.approx(np.pi, rel=1e-3)
    assert outcome.to_dict()["mesh_area"] == outcome.mesh_area
    assert outcome.areas_differ == differ
    assert any("the area of the surface is" in note for note in outcome.notes) == differ


@pytest.mark.parametrize("continuity", ["C0", "C1"])
def test_what_cannot_end_within_the_limit_is_not_begun(monkeypatch: pytest.MonkeyPatch, continuity: Any) -> None:
    hole = reported_bowl(5)
    cleared = fill_hole((hole.vertices, hole.faces), 0, continuity=continuity, return_report=True)[1].loops[0]
    monkeypatch.setattr(fill_loop, "_SEARCHES", np.inf)  # as if a search for intersections took very long
    late = fill_hole((hole.vertices, hole.faces), 0, continuity=continuity, return_report=True)[1].loops[0]
    assert late.filled
    assert late.kind != "smooth"
    assert late.intersections > cleared.intersections
    why = "no time for it" if continuity == "C1" else "time limit ended the removal of intersections"
    assert any(why in remark for remark in late.remarks)


def test_the_closed_volume_is_right() -> None:
    # the polyhedron between two flat caps and straight sides: divergence theorem against prismatoids of 16-gons
    sides = 16
    vertices, faces = fill_hole(tube(sides, 2))
    volume = np.einsum("fi,fi->", vertices[faces[:, 0]], face_normals(vertices, faces)) / 6
    polygon = sides * np.sin(2 * np.pi / sides) / 2
    # the quads of a frustum's sides are flat, so its volume is h (A + √(AB) + B)/3
    np.testing.assert_allclose(volume, 0.5 * polygon * (1 + 0.9 + 0.81) / 3, rtol=1e-12)
