"""Remeshing of patches in space, without a plane domain: edges are split, collapsed and flipped, vertices moved.

The rims' vertices and edges are kept. Edges get about the wanted lengths, and angles are increased: edges are flipped
where that increases the smallest angle of their two triangles, inner vertices move along the surface.

Source: Botsch & Kobbelt, "A remeshing approach to multiresolution modeling", Symposium on Geometry Processing (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from spinor_geom.deadline import require_time
from spinor_geom.domain.delaunay import rim_successors, unique_edges
from spinor_geom.domain.sizes import GROWTH
from spinor_geom.mesh.array_checks import igl_arrays
from spinor_geom.mesh.operators import face_areas, face_normals, internal_angles, vertex_normals
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import DECAY, require_few_points

_ROUNDS = 3
# shortest and longest edges, in wanted lengths
_SHORTEST, _LONGEST = 0.6, 4 / 3
_GOOD = np.radians(25.0)  # triangles with larger angles are not improved by single vertices
_THIN = np.radians(10.0)
_MOST_FLIPS = 50  # rounds of flips
# a vertex of a poor triangle is tried at eight places around it, at these multiples of the mean length of its edges
_STEPS = (0.3, 0.3, 0.15, 0.15, 0.08, 0.08)

Positions = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "f 3"]
Size = Callable[[Float[np.ndarray, "k 3"]], Float[np.ndarray, " k"]]


def remesh(patch: Patch, target: float, taken: Int[np.ndarray, "e 2"]) -> Patch:
    """A patch remeshed to an edge length in space, graded towards the lengths of the rims' edges.

    The new positions in Ω are interpolated; triangles may overlap there.

    Args:
        patch: over one loop or several.
        target: edge length away from the rims, in mesh units.
        taken: pairs of boundary vertices that must not be joined by an inner edge.

    Raises:
        TooManyPointsError: the length needs too many vertices.
        OutOfTimeError: a time limit has passed.
    """
    require_few_points(patch.area, target)
    mesh = _Mesh(patch, target, taken)
    for _ in range(_ROUNDS):
        require_time()
        mesh.split()
        mesh.collapse()
        mesh.flip()
        mesh.smooth()
        mesh.flip()
    mesh.polish()
    mesh.flip()
    old = np.asarray(patch.faces)
    inner = np.ascontiguousarray(mesh.vertices[patch.boundary_size :])
    _, face, nearest = igl.point_mesh_squared_distance(inner, *igl_arrays(patch.vertices, old))
    corners = old[np.asarray(face).reshape(-1)]
    weights = igl.barycentric_coordinates(
        np.ascontiguousarray(nearest), *(np.ascontiguousarray(patch.vertices[corners[:, k]]) for k in range(3))
    )
    points = np.einsum("ki,ki->k", np.asarray(weights), patch.points[corners])
    points = np.concatenate([patch.points[: patch.boundary_size], points])
    return replace(patch, vertices=mesh.vertices, faces=mesh.faces, points=points)


class _Mesh:
    """The mesh that is changed; its first vertices are those of the rims. Unused vertices may remain."""

    def __init__(self, patch: Patch, target: float, taken: Int[np.ndarray, "e 2"]) -> None:
        self.vertices, self.faces, self.rim = patch.vertices, np.array(patch.faces), patch.boundary_size
        self._size, self._taken = _graded_size(patch, target), taken
        self.sizes = self._size(self.vertices)  # wanted lengths at the vertices

    def split(self) -> None:
        """Halves inner edges that are too long, and those between vertices that must not be joined."""
        while True:
            half_edges = HalfEdges.of(self.faces)
            sides = half_edges.pairs
            ends = np.stack([half_edges.origin, half_edges.target], axis=1)
            length = np.linalg.norm(self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]], axis=1)
            longest = length.reshape(-1, 3).max(axis=1)[sides // 3].max(axis=1)
            ends = ends[sides[:, 0]]
            # beside a longer edge of the rim halves of other edges would be too long again
            excess = np.where(length[sides[:, 0]] < longest, 0.0, self._relative_length(ends))
            excess[self._has_edges(self._taken, ends) | self._are_thin_chords(sides, ends)] = np.inf
            sides, ends, excess = (each[excess > _LONGEST] for each in (sides, ends, excess))
            if not len(ends):
                return
            chosen = self._independent(ends, excess)
            new = np.repeat(len(self.vertices) + np.arange(chosen.sum()), 2)
            middles = self.vertices[ends[chosen]].mean(axis=1)
            self.vertices = np.concatenate([self.vertices, middles])
            self.sizes = np.concatenate([self.sizes, self._size(middles)])
            face, corner = np.divmod(sides[chosen].ravel(), 3)
            second = self.faces[face]
            second[np.arange(len(face)), corner] = new
            self.faces[face, (corner + 1) % 3] = new
            self.faces = np.concatenate([self.faces, second])

    def _are_thin_chords(self, sides: Int[np.ndarray, "e 2"], ends: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """Which inner edges between two vertices of the rims have a small angle at one of them."""
        angles = internal_angles(self.vertices, self.faces)
        face, corner = np.divmod(sides, 3)
        least = np.minimum(angles[face, corner], angles[face, (corner + 1) % 3]).min(axis=1)
        return (ends < self.rim).all(axis=1) & ~(least >= _THIN)

    def collapse(self) -> None:
        """Collapses inner edges that are too short, unless that makes an angle too small or an edge too long."""
        count, refused = len(self.vertices), np.zeros((0, 2), dtype=np.int64)
        while True:
            edges = unique_edges(self.faces, count)
            adjacent = coo_array((np.ones(2 * len(edges)), np.concatenate([edges, edges[:, ::-1]]).T), (count, count))
            short = edges[(edges[:, 1] >= self.rim) & (self._relative_length(edges) < _SHORTEST)]
            short = short[~self._has_edges(refused, short)]
            graph = adjacent.tocsr()
            common = graph[short[:, 0]].multiply(graph[short[:, 1]])
            # with a third common neighbour two faces would have the same vertices
            short = short[np.asarray(common.sum(axis=1)).ravel() == 2]
            if not len(short):
                break
            short = short[self._independent(short, -self._relative_length(short), rings=2)]
            good = self._collapsed(short)
            refused = np.concatenate([refused, short[~good]])
        used = np.zeros(count, dtype=bool)
        used[self.faces] = True
        used[: self.rim] = True
        self.vertices, self.sizes = self.vertices[used], self.sizes[used]
        self.faces = (np.cumsum(used) - 1)[self.faces]

    def _collapsed(self, edges: Int[np.ndarray, "k 2"]) -> Bool[np.ndarray, " k"]:
        """Collapses edges without common neighbours into their first vertex; returns which of them were good enough."""
        count = len(self.vertices)
        kept, gone = edges.T
        good = np.ones(len(edges), dtype=bool)
        before = self._least_angles(self.vertices, self.faces)
        least = np.minimum(before[kept], before[gone])
        for _ in range(2):  # all of them, then the good ones
            vertices, number = self.vertices.copy(), np.arange(count)
            number[gone[good]] = kept[good]
            inner = good & (kept >= self.rim)
            vertices[kept[inner]] = self.vertices[edges[inner]].mean(axis=1)
            faces = number[self.faces]
            left = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
            turned = _turned(self.vertices, self.faces[left], vertices, faces[left])
            faces = faces[left]
            is_bad = np.zeros(count, dtype=bool)
            is_bad[faces[turned]] = True
            sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
            length = np.linalg.norm(vertices[sides[:, 0]] - vertices[sides[:, 1]], axis=1)
            is_long = length > _LONGEST * self.sizes[sides].mean(axis=1)
            is_bad[sides[is_long]] = True
            if good.all():
                angles = self._least_angles(vertices, faces)
                good = ~is_bad[kept] & (angles[kept] >= np.minimum(least, _GOOD))
        self.vertices, self.faces = vertices, faces
        return good

    def flip(self) -> None:
        """Flips inner edges where that increases the smallest angle of the two triangles."""
        for _ in range(_MOST_FLIPS):
            half_edges = HalfEdges.of(self.faces)
            sides = half_edges.pairs
            (a, b), (c, d) = half_edges.origin[sides].T, half_edges.opposite[sides].T
            old = self.faces[sides // 3]
            new = np.stack([np.stack([a, d, c], axis=1), np.stack([b, c, d], axis=1)], axis=1)
            least = [internal_angles(self.vertices, f.reshape(-1, 3)).reshape(-1, 6).min(axis=1) for f in (old, new)]
            gain = least[1] - least[0]
            across = np.stack([c, d], axis=1)
            edges = np.concatenate([unique_edges(self.faces, len(self.vertices)), self._taken])
            chosen = np.flatnonzero((gain > 1e-3) & ~self._has_edges(edges, across))
            chosen = chosen[~_is_sharper(self.vertices, old[chosen], new[chosen])]
            if not len(chosen):
                return
            chosen = chosen[self._independent(np.stack([a, b, c, d], axis=1)[chosen], gain[chosen])]
            self.faces[sides[chosen] // 3] = new[chosen]

    def smooth(self) -> None:
        """Moves inner vertices, in their tangent planes, to the weighted mean of the triangles around them."""
        v, f, n = self.vertices, self.faces, len(self.vertices)
        centres = v[f].mean(axis=1)
        weights = face_areas(v, f) / self.sizes[f].mean(axis=1) ** 2
        total = np.bincount(f.ravel(), np.repeat(weights, 3), minlength=n)
        mean = np.stack([np.bincount(f.ravel(), np.repeat(weights * x, 3), minlength=n) for x in centres.T], axis=1)
        step = mean / np.maximum(total, np.finfo(np.float64).tiny)[:, None] - v
        step[: self.rim] = 0
        self._moved(self._along(step))
        self.sizes = self._size(self.vertices)

    def _moved(self, step: Positions) -> None:
        before = np.minimum(internal_angles(self.vertices, self.faces).min(axis=1), _GOOD)
        for _ in range(10):
            moved = self.vertices + step
            angles = internal_angles(moved, self.faces).min(axis=1)
            wrong = _turned(self.vertices, self.faces, moved, self.faces) | ~(angles >= before)
            if not wrong.any():
                break
            step[self.faces[wrong]] = 0
        else:
            return
        self.vertices = moved

    def polish(self) -> None:
        """Moves single vertices of triangles with small angles to where the smallest angle around them is larger."""
        turns = 2 * np.pi * np.arange(8) / 8
        for share in _STEPS:
            least = self._least_angles(self.vertices, self.faces)
            ids = self.rim + np.flatnonzero(least[self.rim :] < _GOOD)
            if not len(ids):
                return
            ids = ids[self._independent(ids[:, None], -least[ids], rings=1)]
            edges = unique_edges(self.faces, len(self.vertices))
            length = np.linalg.norm(self.vertices[edges[:, 0]] - self.vertices[edges[:, 1]], axis=1)
            ends = edges.ravel()
            mean = np.bincount(ends, np.repeat(length, 2)) / np.maximum(np.bincount(ends), 1)
            normals = vertex_normals(self.vertices, self.faces)[ids]
            first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
            first /= np.linalg.norm(first, axis=1)[:, None]
            second = np.cross(normals, first)
            best, found = self.vertices.copy(), least[ids]
            for turn in turns:
                moved = self.vertices.copy()
                moved[ids] += share * mean[ids, None] * (np.cos(turn) * first + np.sin(turn) * second)
                angles = self._least_angles(moved, self.faces)
                is_turned = np.zeros(len(moved), dtype=bool)
                is_turned[self.faces[_turned(self.vertices, self.faces, moved, self.faces)]] = True
                better = (angles[ids] > found) & ~is_turned[ids]
                best[ids[better]], found[better] = moved[ids[better]], angles[ids[better]]
            self.vertices = best

    def _along(self, step: Positions) -> Positions:
        normals = vertex_normals(self.vertices, self.faces)
        return step - np.einsum("nd,nd->n", step, normals)[:, None] * normals

    def _relative_length(self, edges: Int[np.ndarray, "e 2"]) -> Float[np.ndarray, " e"]:
        """Lengths of edges by the wanted ones."""
        ends = self.vertices[edges]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / self.sizes[edges].mean(axis=1)

    def _has_edges(self, edges: Int[np.ndarray, "e 2"], pairs: Int[np.ndarray, "k 2"]) -> Bool[np.ndarray, " k"]:
        count = len(self.vertices)
        return np.isin(np.sort(pairs, axis=1) @ [count, 1], np.sort(edges, axis=1) @ [count, 1])

    def _least_angles(self, vertices: Positions, faces: Faces) -> Float[np.ndarray, " n"]:
        """The smallest angle of the triangles at each vertex; π without any."""
        least = np.full(len(vertices), np.pi)
        np.minimum.at(least, faces.ravel(), np.repeat(np.nan_to_num(internal_angles(vertices, faces)).min(axis=1), 3))
        return least

    def _independent(
        self, groups: Int[np.ndarray, "k c"], priority: Float[np.ndarray, " k"], *, rings: int = 0
    ) -> Bool[np.ndarray, " k"]:
        """Which groups of vertices have the highest priority of all that share a vertex or are within some rings."""
        rank = np.empty(len(groups), dtype=np.int64)
        rank[np.argsort(priority, kind="stable")] = np.arange(1, len(groups) + 1)
        best = np.zeros(len(self.vertices), dtype=np.int64)
        np.maximum.at(best, groups, rank[:, None])
        for _ in range(rings):
            np.maximum.at(best, self.faces, best[self.faces].max(axis=1, keepdims=True))
        return np.asarray((best[groups] == rank[:, None]).all(axis=1))


def _graded_size(patch: Patch, target: float) -> Size:
    """Wanted edge lengths: `target`, near the rims the lengths of their edges; bounded as by `size_bounds`."""
    m = patch.boundary_size
    rim, after = patch.vertices[:m], rim_successors(patch.rims)
    edge = np.linalg.norm(rim[after] - rim, axis=1)
    own = 0.5 * (edge + edge[np.argsort(after)])
    tree = cKDTree(rim)

    def size(x: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        distance, nearest = tree.query(x, k=3)
        lowest = own[nearest[:, 0]] - DECAY * distance[:, 0]
        return np.asarray(np.minimum(np.maximum(target, lowest), (own[nearest] + GROWTH * distance).min(axis=1)))

    return size


def _turned(old: Positions, old_faces: Faces, new: Positions, new_faces: Faces) -> Bool[np.ndarray, " f"]:
    """Whether faces are turned over by a change, or lose their area."""
    before, after = face_normals(old, old_faces), face_normals(new, new_faces)
    flat = ~before.any(axis=1)
    return np.asarray(~(np.einsum("fd,fd->f", before, after) > 0.5) & ~flat)


def _is_sharper(
    vertices: Positions, old: Int[np.ndarray, "k 2 3"], new: Int[np.ndarray, "k 2 3"]
) -> Bool[np.ndarray, " k"]:
    """Whether pairs of faces are turned over by a flip, or bend by more than 60° and more than before."""
    (a, b), (c, d) = (face_normals(vertices, f.reshape(-1, 3)).reshape(-1, 2, 3).swapaxes(0, 1) for f in (old, new))
    bend = [np.einsum("kd,kd->k", *pair) for pair in ((a, b), (c, d))]
    mean = a + b
    is_turned = (np.einsum("kd,kd->k", c, mean) < 0) | (np.einsum("kd,kd->k", d, mean) < 0)
    return np.asarray(is_turned | (bend[1] < np.minimum(bend[0], 0.5)))
