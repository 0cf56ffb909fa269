"""Faces of any number of corners, their triangulation, and the closing of seams between faces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from spinor_geom.errors import PolygonError
from spinor_geom.mesh.find_loops import repeats_a_vertex
from spinor_geom.mesh.topology import boundary_edges, coincident_vertices, linked
from spinor_geom.mesh.triangle_mesh import TriangleMesh

LARGEST_SEARCHED = 32  # corners: comparing all fans of a polygon takes time quadratic in its corners


@dataclass(frozen=True, kw_only=True, eq=False)
class Polygons:
    """Faces of any number of corners: face i has the corners corners[starts[i]:starts[i + 1]]."""

    corners: Int[np.ndarray, " n"]  # int64, vertex indices of all faces, one face after the other
    starts: Int[np.ndarray, " p"]  # int64, where each face begins, and at the end n

    @classmethod
    def of_sizes(cls, corners: Int[np.ndarray, " c"], sizes: Int[np.ndarray, " p"]) -> Polygons:
        """Faces given by the corners of all, one after the other, and the number of corners of each."""
        starts = np.zeros(len(sizes) + 1, dtype=np.int64)
        np.cumsum(sizes, out=starts[1:])
        return cls(corners=np.asarray(corners, dtype=np.int64), starts=starts)

    @classmethod
    def of_triangles(cls, faces: Int[np.ndarray, "f 3"]) -> Polygons:
        """Triangles as polygons."""
        return cls.of_sizes(faces.reshape(-1), np.full(len(faces), 3))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, face: int) -> Int[np.ndarray, " k"]:
        """The corners of one face."""
        start, stop = self.starts[face : face + 2]
        return self.corners[start:stop]

    @property
    def sizes(self) -> Int[np.ndarray, " p"]:
        """The number of corners of each face, (P,) int64."""
        return np.diff(self.starts)

    def followed_by(self, faces: Int[np.ndarray, "t 3"]) -> Polygons:
        """These faces, then the given triangles."""
        sizes = np.concatenate([self.sizes, np.full(len(faces), 3)])
        return Polygons.of_sizes(np.concatenate([self.corners, faces.reshape(-1)]), sizes)

    def require_valid(self, vertices: int) -> None:
        """Raises a PolygonError for a face with fewer than 3 corners, or with an index that is not below `vertices`."""
        for face in np.flatnonzero(self.sizes < 3).tolist():
            raise PolygonError(face=face, problem=f"has {self.sizes[face]} corners, a face needs three")
        for corner in np.flatnonzero((self.corners < 0) | (self.corners >= vertices)):
            problem = f"has vertex index {self.corners[corner]}, but there are vertices 0 to {vertices - 1}"
            raise PolygonError(face=int(np.searchsorted(self.starts, corner, side="right")) - 1, problem=problem)

    def renumbered(self, new_index: Int[np.ndarray, " v"]) -> Polygons:
        """The same faces with new_index[v] in place of v."""
        return Polygons(corners=new_index[self.corners], starts=self.starts)

    def without_repeats(self) -> Polygons:
        """The faces without corners equal to the next one. Faces that then have fewer than three are left out."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.starts[1:] - 1] = self.starts[:-1]
        kept = self.corners != self.corners[following]
        face = np.repeat(np.arange(len(self)), self.sizes)
        sizes = np.bincount(face[kept], minlength=len(self))
        is_face = sizes >= 3
        return Polygons.of_sizes(self.corners[kept & is_face[face]], sizes[is_face])

    def rows(self) -> list[list[int]]:
        """The corners of every face as lists, for writing."""
        flat = self.corners.tolist()
        return [flat[start:stop] for start, stop in pairwise(self.starts.tolist())]

    def triangulated(self, vertices: Float[np.ndarray, "v 3"]) -> tuple[Int[np.ndarray, "t 3"], Int[np.ndarray, " t"]]:
        """The faces split into triangles (T, 3), in the same order, and the index (T,) of the face of each.

        A polygon is split into the fan of triangles from one of its corners. It is the fan that maximises the least
        inner product of a triangle's area vector with the polygon's, so that a quad with a reflex corner is split along
        its inner diagonal, of equal fans by the one from the earliest corner. Polygons of more than `LARGEST_SEARCHED`
        corners get the fan from the first one. Raises as `require_valid`.
        """
        self.require_valid(len(vertices))
        pieces = self.sizes - 2
        starts = np.concatenate([[0], np.cumsum(pieces)])
        triangles = np.empty((int(starts[-1]), 3), dtype=np.int64)
        for size in np.unique(self.sizes).tolist():
            chosen = np.flatnonzero(self.sizes == size)
            corners = self.corners[self.starts[chosen][:, None] + np.arange(size)]
            rows = starts[chosen][:, None] + np.arange(size - 2)
            triangles[rows] = _best_fans(vertices, corners)
        return triangles, np.repeat(np.arange(len(self)), pieces)


