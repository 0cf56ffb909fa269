"""Detection of the boundary loops of a mesh, which are simple polygons.

Faces are first joined into sheets, which on a manifold mesh end at the edges with one face. Duplicate faces and faces
that use a vertex twice are ignored, the faces of a non-manifold edge are joined in pairs, and the orientation of faces
is not used. Each loop has remarks on the defects of the faces beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from spinor_geom.arrays import distinct, norm
from spinor_geom.errors import DuplicateVertexError, MeshError, NonManifoldEdgeError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners, measure
from spinor_geom.mesh.loop_frame import first_points
from spinor_geom.mesh.seams import find_overlaps
from spinor_geom.mesh.topology import HalfEdges, referenced_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh, box_sides

Points = Float[np.ndarray, "n 3"]

SOUP_FRACTION = 0.5
_MOST_FACES = 16  # largest number of faces of an edge that are joined in pairs, because all pairs are compared


def find_boundary_loops(mesh: TriangleMesh, sheets: Sheets | None = None) -> list[BoundaryLoop]:
    """All boundary loops of a mesh as simple oriented polygons, longest perimeter first.

    A loop is traced around each vertex within one fan of faces, so parts of a mesh that touch at a vertex only have
    separate loops. A loop that passes a vertex twice is split there. Two loops may share a vertex. Loops have the
    orientation of the boundary of a patch over them. Their first point is that of `first_points`: it depends on the
    positions only, not on the numbers of the vertices.

    `BoundaryLoop.remarks` and `BoundaryLoop.obstacle` report inconsistent faces that touch a loop. If the faces beside
    a loop have different orientations, the loop follows the majority. `BoundaryLoop.slit_fraction`,
    `BoundaryLoop.seam_edges` and `BoundaryLoop.junctions` describe coincident edges, up to rounding.

    `sheets` are those of the mesh, if already computed. Raises a DuplicateVertexError if the faces do not share their
    vertices: more than half of all boundary edges, and some of every loop, coincide with edges of other loops.
    """
    sheets = sheets or Sheets.of(mesh.vertices, mesh.faces)
    if not len(sheets.half_edges.boundary):
        return []
    traced = _traced_loops(sheets)
    traced = traced.from_first_points(mesh.vertices, sheets.half_edges.opposite)
    beside = mesh.vertices[sheets.half_edges.opposite[traced.half_edges]]
    points, successor, numbers = mesh.vertices[traced.vertices], traced.successor, traced.numbers
    overlaps = find_overlaps(points, successor, numbers, math.hypot(*box_sides(mesh.vertices)))
    on_other = (overlaps.other > 0) & overlaps.is_matched
    is_equal = on_other & (overlaps.distance == 0)
    if is_equal.mean() > SOUP_FRACTION and np.logical_or.reduceat(is_equal, traced.starts[:-1]).all():
        first = np.argmax(is_equal)
        edge = traced.vertices[[first, successor[first]]]
        raise DuplicateVertexError(vertices=tuple(edge.tolist()), count=int(is_equal.sum()))
    defects = _FaceDefects(mesh.faces, sheets)
    # the junctions of each loop: those of its entries, and those on its edges
    number, of_loop = numbers[overlaps.junctions], np.arange(len(overlaps.junctions))
    is_other = number[:, 0] != number[:, 1]
    number, of_loop = np.append(number[:, 0], number[is_other, 1]), np.append(of_loop, of_loop[is_other])
    order = np.lexsort((of_loop, number))
    bounds, junctions = (
        np.searchsorted(number[order], np.arange(len(traced.starts))),
        overlaps.junctions[of_loop[order]],
    )
    entry, edge = junctions.T
    junctions = traced.vertices[np.stack([entry, edge, successor[edge]], axis=1)]
    edges = np.stack([traced.vertices, traced.vertices[successor]], axis=1)
    lengths = norm(points[successor] - points)
    overlapping, perimeters = np.add.reduceat([lengths * overlaps.own, lengths], traced.starts[:-1], axis=1)
    slit = np.divide(overlapping, perimeters, out=np.zeros_like(perimeters), where=perimeters > 0)
    distance = np.maximum.reduceat(overlaps.distance, traced.starts[:-1])
    are_beside = np.logical_or.reduceat(defects.are_at(traced.vertices, traced.half_edges), traced.starts[:-1])
    loops = [
        BoundaryLoop(
            points=points[start:end],
            vertex_ids=traced.vertices[start:end],
            corners=detect_corners(points[start:end]),
            seam_edges=edges[start:end][on_other[start:end]],
            slit_fraction=share,
            seam_distance=apart,
            junctions=junctions[slice(*ends_of)],
            beside=beside[start:end],
            obstacle=defects.obstacle(traced.half_edges[start:end]) if has_defects else None,
            remarks=tuple(defects.remarks(traced.vertices[start:end], traced.half_edges[start:end]))
            if has_defects
            else (),
        )
        for (start, end), ends_of, share, apart, has_defects in zip(
            *(pairwise(traced.starts.tolist()), pairwise(bounds.tolist())),
            *(slit.tolist(), distance.tolist(), are_beside.tolist()),
            strict=True,
        )
    ]
    measure(loops)
    longest_first = np.array([-loop.perimeter for loop in loops])
    order = np.lexsort((np.minimum.reduceat(traced.vertices, traced.starts[:-1]), longest_first))
    return [loops[k] for k in order.tolist()]


def count_boundary_loops(mesh: TriangleMesh) -> int:
    """The number of loops that `find_boundary_loops` finds."""
    return len(_traced_loops(Sheets.of(mesh.vertices, mesh.faces)).starts) - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class _TracedLoops:
    """Vertices of all boundary loops, and the half-edge from each to the next. Loop k is starts[k]:starts[k + 1]."""

    vertices: Int[np.ndarray, " n"]
    half_edges: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " r"]

    def from_first_points(self, positions: Float[np.ndarray, "v 3"], opposite: Int[np.ndarray, " h"]) -> _TracedLoops:
        """The loops from their `first_points`, which does not depend on the numbers of the vertices.

        `opposite` are the vertices opposite to half-edges.
        """
        starts, lengths = self.starts[:-1].copy(), np.diff(self.starts)
        for length in np.unique(lengths).tolist():
            loops = np.flatnonzero(lengths == length)
            entries = starts[loops, None] + np.arange(length)
            beside = positions[opposite[self.half_edges[entries]]]
            starts[loops] += first_points(positions[self.vertices[entries]], beside)[0]
        place = np.arange(len(self.vertices)) - np.repeat(self.starts[:-1], lengths) + np.repeat(starts, lengths)
        ends = np.repeat(self.starts[1:], lengths)
        place = np.where(place < ends, place, place - np.repeat(lengths, lengths))
        return _TracedLoops(vertices=self.vertices[place], half_edges=self.half_edges[place], starts=self.starts)

    @property
    def numbers(self) -> Int[np.ndarray, " n"]:
        """The loop of each entry."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @property
    def successor(self) -> Int[np.ndarray, " n"]:
        """The next entry of the same loop."""
        successor = np.arange(1, len(self.vertices) + 1)
        successor[self.starts[1:] - 1] = self.starts[:-1]
        return successor


