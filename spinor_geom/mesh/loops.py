"""The boundary loops of a mesh: followed inside the fans of faces, split into simple ones, longest first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.errors import DuplicateVertexError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.topology import HalfEdges, coincident_vertices, next_in_face
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.mesh.validate import checked_half_edges

SOUP_FRACTION = 0.5


def find_boundary_loops(mesh: TriangleMesh) -> list[BoundaryLoop]:
    """All boundary loops of a mesh as simple oriented polygons, longest perimeter first.

    A loop is followed by turning around each vertex inside its fan of faces, so pieces of mesh that touch in a vertex
    keep their own loops. A loop that passes a vertex twice is split there, so that each visits a vertex once; two loops
    may share a vertex. Loops run the way the boundary of a patch over them runs and start at their lowest vertex.

    Returns:
        The loops; none for a closed mesh. Edges that lie on one another are told by `BoundaryLoop.slit_fraction` and
        `BoundaryLoop.seam_edges`.

    Raises:
        MeshError: as `spinor_geom.mesh.validate.validate`.
        DuplicateVertexError: more than half of all boundary edges lie on edges of other loops: the faces do not share
            their vertices.
    """
    half_edges = checked_half_edges(mesh.faces)
    if not len(half_edges.boundary):
        return []
    rings = _split_at_repeated_vertices(_follow_boundary(half_edges))
    points = mesh.vertices[rings.vertices]
    overlaps = _find_overlaps(rings, points)
    if overlaps.on_other_ring.mean() > SOUP_FRACTION:
        first = int(np.argmax(overlaps.on_other_ring))
        raise DuplicateVertexError(
            vertices=(int(rings.vertices[first]), int(rings.vertices[rings.successor[first]])),
            count=int(overlaps.on_other_ring.sum()),
        )
    loops = [_boundary_loop(rings, points, overlaps, ring) for ring in range(rings.count)]
    return sorted(loops, key=lambda loop: (-loop.perimeter, int(loop.vertex_ids[0])))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rings:
    """Closed rings of vertices, one after the other: ring k is vertices[starts[k]:starts[k + 1]]."""

    vertices: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " r"]

    @property
    def count(self) -> int:
        return len(self.starts) - 1

    @property
    def labels(self) -> Int[np.ndarray, " n"]:
        """The ring of every entry."""
        return np.repeat(np.arange(self.count), np.diff(self.starts))

    @property
    def successor(self) -> Int[np.ndarray, " n"]:
        """The position of the next entry of the same ring, closing each ring."""
        successor = np.arange(1, len(self.vertices) + 1)
        successor[self.starts[1:] - 1] = self.starts[:-1]
        return successor


@dataclass(frozen=True, kw_only=True, eq=False)
class _Overlaps:
    """For each ring entry, whether the edge from it to its successor lies on another boundary edge."""

    on_same_ring_reversed: Bool[np.ndarray, " n"]
    on_other_ring: Bool[np.ndarray, " n"]


def _follow_boundary(half_edges: HalfEdges) -> _Rings:
    """The boundary as rings of vertices, each against its half-edges and from its lowest vertex; bow-ties not split."""
    # ascending targets, so that the lowest position in a ring is the lowest vertex of the ring
    boundary = half_edges.boundary[np.argsort(half_edges.target[half_edges.boundary], kind="stable")]
    position = np.full(len(half_edges.origin), -1, dtype=np.int64)
    position[boundary] = np.arange(len(boundary))

    following = next_in_face(boundary)
    turning = np.flatnonzero(half_edges.twin[following] >= 0)
    while len(turning):
        following[turning] = next_in_face(half_edges.twin[following[turning]])
        turning = turning[half_edges.twin[following[turning]] >= 0]
    previous = np.empty(len(boundary), dtype=np.int64)
    previous[position[following]] = np.arange(len(boundary))

    root, steps_to_root = _order_cycles(previous)
    lengths = np.bincount(root, minlength=len(boundary))
    place = (lengths[root] - steps_to_root) % lengths[root]
    order = np.lexsort((place, root))
    return _Rings(
        vertices=half_edges.target[boundary[order]],
        starts=np.append(0, np.cumsum(lengths[lengths > 0])),
    )


def _order_cycles(permutation: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The lowest element of each element's cycle, and the number of steps to it, both by pointer doubling."""
    rounds = int(np.ceil(np.log2(max(len(permutation), 2))))
    root = np.arange(len(permutation))
    jump = permutation
    for _ in range(rounds):
        root = np.minimum(root, root[jump])
        jump = jump[jump]
    at_root = root == np.arange(len(permutation))
    jump = np.where(at_root, root, permutation)
    steps = np.where(at_root, 0, 1)
    for _ in range(rounds):
        steps = steps + steps[jump]
        jump = jump[jump]
    return root, steps


