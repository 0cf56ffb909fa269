"""What a new patch meets: the mesh around it, edges and faces that are there already, the patches joined before it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import intersections_between, is_graph, self_intersections
from spinor_geom.mesh.operators import vertex_angles
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

NO_PAIRS = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPatch:
    """A patch ready to be joined to the mesh."""

    place: int  # of its loop, or of the first, among the mesh's loops
    rim: Int[np.ndarray, " m"]  # mesh vertices of the patch's first `boundary_size` vertices
    patch: Patch
    attributes: Mapping[str, Float[np.ndarray, "n _"]]  # at the inner vertices


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


def patch_chords(patch: Patch) -> Int[np.ndarray, "c 2"]:
    """The patch's inner edges that join two rim vertices, as pairs of patch vertices (lower first), each once."""
    starts, ends = np.ravel(patch.faces), np.roll(patch.faces, -1, axis=1).ravel()
    sides = np.stack([starts, ends], axis=1)[(starts < ends) & (ends < patch.boundary_size)]
    sides = sides[(rim_successors(patch.rims)[sides] != sides[:, ::-1]).all(axis=1)]
    return np.asarray(sides[np.lexsort(sides.T[::-1])])


def split_chords(patch: Patch, chords: Int[np.ndarray, "c 2"], surface: SpinorSurface | None = None) -> Patch:
    """A patch with a new vertex in the middle of each of some chords, which divides its two triangles.

    The new vertices come last. On a surface that the patch is a mesh of, the middle is halfway in Ω.
    """
    faces, points = np.asarray(patch.faces), patch.points[chords].mean(axis=1)
    middles = patch.vertices[chords].mean(axis=1) if surface is None else np.asarray(surface.position(points))
    for count, chord in enumerate(chords):
        middle = len(patch.vertices) + count
        beside = np.isin(faces, chord).sum(axis=1) == 2
        # both ends of the chord turn into the middle, once each: a triangle splits in two of the same orientation
        halves = [np.where(faces[beside] == end, middle, faces[beside]) for end in chord]
        faces = np.concatenate([faces[~beside], *halves])
    vertices, points = np.concatenate([patch.vertices, middles]), np.concatenate([patch.points, points])
    return replace(patch, vertices=vertices, faces=faces, points=points)