def _traced_loops(sheets: Sheets) -> _TracedLoops:
    """Boundary loops without repeated vertices, directed against most of their half-edges, from their lowest vertex.

    A closed chain of edges counts as a loop if at least one of its edges has a single face.
    """
    boundary = np.flatnonzero(sheets.twin < 0)
    position = np.empty(len(sheets.twin), dtype=np.int64)
    position[boundary] = np.arange(len(boundary))
    # entry 2k follows boundary half-edge k from its origin, entry 2k + 1 from its target
    half_edge, against = np.repeat(boundary, 2), np.tile([False, True], len(boundary))
    vertex = np.where(against, sheets.half_edges.target[half_edge], sheets.half_edges.origin[half_edge])
    reached = sheets.next_ends(half_edge, ~against)
    following = (2 * position[reached // 2] + reached % 2).tolist()
    has_one_face = referenced_vertices(sheets.half_edges.boundary, vertices=len(position))[boundary].tolist()
    starts, vertices = np.argsort(vertex, kind="stable").tolist(), vertex.tolist()
    seen = bytearray(len(vertices))
    loops: list[list[int]] = []
    for start in starts:
        loop, at = [], start
        while not seen[at]:
            seen[at] = seen[at ^ 1] = True
            loop.append(at)
            at = following[at]
        if any(has_one_face[entry // 2] for entry in loop):
            if 2 * sum(entry % 2 for entry in loop) < len(loop):
                loop = [entry ^ 1 for entry in reversed(loop)]
            loops += _simple_loops(vertices, loop)
    entries, ends = np.array(list(chain.from_iterable(loops)), dtype=np.int64), np.cumsum([0, *map(len, loops)])
    return _TracedLoops(vertices=vertex[entries], half_edges=half_edge[entries], starts=ends)


def _simple_loops(vertices: list[int], loop: list[int]) -> list[list[int]]:
    """A loop split at its repeated vertices, each part from its lowest vertex.

    When the walk returns to a vertex, the loop since its first visit is split off. On a mesh of genus 0 the repeats are
    nested, so the split is unique.
    """
    loop = _from_lowest(vertices, loop)
    if len({vertices[entry] for entry in loop}) == len(loop):
        return [loop]
    walk: list[int] = []
    place: dict[int, int] = {}
    parts = []
    for entry in loop:
        if vertices[entry] in place:
            start = place[vertices[entry]]
            parts.append(walk[start:])
            for passed in walk[start:]:
                del place[vertices[passed]]
            del walk[start:]
        place[vertices[entry]] = len(walk)
        walk.append(entry)
    return [_from_lowest(vertices, part) for part in (*parts, walk)]


def _from_lowest(vertices: list[int], loop: list[int]) -> list[int]:
    ids = [vertices[entry] for entry in loop]
    lowest = min(ids)
    start = min((place for place, vertex in enumerate(ids) if vertex == lowest), key=loop.__getitem__)
    return loop[start:] + loop[:start]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheets:
    """Faces joined across their edges, without duplicate faces and faces that use a vertex twice."""

    half_edges: HalfEdges  # of the remaining faces
    face_ids: Int[np.ndarray, " g"]  # indices of the remaining faces in the mesh
    twin: Int[np.ndarray, " h"]  # the half-edge of the adjacent face of the sheet, −1 for none
    copies: Int[np.ndarray, "k 2"]  # faces with the same vertices: one that remains, one that is ignored
    degenerate: Int[np.ndarray, " d"]  # ignored faces that use a vertex twice

    @classmethod
    def of(cls, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Sheets:
        """The sheets of faces over vertices."""
        flat = repeats_a_vertex(faces)
        face_ids = np.flatnonzero(~flat)
        half_edges = HalfEdges.of(faces[face_ids])
        copies = repeated_faces(half_edges)
        if len(copies):
            copies, face_ids = face_ids[copies], np.delete(face_ids, copies[:, 1])
            half_edges = HalfEdges.of(faces[face_ids])
        twin, degenerate = _twins(half_edges, vertices), np.flatnonzero(flat)
        return cls(half_edges=half_edges, face_ids=face_ids, twin=twin, copies=copies, degenerate=degenerate)

    def unclosed(self, faces: Int[np.ndarray, "f 3"], count: int) -> Bool[np.ndarray, " {count}"]:
        """The vertices of all edges that do not have exactly two faces of opposite directions, (count,) bool.

        All vertices of the ignored faces are among them.
        """
        unclosed = self.half_edges.unclosed(count)
        unclosed[faces[self.degenerate]] = unclosed[faces[self.copies]] = True
        return unclosed

    def next_ends(self, half_edge: Int[np.ndarray, " n"], at_target: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """For half-edges without a twin, the next half-edge without a twin around one of their ends.

        Returns 2h for a half-edge h reached at its origin, 2h + 1 for one reached at its target.
        """
        origin, target, twin = self.half_edges.origin, self.half_edges.target, self.twin
        is_end = referenced_vertices(origin[half_edge], vertices=int(origin.max(initial=-1)) + 1)
        is_end[target[half_edge]] = True
        # 2h and 2h + 1 are the two ends of half-edge h, here those at the vertices of the given ones
        end = np.flatnonzero(np.stack([is_end[origin], is_end[target]], axis=1))
        across = twin[end >> 1]
        is_same = origin[across] == origin[end >> 1]
        place = np.empty(2 * len(origin), dtype=np.int64)
        place[end] = np.arange(len(end))
        step = place[np.where(across < 0, end, _around_corner(2 * across + ((end & 1) == is_same)))]
        reached = place[_around_corner(2 * half_edge + at_target)]
        while (across[reached] >= 0).any():  # doubles the number of faces that are passed at once
            reached, step = step[reached], step[step]
        return np.asarray(end[reached])


def _around_corner(end: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """From ends 2h or 2h + 1 of half-edges to those of the other edges at the same corners of their faces."""
    half_edge, at_target = end >> 1, end & 1
    other = half_edge - half_edge % 3 + (half_edge + 2 - at_target) % 3
    return np.asarray(2 * other + 1 - at_target)


def repeats_a_vertex(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
    """Whether each face uses a vertex more than once, (F,) bool."""
    a, b, c = faces.T
    return np.asarray((a == b) | (b == c) | (c == a))


def repeated_faces(half_edges: HalfEdges) -> Int[np.ndarray, "k 2"]:
    """Pairs of faces with the same three vertices, sorted, and of more than two the consecutive ones."""
    # candidates: faces of an edge with more than two faces, or with two and equal opposite vertices
    a, b = half_edges.pairs.T
    nonmanifold = half_edges.order[np.repeat(half_edges.counts > 2, half_edges.counts)]
    some = np.append(half_edges.pairs[half_edges.opposite[a] == half_edges.opposite[b]], nonmanifold) // 3
    if not len(some):
        return np.zeros((0, 2), dtype=np.int64)
    some = distinct(some)
    corners = np.sort(half_edges.origin.reshape(-1, 3)[some], axis=1)
    order = np.lexsort(corners.T)
    pairs = some[np.stack([order[:-1], order[1:]], axis=1)[(np.diff(corners[order], axis=0) == 0).all(axis=1)]]
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


def _twins(half_edges: HalfEdges, vertices: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, " h"]:
    """The half-edge of the adjacent face for each half-edge, −1 for none.

    The faces of a non-manifold edge are joined in pairs: first those of opposite directions, then the flattest pairs.
    """
    twin: Int[np.ndarray, " h"] = half_edges.twin.copy()
    nonmanifold = np.flatnonzero((half_edges.counts > 2) & (half_edges.counts <= _MOST_FACES))
    if not len(nonmanifold):
        return twin
    start, size = half_edges.starts[nonmanifold], half_edges.counts[nonmanifold]
    edge = np.repeat(np.arange(len(nonmanifold)), size**2)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(size**2) - size**2, size**2)
    one, other = (half_edges.order[start[edge] + n] for n in (number // size[edge], number % size[edge]))
    pairs = np.stack([one, other, edge], axis=1)[one < other]
    corners = np.stack([half_edges.origin, half_edges.target, half_edges.opposite])
    first, second = (_inward_directions(*vertices[corners[:, side]]) for side in pairs[:, :2].T)
    is_same_direction = half_edges.origin[pairs[:, 0]] == half_edges.origin[pairs[:, 1]]
    pairs = pairs[np.lexsort((np.einsum("pi,pi->p", first, second), is_same_direction, pairs[:, 2]))]
    while len(pairs):
        flattest = pairs[np.append(True, np.diff(pairs[:, 2]) != 0)]
        twin[flattest[:, 0]], twin[flattest[:, 1]] = flattest[:, 1], flattest[:, 0]
        pairs = pairs[(twin[pairs[:, :2]] < 0).all(axis=1)]
    return twin


def _inward_directions(start: Points, end: Points, apex: Points) -> Points:
    """Unit vectors in faces from an edge towards the opposite corner, normal to it, and 0 for a face without area."""
    along, aside = end - start, apex - start
    length2 = np.einsum("ni,ni->n", along, along)
    share = np.einsum("ni,ni->n", aside, along) / np.where(length2 > 0, length2, 1.0)
    away = aside - share[:, None] * along
    size = np.linalg.norm(away, axis=1)
    return np.asarray(away / np.where(size > 0, size, 1.0)[:, None])


def _places(keys: Int[np.ndarray, " n"], count: int) -> csr_array:
    """The places of each of the keys 0 to count - 1 in an array, as the columns of a row of a matrix."""
    return csr_array((np.ones(len(keys)), (keys, np.arange(len(keys)))), shape=(count, len(keys)))


class _FaceDefects:
    """The defects of the faces of a mesh, and sentences on those at a loop."""

    def __init__(self, faces: Int[np.ndarray, "f 3"], sheets: Sheets) -> None:
        self._faces, self._sheets, half_edges = faces, sheets, sheets.half_edges
        count = int(faces.max()) + 1
        self._at_degenerate = referenced_vertices(faces[sheets.degenerate], vertices=count)
        self._is_copied = referenced_vertices(sheets.copies[:, :1], vertices=len(faces))
        self._degenerate_corners = _places(faces[sheets.degenerate].ravel(), count)
        self._copies_of = _places(sheets.copies[:, 0], len(faces))
        # the non-manifold edge of each half-edge, and one at each vertex, or −1 for none
        edges = np.repeat(np.where(half_edges.counts > 2, np.arange(len(half_edges.counts)), -1), half_edges.counts)
        self._nonmanifold_of, self._nonmanifold_at = np.empty_like(edges), np.full(count, -1, dtype=np.int64)
        self._nonmanifold_of[half_edges.order] = edges
        nonmanifold = half_edges.order[edges >= 0]
        for ends in (half_edges.origin, half_edges.target):
            self._nonmanifold_at[ends[nonmanifold]] = self._nonmanifold_of[nonmanifold]

    def are_at(self, vertices: Int[np.ndarray, " n"], half_edges: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether there is a defect at each of the vertices and half-edges of loops."""
        return np.asarray(
            (self._sheets.half_edges.origin[half_edges] == vertices)
            | self._at_degenerate[vertices]
            | self._is_copied[self._sheets.face_ids[half_edges // 3]]
            | (self._nonmanifold_at[vertices] >= 0)
        )

    def obstacle(self, half_edges: Int[np.ndarray, " m"]) -> MeshError | None:
        """The error of the first non-manifold edge of a loop, where no patch can be joined, or None without one."""
        edges = self._nonmanifold_of[half_edges]
        return self._nonmanifold_edge(int(edges[np.argmax(edges >= 0)])) if (edges >= 0).any() else None

    def remarks(self, vertices: Int[np.ndarray, " m"], half_edges: Int[np.ndarray, " m"]) -> Iterator[str]:
        """One sentence for each kind of defect of the faces that touch a loop."""
        degenerate, copies, face_ids = self._sheets.degenerate, self._sheets.copies, self._sheets.face_ids
        flipped = half_edges[self._sheets.half_edges.origin[half_edges] == vertices]
        if len(flipped):
            yield (
                f"{len(flipped)} of the {len(half_edges)} faces beside the loop have the opposite orientation, first "
                f"face {face_ids[flipped[0] // 3]}; the patch follows the others: flip these faces"
            )
        if self._at_degenerate[vertices].any():
            touching = degenerate[distinct(self._degenerate_corners[vertices].indices // 3)]
            yield (
                f"{len(touching)} faces that use a vertex twice touch the loop, first face {touching[0]} "
                f"{tuple(self._faces[touching[0]].tolist())}; they were ignored: remove them"
            )
        beside = face_ids[half_edges // 3]
        if self._is_copied[beside].any():
            pairs = copies[distinct(self._copies_of[beside].indices)]
            yield (
                f"{len(pairs)} faces beside the loop have copies, first faces {tuple(pairs[0].tolist())} with the same "
                "vertices; with the patch their edges have more than two faces: keep one face of each pair"
            )
        nonmanifold = int(self._nonmanifold_at[vertices].max())
        if nonmanifold >= 0 and self.obstacle(half_edges) is None:
            yield f"beside the loop {self._nonmanifold_edge(nonmanifold)}"

    def _nonmanifold_edge(self, edge: int) -> NonManifoldEdgeError:
        half_edges = self._sheets.half_edges
        members = half_edges.order[half_edges.starts[edge] : half_edges.starts[edge + 1]]
        ends = (int(half_edges.origin[members[0]]), int(half_edges.target[members[0]]))
        # not all, because each loop at the edge has such an error
        faces = self._sheets.face_ids[members[:_MOST_FACES] // 3].tolist()
        return NonManifoldEdgeError(edge=ends, count=len(members), faces=faces)
