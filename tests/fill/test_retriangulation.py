"""Patches that cross the mesh and whose vertices cannot be moved off it are triangulated again there."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import numpy as np
import pytest

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.ragged import BALLS, bowl, reported_bowls
from spinor_geom.discrete.flattest_triangulation import FlattestTriangulation
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.fill.retriangulation import retriangulated
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from tests.systems import every_second

# noise folds the short edges at the poles of UV spheres; moved alone, patches over these rims cross the mesh
NOISY = [hole for k, hole in enumerate(reported_bowls()) if k in (3, 14, 23, 34)]
RAGGED = [bowl(45 + 5 * k, BALLS[k % 4], noise=0.01 * (k % 3), seed=100 + k) for k in range(8)]


@cache
def filled(hole: Hole, continuity: Literal["C0", "C1"]) -> Any:
    return fill_hole((hole.vertices, hole.faces), 0, continuity=continuity, return_report=True)


@pytest.mark.parametrize("continuity", ["C0", "C1"])
@pytest.mark.parametrize("hole", every_second(NOISY), ids=lambda hole: hole.name)
def test_noisy_walls_are_not_crossed(hole: Hole, continuity: Literal["C0", "C1"]) -> None:
    (vertices, faces), report = filled(hole, continuity)
    (outcome,) = report.loops
    assert report.watertight
    assert outcome.intersections == 0
    patch = faces[len(hole.faces) :]
    assert not len(self_intersections(vertices, patch))
    assert not len(intersections_between(vertices, patch, hole.vertices, hole.faces))
    np.testing.assert_array_equal(vertices[: len(hole.vertices)], hole.vertices)
    np.testing.assert_array_equal(faces[: len(hole.faces)], hole.faces)
    # the report has the number, and says so
    assert outcome.to_dict()["faces_replaced"] == outcome.faces_replaced
    note_start = f"{outcome.faces_replaced} faces of the patch triangulate their outline"
    assert any(note.startswith(note_start) for note in outcome.notes) == (outcome.faces_replaced > 0)
    # a small part of the patch
    assert outcome.faces_replaced < 0.1 * outcome.faces_added
    assert continuity == "C1" or outcome.faces_replaced > 0
    # a continuation that crosses the mesh, and can be cleared, is not dropped for the film
    assert (outcome.kind == "smooth") == (continuity == "C1")


@pytest.mark.parametrize("hole", every_second([*NOISY, *RAGGED]), ids=lambda hole: hole.name)
def test_no_face_and_no_edge_of_the_mesh_is_repeated(hole: Hole) -> None:
    (_, faces), _ = filled(hole, "C0")
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    assert (HalfEdges.of(faces).counts == 2).all()


def test_only_outlines_with_other_charges_are_triangulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    charged: dict[object, list[bool]] = {}  # for each outline, whether triangles were charged before each run
    triangles, charge = FlattestTriangulation.triangles, FlattestTriangulation.charge

    def triangulated(self):
        charged.setdefault(self, [True]).append(False)
        return triangles(self)

    def charging(self, some, charges):
        charged[self][-1] |= bool(charges.any())
        charge(self, some, charges)

    monkeypatch.setattr(FlattestTriangulation, "triangles", triangulated)
    monkeypatch.setattr(FlattestTriangulation, "charge", charging)
    hole = NOISY[1]
    fill_hole((hole.vertices, hole.faces), 0, return_report=True)
    assert sum(map(len, charged.values())) > 5
    assert all(all(before[:-1]) for before in charged.values())


def test_no_edge_of_the_patch_s_other_faces_is_repeated() -> None:
    """A tent of three faces, two of which are crossed: over their outline only the third face's edge is left."""
    t = 2 * np.pi * np.arange(6) / 6
    circle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    own, after = np.arange(6), np.roll(np.arange(6), -1)
    collar = np.concatenate([np.stack([own, own + 6, after], axis=1), np.stack([after, own + 6, after + 6], axis=1)])
    # through the upper end of the edge between the two
    needle = np.array([[0.38, 0.54, 1.38], [-0.66, -0.06, 1.38], [-0.14, 0.24, 1.34]])
    mesh = TriangleMesh(np.concatenate([3 * circle, 5 * circle, needle]), np.vstack([collar, [12, 13, 14]]))
    (rim,) = (loop for loop in find_boundary_loops(mesh) if loop.vertex_ids.max() == 5)
    np.testing.assert_array_equal(rim.vertex_ids, own)
    vertices = np.concatenate([rim.points, circle[::2], [[0, 0, 2]]])
    tent = [[9, 6, 7], [9, 7, 8], [9, 8, 6]]
    around = [[6, 0, 1], [6, 1, 7], [7, 1, 2], [7, 2, 3], [7, 3, 8], [8, 3, 4], [8, 4, 5], [8, 5, 6], [6, 5, 0]]
    faces = np.array([*tent, *around])
    patch = Patch(vertices=vertices, faces=faces, boundary_size=6, points=vertices @ [1, 1j, 0])
    patched = PatchedMesh(mesh)
    crossings = patched.crossings(patch)
    assert len(crossings) == 2
    cleared = retriangulated(patched, NewPatch(patch=patch, rims=[rim], reason="", crossings=crossings))
    assert not len(cleared.crossings)
    assert HalfEdges.of(cleared.patch.faces).counts.max() == 2