class Surroundings:
    """A mesh and the patches joined to it so far: their faces, numbered as in the filled mesh, and their rim edges.

    A patch may have an edge between two rim vertices (a chord) only if it is free: a second sheet on a taken edge would
    make it non-manifold.
    """

    def __init__(self, mesh: TriangleMesh, loops: Iterable[BoundaryLoop] = ()) -> None:
        """Starts with the mesh alone; `loops` are those that may be filled."""
        self.mesh = mesh
        self._loops_at = np.zeros(len(mesh.vertices), dtype=np.int64)
        for loop in loops:
            self._loops_at[loop.vertex_ids] += 1
        on_loop = (self._loops_at > 0)[mesh.faces]
        sides = np.flatnonzero(on_loop & on_loop[:, [1, 2, 0]])
        ends = np.stack([mesh.faces[sides // 3, sides % 3], mesh.faces[sides // 3, (sides + 1) % 3]], axis=1)
        self._taken = set(self._keys(ends))
        within = np.flatnonzero(on_loop.all(axis=1))
        corners = np.sort(mesh.faces[within], axis=1)
        self._faces = dict(zip(map(tuple, corners[::-1].tolist()), within[::-1].tolist(), strict=True))
        self._patches: list[_Piece] = []
        # their boxes, with room for as many again: rows are low and high corners
        self._boxes = np.empty((1, 6))
        self.count = len(mesh.faces)

    def _keys(self, edges: Int[np.ndarray, "e 2"]) -> list[int]:
        low, high = np.sort(edges, axis=1).T
        keys: list[int] = (low * len(self.mesh.vertices) + high).tolist()
        return keys

    def are_taken(self, edges: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """For each pair of vertices of loops whether an edge of the mesh or of a patch joins them already."""
        return np.array([key in self._taken for key in self._keys(edges)], dtype=bool)

    def face_on(self, loop: BoundaryLoop) -> int | None:
        """The mesh's face on just the vertices of a loop of three: then the loop is that face's own outline."""
        return self._faces.get(tuple(sorted(loop.vertex_ids.tolist())))

    def fitted(
        self, patch: Patch, rim: Int[np.ndarray, " m"], surface: SpinorSurface | None = None
    ) -> tuple[Patch, int]:
        """A patch whose chords on taken edges are split, and how many were; `rim` are the mesh's vertices around it.

        Each gets a new vertex, after the others, in its middle, and its two triangles are divided there. On a surface
        that the patch is a mesh of, that is halfway in Ω.
        """
        chords = patch_chords(patch)
        chords = chords[self.are_taken(rim[chords])]
        if not len(chords):
            return patch, 0
        return split_chords(patch, chords, surface), len(chords)

    @cached_property
    def _faces_of_vertices(self) -> csr_array:
        corners = self.mesh.faces.ravel()
        entries = (np.ones(len(corners), dtype=bool), (corners, np.arange(len(corners)) // 3))
        return csr_array(entries, shape=(len(self.mesh.vertices), len(self.mesh.faces)))

    def faces_at(self, vertices: Int[np.ndarray, " k"]) -> Int[np.ndarray, " f"]:
        """The mesh's faces that touch any of some vertices, ascending."""
        return np.unique(self._faces_of_vertices[vertices].indices)

    @cached_property
    def _angles(self) -> Float[np.ndarray, " n"]:
        return vertex_angles(self.mesh.vertices, self.mesh.faces)

    def turning(self, loop: BoundaryLoop) -> float:
        """The total geodesic curvature of a loop, in radians: 2π around a flat sheet, −2π around a hole in one.

        Vertices on several loops are left out: the mesh has no single angle there.
        """
        alone = loop.vertex_ids[self._loops_at[loop.vertex_ids] == 1]
        return float(np.sum(np.pi - self._angles[alone]))

    def is_pinched(self, loop: BoundaryLoop) -> bool:
        """Whether a loop shares a vertex with another, so that its turning is not all known."""
        return bool((self._loops_at[loop.vertex_ids] > 1).any())

    def is_outline(self, loop: BoundaryLoop) -> bool:
        """Whether the mesh lies inside a loop, as a flat sheet in its border, rather than around it."""
        return self.turning(loop) > 0

    @cached_property
    def _mesh_piece(self) -> _Piece:
        return _Piece(self.mesh.vertices, self.mesh.faces, start=0)

    def crossings(self, patch: Patch) -> Crossings:
        """What a patch would cross of itself and of all that is there."""
        new = _Piece(patch.vertices, np.asarray(patch.faces), start=self.count)
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

    def join(self, patch: Patch, rim: Int[np.ndarray, " m"]) -> int:
        """Adds a patch whose boundary vertices are those of the mesh in `rim`; gives the number of its first face."""
        self._taken.update(self._keys(rim[patch_chords(patch)]))
        new = _Piece(patch.vertices, np.asarray(patch.faces), start=self.count)
        if len(self._patches) == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.empty_like(self._boxes)])
        self._boxes[len(self._patches)] = np.concatenate([new.low, new.high])
        self._patches.append(new)
        self.count += len(new.faces)
        return new.start


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


def stitch(mesh: TriangleMesh, patches: Sequence[LoopPatch]) -> MeshExtension:
    """The new vertices and faces that join patches to a mesh, patch by patch; rim vertices are the mesh's own."""
    vertices, faces, face_loops = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    count = len(mesh.vertices)
    for part in patches:
        inner = part.patch.vertices[part.patch.boundary_size :]
        indices = np.concatenate([part.rim, np.arange(count, count + len(inner))])
        vertices.append(inner)
        faces.append(indices[part.patch.faces])
        face_loops.append(np.full(len(part.patch.faces), part.place, dtype=np.int64))
        count += len(inner)
    attributes = {
        name: np.concatenate([np.empty((0, values.shape[1])), *(part.attributes[name] for part in patches)])
        for name, values in mesh.vertex_attributes.items()
    }
    return MeshExtension(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        face_loops=np.concatenate(face_loops),
        vertex_attributes=attributes,
    )
