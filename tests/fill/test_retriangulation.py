"""Patches that cross the mesh, and whose vertices cannot be moved off it, are triangulated anew there."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import numpy as np
import pytest

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.ragged import BALLS, bowl, reported_bowls
from spinor_geom.fill import retriangulation
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.topology import HalfEdges
from tests.systems import every_second

# noise folds the short edges at the poles of UV spheres; moved alone, patches over these rims cross the mesh
NOISY = [hole for k, hole in enumerate(reported_bowls()) if k in (3, 14, 23, 34, 42)]
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
    said = f"{outcome.faces_replaced} faces of the patch are a triangulation of their outline"
    assert any(note.startswith(said) for note in outcome.notes) == (outcome.faces_replaced > 0)
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


def test_only_outlines_that_changed_are_triangulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    triangulate, seen = retriangulation.flattest_triangulation, set()

    def counted(points, around, chords, triangles):
        key = points.tobytes() + chords.tobytes() + triangles.tobytes()
        assert key not in seen
        seen.add(key)
        return triangulate(points, around, chords, triangles)

    monkeypatch.setattr(retriangulation, "flattest_triangulation", counted)
    hole = RAGGED[2]
    fill_hole((hole.vertices, hole.faces), 0, return_report=True)
    assert len(seen) > 10
