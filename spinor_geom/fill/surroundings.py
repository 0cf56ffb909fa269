"""What a new patch may cross: itself, the mesh around it, the patches joined before it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from spinor_geom.fill.stitch import RimEdges, patch_chords
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import intersections_between, is_graph, self_intersections
from spinor_geom.mesh.operators import vertex_angles
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch

NO_PAIRS = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """Where the faces of a patch cross its own, the mesh's and those of patches joined before it.

    Pairs are of faces of the filled mesh; there is a note, a sentence, for each of the three that has some.
    """

    own: Int[np.ndarray, "i 2"]
    mesh: Int[np.ndarray, "j 2"]
    patches: Int[np.ndarray, "k 2"]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        """All pairs."""
        return len(self.own) + len(self.mesh) + len(self.patches)


NOTHING = Crossings(own=NO_PAIRS, mesh=NO_PAIRS, patches=NO_PAIRS, notes=())


class Surroundings:
    """A mesh and the patches joined to it so far: their faces, numbered as in the filled mesh, and their rim edges."""

    def __init__(self, mesh: TriangleMesh, loops: Iterable[BoundaryLoop] = ()) -> None:
        """Starts with the mesh alone; `loops` are those that may be filled."""
        self.mesh, self.taken = mesh, RimEdges(mesh, loops)
        self._patches: list[_Piece] = []
        # their boxes, with room for as many again: rows are low and high corners
        self._boxes = np.empty((16, 6))
        self._count = len(mesh.faces)

    @cached_property
    def _faces_of_vertices(self) -> csr_array:
        corners = self.mesh.faces.ravel()
        entries = (np.ones(len(corners), dtype=bool), (corners, np.arange(len(corners)) // 3))
        return csr_array(entries, shape=(len(self.mesh.vertices), len(self.mesh.faces)))

    def faces_at(self, vertices: Int[np.ndarray, " k"]) -> Int[np.ndarray, " f"]:
        """The mesh's faces that touch any of some vertices, ascending."""
        return np.unique(self._faces_of_vertices[vertices].indices)

    @cached_property
    def angles(self) -> Float[np.ndarray, " n"]:
        """Sum of the angles of the mesh's faces at each vertex, in radians."""
        return vertex_angles(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def _mesh_piece(self) -> _Piece:
        return _Piece(self.mesh.vertices, self.mesh.faces, start=0)

    def crossings(self, patch: Patch) -> Crossings:
        """What a patch would cross of itself and of all that is there."""
        new = _Piece(patch.vertices, np.asarray(patch.faces), start=self._count)
        own = NO_PAIRS
        if patch.hole_sizes or not is_graph(new.vertices, new.faces, patch.boundary_size):
            own = self_intersections(new.vertices, new.faces) + new.start
        mesh = new.crossings(self._mesh_piece)
        boxes = self._boxes[: len(self._patches)].T
        near = _meeting(boxes[:3], boxes[3:], new)
        patches = np.concatenate([NO_PAIRS, *(new.crossings(self._patches[k]) for k in near)])
        found = (("itself", own), ("the mesh", mesh), ("patches of other loops", patches))
        notes = tuple(_sentence(what, pairs, new) for what, pairs in found if len(pairs))
        return Crossings(own=own, mesh=mesh, patches=patches, notes=notes)

    def join(self, patch: Patch, rim: Int[np.ndarray, " m"]) -> None:
        """Adds a patch whose boundary vertices are those of the mesh in `rim`."""
        self.taken.take(rim[patch_chords(patch)])
        new = _Piece(patch.vertices, np.asarray(patch.faces), start=self._count)
        if len(self._patches) == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.empty_like(self._boxes)])
        self._boxes[len(self._patches)] = np.concatenate([new.low, new.high])
        self._patches.append(new)
        self._count += len(new.faces)


class _Piece:
    """Faces with their axis-parallel boxes, so that the few near a patch are found."""

    def __init__(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], *, start: int) -> None:
        """Takes the boxes once for many patches; `start` is the first face's number in the filled mesh."""
        self.vertices, self.faces, self.start = vertices, faces, start
        # corner by corner, then axis by axis: several times as fast as a minimum along a short axis
        a, b, c = (vertices.take(faces[:, k], axis=0) for k in range(3))
        lows, highs = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        self._lows, self._highs = np.ascontiguousarray(lows.T), np.ascontiguousarray(highs.T)
        self.low, self.high = self._lows.min(axis=1, initial=np.inf), self._highs.max(axis=1, initial=-np.inf)
        # along the longest axis faces are looked for by bisection
        self._axis = int(np.argmax(self.high - self.low)) if len(faces) else 0

    @cached_property
    def _along_axis(self) -> tuple[Int[np.ndarray, " f"], Float[np.ndarray, " f"], float]:
        """The order of the faces' low ends, these in order, and the widest face's extent."""
        low, high = self._lows[self._axis], self._highs[self._axis]
        order = np.argsort(low, kind="stable")
        return order, low[order], float((high - low).max(initial=0.0))

    def crossings(self, other: _Piece) -> Int[np.ndarray, "k 2"]:
        """Pairs of a face of this and one of another piece that cross."""
        near = other._faces_near(self)
        corners = other.vertices[other.faces[near]].reshape(-1, 3)
        pairs = intersections_between(self.vertices, self.faces, corners, np.arange(len(corners)).reshape(-1, 3))
        return np.stack([self.start + pairs[:, 0], other.start + near[pairs[:, 1]]], axis=1)

    def _faces_near(self, piece: _Piece) -> Int[np.ndarray, " k"]:
        """The faces whose boxes meet that of another piece, ascending."""
        # a little wider than needed: the sum is rounded
        order, lows, widest = self._along_axis
        first = np.searchsorted(lows, piece.low[self._axis] - 2 * widest)
        last = np.searchsorted(lows, piece.high[self._axis], side="right")
        some = np.sort(order[first:last])
        return np.asarray(some[_meeting(self._lows[:, some], self._highs[:, some], piece)])


def _meeting(lows: Float[np.ndarray, "3 f"], highs: Float[np.ndarray, "3 f"], piece: _Piece) -> Int[np.ndarray, " k"]:
    """Which of many boxes meet that of a piece."""
    meeting = np.flatnonzero((lows[0] <= piece.high[0]) & (highs[0] >= piece.low[0]))
    for axis in (1, 2):
        inside = (lows[axis, meeting] <= piece.high[axis]) & (highs[axis, meeting] >= piece.low[axis])
        meeting = meeting[inside]
    return meeting


def _sentence(what: str, pairs: Int[np.ndarray, "k 2"], patch: _Piece) -> str:
    first = tuple(pairs[0].tolist())
    where = patch.vertices[patch.faces[first[0] - patch.start]].mean(axis=0)
    return (
        f"the patch crosses {what} in {len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'} of faces, first {first} of "
        f"the filled mesh, near ({', '.join(f'{x:.6g}' for x in where)})"
    )
