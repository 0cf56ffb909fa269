"""Removes intersections of a patch: triangulates the outlines of the regions around them, without inner vertices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.discrete.first_fill import LONGEST
from spinor_geom.discrete.flattest_triangulation import flattest_triangulation
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.operators import face_areas, face_normals
from spinor_geom.mesh.topology import HalfEdges, boundary_edges, face_components, is_disk, referenced_vertices
from spinor_geom.meshing.embed import Patch

# Triangulations of each region; after each, intersecting triangles are forbidden. Of 5 noisy rims, 3 keep intersections
# after 2 rounds, none after 4 or 16; where the mesh intersects itself at the rim, 4 rounds leave 15 pairs, 8 and 16
# leave 3.
_ROUNDS = 8
# for outlines of few points, whose rounds take little time; with 8, one more of 36 noisy rims keeps intersections
_MORE_ROUNDS, _FEW_POINTS = 30, 25


def retriangulated(patched: PatchedMesh, new: NewPatch) -> NewPatch:
    """Retriangulates regions around the intersecting faces of a patch, without inner vertices.

    The regions grow until nothing intersects or they cover the patch. Regions with outlines of more than 160 points are
    not changed.
    """
    rings = 0
    while len(new.crossings):
        faces, crossings = np.asarray(new.patch.faces), new.crossings
        own = np.concatenate([crossings.own.ravel(), crossings.mesh[:, 0], crossings.patches[:, 0]])
        region = np.zeros(len(faces), dtype=bool)
        region[own - patched.face_count] = True
        for _ in range(rings):
            a, b, c = referenced_vertices(faces[region], vertices=len(new.patch.vertices))[faces.T]
            region = a | b | c
        new = _with_new_triangles(patched, new, region)
        if region.all():
            break
        rings = 2 * rings or 1
    return new


def _with_new_triangles(patched: PatchedMesh, new: NewPatch, region: Bool[np.ndarray, " f"]) -> NewPatch:
    """The patch with new faces in a region, if it has fewer intersections, else the patch itself.

    After each round, new triangles that intersect something are forbidden in the next ones.
    """
    faces, best = np.asarray(new.patch.faces), new
    component = face_components(faces[region])
    pieces = [np.flatnonzero(region)[component == k] for k in range(component.max() + 1)]
    outlines = [
        _Outline(patched, new, piece)
        for piece in pieces
        if len(piece) > 1 and is_disk(faces[piece]) and len(boundary_edges(faces[piece])) <= LONGEST
    ]
    if not outlines:
        return new
    is_kept = np.ones(len(faces), dtype=bool)
    is_kept[np.concatenate([one.faces for one in outlines])] = False
    rest, numbers = faces[is_kept], np.where(is_kept, np.cumsum(is_kept) - 1, -1)
    longest = max(len(one.ids) for one in outlines)
    for _ in range(_MORE_ROUNDS if longest <= _FEW_POINTS else _ROUNDS):
        found = [triangles for one in outlines if (triangles := one.triangles()) is not None]
        if len(found) < len(outlines):
            break
        numbered = [one.ids[triangles] for one, triangles in zip(outlines, found, strict=True)]
        replaced = _without_unused(replace(new.patch, faces=np.concatenate([rest, *numbered])))
        crossings = patched.crossings(replaced, new.crossings, numbers)
        if len(crossings) < len(best.crossings):
            count = len(replaced.faces) - len(rest)
            best = replace(new, patch=replaced, crossings=crossings, faces_replaced=count)
        if not len(crossings):
            break
        # of two new triangles that intersect each other, the larger one is forbidden
        own = crossings.own - patched.face_count
        areas = face_areas(replaced.vertices, np.asarray(replaced.faces))
        areas[: len(rest)] = -1.0
        larger = np.take_along_axis(own, areas[own].argmax(axis=1)[:, None], axis=1).ravel()
        others = np.concatenate([crossings.mesh[:, 0], crossings.patches[:, 0]]) - patched.face_count
        wrong = np.isin(np.arange(len(rest), len(replaced.faces)), np.concatenate([larger, others]))
        if not wrong.any():
            break  # the remaining intersections are not of new triangles
        parts = np.split(wrong, np.cumsum([len(triangles) for triangles in found])[:-1])
        for one, triangles, is_wrong in zip(outlines, found, parts, strict=True):
            one.forbid(triangles[is_wrong])
    return best


class _Outline:
    """The closed polygon around faces of a patch, and the edges and triangles that its triangulation must not have."""

    def __init__(self, patched: PatchedMesh, new: NewPatch, piece: Int[np.ndarray, " k"]) -> None:
        """`piece` are the faces of the patch to be replaced, a topological disk."""
        patch, rim, mesh = new.patch, new.rim, patched.mesh
        self.faces, faces = piece, np.asarray(patch.faces)
        # mesh faces at the rim; rim vertices have their numbers in the patch, other vertices numbers after these
        beside = mesh.faces[patched.faces_at(rim)]
        others = np.setdiff1d(beside, rim)
        ids = np.concatenate([rim, others])
        numbers = np.concatenate([np.arange(len(rim)), len(patch.vertices) + np.arange(len(others))])
        order = np.argsort(ids, kind="stable")
        beside = numbers[order[np.searchsorted(ids[order], beside)]]
        outside = np.concatenate([np.delete(faces, piece, axis=0), beside])
        vertices = np.concatenate([patch.vertices, mesh.vertices[others]])
        sides = _in_order(HalfEdges.of(faces[piece]))
        joined = HalfEdges.of(np.concatenate([faces[piece], outside]))
        self.ids = joined.origin[sides]
        twin = joined.twin[sides]
        normals = face_normals(vertices, outside)[twin // 3 - len(piece)]
        normals[joined.origin[twin] == self.ids] *= -1
        normals[twin < 0] = np.nan
        self._points, self._around = patch.vertices[self.ids], normals
        self._chords = self._edges_outside(patched, rim, outside)
        self._forbidden = np.zeros((len(sides),) * 3, dtype=bool)
        self._found: Int[np.ndarray, "t 3"] | None = None
        self._is_current = False  # whether `_found` has no triangle that was forbidden since

    def _edges_outside(
        self, patched: PatchedMesh, rim: Int[np.ndarray, " m"], outside: Int[np.ndarray, "f 3"]
    ) -> Bool[np.ndarray, "n n"]:
        """Whether pairs of the polygon's points are edges of other faces."""
        n = len(self.ids)
        taken = np.zeros((n, n), dtype=bool)
        on_rim = np.flatnonzero(self.ids < len(rim))
        pairs = np.stack(np.meshgrid(on_rim, on_rim, indexing="ij"), axis=2).reshape(-1, 2)
        taken[pairs[:, 0], pairs[:, 1]] = patched.has_edges(rim[self.ids[pairs]])
        place = np.full(max(outside.max(initial=0), self.ids.max()) + 1, -1)
        place[self.ids] = np.arange(n)
        ends = place[np.concatenate([outside, np.roll(outside, -1, axis=1)], axis=0).reshape(2, -1).T]
        ends = ends[(ends >= 0).all(axis=1)]
        taken[ends[:, 0], ends[:, 1]] = taken[ends[:, 1], ends[:, 0]] = True
        return taken

    def triangles(self) -> Int[np.ndarray, "t 3"] | None:
        """The flattest allowed triangulation, as indices of the polygon's points; None if there is none."""
        if not self._is_current:
            self._found = flattest_triangulation(self._points, self._around, self._chords, self._forbidden)
            self._is_current = True
        return self._found

    def forbid(self, triangles: Int[np.ndarray, "k 3"]) -> None:
        """Excludes triangles from later triangulations."""
        self._forbidden[tuple(triangles.T)] = True
        self._is_current = self._is_current and not len(triangles)


def _in_order(half_edges: HalfEdges) -> Int[np.ndarray, " n"]:
    """The half-edges of a disk's boundary, in order along it."""
    sides = half_edges.boundary
    following = dict(zip(half_edges.origin[sides].tolist(), sides.tolist(), strict=True))
    order = [int(sides[0])]
    while len(order) < len(sides):
        order.append(following[int(half_edges.target[order[-1]])])
    return np.array(order)


def _without_unused(patch: Patch) -> Patch:
    """Removes inner vertices without faces."""
    used = np.zeros(len(patch.vertices), dtype=bool)
    used[patch.faces] = True
    used[: patch.boundary_size] = True
    faces = (np.cumsum(used) - 1)[patch.faces]
    return replace(patch, vertices=patch.vertices[used], points=patch.points[used], faces=faces)