def _best_fans(vertices: Float[np.ndarray, "v 3"], corners: Int[np.ndarray, "m n"]) -> Int[np.ndarray, "m n-2 3"]:
    """The fans of `triangulated` for m polygons with n corners."""
    size = corners.shape[1]
    best = _fans(corners, 0)
    if not 4 <= size <= LARGEST_SEARCHED:
        return best
    with np.errstate(over="ignore", invalid="ignore"):  # for huge coordinates any fan has the right topology
        quality = _least_agreement(vertices, best)
        for start in range(1, size if size > 4 else 2):
            fans = _fans(corners, start)
            candidate = _least_agreement(vertices, fans)
            better = candidate > quality
            best[better] = fans[better]
            quality = np.where(better, candidate, quality)
    return best


def _fans(corners: Int[np.ndarray, "m n"], start: int) -> Int[np.ndarray, "m n-2 3"]:
    turned = np.roll(corners, -start, axis=1)
    apex = np.broadcast_to(turned[:, :1], (len(corners), corners.shape[1] - 2))
    return np.stack([apex, turned[:, 1:-1], turned[:, 2:]], axis=2)


def _least_agreement(vertices: Float[np.ndarray, "v 3"], fans: Int[np.ndarray, "m t 3"]) -> Float[np.ndarray, " m"]:
    """The least of the inner products of a fan's triangle area vectors with their sum."""
    a, b, c = np.moveaxis(vertices[fans], 2, 0)
    areas = np.cross(b - a, c - a)
    return np.asarray(np.einsum("mtx,mx->mt", areas, areas.sum(axis=1)).min(axis=1))


def chained(elements: Sequence[Int[np.ndarray, " _"]]) -> tuple[tuple[int, Int[np.ndarray, " _"]], ...]:
    """Pieces of polylines (k ≥ 2 vertex indices each) joined at every vertex where exactly two of their ends meet.

    Returns for each curve the index of its first piece, which determines its direction, and its vertices. A closed
    curve begins and ends with the same one. Other pieces are reversed where needed.
    """
    pieces = [element.tolist() for element in elements]
    ends: dict[int, list[int]] = {}
    for number, piece in enumerate(pieces):
        for end in (piece[0], piece[-1]):
            ends.setdefault(end, []).append(number)
    unused = set(range(len(pieces)))
    curves = []
    for number, first in enumerate(pieces):
        if number not in unused:
            continue
        unused.discard(number)
        curve = list(first)
        for _ in range(2):  # beyond its last vertex and then, reversed, beyond its first
            while curve[0] != curve[-1] and len(ends[curve[-1]]) == 2:
                # one of the two is the last piece of the curve. The other is unused, because the curve is not closed
                follower = next(piece for piece in ends[curve[-1]] if piece in unused)
                unused.discard(follower)
                added = pieces[follower]
                curve += (added if added[0] == curve[-1] else added[::-1])[1:]
            curve = curve[::-1]
        curves.append((number, np.array(curve, dtype=np.int64)))
    return tuple(curves)


