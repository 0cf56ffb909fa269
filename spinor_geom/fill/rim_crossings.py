"""Intersections that every patch over a rim has: where edges of the rim pass through faces of the mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import Crossings, PatchedMesh
from spinor_geom.mesh.intersections import edges_through
from spinor_geom.meshing.embed import Patch


class Avoidable(NamedTuple):
    """Pairs of intersecting faces that another patch over the same rim may not have."""

    own: Int[np.ndarray, "i 2"]  # both faces are the patch's
    others: Int[np.ndarray, "j 2"]  # a face of the patch, and one of the mesh or of another patch


class RimCrossings:
    """The faces of the mesh and of other patches through which edges of a rim pass.

    Whichever face of a patch has such an edge, it intersects that face.
    """

    def __init__(self, patched: PatchedMesh, new: NewPatch) -> None:
        """Tests the edges of the rim with the faces that the patch intersects."""
        self._first, self._after = patched.face_count, rim_successors(new.patch.rims)
        pairs = np.concatenate([new.crossings.mesh, new.crossings.patches])
        pair, start, end = self._rim_edges(new.patch, pairs)
        vertices, others = new.patch.vertices, pairs[pair, 1]
        through = edges_through(vertices[start], vertices[end], patched.corners(others))
        self._keys = np.unique(self._keys_of(start[through], others[through]))

    def _rim_edges(
        self, patch: Patch, pairs: Int[np.ndarray, "k 2"]
    ) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
        """The edges of the rim that belong to the first faces of pairs: the pair, and the ends of the edge."""
        starts = np.asarray(patch.faces)[pairs[:, 0] - self._first]
        ends = starts[:, [1, 2, 0]]
        pair, side = np.nonzero(starts < patch.boundary_size)
        start, end = starts[pair, side], ends[pair, side]
        is_rim = self._after[start] == end
        return pair[is_rim], start[is_rim], end[is_rim]

    def _keys_of(self, start: Int[np.ndarray, " k"], face: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        return np.asarray(start * self._first + face)

    def avoidable(self, patch: Patch, crossings: Crossings) -> Avoidable:
        """The intersections of a patch without those at its rim."""
        pairs = np.concatenate([crossings.mesh, crossings.patches])
        if len(self._keys):
            pair, start, _ = self._rim_edges(patch, pairs)
            pairs = np.delete(pairs, pair[np.isin(self._keys_of(start, pairs[pair, 1]), self._keys)], axis=0)
        return Avoidable(own=crossings.own, others=pairs)
