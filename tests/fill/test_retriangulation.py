"""Patches that cross the mesh and whose vertices cannot be moved off it are triangulated again there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.ragged import BALLS, bowl
from spinor_geom.errors import OutOfTimeError
from spinor_geom.fill.clearance import cleared
from spinor_geom.fill.discrete_patch import graded_patch
from spinor_geom.fill.fill_loop import fill_loop
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import Crossings, PatchedMesh
from spinor_geom.fill.retriangulation import retriangulated
from spinor_geom.fill.solved_loops import solved_loops
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from tests.fill.shapes import circle, collar, together
from tests.fill.test_clearance import NOISY, filled
from tests.systems import every_second

RAGGED = [bowl(45 + 5 * k, BALLS[k % 4], noise=0.01 * (k % 3), seed=100 + k) for k in range(8)]


@pytest.mark.parametrize("continuity", ["C0", "C1"])
@pytest.mark.parametrize("hole", every_second(NOISY), ids=lambda hole: hole.name)
def test_replaced_faces_are_few_and_reported(hole: Hole, continuity: Literal["C0", "C1"]) -> None:
    (outcome,) = filled(hole, continuity)[1].loops
    assert outcome.to_dict()["faces_replaced"] == outcome.faces_replaced
    note_start = f"{outcome.faces_replaced} faces of the patch triangulate their outline"
    assert any(note.startswith(note_start) for note in outcome.notes) == (outcome.faces_replaced > 0)
    assert outcome.faces_replaced < 0.1 * outcome.faces_added
    assert continuity == "C1" or outcome.faces_replaced > 0
    # a continuation that crosses the mesh, and can be cleared, is not dropped for the film
    assert (outcome.kind == "smooth") == (continuity == "C1")


@pytest.mark.parametrize("hole", every_second([*NOISY, *RAGGED]), ids=lambda hole: hole.name)
def test_no_face_and_no_edge_of_the_mesh_is_repeated(hole: Hole) -> None:
    (_, faces), _ = filled(hole, "C0")
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    assert (HalfEdges.of(faces).counts == 2).all()


@pytest.mark.parametrize("step", [cleared, retriangulated])
def test_what_the_time_limit_interrupts_is_kept_as_far_as_it_is(
    step: Callable[[PatchedMesh, NewPatch], NewPatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = TriangleMesh(NOISY[2].vertices, NOISY[2].faces)
    (loop, *_) = find_boundary_loops(mesh)
    patched, patch = PatchedMesh(mesh), graded_patch(loop, loop.mean_edge_length)
    new = NewPatch(patch=patch, rims=[loop], reason="").fitted(patched)
    search, left = PatchedMesh.crossings, iter([True, True, False])

    def interrupted(*arguments: Any) -> Crossings:
        if next(left, True):
            return search(*arguments)
        raise OutOfTimeError

    monkeypatch.setattr(PatchedMesh, "crossings", interrupted)
    assert len(step(patched, new).crossings) < len(new.crossings)


def tent(radius: float) -> tuple[PatchedMesh, NewPatch]:
    """A patch over a circle with a tent of three faces in its middle, two of which are crossed."""
    hexagon, own, after = circle(6), np.arange(6), np.roll(np.arange(6), -1)
    # through the upper end of the edge between the two
    needle = np.array([[0.38, 0.54, 1.38], [-0.66, -0.06, 1.38], [-0.14, 0.24, 1.34]])
    mesh = TriangleMesh(*together(collar(radius * hexagon, radius * hexagon), (needle, np.array([[0, 1, 2]]))))
    (rim,) = (loop for loop in find_boundary_loops(mesh) if loop.vertex_ids.max() == 5)
    np.testing.assert_array_equal(rim.vertex_ids, own)
    vertices = np.concatenate([rim.points, hexagon[::2], [[0, 0, 2]], 1.5 * hexagon])
    faces = [[9, 6, 7], [9, 7, 8], [9, 8, 6]]
    around = [[6, 10, 11], [6, 11, 7], [7, 11, 12], [7, 12, 13], [7, 13, 8], [8, 13, 14], [8, 14, 15], [8, 15, 6]]
    belt = np.concatenate([np.stack([own + 10, own, after], axis=1), np.stack([own + 10, after, after + 10], axis=1)])
    faces = np.array([*faces, *around, [6, 15, 10], *belt])
    patch = Patch(vertices=vertices, faces=faces, boundary_size=6, points=vertices @ [1, 1j, 0])
    patched = PatchedMesh(mesh)
    new = NewPatch(patch=patch, rims=[rim], reason="", crossings=patched.crossings(patch))
    assert len(new.crossings) == 2
    return patched, new


def test_no_edge_of_the_patch_s_other_faces_is_repeated() -> None:
    # over the outline of two faces of the tent only the third face's edge is left
    cleared = retriangulated(*tent(6.0))
    assert not len(cleared.crossings)
    assert HalfEdges.of(cleared.patch.faces).counts.max() == 2


def test_a_patch_keeps_its_faces_if_new_ones_would_change_most_of_it() -> None:
    patched, new = tent(2.0)
    assert retriangulated(patched, new) is new


def test_a_patch_over_a_knot_without_a_mesh_has_its_crossings_reported() -> None:
    t = 2 * np.pi * np.arange(90) / 90
    radius = 2 + np.cos(3 * t)
    trefoil = np.stack([radius * np.cos(2 * t), radius * np.sin(2 * t), np.sin(3 * t)], axis=1)
    loop, options = BoundaryLoop.from_points(trefoil), FillOptions()
    alone = PatchedMesh(TriangleMesh(trefoil, np.zeros((0, 3), dtype=np.int64)))
    outcome, _ = fill_loop(alone, 0, loop, next(solved_loops([loop], options)), options)
    assert outcome.filled
    assert outcome.self_intersections > 0
