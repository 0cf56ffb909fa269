"""What does not fit together among the faces beside a boundary loop, and whether a patch can be joined there."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.errors import MeshError, NonManifoldEdgeError
from spinor_geom.mesh.sheets import Sheets


class FaceDefects:
    """The defects of a mesh, to be asked for loop by loop and its half-edges; clean loops cost nothing."""

    def __init__(self, faces: Int[np.ndarray, "f 3"], sheets: Sheets) -> None:
        """Looks at the faces of a mesh and the sheets in which they hang together."""
        self._faces, self._sheets = faces, sheets

    def obstacle(self, half_edges: Int[np.ndarray, " m"]) -> MeshError | None:
        """Why a loop along half-edges can have no patch: an edge of it has several faces already."""
        if self._at_crowded_edge is None:
            return None
        crowded = self._sheets.half_edges.counts[self._edge_of[half_edges]] > 2
        return self._crowded_edge(int(half_edges[np.argmax(crowded)])) if crowded.any() else None

    def remarks(self, vertices: Int[np.ndarray, " m"], half_edges: Int[np.ndarray, " m"]) -> tuple[str, ...]:
        """What is to be said of the faces that touch a loop, a sentence each; it starts along its first half-edge."""
        flipped = half_edges[self._sheets.half_edges.origin[half_edges] == vertices]
        return (*self._flipped(flipped, len(half_edges)), *self._others(vertices, half_edges))

    def _flipped(self, half_edges: Int[np.ndarray, " k"], count: int) -> Iterator[str]:
        if len(half_edges):
            yield (
                f"{len(half_edges)} of the {count} faces beside the loop run against the others, first face "
                f"{self._sheets.face_ids[half_edges[0] // 3]}; the patch goes with the others: turn the faces over"
            )

    def _others(self, vertices: Int[np.ndarray, " m"], half_edges: Int[np.ndarray, " m"]) -> Iterator[str]:
        degenerate, copies = self._sheets.degenerate, self._sheets.copies
        if len(degenerate) and self._at_degenerate[vertices].any():
            touching = degenerate[np.isin(self._faces[degenerate], vertices).any(axis=1)]
            yield (
                f"{len(touching)} faces that use a vertex twice touch the loop, first face {touching[0]} "
                f"{tuple(self._faces[touching[0]].tolist())}; they were passed over: remove them"
            )
        beside = self._sheets.face_ids[half_edges // 3]
        if len(copies) and self._is_copied[beside].any():
            pairs = copies[np.isin(copies[:, 0], beside)]
            yield (
                f"{len(pairs)} faces beside the loop have copies, first faces {tuple(pairs[0].tolist())} with the same "
                "vertices; the patch makes one face more on their edges: keep one of them"
            )
        at_crowded = self._at_crowded_edge
        # an edge of the loop itself is its obstacle, and told as that
        if at_crowded is not None and (at_crowded[vertices] >= 0).any() and self.obstacle(half_edges) is None:
            yield f"beside the loop {self._crowded_edge(int(at_crowded[vertices].max()))}"

    @cached_property
    def _at_degenerate(self) -> Bool[np.ndarray, " v"]:
        """For every vertex whether a face uses it that uses some vertex twice."""
        touched = np.zeros(self._faces.max() + 1, dtype=bool)
        touched[self._faces[self._sheets.degenerate]] = True
        return touched

    @cached_property
    def _is_copied(self) -> Bool[np.ndarray, " f"]:
        """For every face whether another has its vertices."""
        copied = np.zeros(len(self._faces), dtype=bool)
        copied[self._sheets.copies[:, 0]] = True
        return copied

    @cached_property
    def _edge_of(self) -> Int[np.ndarray, " h"]:
        """The edge of every half-edge."""
        half_edges = self._sheets.half_edges
        edge = np.empty(len(half_edges.order), dtype=np.int64)
        edge[half_edges.order] = np.repeat(np.arange(len(half_edges.counts)), half_edges.counts)
        return edge

    @cached_property
    def _at_crowded_edge(self) -> Int[np.ndarray, " v"] | None:
        """For every vertex a half-edge that ends there on an edge of more than two faces, or −1; None without such."""
        half_edges = self._sheets.half_edges
        crowded = np.flatnonzero(half_edges.counts > 2)
        if not len(crowded):
            return None
        first = half_edges.order[half_edges.starts[crowded]]
        touched = np.full(self._faces.max() + 1, -1, dtype=np.int64)
        touched[half_edges.origin[first]] = touched[half_edges.target[first]] = first
        return touched

    def _crowded_edge(self, half_edge: int) -> NonManifoldEdgeError:
        half_edges, edge = self._sheets.half_edges, self._edge_of[half_edge]
        members = half_edges.order[half_edges.starts[edge] : half_edges.starts[edge + 1]]
        ends = (int(half_edges.origin[members[0]]), int(half_edges.target[members[0]]))
        return NonManifoldEdgeError(edge=ends, faces=self._sheets.face_ids[members // 3].tolist())