def _split_at_repeated_vertices(rings: _Rings) -> _Rings:
    """Rings that visit each vertex once; a ring that does already is left as it is."""
    labels = rings.labels
    order = np.lexsort((rings.vertices, labels))
    repeated = (np.diff(labels[order]) == 0) & (np.diff(rings.vertices[order]) == 0)
    if not repeated.any():
        return rings
    pinched = set(labels[order[1:][repeated]].tolist())
    parts: list[Int[np.ndarray, " _"]] = []
    for ring, vertices in enumerate(np.split(rings.vertices, rings.starts[1:-1])):
        parts.extend(_simple_rings(vertices) if ring in pinched else [vertices])
    return _Rings(vertices=np.concatenate(parts), starts=np.append(0, np.cumsum([len(part) for part in parts])))


def _simple_rings(vertices: Int[np.ndarray, " n"]) -> list[Int[np.ndarray, " _"]]:
    """One ring cut at its repeated vertices, each part from its lowest vertex.

    Each time the walk returns to a vertex, the part since then is cut off. On a plane or spherical piece of mesh the
    repeats are nested, and there is no other way to cut.
    """
    walk: list[int] = []
    place: dict[int, int] = {}
    parts = []
    for vertex in vertices.tolist():
        if vertex in place:
            start = place[vertex]
            parts.append(np.array(walk[start:], dtype=np.int64))
            for passed in walk[start + 1 :]:
                del place[passed]
            del walk[start + 1 :]
        else:
            place[vertex] = len(walk)
            walk.append(vertex)
    parts.append(np.array(walk, dtype=np.int64))
    return [np.roll(part, -int(np.argmin(part))) for part in parts]


def _find_overlaps(rings: _Rings, points: Float[np.ndarray, "n 3"]) -> _Overlaps:
    """Which ring edges have the same two end positions as another ring edge."""
    place = coincident_vertices(points)
    start, end = place, place[rings.successor]
    forward = start < end
    pair = np.minimum(start, end) * len(points) + np.maximum(start, end)
    on_edge = _group_sizes(pair)
    # an edge of length 0 says nothing about two sides
    shared = np.flatnonzero((on_edge > 1) & (start != end))
    _, edge = np.unique(pair[shared], return_inverse=True)
    edge_of_ring = edge * rings.count + rings.labels[shared]
    on_ring = _group_sizes(edge_of_ring)
    on_ring_same_way = _group_sizes(edge_of_ring * 2 + forward[shared])
    reversed_ = np.zeros(len(points), dtype=bool)
    reversed_[shared] = on_ring > on_ring_same_way
    other = np.zeros(len(points), dtype=bool)
    other[shared] = on_edge[shared] > on_ring
    return _Overlaps(on_same_ring_reversed=reversed_, on_other_ring=other)


def _group_sizes(keys: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """How many entries have each entry's value."""
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return counts[inverse]


def _boundary_loop(rings: _Rings, points: Float[np.ndarray, "n 3"], overlaps: _Overlaps, ring: int) -> BoundaryLoop:
    part = slice(rings.starts[ring], rings.starts[ring + 1])
    vertices, own = rings.vertices[part], points[part]
    lengths = np.linalg.norm(np.roll(own, -1, axis=0) - own, axis=1)
    perimeter = float(lengths.sum())
    seam = overlaps.on_other_ring[part]
    return BoundaryLoop(
        points=own,
        vertex_ids=vertices,
        corners=detect_corners(own),
        slit_fraction=float(lengths[overlaps.on_same_ring_reversed[part]].sum()) / perimeter if perimeter else 0.0,
        seam_edges=np.stack([vertices, np.roll(vertices, -1)], axis=1)[seam],
    )
