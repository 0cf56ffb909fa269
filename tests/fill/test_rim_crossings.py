"""Intersections at edges of the rim are those of every patch, and nothing is triangulated again for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spinor_geom.fill import outlines
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.fill.retriangulation import RimCrossings, retriangulated
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import as_mesh, circle, collar, cone, fan


def with_needles(*heights: float) -> tuple[TriangleMesh, BoundaryLoop]:
    """An outward collar of a hexagon, with upright triangles through the middles of its first sides."""
    rim = circle(6)
    vertices, faces = collar(rim, np.array([0.0, 0.0, -1.0]))
    for k, height in enumerate(heights):
        middle, out = (rim[k] + rim[k + 1]) / 2, np.array([0.0, 0.0, 1.0])
        across = 0.1 * middle
        needle = np.stack([middle - across, middle + across, middle + height * out]) - 0.1 * out
        faces = np.concatenate([faces, [len(vertices) + np.arange(3)]])
        vertices = np.concatenate([vertices, needle])
    mesh = as_mesh((vertices, faces))
    (loop,) = (loop for loop in find_boundary_loops(mesh) if set(loop.vertex_ids) == set(range(6)))
    return mesh, loop


@pytest.mark.parametrize("apex", range(6))
def test_every_triangulation_crosses_what_the_rim_passes_through(apex: int) -> None:
    mesh, loop = with_needles(0.5, 0.5)
    patched = PatchedMesh(mesh)
    patches = (cone(loop), fan(loop, apex))
    first, other = (NewPatch(patch=p, rims=[loop], reason="", crossings=patched.crossings(p)) for p in patches)
    at_rim = RimCrossings(patched, first)
    for new in (first, other):
        assert len(new.crossings.mesh) >= 2
        wrong = at_rim.avoidable(new.patch, new.crossings)
        assert not len(wrong.own)
        assert not len(wrong.others)


def test_other_intersections_are_avoidable() -> None:
    mesh, loop = with_needles(0.5)
    vertices = np.concatenate([mesh.vertices, [[0.1, 0, 1], [0, 0.1, 1], [0.1, 0.2, -1]]])
    patched = PatchedMesh(as_mesh((vertices, np.concatenate([mesh.faces, [len(mesh.vertices) + np.arange(3)]]))))
    patch = cone(loop)
    new = NewPatch(patch=patch, rims=[loop], reason="", crossings=patched.crossings(patch))
    others = RimCrossings(patched, new).avoidable(patch, new.crossings).others
    assert len(new.crossings.mesh) == len(others) + 1
    assert set(others[:, 1]) == {len(mesh.faces)}


def test_patches_that_cross_at_the_rim_only_are_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any) -> None:
        raise AssertionError("triangulated again")

    monkeypatch.setattr(outlines, "FlattestTriangulation", never)
    mesh, loop = with_needles(0.5)
    patched = PatchedMesh(mesh)
    new = NewPatch(patch=cone(loop), rims=[loop], reason="", crossings=patched.crossings(cone(loop)))
    assert len(new.crossings) == 1
    assert retriangulated(patched, new) is new
    # in the whole fill as well
    _, report = fill_hole((mesh.vertices, mesh.faces), return_report=True)
    (outcome,) = (outcome for outcome in report.loops if set(outcome.loop.vertex_ids) == set(range(6)))
    assert outcome.mesh_intersections == 1
    assert outcome.faces_replaced == 0
