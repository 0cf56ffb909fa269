"""Joining patches: orientation, indices, and edges that already have two faces."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh, patch_chords, split_chords, stitch
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.meshing.embed import Patch
from tests.closed import is_watertight
from tests.fill.shapes import as_mesh, cone, fan, folded_quad, on_circle, tube, undirected_edges
from tests.strategies import holed_disks, ragged_meshes
from tests.validity import validate


def joined(mesh: TriangleMesh, extension: MeshExtension) -> TriangleMesh:
    arrays = ((mesh.vertices, extension.vertices), (mesh.faces, extension.faces))
    return TriangleMesh(*map(np.concatenate, arrays))


def flat_position(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points.real, points.imag, np.zeros(len(points))])


def hexagon() -> BoundaryLoop:
    return BoundaryLoop.from_points(flat_position(on_circle(6)))


def fitted(patched: PatchedMesh, patch: Patch, rim: np.ndarray) -> tuple[Patch, int]:
    """The patch with its taken chords split, and their number."""
    taken = patched.taken_chords(patch, rim)
    return split_chords(patch, taken), len(taken)


def filled_with_fans(mesh: TriangleMesh, apex: int) -> tuple[TriangleMesh, bool]:
    """Every loop filled by chords alone, and whether none had to be left out."""
    loops = find_boundary_loops(mesh)
    patched = PatchedMesh(mesh, loops)
    parts = []
    for place, loop in enumerate(loops):
        if patched.face_on(loop) is None:
            patch, _ = fitted(patched, fan(loop, apex % len(loop)), loop.vertex_ids)
            patched.join(patch, loop.vertex_ids)
            parts.append(LoopPatch(index=place, rim=loop.vertex_ids, patch=patch, attributes={}))
    return joined(mesh, stitch(mesh, parts)), len(parts) == len(loops)


def test_chords_of_a_fan_are_its_inner_edges() -> None:
    np.testing.assert_array_equal(patch_chords(fan(hexagon())), [[0, 2], [0, 3], [0, 4]])
    np.testing.assert_array_equal(patch_chords(fan(hexagon(), apex=5)), [[1, 5], [2, 5], [3, 5]])


@given(chosen=st.sets(st.integers(0, 2), min_size=1))
def test_splitting_chords_keeps_area_orientation_and_rim(chosen: set[int]) -> None:
    patch = fan(hexagon())
    chords = patch_chords(patch)[sorted(chosen)]
    apexes = np.random.default_rng(0).normal(size=(len(chords), 3))
    faces = np.column_stack([chords, 6 + np.arange(len(chords))])
    beside = TriangleMesh(np.concatenate([patch.vertices, apexes]), faces)
    split, count = fitted(PatchedMesh(beside, [hexagon()]), patch, np.arange(6))
    assert count == len(chords)
    corners = split.points[split.faces]
    areas = ((corners[:, 1] - corners[:, 0]).conj() * (corners[:, 2] - corners[:, 0])).imag / 2
    assert (areas > 0).all()
    np.testing.assert_allclose(areas.sum(), 3**1.5 / 2, rtol=1e-14)
    assert len(split.faces) == len(patch.faces) + 2 * len(chords)
    np.testing.assert_array_equal(split.vertices[:6], patch.vertices)
    left = {tuple(edge) for edge in patch_chords(split).tolist()}
    assert not left & {tuple(edge) for edge in chords.tolist()}


def test_a_chord_on_a_taken_edge_is_split_and_a_free_one_stays() -> None:
    mesh = as_mesh(folded_quad())
    (loop,) = find_boundary_loops(mesh)
    free_apex = int(np.flatnonzero(loop.vertex_ids == 0)[0])
    patched = PatchedMesh(mesh, [loop])
    kept, none = fitted(patched, fan(loop, free_apex), loop.vertex_ids)
    split, one = fitted(patched, fan(loop, free_apex + 1), loop.vertex_ids)
    assert (none, one) == (0, 1)
    assert len(kept.vertices) == 4
    assert len(split.vertices) == 5
    for patch in (kept, split):
        part = LoopPatch(index=0, rim=loop.vertex_ids, patch=patch, attributes={})
        assert is_watertight(joined(mesh, stitch(mesh, [part])).faces)


def test_a_chord_that_an_earlier_patch_took_is_split_in_the_next() -> None:
    # two squares that touch in two opposite corners: both could be divided along the line between those corners
    ring = TriangleMesh(np.random.default_rng(3).normal(size=(6, 3)), np.array([[0, 1, 4]]))
    first, second = (
        BoundaryLoop(points=ring.vertices[ids], vertex_ids=np.array(ids), corners=np.zeros(4, bool))
        for ids in ([0, 1, 2, 3], [0, 4, 2, 5])
    )
    patched = PatchedMesh(ring, [first, second])
    patch, split = fitted(patched, fan(first), first.vertex_ids)
    assert split == 0
    patched.join(patch, first.vertex_ids)
    assert fitted(patched, fan(second), second.vertex_ids)[1] == 1


def test_the_outline_of_a_lone_face_is_recognised() -> None:
    vertices = np.random.default_rng(0).normal(size=(7, 3))
    mesh = TriangleMesh(vertices, np.array([[0, 1, 2], [3, 4, 5], [3, 5, 6]]))
    loops = {len(loop): loop for loop in find_boundary_loops(mesh)}
    patched = PatchedMesh(mesh, loops.values())
    assert patched.face_on(loops[3]) == 0
    assert patched.face_on(loops[4]) is None


def test_new_vertices_and_faces_come_loop_by_loop() -> None:
    mesh = as_mesh(tube(), color=np.ones((48, 3)))
    loops = find_boundary_loops(mesh)
    colors = [{"color": np.full((1, 3), float(place))} for place in range(len(loops))]
    parts = [
        LoopPatch(index=place, rim=loop.vertex_ids, patch=cone(loop), attributes=colors[place])
        for place, loop in enumerate(loops)
    ]
    extension = stitch(mesh, parts)
    np.testing.assert_allclose(extension.vertices, [loop.centroid for loop in loops], atol=1e-15)
    np.testing.assert_array_equal(extension.face_loops, np.repeat([0, 1], 16))
    np.testing.assert_array_equal(extension.vertex_attributes["color"], [[0, 0, 0], [1, 1, 1]])
    assert set(extension.faces[:16].ravel()) == {*range(16), 48}
    assert set(extension.faces[16:].ravel()) == {*range(32, 48), 49}
    assert is_watertight(joined(mesh, extension).faces)


@given(mesh=ragged_meshes(), apex=st.integers(0, 1000))
def test_ragged_meshes_filled_by_chords_are_watertight_and_valid(mesh: TriangleMesh, apex: int) -> None:
    filled, complete = filled_with_fans(mesh, apex)
    validate(filled)
    np.testing.assert_array_equal(filled.faces[: len(mesh.faces)], mesh.faces)
    _, uses = np.unique(undirected_edges(filled.faces), axis=0, return_counts=True)
    assert uses.max() <= 2
    assert is_watertight(filled.faces) == complete


@given(disk=holed_disks(), apex=st.integers(0, 1000))
def test_disks_with_holes_become_spheres(disk: object, apex: int) -> None:
    filled, complete = filled_with_fans(disk.mesh, apex)
    assert complete
    assert is_watertight(filled.faces)
    used = len(np.unique(filled.faces))
    edges = len(np.unique(undirected_edges(filled.faces), axis=0))
    assert used - edges + len(filled.faces) == 2
