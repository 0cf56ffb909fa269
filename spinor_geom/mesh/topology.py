"""Half-edges of triangle meshes, boundary edges, components, coincident vertices."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.arrays import norm
from spinor_geom.kernel import call, checked

# Vertices farther apart than this share of their edges are not merged, so fine parts of large meshes are unchanged.
SHARE_OF_EDGE = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfEdges:
    """The 3F half-edges of F triangles, grouped by edge.

    Half-edge 3f + k runs from corner k of face f to corner k + 1 (mod 3).
    """

    origin: Int[np.ndarray, " h"]  # the vertex each starts at
    target: Int[np.ndarray, " h"]  # the vertex it ends at
    order: Int[np.ndarray, " h"]  # half-edges sorted by edge, then by index
    starts: Int[np.ndarray, " e"]  # edge e has the half-edges order[starts[e]:starts[e + 1]]

    @classmethod
    def of(cls, faces: Int[np.ndarray, "f 3"]) -> HalfEdges:
        """The half-edges of faces given by non-negative vertex indices."""
        origin = np.ascontiguousarray(faces, dtype=np.int64).reshape(-1)
        target = faces[:, [1, 2, 0]].astype(np.int64, copy=False).reshape(-1)
        order, starts, edges = (
            np.empty_like(origin),
            np.empty(len(origin) + 1, dtype=np.int64),
            np.zeros(1, dtype=np.int64),
        )
        corners = checked("faces", faces, np.int64, None, 3, least=0)
        vertices = int(origin.max(initial=-1)) + 1
        call("group_half_edges", len(corners), corners, vertices, order, starts, edges)
        starts = starts[: edges[0] + 1].copy()
        return cls(origin=origin, target=target, order=order, starts=starts)

    @cached_property
    def counts(self) -> Int[np.ndarray, " edges"]:
        """Number of faces of each edge, (E,) int64."""
        return np.diff(self.starts)

    @cached_property
    def boundary(self) -> Int[np.ndarray, " b"]:
        """The half-edges whose edge has no other face, ascending, (b,) int64."""
        return np.sort(self.order[self.starts[:-1][self.counts == 1]])

    @cached_property
    def pairs(self) -> Int[np.ndarray, "p 2"]:
        """The two half-edges of every edge that has exactly two faces, (p, 2) int64."""
        first = self.starts[:-1][self.counts == 2]
        return np.stack([self.order[first], self.order[first + 1]], axis=1)

    @cached_property
    def twin(self) -> Int[np.ndarray, " h"]:
        """The other half-edge of an edge with exactly two faces, else −1, (3F,) int64."""
        twin = np.full(len(self.origin), -1, dtype=np.int64)
        a, b = self.pairs.T
        twin[a], twin[b] = b, a
        return twin

    @cached_property
    def opposite(self) -> Int[np.ndarray, " h"]:
        """The corner of its face that a half-edge does not touch, (3F,) int64."""
        return self.origin.reshape(-1, 3)[:, [2, 0, 1]].reshape(-1)

    @cached_property
    def components(self) -> Int[np.ndarray, " f"]:
        """The component of each face, from 0, (F,) int64. Faces are connected through common edges, not vertices."""
        face = self.order // 3
        is_same_edge = np.ones(len(face), dtype=bool)
        is_same_edge[self.starts[:-1]] = False
        later = np.flatnonzero(is_same_edge)
        return linked(np.stack([face[later - 1], face[later]], axis=1), len(face) // 3)

    @cached_property
    def is_open(self) -> Bool[np.ndarray, " h"]:
        """Whether the edge of a half-edge does not have exactly two faces of opposite directions, (3F,) bool."""
        return np.asarray((self.twin < 0) | (self.origin == self.origin[self.twin]))

    @property
    def is_closed(self) -> bool:
        """Whether there are faces and every edge has exactly two, of opposite directions."""
        return len(self.origin) > 0 and not self.is_open.any()

    def unclosed(self, count: int) -> Bool[np.ndarray, " {count}"]:
        """Which of `count` vertices have an edge without exactly two faces of opposite directions, (count,) bool."""
        ends = np.stack([self.origin[self.is_open], self.target[self.is_open]])
        return referenced_vertices(ends, vertices=count)


def boundary_edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "b 2"]:
    """The edges with exactly one face, each as (from, to) in the direction of that face, (b, 2) int64."""
    half_edges = HalfEdges.of(faces)
    return np.stack([half_edges.origin[half_edges.boundary], half_edges.target[half_edges.boundary]], axis=1)


def is_watertight_with(
    faces: Int[np.ndarray, "f 3"], unclosed: Bool[np.ndarray, " v"], added: Int[np.ndarray, "g 3"]
) -> bool:
    """`HalfEdges.is_closed` of the faces of a mesh and added ones, whose vertices may be new.

    `unclosed` contains the vertices of all edges that do not have exactly two faces of opposite directions.
    """
    counts = np.zeros(max(len(unclosed), int(added.max(initial=-1)) + 1), dtype=bool)
    counts[: len(unclosed)] = unclosed
    counts[added] = True
    a, b, c = counts[faces.T]
    # all faces of an edge between two of these vertices
    half_edges = HalfEdges.of(np.concatenate([faces[(a & b) | (b & c) | (c & a)], added]))
    is_open = half_edges.is_open & counts[half_edges.origin] & counts[half_edges.target]
    return len(faces) + len(added) > 0 and not is_open.any()


def is_disk(faces: Int[np.ndarray, "f 3"]) -> bool:
    """Whether faces form one disk."""
    found = disks(HalfEdges.of(faces)) if len(faces) else np.zeros(0, dtype=bool)
    return len(found) == 1 and bool(found[0])


def disks(half_edges: HalfEdges) -> Bool[np.ndarray, " components"]:
    """Which components of faces are disks: a cone over the boundary closes each of these to a sphere."""
    component, sides = half_edges.components, half_edges.boundary
    count, beside = int(component.max()) + 1, component[sides // 3]
    apex = half_edges.origin.max() + 1 + beside
    cones = np.stack([half_edges.target[sides], half_edges.origin[sides], apex], axis=1)
    faces = np.concatenate([half_edges.origin.reshape(-1, 3), cones])
    component = np.concatenate([component, beside])
    vertices = np.unique(np.repeat(component, 3) * (int(faces.max()) + 1) + faces.ravel()) // (int(faces.max()) + 1)
    # Euler's formula for triangles without a boundary
    is_sphere = 2 * np.bincount(vertices, minlength=count) - np.bincount(component, minlength=count) == 4
    is_sphere[np.repeat(component, 3)[HalfEdges.of(faces).is_open]] = False
    return np.asarray(is_sphere & (np.bincount(beside, minlength=count) > 0))


def face_components(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " f"]:
    """The component of each face, from 0, (f,) int64. Faces are connected through common edges, not vertices."""
    return HalfEdges.of(faces).components


def linked(pairs: Int[np.ndarray, "k 2"], count: int) -> Int[np.ndarray, " {count}"]:
    """Connected component, from 0, of each of the `count` nodes of a graph with the edges `pairs`."""
    labels = np.empty(count, dtype=np.int64)
    pairs = checked("pairs", pairs, np.int64, None, 2, least=0, most=count - 1)
    call("components", len(pairs), pairs, count, labels)
    return labels


def referenced_vertices(faces: Int[np.ndarray, "*any"], *, vertices: int) -> Bool[np.ndarray, " {vertices}"]:
    """Which vertices faces use, (vertices,) bool."""
    used = np.zeros(vertices, dtype=bool)
    used[faces] = True
    return used


def coincident_vertices(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """For every point the lowest index among the points of equal coordinates, −0.0 being 0.0, (n,) int64."""
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.ones(len(points), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    # lexsort is stable, so the first of a group is its lowest index
    representative = np.empty(len(points), dtype=np.int64)
    representative[order] = order[np.flatnonzero(new)][np.cumsum(new) - 1]
    return representative


def near_vertices(
    points: Float[np.ndarray, "n 3"], reach: Float[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"] | None = None
) -> Int[np.ndarray, " n"]:
    """`coincident_vertices` to a tolerance: two points coincide within the smaller of their reaches, (n,) int64.

    Reaches are in mesh units. Groups are transitive. With `faces`, no group has two different corners of a face: the
    tolerance of such a group is halved until none has.
    """
    exact = coincident_vertices(points)
    unique, number = np.unique(exact, return_inverse=True)
    limit = float(reach.max(initial=0.0))
    if limit == 0.0:
        return exact
    finite = np.flatnonzero(np.isfinite(points[unique]).all(axis=1))
    tree = cKDTree(points[unique[finite]], balanced_tree=False)
    pairs = finite[tree.query_pairs(limit, output_type="ndarray")]
    apart = norm(points[unique[pairs[:, 0]]] - points[unique[pairs[:, 1]]])
    within = apart <= reach[unique[pairs]].min(axis=1)
    pairs, apart = pairs[within], apart[within]
    if not len(pairs):
        return exact
    labels = linked(pairs, len(unique))
    corners = number[np.zeros((0, 3), dtype=np.int64) if faces is None else faces]
    sides = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    sides = sides[(sides[:, 0] != sides[:, 1]) & (labels[sides[:, 0]] == labels[sides[:, 1]])]
    while len(sides):
        is_divided = np.isin(labels, labels[sides[:, 0]])
        limit /= 2
        kept = ~is_divided[pairs[:, 0]] | (apart <= limit)
        pairs, apart = pairs[kept], apart[kept]
        labels = linked(pairs, len(unique))
        sides = sides[labels[sides[:, 0]] == labels[sides[:, 1]]]
    _, lowest = np.unique(labels, return_index=True)
    return np.asarray(unique[lowest[labels]][number])


def longest_sides(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " n"]:
    """Length of the longest edge of the faces at each vertex, 0 for unused vertices, (n,) float64."""
    longest = np.zeros(len(points))
    for start, end in ((0, 1), (1, 2), (2, 0)):
        lengths = norm(points[faces[:, start]] - points[faces[:, end]])
        np.maximum.at(longest, faces[:, start], lengths)
        np.maximum.at(longest, faces[:, end], lengths)
    return longest