def seam_representatives(
    vertices: Float[np.ndarray, "v 3"], polygons: Polygons, appearance: Iterable[Shaped[np.ndarray, "v _"]]
) -> Int[np.ndarray, " v"]:
    """For every vertex the one that represents its position: along a seam the lowest index, elsewhere itself.

    A seam is a pair of boundary edges with equal ends in opposite directions, and no third one there. Each end is a
    shared vertex, or vertices at its position differ in `appearance`, values (V, k) that a renderer stores at each
    vertex. Pieces that only touch are not joined, nor are vertices without a difference, which may be separate on
    purpose.
    """
    place = coincident_vertices(vertices)
    differs = np.zeros(len(vertices), dtype=bool)
    for values in appearance:
        differs |= (values != values[place]).any(axis=1)
    if not differs.any():
        return np.arange(len(vertices))
    may_be_joined = np.zeros(len(vertices), dtype=bool)
    may_be_joined[place[differs]] = True
    edges = boundary_edges(polygons.triangulated(vertices)[0])
    first, second = _edge_pairs(place[edges])
    joined = np.stack([edges[first], edges[second, ::-1]], axis=2)
    is_seam = ((joined[:, :, 0] == joined[:, :, 1]) | may_be_joined[place[joined[:, :, 0]]]).all(axis=1)
    labels = linked(joined[is_seam].reshape(-1, 2), len(vertices))
    _, lowest = np.unique(labels, return_index=True)
    return np.asarray(lowest[labels], dtype=np.int64)


def _edge_pairs(edges: Int[np.ndarray, "b 2"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """The indices of directed edges and of their reverses, where no third edge has the same two ends."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((high, low))
    starts = np.flatnonzero(np.diff(low[order], prepend=-1) | np.diff(high[order], prepend=-1))
    pairs = starts[np.diff(np.append(starts, len(edges))) == 2]
    first, second = order[pairs], order[pairs + 1]
    opposite = (edges[first, 0] == edges[second, 1]) & (edges[first, 0] != edges[first, 1])
    return first[opposite], second[opposite]


def close_seams(
    faces: Int[np.ndarray, "f 3"], representatives: Int[np.ndarray, " v"]
) -> tuple[Int[np.ndarray, "g 3"], Bool[np.ndarray, " f"]]:
    """The triangles over the vertices that represent their positions, and a mask of those that are kept, (F,) bool.

    A triangle of which two vertices become one (as at the poles of a textured globe) has no area and is left out.
    """
    closed = representatives[faces]
    kept = ~repeats_a_vertex(closed) | repeats_a_vertex(faces)
    return closed[kept], kept


def appearance_of(attributes: Mapping[str, Float[np.ndarray, "v _"]]) -> list[Float[np.ndarray, "v _"]]:
    """The attributes of a mesh that a renderer stores at each vertex."""
    return [attributes[name] for name in ("uv", "normal", "color") if name in attributes]


def without_seams(mesh: TriangleMesh) -> TriangleMesh:
    """A mesh closed along the edges where texture coordinates, normals or colours differ."""
    closed, _ = closed_along_seams(mesh)
    attributes, labels, stored = mesh.vertex_attributes, mesh.labels, mesh.stored
    return TriangleMesh(mesh.vertices, closed, vertex_attributes=attributes, labels=labels, stored=stored)


def closed_along_seams(mesh: TriangleMesh) -> tuple[Int[np.ndarray, "g 3"], Bool[np.ndarray, " f"]]:
    """The triangles of `without_seams`, and a mask of those that are kept, as by `close_seams`."""
    polygons, appearance = Polygons.of_triangles(mesh.faces), appearance_of(mesh.vertex_attributes)
    return close_seams(mesh.faces, seam_representatives(mesh.vertices, polygons, appearance))
