"""Joins patches to a mesh: shared rim vertices, new inner ones, no edge or face that the mesh has already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.extension import MeshExtension
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPatch:
    """A patch ready to be joined to the mesh along its loop or loops.

    Attributes:
        place: the place of its loop, or of the first, among the mesh's loops.
        rim: mesh vertices of the patch's first `boundary_size` vertices.
        patch: the patch.
        attributes: (n − M, k) values at the inner vertices under the names of the mesh's attributes.
    """

    place: int
    rim: Int[np.ndarray, " m"]
    patch: Patch
    attributes: Mapping[str, Float[np.ndarray, "n _"]]


def patch_chords(patch: Patch) -> Int[np.ndarray, "c 2"]:
    """The patch's inner edges that join two rim vertices, as pairs of patch vertices (lower first), each once."""
    after = rim_successors(patch.rims)
    edges = np.asarray(patch.faces)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = np.unique(np.sort(edges[(edges < patch.boundary_size).all(axis=1)], axis=1), axis=0)
    chords: Int[np.ndarray, "c 2"] = edges[(after[edges] != edges[:, ::-1]).all(axis=1)]
    return chords


class RimEdges:
    """The edges between loop vertices that are taken: the mesh's own, and those of the patches joined so far.

    A patch may have an edge between two rim vertices (a chord) only if it is free; a second sheet on a taken edge would
    make it non-manifold. Loops of few vertices run into this often, since the mesh around them may well join opposite
    vertices of the hole.
    """

    def __init__(self, mesh: TriangleMesh, loops: Iterable[BoundaryLoop]) -> None:
        """Collects the mesh's edges and faces whose vertices all lie on loops."""
        self._size = len(mesh.vertices)
        on_loop = np.zeros(self._size, dtype=bool)
        for loop in loops:
            on_loop[loop.vertex_ids] = True
        edges = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        self._taken = np.unique(self._keys(edges[on_loop[edges].all(axis=1)]))
        self._face_ids = np.flatnonzero(on_loop[mesh.faces].all(axis=1))
        self._faces = np.sort(mesh.faces[self._face_ids], axis=1)

    def _keys(self, edges: Int[np.ndarray, "e 2"]) -> Int[np.ndarray, " e"]:
        ordered = np.sort(edges, axis=1)
        return np.asarray(ordered[:, 0] * self._size + ordered[:, 1])

    def are_taken(self, edges: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """For each pair of mesh vertices whether an edge joins them already."""
        return np.isin(self._keys(edges), self._taken)

    def take(self, edges: Int[np.ndarray, "e 2"]) -> None:
        """Adds edges of a patch, as pairs of mesh vertices."""
        self._taken = np.union1d(self._taken, self._keys(edges))

    def face_on(self, loop: BoundaryLoop) -> int | None:
        """The mesh's face on just the vertices of a loop of three: then the loop is that face's own outline."""
        if len(loop) != 3 or not len(self._faces):
            return None
        same = np.flatnonzero((self._faces == np.sort(loop.vertex_ids)).all(axis=1))
        return int(self._face_ids[same[0]]) if same.size else None


def split_chords(
    patch: Patch,
    chords: Int[np.ndarray, "c 2"],
    position: Callable[[Complex[np.ndarray, " c"]], Float[np.ndarray, "c 3"]],
) -> Patch:
    """Puts a new vertex in the middle (in Ω) of each chord and divides the chord's two triangles there.

    Args:
        patch: the patch.
        chords: (c, 2) pairs of its rim vertices, each joined by an inner edge.
        position: the surface's position at points of Ω.

    Returns:
        A patch with c more vertices, at its end, and 2c more faces, none of which has one of the chords as an edge.
    """
    points = patch.points[chords].mean(axis=1)
    faces = np.asarray(patch.faces)
    for count, chord in enumerate(chords):
        middle = len(patch.vertices) + count
        beside = np.isin(faces, chord).sum(axis=1) == 2
        # both ends of the chord turn into the middle, once each: a triangle splits in two of the same orientation
        halves = [np.where(faces[beside] == end, middle, faces[beside]) for end in chord]
        faces = np.concatenate([faces[~beside], *halves])
    return replace(
        patch,
        vertices=np.concatenate([patch.vertices, np.asarray(position(points), dtype=np.float64)]),
        faces=faces,
        points=np.concatenate([patch.points, points]),
    )


def fit_to_rim(
    rim: Int[np.ndarray, " m"],
    patch: Patch,
    taken: RimEdges,
    position: Callable[[Complex[np.ndarray, " c"]], Float[np.ndarray, "c 3"]],
) -> tuple[Patch, int]:
    """Makes a patch joinable: chords on taken edges are split; those that stay are taken from now on.

    Args:
        rim: mesh vertices of the patch's boundary vertices.
        patch: the patch.
        taken: the edges of the mesh and of the patches joined so far; updated.
        position: the surface's position at points of Ω.

    Returns:
        The patch, and how many chords were split.
    """
    chords = patch_chords(patch)
    in_mesh = rim[chords]
    clash = taken.are_taken(in_mesh)
    taken.take(in_mesh[~clash])
    if not clash.any():
        return patch, 0
    return split_chords(patch, chords[clash], position), int(clash.sum())


def stitch(mesh: TriangleMesh, patches: Sequence[LoopPatch]) -> MeshExtension:
    """The new vertices and faces that join patches to a mesh.

    Rim vertices are the mesh's own; inner vertices are appended patch by patch, and so are the faces.

    Args:
        mesh: the mesh with holes, V vertices.
        patches: in the order in which they are appended.

    Returns:
        The extension; its faces index [V old vertices | new vertices].
    """
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


def joined(mesh: TriangleMesh, extension: MeshExtension) -> TriangleMesh:
    """The mesh with its extension as one triangle mesh, without attributes."""
    return TriangleMesh(
        np.concatenate([mesh.vertices, extension.vertices]), np.concatenate([mesh.faces, extension.faces])
    )
