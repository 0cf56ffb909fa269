"""Replaces the parts of a patch that cross something by triangulations of their outlines that do not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.discrete.first_fill import LONGEST
from spinor_geom.discrete.flattest_triangulation import flattest_triangulation
from spinor_geom.fill.surroundings import Crossings, Surroundings
from spinor_geom.mesh.operators import face_areas, face_normals
from spinor_geom.mesh.topology import HalfEdges, boundary_edges, face_components, is_disk
from spinor_geom.meshing.embed import Patch

# of forbidding triangles, for each region. Of 5 noisy rims that cross something 2 rounds leave 3, 4 and 16 none; where
# the mesh crosses itself at the rim, 4 rounds leave 15 pairs, 8 and 16 leave 3
_ROUNDS = 8
# and for outlines of so few points, whose rounds take little: with 8 one noisy rim of 36 more keeps intersections
_MORE_ROUNDS, _FEW_POINTS = 30, 25


@dataclass(frozen=True, kw_only=True, eq=False)
class Retriangulated:
    """A patch that crosses less than before, or the one it was."""

    patch: Patch
    crossings: Crossings
    faces: int = 0  # how many are new


def retriangulated(
    surroundings: Surroundings, rim: Int[np.ndarray, " m"], patch: Patch, crossings: Crossings
) -> Retriangulated:
    """The patch with outlines around its crossing faces triangulated anew, without inner vertices.

    The outlines grow until nothing crosses, or the whole patch was tried; `rim` are the mesh's vertices around it.
    Outlines of more than 160 points are left as they are.
    """
    best, rings = Retriangulated(patch=patch, crossings=crossings), 0
    while len(best.crossings):
        region = _crossing_faces(best.patch, best.crossings, surroundings.count)
        for _ in range(rings):
            touched = np.zeros(len(best.patch.vertices), dtype=bool)
            touched[np.asarray(best.patch.faces)[region]] = True
            region = touched[best.patch.faces].any(axis=1)
        found = _with_new_triangles(surroundings, rim, best.patch, region, len(best.crossings))
        best = found or best
        if region.all():
            break
        rings = 2 * rings or 1
    return best


def _crossing_faces(patch: Patch, crossings: Crossings, start: int) -> Bool[np.ndarray, " f"]:
    crossing = np.zeros(len(patch.faces), dtype=bool)
    crossing[crossings.own.ravel() - start] = True
    crossing[crossings.mesh[:, 0] - start] = True
    crossing[crossings.patches[:, 0] - start] = True
    return crossing


def _with_new_triangles(
    surroundings: Surroundings, rim: Int[np.ndarray, " m"], patch: Patch, region: Bool[np.ndarray, " f"], allowed: int
) -> Retriangulated | None:
    """The patch with fewer crossings than allowed, and the fewest of some rounds, whose faces in a region are new."""
    faces, best = np.asarray(patch.faces), None
    piece = face_components(faces[region])
    pieces = [np.flatnonzero(region)[piece == k] for k in range(piece.max() + 1)]
    pieces = [one for one in pieces if len(one) > 1 and is_disk(faces[one])]
    outlines = [_Outline(surroundings, rim, patch, one) for one in pieces if len(boundary_edges(faces[one])) <= LONGEST]
    rest = np.delete(faces, np.concatenate([np.zeros(0, dtype=np.int64), *(one.faces for one in outlines)]), axis=0)
    longest = max((len(one.ids) for one in outlines), default=0)
    for _ in range(0 if not outlines else _MORE_ROUNDS if longest <= _FEW_POINTS else _ROUNDS):
        new = [one.triangles() for one in outlines]
        known = [(one, triangles) for one, triangles in zip(outlines, new, strict=True) if triangles is not None]
        if len(known) < len(outlines):
            break
        replaced = _without_unused(
            replace(patch, faces=np.concatenate([rest, *(one.ids[triangles] for one, triangles in known)]))
        )
        crossings = surroundings.crossings(replaced)
        if len(crossings) < allowed:
            allowed = len(crossings)
            best = Retriangulated(patch=replaced, crossings=crossings, faces=len(replaced.faces) - len(rest))
        if not len(crossings):
            break
        wrong = _crossing_faces(replaced, replace(crossings, own=crossings.own[:0]), surroundings.count)
        # of two that cross each other the larger one
        pairs = crossings.own - surroundings.count
        areas = face_areas(replaced.vertices, np.asarray(replaced.faces))
        areas[: len(rest)] = -1.0
        wrong[np.take_along_axis(pairs, areas[pairs].argmax(axis=1)[:, None], axis=1)] = True
        begin = len(rest)
        for one, triangles in known:
            one.forbid(triangles[wrong[begin : begin + len(triangles)]])
            begin += len(triangles)
    return best


class _Outline:
    """The closed curve around some faces of a patch, and which triangles over it are not allowed."""

    def __init__(
        self, surroundings: Surroundings, rim: Int[np.ndarray, " m"], patch: Patch, piece: Int[np.ndarray, " k"]
    ) -> None:
        """Takes the faces of the patch that are to be replaced, which are a disk."""
        self.faces, faces, mesh = piece, np.asarray(patch.faces), surroundings.mesh
        # the mesh's faces beside the rim in the patch's numbering, other vertices after the patch's
        beside = mesh.faces[surroundings.faces_at(rim)]
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
        self._chords = self._taken(surroundings, rim, outside)
        self._triangles = np.zeros((len(sides),) * 3, dtype=bool)

    def _taken(
        self, surroundings: Surroundings, rim: Int[np.ndarray, " m"], outside: Int[np.ndarray, "f 3"]
    ) -> Bool[np.ndarray, "n n"]:
        """Which pairs of the curve's points are joined already, outside of it."""
        n = len(self.ids)
        taken = np.zeros((n, n), dtype=bool)
        on_rim = np.flatnonzero(self.ids < len(rim))
        pairs = np.stack(np.meshgrid(on_rim, on_rim, indexing="ij"), axis=2).reshape(-1, 2)
        taken[pairs[:, 0], pairs[:, 1]] = surroundings.are_taken(rim[self.ids[pairs]])
        place = np.full(max(outside.max(initial=0), self.ids.max()) + 1, -1)
        place[self.ids] = np.arange(n)
        ends = place[np.concatenate([outside, np.roll(outside, -1, axis=1)], axis=0).reshape(2, -1).T]
        ends = ends[(ends >= 0).all(axis=1)]
        taken[ends[:, 0], ends[:, 1]] = taken[ends[:, 1], ends[:, 0]] = True
        return taken

    def triangles(self) -> Int[np.ndarray, "t 3"] | None:
        """The triangles over the curve, by its points, that bend least of those that are allowed."""
        return flattest_triangulation(self._points, self._around, self._chords, self._triangles)

    def forbid(self, triangles: Int[np.ndarray, "k 3"]) -> None:
        """Triangles that are not allowed any more."""
        self._triangles[tuple(triangles.T)] = True


def _in_order(half_edges: HalfEdges) -> Int[np.ndarray, " n"]:
    """The half-edges of a disk's boundary, one after the other."""
    sides = half_edges.boundary
    following = dict(zip(half_edges.origin[sides].tolist(), sides.tolist(), strict=True))
    order = [int(sides[0])]
    while len(order) < len(sides):
        order.append(following[int(half_edges.target[order[-1]])])
    return np.array(order)


def _without_unused(patch: Patch) -> Patch:
    """A patch without inner vertices that have no face."""
    used = np.zeros(len(patch.vertices), dtype=bool)
    used[patch.faces] = True
    used[: patch.boundary_size] = True
    faces = (np.cumsum(used) - 1)[patch.faces]
    return replace(patch, vertices=patch.vertices[used], points=patch.points[used], faces=faces)
