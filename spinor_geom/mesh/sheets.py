"""How the faces of any mesh hang together in sheets, also where edges are crowded or faces flipped or copied.

On clean meshes a sheet ends where an edge has one face. Elsewhere copies of faces and faces that use a vertex twice are
passed over, an edge with more than two faces joins them two by two, and the direction of faces does not matter; what
does not fit together is told of the loops that it lies beside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.errors import MeshError, NonManifoldEdgeError
from spinor_geom.mesh.topology import HalfEdges, referenced_vertices

# Faces on one edge beyond which none of them are joined: all pairs of them are compared.
_MOST_FACES = 16
_OPPOSITE_FIRST = 4.0  # more than any two cosines differ by


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheets:
    """The half-edges of the faces that count, with what lies across each."""

    half_edges: HalfEdges  # of those faces
    face_ids: Int[np.ndarray, " g"]  # the faces' numbers in the mesh
    twin: Int[np.ndarray, " h"]  # for every half-edge the one across its edge, −1 where its sheet ends
    copies: Int[np.ndarray, "k 2"]  # faces with the same vertices: one that counts, one that was passed over
    degenerate: Int[np.ndarray, " d"]  # faces that use a vertex twice, which were passed over

    @classmethod
    def of(cls, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Sheets:
        """The sheets of faces over vertices."""
        flat = repeats_a_vertex(faces)
        face_ids = np.flatnonzero(~flat)
        half_edges = HalfEdges.of(faces[face_ids])
        copies = repeated_faces(half_edges)
        if len(copies):
            counts = np.ones(len(face_ids), dtype=bool)
            counts[copies[:, 1]] = False
            copies, face_ids = face_ids[copies], face_ids[counts]
            half_edges = HalfEdges.of(faces[face_ids])
        return cls(
            half_edges=half_edges,
            face_ids=face_ids,
            twin=_twins(half_edges, vertices),
            copies=copies,
            degenerate=np.flatnonzero(flat),
        )

    def next_ends(self, half_edge: Int[np.ndarray, " n"], at_target: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Turns around an end of each given half-edge without a twin, to the next such half-edge there.

        Gives 2h for a half-edge h that was reached at its origin, 2h + 1 for one reached at its target.
        """
        origin, target = self.half_edges.origin, self.half_edges.target
        vertex = np.where(at_target, target[half_edge], origin[half_edge])
        reached, turning = half_edge.copy(), np.arange(len(half_edge))
        while len(turning):
            here = reached[turning]
            # on around the face, or back
            here = here - here % 3 + (here + np.where(target[here] == vertex[turning], 1, 2)) % 3
            across = self.twin[here]
            reached[turning] = np.where(across < 0, here, across)
            turning = turning[across >= 0]
        return np.asarray(2 * reached + (target[reached] == vertex))


