"""Removes intersections of a patch: triangulates the outlines of the regions around them, without inner vertices."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.errors import OutOfTimeError
from spinor_geom.fill.clearance import cleared
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.outlines import Outline, outlines_of
from spinor_geom.fill.patched_mesh import Crossings, PatchedMesh
from spinor_geom.mesh.intersections import edges_through
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.topology import referenced_vertices
from spinor_geom.meshing.embed import Patch


class Avoidable(NamedTuple):
    """Pairs of intersecting faces that another patch over the same rim may not have."""

    own: Int[np.ndarray, "i 2"]  # both faces are the patch's
    others: Int[np.ndarray, "j 2"]  # a face of the patch, and one of the mesh or of another patch


class RimCrossings:
    """The faces of the mesh and of other patches through which edges of a rim pass.

    Any patch face with this edge intersects them.
    """

    def __init__(self, patched: PatchedMesh, new: NewPatch) -> None:
        """Tests the edges of the rim with the faces that the patch intersects."""
        self._first, self._after = patched.face_count, rim_successors(new.patch.rims)
        pairs = np.concatenate([new.crossings.mesh, new.crossings.patches])
        pair, start, end = self._rim_edges(new.patch, pairs)
        vertices, others = new.patch.vertices, pairs[pair, 1]
        through = edges_through(vertices[start], vertices[end], patched.corners(others))
        self._keys = np.unique(self._keys_of(start[through], others[through]))

    def _rim_edges(
        self, patch: Patch, pairs: Int[np.ndarray, "k 2"]
    ) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
        """The edges of the rim that belong to the first faces of pairs: the pair, and the ends of the edge."""
        starts = np.asarray(patch.faces)[pairs[:, 0] - self._first]
        ends = starts[:, [1, 2, 0]]
        pair, side = np.nonzero(starts < patch.boundary_size)
        start, end = starts[pair, side], ends[pair, side]
        is_rim = self._after[start] == end
        return pair[is_rim], start[is_rim], end[is_rim]

    def _keys_of(self, start: Int[np.ndarray, " k"], face: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        return np.asarray(start * self._first + face)

    def avoidable(self, patch: Patch, crossings: Crossings) -> Avoidable:
        """The intersections of a patch without those at its rim."""
        pairs = np.concatenate([crossings.mesh, crossings.patches])
        if len(self._keys):
            pair, start, _ = self._rim_edges(patch, pairs)
            pairs = np.delete(pairs, pair[np.isin(self._keys_of(start, pairs[pair, 1]), self._keys)], axis=0)
        return Avoidable(own=crossings.own, others=pairs)


# Largest share of a patch's area that is triangulated again in one step, so that the rest stays the surface.
_MOST_AREA = 1 / 3
# Largest change of the area by new triangles, per area of the patch: where more is needed, it runs along the mesh.
_MOST_CHANGE = 0.05


NOT_CLEARED = "the time limit ended the removal of intersections"


def without_intersections(patched: PatchedMesh, new: NewPatch) -> NewPatch:
    """Moves a patch away from the mesh, and retriangulates it where it still intersects something."""
    with suppress(OutOfTimeError):
        new = cleared(patched, new)
        new = retriangulated(patched, new)
    if not len(new.crossings) or not is_out_of_time():
        return new
    return replace(new, remarks=(*new.remarks, NOT_CLEARED))


def retriangulated(patched: PatchedMesh, new: NewPatch) -> NewPatch:
    """Retriangulates regions around the intersecting faces of a patch, without inner vertices.

    The regions grow until nothing intersects, they are a third of the patch's area, or time is out. New triangles are
    taken if they have fewer intersections and change the area of the patch by at most 5 %. Faces that intersect
    something at the rim only, as every patch does there, are not changed, nor are regions with outlines of more than
    160 points.
    """
    if not len(new.crossings):
        return new
    rings, at_rim, is_replaced = 0, RimCrossings(patched, new), np.zeros(len(new.patch.faces), dtype=bool)
    area = new.patch.area
    while not is_out_of_time():
        faces, wrong = np.asarray(new.patch.faces), at_rim.avoidable(new.patch, new.crossings)
        region = np.zeros(len(faces), dtype=bool)
        region[np.concatenate([wrong.own.ravel(), wrong.others[:, 0]]) - patched.face_count] = True
        if not region.any():
            break
        for _ in range(rings):
            a, b, c = referenced_vertices(faces[region], vertices=len(new.patch.vertices))[faces.T]
            region = a | b | c
        if not face_areas(new.patch.vertices, faces[region]).sum() < _MOST_AREA * area:
            break
        new, is_replaced = _with_new_triangles(patched, new, is_replaced, np.flatnonzero(region), at_rim, area)
        rings = 4 * rings or 1
    return new


def _with_new_triangles(
    patched: PatchedMesh,
    new: NewPatch,
    is_replaced: Bool[np.ndarray, " f"],
    region: Int[np.ndarray, " r"],
    at_rim: RimCrossings,
    area: float,
) -> tuple[NewPatch, Bool[np.ndarray, " g"]]:
    """The patch with new faces in a region, if it has fewer intersections, else the patch itself.

    Each outline is triangulated several times, and its best triangulation is taken. `area` is that of the surface.

    Returns:
        The patch, and which of its faces are not those of the surface. `is_replaced` are those before.
    """
    outlines = outlines_of(patched, new, region)
    if not outlines:
        return new, is_replaced
    faces, count = np.asarray(new.patch.faces), len(new.patch.vertices)
    inside = np.concatenate([one.faces for one in outlines])
    outside = np.delete(np.arange(len(faces)), inside)
    # first the faces outside, then those of each outline
    patch = replace(new.patch, faces=faces[np.concatenate([outside, inside])])
    crossings = patched.crossings(patch, new.crossings, np.argsort(np.concatenate([outside, inside])))
    best = None
    while True:
        _judge(patched, patch, crossings, outlines, at_rim)
        for one in outlines:
            one.advance()
        before = np.asarray(patch.faces)
        patch = replace(patch, faces=np.concatenate([faces[outside], *(one.current for one in outlines)]))
        places = _places(before, np.asarray(patch.faces), len(outside), count)
        try:
            crossings = patched.crossings(patch, crossings, places)
        except OutOfTimeError:
            break
        is_near = abs(patch.area - area) <= _MOST_CHANGE * area
        if is_near and len(crossings) < len(new.crossings if best is None else best.crossings):
            parts = [is_replaced[outside], *(one.is_replaced(is_replaced) for one in outlines)]
            best, is_best_replaced = replace(new, patch=patch, crossings=crossings), np.concatenate(parts)
        if not len(crossings) or not any(one.is_open for one in outlines) or is_out_of_time():
            break
    if best is None:
        return new, is_replaced
    number = int(is_best_replaced.sum())
    return replace(best, patch=_without_unused(best.patch), faces_replaced=number), is_best_replaced


def _judge(
    patched: PatchedMesh, patch: Patch, crossings: Crossings, outlines: Sequence[Outline], at_rim: RimCrossings
) -> None:
    """Passes intersections to outlines, whose faces are the last ones of a patch."""
    sizes = [len(one.current) for one in outlines]
    first = len(patch.faces) - sum(sizes)
    owner = np.concatenate([np.full(first, -1), np.repeat(np.arange(len(sizes)), sizes)])
    is_new = np.concatenate([np.zeros(first, dtype=bool), np.repeat([one.is_new for one in outlines], sizes)])
    wrong = at_rim.avoidable(patch, crossings)
    own, other = wrong.own - patched.face_count, wrong.others[:, 0] - patched.face_count
    pairs = owner[own]
    pairs[pairs[:, 0] == pairs[:, 1], 1] = -1
    counts = np.bincount(1 + np.concatenate([pairs.ravel(), owner[other]]), minlength=1 + len(sizes))[1:]
    # of two new triangles that intersect each other, the larger one
    areas = np.where(is_new, face_areas(patch.vertices, np.asarray(patch.faces)), -1.0)
    larger = np.take_along_axis(own, areas[own].argmax(axis=1)[:, None], axis=1).ravel()
    charges = np.bincount(np.concatenate([larger, other]), minlength=len(owner))
    for k, one in enumerate(outlines):
        one.judge(int(counts[k]), charges[owner == k])


def _places(
    before: Int[np.ndarray, "f 3"], after: Int[np.ndarray, "g 3"], first: int, vertices: int
) -> Int[np.ndarray, " f"]:
    """The number of each face after a change, −1 for none. The `first` ones are the same."""
    places = np.full(len(before), -1)
    places[:first] = np.arange(first)
    keys, new_keys = (faces[first:] @ [vertices**2, vertices, 1] for faces in (before, after))
    _, old, new = np.intersect1d(keys, new_keys, return_indices=True)
    places[first + old] = first + new
    return places


def _without_unused(patch: Patch) -> Patch:
    """Removes inner vertices without faces."""
    used = np.zeros(len(patch.vertices), dtype=bool)
    used[patch.faces] = True
    used[: patch.boundary_size] = True
    faces = (np.cumsum(used) - 1)[patch.faces]
    return replace(patch, vertices=patch.vertices[used], points=patch.points[used], faces=faces)
