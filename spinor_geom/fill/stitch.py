"""Joins patches to a mesh: shared rim vertices, new inner ones, no edge or face that the mesh has already."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.sheets import away_from_edges
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

_FOLDED_BACK = np.cos(np.radians(45))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPatch:
    """A patch ready to be joined to the mesh."""

    place: int  # of its loop, or of the first, among the mesh's loops
    rim: Int[np.ndarray, " m"]  # mesh vertices of the patch's first `boundary_size` vertices
    patch: Patch
    attributes: Mapping[str, Float[np.ndarray, "n _"]]  # at the inner vertices


def patch_chords(patch: Patch) -> Int[np.ndarray, "c 2"]:
    """The patch's inner edges that join two rim vertices, as pairs of patch vertices (lower first), each once."""
    starts, ends = np.ravel(patch.faces), np.roll(patch.faces, -1, axis=1).ravel()
    sides = np.stack([starts, ends], axis=1)[(starts < ends) & (ends < patch.boundary_size)]
    sides = sides[(rim_successors(patch.rims)[sides] != sides[:, ::-1]).all(axis=1)]
    return np.asarray(sides[np.lexsort(sides.T[::-1])])


class RimEdges:
    """The edges between loop vertices that are taken: the mesh's own, and those of the patches joined so far.

    A patch may have an edge between two rim vertices (a chord) only if it is free: a second sheet on a taken edge would
    make it non-manifold.
    """

    def __init__(self, mesh: TriangleMesh, loops: Iterable[BoundaryLoop]) -> None:
        """Collects the mesh's edges and faces whose vertices all lie on loops."""
        self._size = len(mesh.vertices)
        on_loop = np.zeros(self._size, dtype=bool)
        for loop in loops:
            on_loop[loop.vertex_ids] = True
        on_loop = on_loop[mesh.faces]
        # backwards: of several faces on an edge the first counts
        sides = np.flatnonzero(on_loop & on_loop[:, [1, 2, 0]])[::-1]
        start, end, opposite = mesh.faces[sides // 3, [sides % 3, (sides + 1) % 3, (sides + 2) % 3]]
        self._opposite = dict(zip(self._keys(np.stack([start, end], axis=1)), opposite.tolist(), strict=True))
        self._taken = set(self._opposite)
        within = np.flatnonzero(on_loop.all(axis=1))
        corners = np.sort(mesh.faces[within], axis=1)
        self._faces = dict(zip(map(tuple, corners[::-1].tolist()), within[::-1].tolist(), strict=True))

    def _keys(self, edges: Int[np.ndarray, "e 2"]) -> list[int]:
        low, high = np.sort(edges, axis=1).T
        keys: list[int] = (low * self._size + high).tolist()
        return keys

    def are_taken(self, edges: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
        """For each pair of mesh vertices whether an edge joins them already."""
        return np.array([key in self._taken for key in self._keys(edges)], dtype=bool)

    def take(self, edges: Int[np.ndarray, "e 2"]) -> None:
        """Adds edges of a patch, as pairs of mesh vertices."""
        self._taken.update(self._keys(edges))

    def face_on(self, loop: BoundaryLoop) -> int | None:
        """The mesh's face on just the vertices of a loop of three: then the loop is that face's own outline."""
        return self._faces.get(tuple(sorted(loop.vertex_ids.tolist())))

    def share_folded_back(self, mesh: TriangleMesh, rim: Int[np.ndarray, " m"], patch: Patch) -> float:
        """The share of a rim (its mesh vertices) along which a patch and the face beside it are less than 45° apart."""
        sides = np.asarray(patch.faces)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        apexes = np.roll(patch.faces, -2, axis=1).reshape(-1)
        on_rim = np.flatnonzero((sides < patch.boundary_size).all(axis=1))
        on_rim = on_rim[rim_successors(patch.rims)[sides[on_rim, 0]] == sides[on_rim, 1]]
        sides = sides[on_rim]
        opposite = np.array([self._opposite.get(key, -1) for key in self._keys(rim[sides])])
        start, end = patch.vertices[sides.T]
        lengths = np.linalg.norm(end - start, axis=1)
        corners = (patch.vertices[apexes[on_rim]], mesh.vertices[opposite])
        away = [away_from_edges(start, end, corner) for corner in corners]
        folded = (opposite >= 0) & (np.einsum("ei,ei->e", *away) > _FOLDED_BACK)
        return float(lengths[folded].sum() / lengths.sum())


def split_chords(patch: Patch, chords: Int[np.ndarray, "c 2"], surface: SpinorSurface | None = None) -> Patch:
    """Puts a new vertex, after the others, in the middle of each chord, and divides its two triangles there.

    Where the patch is a mesh of a surface, that is on it, halfway in Ω.
    """
    faces, points = np.asarray(patch.faces), patch.points[chords].mean(axis=1)
    middles = patch.vertices[chords].mean(axis=1) if surface is None else np.asarray(surface.position(points))
    for count, chord in enumerate(chords):
        middle = len(patch.vertices) + count
        beside = np.isin(faces, chord).sum(axis=1) == 2
        # both ends of the chord turn into the middle, once each: a triangle splits in two of the same orientation
        halves = [np.where(faces[beside] == end, middle, faces[beside]) for end in chord]
        faces = np.concatenate([faces[~beside], *halves])
    return replace(
        patch,
        vertices=np.concatenate([patch.vertices, middles]),
        faces=faces,
        points=np.concatenate([patch.points, points]),
    )


def fit_to_rim(
    rim: Int[np.ndarray, " m"], patch: Patch, taken: RimEdges, surface: SpinorSurface | None = None
) -> tuple[Patch, int]:
    """A patch whose chords on taken edges are split, and how many were; `rim` are the mesh's vertices around it."""
    chords = patch_chords(patch)
    clash = taken.are_taken(rim[chords])
    if not clash.any():
        return patch, 0
    return split_chords(patch, chords[clash], surface), int(clash.sum())


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
