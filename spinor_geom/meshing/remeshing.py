"""Remeshing of patches in space, without a plane domain: edges are split, collapsed and flipped, vertices moved.

Vertices and edges of the rims are kept. Edges get about the wanted lengths, and angles are increased: edges are flipped
if that increases the smallest angle of their two triangles, and inner vertices move along the surface.

Source: Botsch & Kobbelt, "A remeshing approach to multiresolution modeling", Symposium on Geometry Processing (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import igl
import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from spinor_geom.arrays import EPS
from spinor_geom.deadline import require_time
from spinor_geom.domain.delaunay import rim_successors, unique_edges
from spinor_geom.domain.sizes import DECAY, GROWTH
from spinor_geom.mesh.operators import face_areas, face_normals, internal_angles, nearest_on_mesh, vertex_normals
from spinor_geom.mesh.topology import HalfEdges, referenced_vertices
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import require_few_points

_ROUNDS = 2
# shortest and longest edges, in wanted lengths
_SHORTEST, _LONGEST = 0.6, 4 / 3
_THIN = np.radians(10.0)
_MOST_SPLITS = 30  # rounds of splits
_FLIPS_BETWEEN = 2
_MOST_FLIPS, _LEAST_GAIN = 50, 1e-3  # rounds of flips, and the smallest increase of an angle
_GOOD_ANGLE = np.radians(25.0)  # triangles without smaller angles are kept
# a vertex of a poor triangle is tried at eight positions around it, at these multiples of the requested edge length
_POLISHING, _AROUND = (0.3, 0.3, 0.15, 0.15, 0.08, 0.08), np.exp(2j * np.pi * np.arange(8) / 8)
_CORRECTIONS = 10  # largest number of corrections of a smoothing that turns triangles over

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
    old = np.asarray(patch.faces)
    mesh = _Mesh(patch.vertices, old, patch.boundary_size, _graded_size(patch, target), taken)
    mesh.flip()
    for _ in range(_ROUNDS):
        require_time()
        mesh.split()
        mesh.collapse()
        mesh.flip()
        mesh.smooth()
        mesh.flip()
    mesh.polish()
    mesh.flip()
    new = mesh.vertices[patch.boundary_size :]
    points = np.concatenate([patch.points[: patch.boundary_size], _points_at(patch, old, new)])
    return replace(patch, vertices=mesh.vertices, faces=mesh.faces, points=points, is_complete=True)


def remesh_region(
    patch: Patch, region: Bool[np.ndarray, " f"], target: float, taken: Int[np.ndarray, "e 2"], enough: float
) -> tuple[Patch, Int[np.ndarray, " f"]]:
    """Remeshes a region of a patch within its outline; only vertices of poor triangles move.

    Args:
        patch: over one loop or several.
        region: which faces may be replaced.
        target: edge length away from the rims, in mesh units.
        taken: pairs of boundary vertices that must not be joined by an inner edge.
        enough: smallest angle that is not increased further, in radians.

    Returns:
        The patch, and for each old face its new number, −1 if it was in the region.
    """
    old = np.asarray(patch.faces)
    inside, outside, count = old[region], old[~region], len(patch.vertices)
    is_fixed = np.zeros(count, dtype=bool)
    is_fixed[: patch.boundary_size] = True
    is_fixed[outside] = True
    used = referenced_vertices(inside, vertices=count)
    ids = np.concatenate([np.flatnonzero(used & is_fixed), np.flatnonzero(used & ~is_fixed)])
    local, fixed = np.full(count, -1), int((used & is_fixed).sum())
    local[ids] = np.arange(len(ids))
    pairs = local[np.concatenate([taken, unique_edges(outside, count)])]
    size = _graded_size(patch, target)
    mesh = _Mesh(patch.vertices[ids], local[inside], fixed, size, pairs[(pairs >= 0).all(axis=1)], enough)
    mesh.flip()
    mesh.split()
    mesh.collapse()
    mesh.flip()
    mesh.polish()
    mesh.flip()
    kept = np.ones(count, dtype=bool)
    kept[ids[fixed:]] = False
    number, new = np.cumsum(kept) - 1, mesh.vertices[fixed:]
    numbers = np.concatenate([number[ids[:fixed]], kept.sum() + np.arange(len(new))])
    remeshed = replace(
        patch,
        vertices=np.concatenate([patch.vertices[kept], new]),
        points=np.concatenate([patch.points[kept], _points_at(patch, inside, new)]),
        faces=np.concatenate([number[outside], numbers[mesh.faces]]),
    )
    return remeshed, np.where(region, -1, np.cumsum(~region) - 1)


def _points_at(patch: Patch, faces: Faces, positions: Positions) -> Complex[np.ndarray, " k"]:
    """Positions in Ω of the points of some faces of a patch that are nearest to positions in space."""
    _, face, nearest = nearest_on_mesh(positions, patch.vertices, faces)
    corners = faces[face]
    weights = igl.barycentric_coordinates(
        np.ascontiguousarray(nearest), *(np.ascontiguousarray(patch.vertices[corners[:, k]]) for k in range(3))
    )
    return np.asarray(np.einsum("ki,ki->k", np.asarray(weights), patch.points[corners]))


class _Mesh:
    """The mesh that is changed. Its first `rim` vertices are kept, even without faces."""

    def __init__(
        self,
        vertices: Positions,
        faces: Faces,
        rim: int,
        size: Size,
        taken: Int[np.ndarray, "e 2"],
        enough: float = np.pi,
    ) -> None:
        self.vertices, self.faces, self.rim = vertices, faces.copy(), rim
        self._size, self._taken, self._enough = size, taken, enough
        self._sizes = self._size(self.vertices)  # wanted lengths at the vertices
        self._changed = np.ones(len(self.faces), dtype=bool)  # faces whose edges may have to be flipped

    def split(self) -> None:
        """Halves inner edges that are too long, chords with small angles, and chords that are edges elsewhere."""
        for _ in range(_MOST_SPLITS):
            half_edges = HalfEdges.of(self.faces)
            sides = half_edges.pairs
            ends = np.stack([half_edges.origin, half_edges.target], axis=1)
            length = np.linalg.norm(self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]], axis=1)
            longest = length.reshape(-1, 3).max(axis=1)[sides // 3].max(axis=1)
            ends = ends[sides[:, 0]]
            # only the longest edges of both triangles: next to a longer rim edge, the halves would be too long again
            excess = np.where(length[sides[:, 0]] < longest, 0.0, self._relative_length(ends))
            excess[self._has_edges(self._taken, ends) | self._are_thin_chords(sides, ends)] = np.inf
            sides, ends, excess = (each[excess > _LONGEST] for each in (sides, ends, excess))
            if not len(ends):
                return
            chosen = self._independent(ends, excess)
            new = np.repeat(len(self.vertices) + np.arange(chosen.sum()), 2)
            middles = self.vertices[ends[chosen]].mean(axis=1)
            self.vertices = np.concatenate([self.vertices, middles])
            self._sizes = np.concatenate([self._sizes, self._size(middles)])
            face, corner = np.divmod(sides[chosen].ravel(), 3)
            second = self.faces[face]
            second[np.arange(len(face)), corner] = new
            self.faces[face, (corner + 1) % 3] = new
            self.faces = np.concatenate([self.faces, second])
            self._changed[face] = True
            self._changed = np.append(self._changed, np.ones(len(second), dtype=bool))
            self.flip(_FLIPS_BETWEEN)  # without flips, thin triangles would be halved very often

    def _are_thin_chords(self, sides: Int[np.ndarray, "e 2"], ends: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """Whether an inner edge between two rim vertices has a small angle at one of them.

        False for an edge opposite to a small angle: halving it would halve this angle.
        """
        angles = np.nan_to_num(internal_angles(self.vertices, self.faces))
        face, corner = np.divmod(sides, 3)
        beside = np.minimum(angles[face, corner], angles[face, (corner + 1) % 3]).min(axis=1)
        opposite = angles[face, (corner + 2) % 3].min(axis=1)
        return np.asarray((ends < self.rim).all(axis=1) & (beside < _THIN) & (opposite > 2 * _THIN))

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
            good = self._are_good_collapses(short)
            self.vertices, faces = self._collapsed(short[good])
            self.faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
            refused = np.concatenate([refused, short[~good]])
        used = np.zeros(count, dtype=bool)
        used[self.faces] = True
        used[: self.rim] = True
        self.vertices, self._sizes = self.vertices[used], self._sizes[used]
        self.faces = (np.cumsum(used) - 1)[self.faces]
        self._changed = np.ones(len(self.faces), dtype=bool)

    def _collapsed(self, edges: Int[np.ndarray, "k 2"]) -> tuple[Positions, Faces]:
        """The mesh with edges collapsed to their midpoints, or to their rim vertices; the faces at them get no area."""
        vertices, number = self.vertices.copy(), np.arange(len(self.vertices))
        number[edges[:, 1]] = edges[:, 0]
        inner = edges[edges[:, 0] >= self.rim]
        vertices[inner[:, 0]] = self.vertices[inner].mean(axis=1)
        return vertices, number[self.faces]

    def _are_good_collapses(self, edges: Int[np.ndarray, "k 2"]) -> Bool[np.ndarray, " k"]:
        """Whether the triangles around an edge stay good if it is collapsed; the edges must be far from each other."""
        vertices, faces = self._collapsed(edges)
        left = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        turned = _turned(self.vertices, self.faces[left], vertices, faces[left])
        faces = faces[left]
        sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        length = np.linalg.norm(vertices[sides[:, 0]] - vertices[sides[:, 1]], axis=1)
        is_wrong = (length > _LONGEST * self._sizes[sides].mean(axis=1)) | self._has_edges(self._taken, sides)
        is_bad = np.zeros(len(vertices), dtype=bool)
        is_bad[faces[turned]] = True
        is_bad[sides[is_wrong]] = True
        least = np.minimum(_least_angles(self.vertices, self.faces)[edges].min(axis=1), _GOOD_ANGLE)
        return np.asarray(~is_bad[edges[:, 0]] & (_least_angles(vertices, faces)[edges[:, 0]] >= least))

    def flip(self, rounds: int = _MOST_FLIPS) -> None:
        """Flips inner edges where that increases the smallest angle of the two triangles."""
        for _ in range(rounds):
            half_edges = HalfEdges.of(self.faces)
            sides = half_edges.pairs
            sides = sides[self._changed[sides // 3].any(axis=1)]
            (a, b), (c, d) = half_edges.origin[sides].T, half_edges.opposite[sides].T
            old = self.faces[sides // 3]
            new = np.stack([np.stack([a, d, c], axis=1), np.stack([b, c, d], axis=1)], axis=1)
            least = [_smallest_angle(self.vertices, each.reshape(-1, 3)).reshape(-1, 2) for each in (new, old)]
            gain = np.minimum(least[0].min(axis=1), self._enough) - least[1].min(axis=1)
            ids = np.flatnonzero(gain > _LEAST_GAIN)
            edges = half_edges.order[half_edges.starts[:-1]]
            edges = np.stack([half_edges.origin[edges], half_edges.target[edges]], axis=1)
            ids = ids[~self._has_edges(np.concatenate([edges, self._taken]), np.stack([c, d], axis=1)[ids])]
            ids = ids[~_is_sharper(self.vertices, old[ids], new[ids])]
            self._changed[:] = False
            if not len(ids):
                return
            self._changed[sides[ids] // 3] = True
            ids = ids[self._independent(np.stack([a, b, c, d], axis=1)[ids], gain[ids])]
            self.faces[sides[ids] // 3] = new[ids]

    def smooth(self) -> None:
        """Moves inner vertices, in their tangent planes, to the weighted mean of the triangles around them."""
        x, faces, count = self.vertices, self.faces, len(self.vertices)
        weights = np.repeat(face_areas(x, faces) / self._sizes[faces].mean(axis=1) ** 2, 3)
        total = np.maximum(np.bincount(faces.ravel(), weights, count), np.finfo(np.float64).tiny)
        centres = np.repeat(x[faces].mean(axis=1), 3, axis=0).T
        step = np.stack([np.bincount(faces.ravel(), weights * each, count) / total for each in centres], axis=1) - x
        normals = vertex_normals(x, faces)
        step -= np.einsum("nd,nd->n", step, normals)[:, None] * normals
        step[: self.rim] = 0
        least = np.minimum(_smallest_angle(x, faces), _GOOD_ANGLE)
        for _ in range(_CORRECTIONS):
            wrong = _turned(x, faces, x + step, faces) | (_smallest_angle(x + step, faces) < least)
            if not wrong.any():
                self.vertices = x + step
                self._changed[:] = True
                self._sizes = self._size(self.vertices)
                break
            step[faces[wrong]] = 0

    def polish(self) -> None:
        """Moves single vertices of triangles with small angles if that increases the smallest angle around them."""
        enough = min(self._enough, _GOOD_ANGLE)
        # small steps first if a smaller angle is enough, so that vertices move less
        for share in _POLISHING if enough == _GOOD_ANGLE else _POLISHING[::-1]:
            x, faces = self.vertices, self.faces
            least = _least_angles(x, faces)
            ids = self.rim + np.flatnonzero(least[self.rim :] < enough)
            ids = ids[self._independent(ids[:, None], -least[ids], rings=1)]
            is_near = np.isin(faces, ids).any(axis=1)
            near = faces[is_near]
            self._changed |= is_near
            normals = vertex_normals(x, near)[ids]
            across = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
            across *= (share * self._sizes[ids] / np.linalg.norm(across, axis=1))[:, None]
            along = np.cross(normals, across)
            best, found = x.copy(), least[ids]
            for turn in _AROUND:
                moved = x.copy()
                moved[ids] += turn.real * across + turn.imag * along
                is_turned = np.zeros(len(x), dtype=bool)
                is_turned[near[_turned(x, near, moved, near)]] = True
                angles = _least_angles(moved, near)[ids]
                better = (angles > found) & ~is_turned[ids]
                best[ids[better]], found[better] = moved[ids[better]], angles[better]
            self.vertices = best

    def _relative_length(self, edges: Int[np.ndarray, "e 2"]) -> Float[np.ndarray, " e"]:
        """Ratios of edge lengths to the wanted ones."""
        ends = self.vertices[edges]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / self._sizes[edges].mean(axis=1))

    def _has_edges(self, edges: Int[np.ndarray, "e 2"], pairs: Int[np.ndarray, "k 2"]) -> Bool[np.ndarray, " k"]:
        count = len(self.vertices)
        return np.isin(np.sort(pairs, axis=1) @ [count, 1], np.sort(edges, axis=1) @ [count, 1])

    def _independent(
        self, groups: Int[np.ndarray, "k c"], priority: Float[np.ndarray, " k"], *, rings: int = 0
    ) -> Bool[np.ndarray, " k"]:
        """Whether a group of vertices has the highest priority of all groups within some rings around it."""
        rank = np.empty(len(groups), dtype=np.int64)
        rank[np.argsort(priority, kind="stable")] = np.arange(1, len(groups) + 1)
        best = np.zeros(len(self.vertices), dtype=np.int64)
        np.maximum.at(best, groups, rank[:, None])
        for _ in range(rings):
            np.maximum.at(best, self.faces, best[self.faces].max(axis=1, keepdims=True))
        return np.asarray((best[groups] == rank[:, None]).all(axis=1))


def _graded_size(patch: Patch, target: float) -> Size:
    """The requested edge lengths: `target`, and near the rims the lengths of their edges, bounded as by `SizeField`."""
    m = patch.boundary_size
    rim, after = patch.vertices[:m], rim_successors(patch.rims)
    edge = np.linalg.norm(rim[after] - rim, axis=1)
    own = 0.5 * (edge + edge[np.argsort(after)])
    own[own <= EPS * target] = target  # repeated points have no length
    tree = cKDTree(rim)

    def size(x: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        distance, nearest = map(np.asarray, tree.query(x, k=3))
        lowest = own[nearest[:, 0]] - DECAY * distance[:, 0]
        return np.asarray(np.minimum(np.maximum(target, lowest), (own[nearest] + GROWTH * distance).min(axis=1)))

    return size


def _smallest_angle(vertices: Positions, faces: Faces) -> Float[np.ndarray, " f"]:
    """The smallest angle of each triangle, 0 with equal vertices.

    Its sine is twice the area divided by the two longer edges.
    """
    a, b, c = (vertices.take(faces[:, k], axis=0) for k in range(3))
    p, q, r = (np.einsum("fd,fd->f", edge, edge) for edge in (b - a, c - b, a - c))
    squared_area = np.maximum(4 * p * q - (p + q - r) ** 2, 0)  # 16 times
    product = np.maximum(4 * p * q * r, np.finfo(np.float64).tiny)
    return np.asarray(np.arcsin(np.sqrt(squared_area * np.minimum(np.minimum(p, q), r) / product)))


def _least_angles(vertices: Positions, faces: Faces) -> Float[np.ndarray, " n"]:
    """The smallest angle of the triangles at each vertex; π without any."""
    least = np.full(len(vertices), np.pi)
    np.minimum.at(least, faces.ravel(), np.repeat(_smallest_angle(vertices, faces), 3))
    return least


def _turned(old: Positions, old_faces: Faces, new: Positions, new_faces: Faces) -> Bool[np.ndarray, " f"]:
    """Whether faces are turned over by a change, or lose their area."""
    before, after = face_normals(old, old_faces), face_normals(new, new_faces)
    flat = ~before.any(axis=1)
    return np.asarray(~(np.einsum("fd,fd->f", before, after) > 0.5) & ~flat)


def _is_sharper(
    vertices: Positions, old: Int[np.ndarray, "k 2 3"], new: Int[np.ndarray, "k 2 3"]
) -> Bool[np.ndarray, " k"]:
    """Whether a flip turns a pair of faces over, or bends it by more than 60° and more than before."""
    (a, b), (c, d) = (face_normals(vertices, f.reshape(-1, 3)).reshape(-1, 2, 3).swapaxes(0, 1) for f in (old, new))
    bend = [np.einsum("kd,kd->k", *pair) for pair in ((a, b), (c, d))]
    mean = a + b
    is_turned = (np.einsum("kd,kd->k", c, mean) < 0) | (np.einsum("kd,kd->k", d, mean) < 0)
    return np.asarray(is_turned | (bend[1] < np.minimum(bend[0], 0.5)))
