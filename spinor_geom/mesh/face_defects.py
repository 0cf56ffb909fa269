"""What does not fit together among the faces beside a boundary loop, and whether a patch can be joined there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from spinor_geom.errors import MeshError, NonManifoldEdgeError
from spinor_geom.mesh.sheets import Sheets
from spinor_geom.mesh.topology import referenced_vertices


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
