"""Loops that cross themselves are refused; intersections of patches are kept, counted and located."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import read_mesh
from spinor_geom.cli.fill import _row as fill_row
from spinor_geom.deadline import seconds_left
from spinor_geom.errors import SelfCrossingLoopError
from spinor_geom.fill import fill_loop, new_patch
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import LEAST_TIME
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.fill.patched_mesh import Crossings, PatchedMesh
from spinor_geom.fill.retriangulation import NOT_CLEARED
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau import solve_plateau
from tests.fill.shapes import circle, collar, cone, figure_eight, linked_rings, spiked_tetrahedron, trefoil, tube
from tests.strategies import SEEDS, HoledDisk, RigidMotion, holed_disks, rigid_motions


@given(seed=SEEDS, count=st.integers(0, 300))
def test_the_faces_in_a_box_are_those_whose_boxes_meet_it(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(60, 3))
    faces = rng.integers(0, 60, size=(count, 3))
    patched = PatchedMesh(TriangleMesh(vertices, faces))
    low = rng.normal(size=3)
    high = low + rng.exponential(size=3)
    corners = vertices[faces]
    meets = (corners.min(axis=1) <= high).all(axis=1) & (corners.max(axis=1) >= low).all(axis=1)
    np.testing.assert_array_equal(np.sort(patched.faces_in_box(low, high)), np.flatnonzero(meets))


def loop_with(vertex: int, loops: list[BoundaryLoop]) -> int:
    return next(place for place, loop in enumerate(loops) if vertex in loop.vertex_ids)


def filled_at(mesh: tuple[np.ndarray, np.ndarray], *vertices: int, **options: float) -> tuple[FillResult, LoopOutcome]:
    """The result of filling the loops through some vertices, and the outcome of the last of them."""
    places = [loop_with(vertex, boundary_loops(mesh)) for vertex in vertices]
    _, report = fill_hole(mesh, places, return_report=True, **options)
    return report, report.loops[max(places)]


def named_faces(note: str) -> tuple[int, int]:
    found = re.search(r"first \((\d+), (\d+)\) of the filled mesh", note)
    assert found
    return int(found[1]), int(found[2])


# --- loops ------------------------------------------------------------------------------------------------------------


def test_a_figure_eight_has_no_exact_surface_and_its_crossing_edges_are_named() -> None:
    mesh = collar(figure_eight(64, 0.5), np.array([0, 0, 0.3]))
    _, report = fill_hole(mesh, return_report=True)
    for outcome, middle in zip(report.loops, ([(0, 63), (31, 32)], [(64, 127), (95, 96)]), strict=True):
        assert outcome.requested
        assert outcome.kind == "discrete"
        assert outcome.self_intersections > 0
        # in any order, because the loop is solved in the direction and from the start of its frame
        a, b, c, d = map(int, re.findall(r"\d+", outcome.reason.partition("its edges ")[2])[:4])
        assert {frozenset((a, b)), frozenset((c, d))} == set(map(frozenset, middle))
    assert report.watertight
    assert report.closed
    assert not report.complete
    (loop, _) = boundary_loops(mesh)
    with pytest.raises(SelfCrossingLoopError, match="move them apart") as caught:
        solve_plateau(loop)
    assert caught.value.edges == ((0, 63), (31, 32))
    assert caught.value.count == 1


def test_a_hole_with_a_slit_at_its_edge_is_closed_by_triangles() -> None:
    out = np.array([[1.2, 0, 0], [1.4, 0, 0], [1.6, 0, 0]])
    rim = np.concatenate([circle(40), circle(1), out, out[-2::-1]])
    mesh = collar(rim, np.array([0, 0, 0.3]))
    _, report = fill_hole(mesh, return_report=True)
    assert all(0.1 < outcome.loop.slit_fraction < 0.2 for outcome in report.loops)
    assert report.watertight
    for outcome in report.loops:
        assert outcome.kind == "discrete"
        # the disk, and nothing in the slit
        assert outcome.area == pytest.approx(20 * np.sin(2 * np.pi / 40), rel=1e-9)


# --- patches ----------------------------------------------------------------------------------------------------------


def test_a_patch_without_time_for_a_search_is_not_called_free_of_intersections(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = collar(np.random.default_rng(0).normal(size=(40, 3)), np.array([0, 0, 0.01]))
    monkeypatch.setattr("spinor_geom.fill.fill_loop.LEAST_TIME", -1)
    report, outcome = filled_at(mesh, 0, time_limit=1e-3)
    assert outcome.filled
    assert not outcome.is_searched
    assert outcome.to_dict()["is_searched"] is False
    assert outcome.to_dict()["mesh_intersections"] is None
    assert "not searched for intersections" in repr(outcome)
    assert str(fill_row(outcome)["crossings"]) == "unknown"
    more = replace(report, loops=(*report.loops, replace(outcome, is_searched=True, mesh_intersections=3)))
    assert "at least 3 intersecting pairs" in more.summary
    assert not report.intersection_free
    assert "not searched for all intersections" in report.summary
    assert any("whether the patch intersects anything is not known" in note for note in outcome.remarks)


def test_the_mesh_of_a_film_leaves_time_for_the_search_for_intersections(monkeypatch: pytest.MonkeyPatch) -> None:
    left: dict[str, float] = {}
    for module, name in ((fill_loop, "mesh_over_points"), (new_patch.NewPatch, "fitted")):
        called = getattr(module, name)

        def noted(*args: Any, called: Any = called, name: str = name) -> Any:
            left[name] = seconds_left() + perf_counter()
            return called(*args)

        monkeypatch.setattr(module, name, noted)
    filled_at(tube(), 0, time_limit=60)
    assert left["fitted"] - left["mesh_over_points"] == pytest.approx(LEAST_TIME, abs=1e-3)


def test_the_removal_of_intersections_leaves_time_for_the_search_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    left, fitted = [], fill_loop._Maker._fitted
    monkeypatch.setattr(fill_loop._Maker, "_fitted", lambda *them: (fitted(*them)[0], 5.0))  # seconds of a search
    monkeypatch.setattr(fill_loop, "without_intersections", lambda _, local: left.append(seconds_left()) or local)
    filled_at(spiked_tetrahedron(), 0, time_limit=60)
    assert left[0] < 55


def test_without_time_to_remove_intersections_a_patch_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spinor_geom.fill.fill_loop._SEARCHES", -1e9)  # the limit ends during the removal
    report, outcome = filled_at(spiked_tetrahedron(), 0, time_limit=1e-3)
    assert outcome.filled
    assert outcome.intersections == 1
    assert NOT_CLEARED in outcome.remarks
    assert report.summary.endswith("intersecting pairs of faces")


def test_a_patch_over_a_knot_crosses_itself_and_reports_where() -> None:
    mesh = trefoil(60)
    report, outcome = filled_at(mesh, 0, tolerance=1e-2)
    assert outcome.filled
    assert outcome.self_intersections > 0
    vertices, faces = report.mesh
    first = len(mesh[1])
    pairs = first + self_intersections(vertices, faces[first:])
    assert len(pairs) == outcome.self_intersections
    own = [note for note in outcome.notes if "crosses itself" in note]
    assert len(own) == 1
    assert f"in {len(pairs)} pairs of faces" in own[0]
    assert named_faces(own[0]) == tuple(pairs[0])
    assert not report.intersection_free
    # converged and its reason speak of the boundary alone
    assert outcome.converged is bool(outcome.solution and outcome.solution.converged)
    assert "cross" not in outcome.reason


def test_a_patch_that_a_part_of_the_mesh_pokes_through_reports_it() -> None:
    report, outcome = filled_at(spiked_tetrahedron(), 0)
    assert (outcome.filled, outcome.converged, outcome.faces_added) == (True, True, 1)
    assert (outcome.self_intersections, outcome.mesh_intersections, outcome.patch_intersections) == (0, 1, 0)
    (note,) = outcome.remarks
    assert note.startswith("the patch crosses the mesh in 1 pair of faces, first (4, 3) of the filled mesh, near (1.33")
    assert outcome.intersections == 1
    assert report.complete
    assert not report.intersection_free


@pytest.mark.parametrize("height", [-1e-9, 0.0])
def test_a_spike_whose_tip_is_on_the_patch_crosses_it_and_one_just_below_does_not(height: float) -> None:
    report, outcome = filled_at(spiked_tetrahedron(height), 0)
    assert outcome.mesh_intersections == (1 if height == 0 else 0)
    assert report.intersection_free is (height < 0)


def test_patches_of_two_loops_that_cross_are_counted_once() -> None:
    report, _ = filled_at(linked_rings(), 0, 64)
    large, small = (report.loops[loop_with(vertex, [o.loop for o in report.loops])] for vertex in (0, 64))
    assert large.index < small.index
    assert large.patch_intersections == 0
    patches = [report.extension.faces[report.extension.face_loops == o.index] for o in (small, large)]
    vertices = report.mesh[0]
    assert small.patch_intersections == len(intersections_between(vertices, patches[0], vertices, patches[1])) > 0
    assert any("patches of other loops" in note for note in small.notes)
    assert large.mesh_intersections > 0  # the small ring itself passes the large hole
    assert large.self_intersections == small.self_intersections == 0


# --- no false alarms --------------------------------------------------------------------------------------------------


def star(disk: HoledDisk, loop: BoundaryLoop) -> Patch:
    """The faces that were removed around a vertex, as a patch on the boundary of the hole."""
    vertex = disk.removed[disk.holes.index(frozenset(loop.vertex_ids.tolist()))]
    patch = cone(loop)
    vertices = np.vstack([loop.points, disk.mesh.vertices[vertex]])
    return replace(patch, vertices=vertices)


@given(disk=holed_disks(), motion=rigid_motions(), scale=st.floats(1e-6, 1e6))
def test_what_was_cut_out_of_a_sheet_fits_back_uncrossed(disk: HoledDisk, motion: RigidMotion, scale: float) -> None:
    moved = TriangleMesh(scale * motion(disk.mesh.vertices), disk.mesh.faces)
    whole = HoledDisk(mesh=moved, removed=disk.removed, holes=disk.holes, rim=disk.rim)
    patched = PatchedMesh(moved)
    for loop in find_boundary_loops(moved):
        if frozenset(loop.vertex_ids.tolist()) in disk.holes:
            patch = star(whole, loop)
            assert total(patched.crossings(patch)) == 0
            patched.join(patch, loop.vertex_ids)


@given(seed=SEEDS, share=st.floats(0, 1))
def test_crossings_of_unchanged_faces_need_no_second_test(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    mesh = TriangleMesh(*tube(12, 4))
    patched = PatchedMesh(mesh)
    first, second = find_boundary_loops(mesh)
    patched.join(cone(first), first.vertex_ids)
    # inner vertices at random places in the tube: the faces cross each other, the tube and the other end's patch
    vertices = np.concatenate([second.points, mesh.vertices[rng.integers(0, len(mesh.vertices), 8)] * rng.random(3)])
    faces = np.array([rng.choice(len(vertices), 3, replace=False) for _ in range(30)])
    patch = Patch(vertices=vertices, faces=faces, boundary_size=len(second), points=vertices @ [1, 1j, 0])
    before = patched.crossings(patch)
    # some faces are replaced, the others come in another order
    kept = np.flatnonzero(rng.random(len(faces)) < share)
    places = np.full(len(faces), -1)
    order = rng.permutation(len(faces))
    places[kept] = order[kept]
    after = np.empty_like(faces)
    after[order] = np.where((places < 0)[:, None], faces[:, [0, 2, 1]], faces)
    after[order[places < 0], 0] = rng.integers(0, len(vertices), int((places < 0).sum()))
    changed = Patch(vertices=vertices, faces=after, boundary_size=len(second), points=patch.points)
    whole, partial = patched.crossings(changed), patched.crossings(changed, before, places)
    for name in ("own", "mesh", "patches"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(partial, name))
    assert whole.notes == partial.notes


def total(crossings: Crossings) -> int:
    assert bool(crossings.notes) == bool(len(crossings.own) + len(crossings.mesh) + len(crossings.patches))
    return len(crossings.own) + len(crossings.mesh) + len(crossings.patches)


@pytest.mark.parametrize(
    ("name", "places"), [("trimesh_reference.obj", [0, 1]), ("plane_holes.obj", [1, 2, 20]), ("spot_cut.obj", [2, 60])]
)
def test_patches_of_real_meshes_cross_nothing(name: str, places: list[int]) -> None:
    _, report = fill_hole(read_mesh(Path(__file__).parents[2] / "data" / name), places, return_report=True)
    assert all(report.loops[place].filled for place in places)
    assert report.intersection_free
    assert all(outcome.remarks == () for outcome in report.loops)
