"""A mesh with the patches joined to it so far. Finds intersections and duplicate edges of a new patch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from spinor_geom.arrays import distinct
from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.errors import SurfaceError
from spinor_geom.kernel import call, checked
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import intersections_between, is_graph, self_intersections, sorted_pairs
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.mesh.operators import vertex_angles
from spinor_geom.mesh.topology import coincident_vertices, referenced_vertices
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.array_surface import ArraySurface

NO_PAIRS = np.zeros((0, 2), dtype=np.int64)
_SLANTS = np.sqrt(2.0), np.sqrt(3.0)  # any direction in which no lattice has two points at one height
_CELLS = 16  # of the grid that sorts faces, in each direction: 8 and 32 take a third longer on scans
_RINGS_BEYOND = 2  # of faces beyond those near a patch: normals of the mesh are averaged over as many


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPatch:
    """A patch to be joined to the mesh."""

    index: int  # of its loop, or of the first of its loops, among the mesh's boundary loops
    rim: Int[np.ndarray, " m"]  # mesh vertices of the patch's boundary vertices
    patch: Patch
    attributes: Mapping[str, Float[np.ndarray, "n _"]]  # at the inner vertices


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """Pairs of intersecting faces, of which the first, or both, belong to one patch.

    Face indices are those of the filled mesh. `notes` has one sentence for each kind that occurs. `is_complete` is
    False if there was no time to search for them.
    """

    own: Int[np.ndarray, "i 2"]  # both faces are the patch's
    mesh: Int[np.ndarray, "j 2"]
    patches: Int[np.ndarray, "k 2"]  # with patches that were joined before
    notes: tuple[str, ...]
    is_complete: bool = True

    def __len__(self) -> int:
        """Number of all pairs."""
        return len(self.own) + len(self.mesh) + len(self.patches)


NO_CROSSINGS = Crossings(own=NO_PAIRS, mesh=NO_PAIRS, patches=NO_PAIRS, notes=())
NOT_SEARCHED = replace(
    NO_CROSSINGS,
    notes=("whether the patch intersects anything is not known: the time limit ended the search",),
    is_complete=False,
)


def patch_chords(patch: Patch) -> Int[np.ndarray, "c 2"]:
    """Inner edges of a patch between two boundary vertices, as sorted pairs of patch vertices."""
    starts, ends = np.ravel(patch.faces), np.asarray(patch.faces)[:, [1, 2, 0]].ravel()
    between = np.flatnonzero((starts < ends) & (ends < patch.boundary_size))
    sides = np.stack([starts[between], ends[between]], axis=1)
    sides = sides[(rim_successors(patch.rims)[sides] != sides[:, ::-1]).all(axis=1)]
    return np.asarray(sides[np.lexsort(sides.T[::-1])])


def split_chords(patch: Patch, chords: Int[np.ndarray, "c 2"], surface: ArraySurface | None = None) -> Patch:
    """Splits chords, and the two triangles at each of them. The new vertices come last.

    A new vertex is the chord's midpoint, or the point of `surface` at the midpoint in Ω.
    """
    faces, points = np.asarray(patch.faces), patch.points[chords].mean(axis=1)
    middles = patch.vertices[chords].mean(axis=1) if surface is None else np.asarray(surface.position(points))
    for middle, chord in enumerate(chords, start=len(patch.vertices)):
        beside = np.isin(faces, chord).sum(axis=1) == 2
        # replacing either end by the midpoint gives the two halves of a triangle, with the same orientation
        halves = [np.where(faces[beside] == end, middle, faces[beside]) for end in chord]
        faces = np.concatenate([faces[~beside], *halves])
    vertices, points = np.concatenate([patch.vertices, middles]), np.concatenate([patch.points, points])
    return replace(patch, vertices=vertices, faces=faces, points=points)


def numbered(loops: Iterable[BoundaryLoop]) -> list[BoundaryLoop]:
    """Loops with consecutive vertex numbers, from 0 on."""
    found, count = [], 0
    for loop in loops:
        found.append(replace(loop, vertex_ids=count + np.arange(len(loop))))
        count += len(loop)
    return found


class PatchedMesh:
    """A mesh and the patches joined to it so far, with faces numbered as in the filled mesh.

    If a chord of a patch were an edge of the mesh or of another patch, this edge would be non-manifold.

    Attributes:
        mesh: the mesh without patches.
        face_count: number of faces, with those of the patches.
        reach: low and high corner of the box in which patches were searched for since `clear`: none outside it had an
            effect.
    """

    def __init__(self, mesh: TriangleMesh, loops: Iterable[BoundaryLoop] = ()) -> None:
        """Starts without patches. `loops` are the boundary loops that may be filled."""
        self.mesh = mesh
        self._loops_at = np.zeros(len(mesh.vertices), dtype=np.int64)
        self._loops_of_three = []
        for loop in loops:
            self._loops_at[loop.vertex_ids] += 1
            if len(loop) == 3:
                self._loops_of_three.append(loop.vertex_ids)
        on_loop = (self._loops_at > 0)[mesh.faces]
        self._at_loops = np.flatnonzero(on_loop[:, 0] | on_loop[:, 1] | on_loop[:, 2])
        sides = [mesh.faces[on_loop[:, side].all(axis=1)][:, side] for side in ([0, 1], [1, 2], [2, 0])]
        self._mesh_edges = frozenset(distinct(np.concatenate([self._keys(ends) for ends in sides])).tolist())
        self.clear()

    def as_stored(self, patch: Patch, rim: Int[np.ndarray, " m"]) -> Patch:
        """A patch with the positions that its inner vertices get where the filled mesh is stored.

        Raises a SurfaceError if one is too large.
        """
        inner = patch.vertices[patch.boundary_size :]
        stored = self.mesh.stored(inner, rim)
        if np.array_equal(stored, inner):
            return patch
        if not np.isfinite(stored).all():
            raise SurfaceError("positions of the patch are too large for the numbers of the mesh; give it in float64")
        return replace(patch, vertices=np.concatenate([patch.vertices[: patch.boundary_size], stored]))

    def clear(self) -> None:
        """Removes all patches."""
        self.face_count = len(self.mesh.faces)
        self.reach = np.array([[np.inf] * 3, [-np.inf] * 3])
        self._patch_edges: set[int] = set()
        self._patches: list[_Piece] = []
        # bounding boxes of the patches, low and high corner in one row. The array has spare rows
        self._boxes = np.empty((1, 6))

    def _patches_in(self, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> list[_Piece]:
        """The patches whose boxes overlap a box."""
        self.reach = np.stack([np.minimum(self.reach[0], low), np.maximum(self.reach[1], high)])
        boxes = self._boxes[: len(self._patches)].T
        return [self._patches[k] for k in overlapping(boxes[:3], boxes[3:], low, high)]

    def _keys(self, edges: Int[np.ndarray, "e 2"]) -> Int[np.ndarray, " e"]:
        return np.asarray(edges.min(axis=1) * len(self.mesh.vertices) + edges.max(axis=1))

    def has_edges(self, edges: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """Whether pairs of vertices of loops are edges of the mesh or of a patch."""
        return np.array(
            [key in self._mesh_edges or key in self._patch_edges for key in self._keys(edges).tolist()], dtype=bool
        )

    def face_on(self, loop: BoundaryLoop) -> int | None:
        """The mesh face of which a loop is the outline, or None."""
        return self._faces_on_loops.get(tuple(sorted(loop.vertex_ids.tolist()))) if len(loop) == 3 else None

    @cached_property
    def _faces_on_loops(self) -> dict[tuple[int, ...], int]:
        """The lowest of the mesh faces with the same corners, all on loops of three points, by its sorted corners."""
        is_corner = np.zeros(len(self.mesh.vertices), dtype=bool)
        for corners in self._loops_of_three:
            is_corner[corners] = True
        faces = self._at_loops[is_corner[self.mesh.faces[self._at_loops]].all(axis=1)]
        corners = np.sort(self.mesh.faces[faces], axis=1)
        first = distinct(coincident_vertices(corners.astype(np.float64)))  # rows, as if they were positions
        return dict(zip(map(tuple, corners[first].tolist()), faces[first].tolist(), strict=True))

    def taken_chords(self, patch: Patch, rim: Int[np.ndarray, " m"]) -> Int[np.ndarray, "c 2"]:
        """The chords of a patch that are edges of the mesh or of another patch already."""
        chords = patch_chords(patch)
        return np.asarray(chords[self.has_edges(rim[chords])])

    @cached_property
    def _faces_of_vertices(self) -> csr_array:
        corners = self.mesh.faces.ravel()
        entries = (np.ones(len(corners), dtype=bool), (corners, np.arange(len(corners)) // 3))
        return csr_array(entries, shape=(len(self.mesh.vertices), len(self.mesh.faces)))

    def faces_at(self, vertices: Int[np.ndarray, " k"]) -> Int[np.ndarray, " f"]:
        """The mesh faces with at least one of the vertices, ascending."""
        is_at = np.zeros(len(self.mesh.faces), dtype=bool)
        faces, starts = self._faces_of_vertices.indices, self._faces_of_vertices.indptr
        counts = starts[vertices + 1] - starts[vertices]
        is_at[faces[np.arange(counts.sum()) + np.repeat(starts[vertices] - np.cumsum(counts) + counts, counts)]] = True
        return np.flatnonzero(is_at)

    @cached_property
    def _angles(self) -> Float[np.ndarray, " n"]:
        """Sums of the angles at the vertices of loops."""
        return vertex_angles(self.mesh.vertices, self.mesh.faces[self._at_loops])

    def turning(self, loop: BoundaryLoop) -> float:
        """Total geodesic curvature of a loop, in radians: 2π for the border of a flat sheet, −2π for a hole in it.

        Vertices on several loops are left out, because only the sum of their angles is known.
        """
        alone = loop.vertex_ids[self._loops_at[loop.vertex_ids] == 1]
        return float(np.sum(np.pi - self._angles[alone]))

    def is_pinched(self, loop: BoundaryLoop) -> bool:
        """Whether a loop shares a vertex with another one."""
        return bool((self._loops_at[loop.vertex_ids] > 1).any())

    @cached_property
    def _mesh_piece(self) -> _Piece:
        return _Piece(self.mesh.vertices, self.mesh.faces, np.arange(len(self.mesh.faces)))

    def faces_in_box(self, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> Int[np.ndarray, " _"]:
        """The mesh faces whose bounding boxes overlap a box."""
        return self._mesh_piece.in_boxes(np.stack([low, high])[None])

    def crossings(
        self, patch: Patch, before: Crossings = NO_CROSSINGS, numbers: Int[np.ndarray, " k"] | None = None
    ) -> Crossings:
        """Intersections of a patch with itself, the mesh and the patches joined before.

        `before` are those of an earlier patch. `numbers` has for each of its faces the number in the patch, or −1 for
        faces that were removed. Pairs of faces that `before` has tested are not tested again.
        """
        numbers = np.zeros(0, dtype=np.int64) if numbers is None else numbers
        faces = np.asarray(patch.faces)
        is_new = np.ones(len(faces), dtype=bool)
        is_new[numbers[numbers >= 0]] = False
        new = _Piece(patch.vertices, faces[is_new], self.face_count + np.flatnonzero(is_new))
        near = [self._mesh_piece, *self._patches_in(new.low, new.high)]
        own = NO_PAIRS
        if len(numbers):
            near += [_Piece(patch.vertices, faces, self.face_count + np.arange(len(faces)))]
        elif patch.hole_sizes or not is_graph(patch.vertices, faces, patch.boundary_size):
            own = self.face_count + self_intersections(patch.vertices, faces)
        pairs = new.crossings(near)
        if len(numbers):
            among = np.sort(pairs[pairs[:, 1] >= self.face_count], axis=1)
            # like `self_intersections`, without pairs of faces with the same vertices
            one, other = np.sort(faces[among - self.face_count], axis=2).swapaxes(0, 1)
            own = np.concatenate([self._carried(before.own, numbers, 2), among[(one != other).any(axis=1)]])
        is_mesh = pairs[:, 1] < len(self.mesh.faces)
        mesh = np.concatenate([self._carried(before.mesh, numbers, 1), pairs[is_mesh]])
        is_patch = ~is_mesh & (pairs[:, 1] < self.face_count)
        others = np.concatenate([self._carried(before.patches, numbers, 1), pairs[is_patch]])
        own, mesh, others = map(sorted_pairs, (own, mesh, others))
        found = (("itself", own), ("the mesh", mesh), ("patches of other loops", others))
        notes = tuple(self._note(what, pairs, patch) for what, pairs in found if len(pairs))
        return Crossings(own=own, mesh=mesh, patches=others, notes=notes)

    def _carried(
        self, pairs: Int[np.ndarray, "p 2"], numbers: Int[np.ndarray, " k"], columns: int
    ) -> Int[np.ndarray, "q 2"]:
        """The pairs whose first columns are faces that were not removed, with their new numbers."""
        if not len(numbers):
            return NO_PAIRS
        own = numbers[pairs[:, :columns] - self.face_count]
        is_kept = (own >= 0).all(axis=1)
        return np.concatenate([np.sort(self.face_count + own[is_kept], axis=1), pairs[is_kept, columns:]], axis=1)

    def _note(self, what: str, pairs: Int[np.ndarray, "k 2"], patch: Patch) -> str:
        first = tuple(pairs[0].tolist())
        where = patch.vertices[np.asarray(patch.faces)[first[0] - self.face_count]].mean(axis=0)
        return (
            f"the patch crosses {what} in {len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'} of faces, first "
            f"{first} of the filled mesh, near ({', '.join(f'{x:.6g}' for x in where)})"
        )

    def corners(self, numbers: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 3 3"]:
        """The corners of faces of the mesh and of patches, by their numbers in the filled mesh."""
        pieces = [piece for piece in (self._mesh_piece, *self._patches) if len(piece.numbers)]
        place = np.searchsorted([piece.numbers[0] for piece in pieces], numbers, side="right") - 1
        found = np.empty((len(numbers), 3, 3))
        for k in np.unique(place):
            piece, here = pieces[k], place == k
            found[here] = piece.vertices[piece.faces[numbers[here] - piece.numbers[0]]]
        return found

    def near(
        self,
        box: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
        loops: Sequence[BoundaryLoop],
        frame: LoopFrame,
    ) -> PatchedMesh:
        """The mesh and the patches in a box around loops, in a frame of the loops.

        The loops' points come first, in the direction of the frame. The other vertices and the faces of the mesh are
        numbered by their local coordinates.
        """
        count, given = len(self.mesh.vertices), np.concatenate([loop.vertex_ids for loop in loops])
        faces = distinct(np.concatenate([self.faces_in_box(*box), self.faces_at(given)]))
        for _ in range(_RINGS_BEYOND):
            faces = self.faces_at(np.flatnonzero(referenced_vertices(self.mesh.faces[faces], vertices=count)))
        rim = given[frame.order(*map(len, loops))]
        is_other = referenced_vertices(self.mesh.faces[faces], vertices=count)
        is_other[rim] = False
        others = np.flatnonzero(is_other)
        x, y, z = frame.local(self.mesh.vertices[others]).T
        # about as quick as by one coordinate, and without equal values on regular meshes
        others = others[np.argsort(x + _SLANTS[0] * y + _SLANTS[1] * z, kind="stable")]
        ids = np.concatenate([rim, others])
        places = np.empty(count, dtype=np.int64)
        places[ids] = np.arange(len(ids))
        corners = places[self.mesh.faces[faces]]
        if frame.is_backward:
            corners = corners[:, ::-1]
        first = corners.argmin(axis=1)[:, None]
        corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
        in_order = np.argsort(corners @ [len(ids) ** 2, len(ids), 1])

        def stored(points: Float[np.ndarray, "n 3"], _: Int[np.ndarray, " m"]) -> Float[np.ndarray, "n 3"]:
            outside = frame.outside(points)
            stored = self.mesh.stored(outside, given)
            return points if np.array_equal(stored, outside) else frame.local(stored)

        mesh = TriangleMesh(frame.local(self.mesh.vertices[ids]), corners[in_order], stored=stored)
        near = PatchedMesh(mesh, numbered(loops))
        shared = np.flatnonzero(self._loops_at[rim] > 1)
        pairs = np.stack(np.triu_indices(len(shared), 1), axis=1)
        near._patch_edges.update(near._keys(shared[pairs][self.has_edges(rim[shared[pairs]])]).tolist())
        for piece in self._patches_in(*box):
            near._add(frame.local(piece.vertices), piece.faces)
        return near

    def join(self, patch: Patch, rim: Int[np.ndarray, " m"]) -> int:
        """Adds a patch with the boundary vertices `rim` of the mesh. Returns the number of its first face."""
        self._patch_edges.update(self._keys(rim[patch_chords(patch)]).tolist())
        return self._add(patch.vertices, np.asarray(patch.faces))

    def _add(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> int:
        """Adds the faces of a patch. Returns the number of the first."""
        first = self.face_count
        new = _Piece(vertices, faces, first + np.arange(len(faces)))
        if len(self._patches) == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.empty_like(self._boxes)])
        self._boxes[len(self._patches)] = np.concatenate([new.low, new.high])
        self._patches.append(new)
        self.face_count += len(faces)
        return first


class _Piece:
    """Faces, with their numbers in the filled mesh and their bounding box."""

    def __init__(
        self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], numbers: Int[np.ndarray, " f"]
    ) -> None:
        self.vertices, self.faces, self.numbers = vertices, faces, numbers
        self._points = np.ascontiguousarray(vertices, dtype=np.float64)
        self._corners = checked("faces", faces, np.int64, None, 3, least=0, most=len(vertices) - 1)
        # the faces by cells of a grid, the place of each cell's first face, and the boxes of the cells' faces
        cells = min(len(faces), _CELLS**3)
        order, starts, boxes = np.empty(len(faces), np.int64), np.empty(cells + 1, np.int64), np.empty((cells, 2, 3))
        count = np.zeros(1, dtype=np.int64)
        call("sort_by_cells", self._points, len(faces), self._corners, _CELLS, order, starts, boxes, count)
        self._order, self._starts, self._boxes = order, starts[: count[0] + 1].copy(), boxes[: count[0]].copy()
        self.low, self.high = (
            self._boxes[:, 0].min(axis=0, initial=np.inf),
            self._boxes[:, 1].max(axis=0, initial=-np.inf),
        )

    def in_boxes(self, boxes: Float[np.ndarray, "k 2 3"]) -> Int[np.ndarray, " _"]:
        """The faces whose boxes overlap one of some boxes, given by their lowest and highest corners."""
        found, count = np.empty(len(self.faces), dtype=np.int64), np.zeros(1, dtype=np.int64)
        sorted_faces = self._order, len(self._boxes), self._starts, self._boxes
        wanted = len(boxes), np.ascontiguousarray(boxes, dtype=np.float64)
        call("faces_in_boxes", self._points, len(found), self._corners, *sorted_faces, *wanted, found, count)
        return found[: count[0]]

    def crossings(self, others: Sequence[_Piece]) -> Int[np.ndarray, "k 2"]:
        """Intersecting pairs of a face of this piece and a face of others, or of itself, each pair once."""
        whole, own = np.stack([self.low, self.high])[None], self._points[self._corners]
        # a search tree of more boxes than there are faces to find takes longer than it saves
        near = [
            one.in_boxes(np.stack([own.min(axis=1), own.max(axis=1)], axis=1) if len(own) < len(one.faces) else whole)
            for one in others
        ]
        corners = np.concatenate([one.vertices[one.faces[at]] for one, at in zip(others, near, strict=True)])
        numbers = np.concatenate([one.numbers[at] for one, at in zip(others, near, strict=True)])
        soup = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
        is_own = np.isin(numbers, self.numbers)
        pairs = intersections_between(
            self.vertices,
            self.faces,
            *soup,
            wanted=lambda one, other: ~is_own[other] | (self.numbers[one] < numbers[other]),
        )
        return np.stack([self.numbers[pairs[:, 0]], numbers[pairs[:, 1]]], axis=1)


def overlapping(
    lows: Float[np.ndarray, "3 k"],
    highs: Float[np.ndarray, "3 k"],
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
) -> Int[np.ndarray, " _"]:
    """Indices of the boxes that overlap one box."""
    found = np.flatnonzero((lows[0] <= high[0]) & (highs[0] >= low[0]))
    for axis in (1, 2):
        found = found[(lows[axis, found] <= high[axis]) & (highs[axis, found] >= low[axis])]
    return found


def stitch(mesh: TriangleMesh, patches: Sequence[LoopPatch]) -> MeshExtension:
    """The new vertices and faces of patches, in order. Boundary vertices are shared with the mesh."""
    vertices, faces, face_loops = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    count = len(mesh.vertices)
    for part in patches:
        inner = part.patch.vertices[part.patch.boundary_size :]
        indices = np.concatenate([part.rim, np.arange(count, count + len(inner))])
        vertices.append(inner)
        faces.append(indices[part.patch.faces])
        face_loops.append(np.full(len(part.patch.faces), part.index, dtype=np.int64))
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