def repeats_a_vertex(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
    """Which faces use one vertex more than once."""
    a, b, c = faces.T
    return np.asarray((a == b) | (b == c) | (c == a))


def repeated_faces(half_edges: HalfEdges) -> Int[np.ndarray, "k 2"]:
    """Pairs of faces with the same three vertices, sorted; of several the first with each, or each with the next."""
    # two faces are the same exactly if they share an edge and the vertex opposite to it
    a, b = half_edges.pairs.T
    same = half_edges.opposite[a] == half_edges.opposite[b]
    found = [np.stack([a[same], b[same]], axis=1)]
    crowded = np.repeat(half_edges.counts > 2, half_edges.counts)
    if crowded.any():
        edge = np.repeat(np.arange(len(half_edges.counts)), half_edges.counts)[crowded]
        members = half_edges.order[crowded]
        apex = half_edges.opposite[members]
        by_apex = np.lexsort((members, apex, edge))
        same = (np.diff(edge[by_apex]) == 0) & (np.diff(apex[by_apex]) == 0)
        found.append(np.stack([members[by_apex][:-1][same], members[by_apex][1:][same]], axis=1))
    pairs = np.sort(np.concatenate(found) // 3, axis=1)
    return np.asarray(np.unique(pairs, axis=0)) if len(pairs) else pairs


def _twins(half_edges: HalfEdges, vertices: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, " h"]:
    """What lies across each half-edge; of more than two faces on an edge the flattest pair is joined first.

    Faces that run through the edge in opposite directions come before those that do not.
    """
    twin: Int[np.ndarray, " h"] = half_edges.twin.copy()
    crowded = np.flatnonzero((half_edges.counts > 2) & (half_edges.counts <= _MOST_FACES))
    if not len(crowded):
        return twin
    start, size = half_edges.starts[crowded], half_edges.counts[crowded]
    edge = np.repeat(np.arange(len(crowded)), size**2)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(size**2) - size**2, size**2)
    one, other = (half_edges.order[start[edge] + n] for n in (number // size[edge], number % size[edge]))
    pairs = np.stack([one, other, edge], axis=1)[one < other]
    corners = np.stack([half_edges.origin, half_edges.target, half_edges.opposite])
    first, second = (away_from_edges(*vertices[corners[:, side]]) for side in pairs[:, :2].T)
    same_way = half_edges.origin[pairs[:, 0]] == half_edges.origin[pairs[:, 1]]
    fold = np.einsum("pi,pi->p", first, second) + _OPPOSITE_FIRST * same_way
    pairs = pairs[np.lexsort((fold, pairs[:, 2]))]
    while len(pairs):
        flattest = pairs[np.append(True, np.diff(pairs[:, 2]) != 0)]
        twin[flattest[:, 0]], twin[flattest[:, 1]] = flattest[:, 1], flattest[:, 0]
        pairs = pairs[(twin[pairs[:, :2]] < 0).all(axis=1)]
    return twin


def away_from_edges(
    start: Float[np.ndarray, "n 3"], end: Float[np.ndarray, "n 3"], apex: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors in faces, across one of their edges and towards the corner beyond it; 0 for a face without area."""
    along, aside = end - start, apex - start
    length2 = np.einsum("ni,ni->n", along, along)
    share = np.einsum("ni,ni->n", aside, along) / np.where(length2 > 0, length2, 1.0)
    away = aside - share[:, None] * along
    size = np.linalg.norm(away, axis=1)
    return np.asarray(away / np.where(size > 0, size, 1.0)[:, None])


class FaceDefects:
    """The defects of a mesh, to be asked for loop by loop and its half-edges; clean loops cost nothing."""

    def __init__(self, faces: Int[np.ndarray, "f 3"], sheets: Sheets) -> None:
        """Looks at the faces of a mesh and the sheets in which they hang together."""
        self._faces, self._sheets, half_edges = faces, sheets, sheets.half_edges
        count = int(faces.max()) + 1
        self._at_degenerate = referenced_vertices(faces[sheets.degenerate], vertices=count)
        self._is_copied = referenced_vertices(sheets.copies[:, :1], vertices=len(faces))
        # of half-edges, and at vertices, an edge of more than two faces; −1 where there is none
        is_crowded = np.repeat(half_edges.counts > 2, half_edges.counts)
        crowded, edges = half_edges.order[is_crowded], np.repeat(np.arange(len(half_edges.counts)), half_edges.counts)
        self._crowded_at = np.full(count, -1, dtype=np.int64)
        self._crowded_of = np.full(len(half_edges.order), -1, dtype=np.int64)
        self._crowded_of[crowded] = edges[is_crowded]
        self._crowded_at[half_edges.origin[crowded]] = self._crowded_at[half_edges.target[crowded]] = edges[is_crowded]

    def obstacle(self, half_edges: Int[np.ndarray, " m"]) -> MeshError | None:
        """Why a loop along half-edges can have no patch: an edge of it has several faces already."""
        crowded = self._crowded_of[half_edges]
        return self._crowded_edge(int(crowded[np.argmax(crowded >= 0)])) if (crowded >= 0).any() else None

    def remarks(self, vertices: Int[np.ndarray, " m"], half_edges: Int[np.ndarray, " m"]) -> Iterator[str]:
        """What is to be said of the faces that touch a loop, a sentence each; it starts along its first half-edge."""
        degenerate, copies, face_ids = self._sheets.degenerate, self._sheets.copies, self._sheets.face_ids
        flipped = half_edges[self._sheets.half_edges.origin[half_edges] == vertices]
        if len(flipped):
            yield (
                f"{len(flipped)} of the {len(half_edges)} faces beside the loop run against the others, first face "
                f"{face_ids[flipped[0] // 3]}; the patch goes with the others: turn the faces over"
            )
        if self._at_degenerate[vertices].any():
            touching = degenerate[np.isin(self._faces[degenerate], vertices).any(axis=1)]
            yield (
                f"{len(touching)} faces that use a vertex twice touch the loop, first face {touching[0]} "
                f"{tuple(self._faces[touching[0]].tolist())}; they were passed over: remove them"
            )
        beside = face_ids[half_edges // 3]
        if self._is_copied[beside].any():
            pairs = copies[np.isin(copies[:, 0], beside)]
            yield (
                f"{len(pairs)} faces beside the loop have copies, first faces {tuple(pairs[0].tolist())} with the same "
                "vertices; the patch makes one face more on their edges: keep one of them"
            )
        crowded = int(self._crowded_at[vertices].max())
        # an edge of the loop itself is its obstacle, and told as that
        if crowded >= 0 and self.obstacle(half_edges) is None:
            yield f"beside the loop {self._crowded_edge(crowded)}"

    def _crowded_edge(self, edge: int) -> NonManifoldEdgeError:
        half_edges = self._sheets.half_edges
        members = half_edges.order[half_edges.starts[edge] : half_edges.starts[edge + 1]]
        ends = (int(half_edges.origin[members[0]]), int(half_edges.target[members[0]]))
        return NonManifoldEdgeError(edge=ends, faces=self._sheets.face_ids[members // 3].tolist())
