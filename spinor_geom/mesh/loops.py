"""The boundary loops of a mesh: followed inside the fans of faces, split into simple ones, longest first."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.errors import DuplicateVertexError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.sheets import FaceDefects, Sheets
from spinor_geom.mesh.topology import coincident_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh

SOUP_FRACTION = 0.5


def find_boundary_loops(mesh: TriangleMesh) -> list[BoundaryLoop]:
    """All boundary loops of a mesh as simple oriented polygons, longest perimeter first.

    A loop is followed by turning around each vertex inside its fan of faces, so pieces of mesh that touch in a vertex
    keep their own loops. A loop that passes a vertex twice is split there, so that each visits a vertex once; two loops
    may share a vertex. Loops run the way the boundary of a patch over them runs and start at their lowest vertex.

    Faces that do not fit together matter where they touch a loop, and are told there (`BoundaryLoop.remarks`,
    `BoundaryLoop.obstacle`). Where the faces beside a loop run against each other, it goes with most of them.

    Edges that lie on one another are told by `BoundaryLoop.slit_fraction` and `BoundaryLoop.seam_edges`. A closed mesh
    has no loops.

    Raises:
        DuplicateVertexError: more than half of all boundary edges lie on edges of other loops, and some of every loop:
            the faces do not share their vertices.
    """
    sheets = Sheets.of(mesh.vertices, mesh.faces)
    if not len(sheets.half_edges.boundary):
        return []
    rings = _boundary_rings(sheets)
    points = mesh.vertices[rings.vertices]
    on_own, on_other = _find_overlaps(rings, points)
    if on_other.mean() > SOUP_FRACTION and np.logical_or.reduceat(on_other, rings.starts[:-1]).all():
        first = int(np.argmax(on_other))
        raise DuplicateVertexError(
            vertices=(int(rings.vertices[first]), int(rings.vertices[rings.successor[first]])),
            count=int(on_other.sum()),
        )
    defects = FaceDefects(mesh.faces, sheets)
    loops = []
    for part in (slice(*ends) for ends in pairwise(rings.starts)):
        vertices, own = rings.vertices[part], points[part]
        lengths = np.linalg.norm(np.roll(own, -1, axis=0) - own, axis=1)
        perimeter = float(lengths.sum())
        loop = BoundaryLoop(
            points=own,
            vertex_ids=vertices,
            corners=detect_corners(own),
            slit_fraction=float(lengths[on_own[part]].sum()) / perimeter if perimeter else 0.0,
            seam_edges=np.stack([vertices, np.roll(vertices, -1)], axis=1)[on_other[part]],
            obstacle=defects.obstacle(rings.half_edges[part]),
            remarks=tuple(defects.remarks(vertices, rings.half_edges[part])),
        )
        loops.append(loop)
    return sorted(loops, key=lambda loop: (-loop.perimeter, int(loop.vertex_ids[0])))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rings:
    """Closed rings of vertices, ring k from starts[k] to starts[k + 1], and the half-edges along their edges."""

    vertices: Int[np.ndarray, " n"]
    half_edges: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " r"]

    @property
    def successor(self) -> Int[np.ndarray, " n"]:
        """The position of the next entry of the same ring, closing each ring."""
        successor = np.arange(1, len(self.vertices) + 1)
        successor[self.starts[1:] - 1] = self.starts[:-1]
        return successor


def _boundary_rings(sheets: Sheets) -> _Rings:
    """The boundary as rings that visit each vertex once, against most of their half-edges and from their lowest vertex.

    Where sheets end on edges of other faces only, that is no boundary.
    """
    boundary = np.flatnonzero(sheets.twin < 0)
    position = np.empty(len(sheets.twin), dtype=np.int64)
    position[boundary] = np.arange(len(boundary))
    # a half-edge can be followed from its origin, which is the even number, and from its target, against it
    half_edge, against = np.repeat(boundary, 2), np.tile([False, True], len(boundary))
    vertex = np.where(against, sheets.half_edges.target[half_edge], sheets.half_edges.origin[half_edge])
    reached = sheets.next_ends(half_edge, ~against)  # a walk leaves each half-edge at its other end
    following = (2 * position[reached // 2] + reached % 2).tolist()
    is_alone = np.isin(boundary, sheets.half_edges.boundary).tolist()
    starts, vertices = np.argsort(vertex, kind="stable").tolist(), vertex.tolist()
    seen = bytearray(len(vertices))
    rings: list[list[int]] = []
    for start in starts:
        ring, at = [], start
        while not seen[at]:
            seen[at] = seen[at ^ 1] = True
            ring.append(at)
            at = following[at]
        if any(is_alone[entry // 2] for entry in ring):
            if 2 * sum(entry % 2 for entry in ring) < len(ring):
                ring = [entry ^ 1 for entry in reversed(ring)]
            rings += _simple_rings(vertices, ring)
    entries = np.array(list(chain.from_iterable(rings)), dtype=np.int64)
    return _Rings(
        vertices=vertex[entries], half_edges=half_edge[entries], starts=np.append(0, np.cumsum(list(map(len, rings))))
    )


def _simple_rings(vertices: list[int], ring: list[int]) -> list[list[int]]:
    """One ring cut at its repeated vertices, each part from its lowest vertex.

    Each time the walk returns to a vertex, the part since then is cut off. On a plane or spherical piece of mesh the
    repeats are nested, and there is no other way to cut.
    """
    walk: list[int] = []
    place: dict[int, int] = {}
    parts = []
    for entry in _from_lowest(vertices, ring):
        if vertices[entry] in place:
            start = place[vertices[entry]]
            parts.append(walk[start:])
            for passed in walk[start:]:
                del place[vertices[passed]]
            del walk[start:]
        place[vertices[entry]] = len(walk)
        walk.append(entry)
    return [_from_lowest(vertices, part) for part in (*parts, walk)]


def _from_lowest(vertices: list[int], ring: list[int]) -> list[int]:
    start = min(range(len(ring)), key=lambda place: (vertices[ring[place]], ring[place]))
    return ring[start:] + ring[:start]


def _find_overlaps(
    rings: _Rings, points: Float[np.ndarray, "n 3"]
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Whether each ring edge lies on another of the same ring, run the other way, and whether on one of another."""
    place = coincident_vertices(points)
    start, end = place, place[rings.successor]
    forward = start < end
    pair = np.minimum(start, end) * len(points) + np.maximum(start, end)
    on_edge = _group_sizes(pair)
    # an edge of length 0 says nothing about two sides
    shared = np.flatnonzero((on_edge > 1) & (start != end))
    _, edge = np.unique(pair[shared], return_inverse=True)
    count = len(rings.starts) - 1
    edge_of_ring = edge * count + np.repeat(np.arange(count), np.diff(rings.starts))[shared]
    on_ring = _group_sizes(edge_of_ring)
    on_ring_same_way = _group_sizes(edge_of_ring * 2 + forward[shared])
    reversed_ = np.zeros(len(points), dtype=bool)
    reversed_[shared] = on_ring > on_ring_same_way
    other = np.zeros(len(points), dtype=bool)
    other[shared] = on_edge[shared] > on_ring
    return reversed_, other


def _group_sizes(keys: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """How many entries have each entry's value."""
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return counts[inverse]
