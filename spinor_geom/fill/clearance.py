"""Moves the vertices of a patch away from the adjacent mesh where the two intersect.

At a ragged rim of a steep wall the patch runs along the wall, and its flat triangles intersect those of the wall.
Intersecting triangles with an inner edge between two rim vertices are first split at this edge.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.delaunay import rim_successors, unique_edges
from spinor_geom.errors import OutOfTimeError
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh, patch_chords, split_chords
from spinor_geom.mesh.operators import face_normals, vertex_normals
from spinor_geom.meshing.embed import Patch

# Measured on 26 rims of noisy bowls and tubes. With these values, 32 pairs of faces at 5 rims still intersect. The
# comments have the numbers of rims or pairs for other values.
_CLEARANCE = 0.05  # height over the mesh's faces, in edges of the patch. 0.025: 6 rims, 0.1: thinner triangles
_FARTHEST = 1.0  # largest displacement of a vertex, in mean edges of the rim. 0.5: 6 rims
_RINGS = 2  # over which normals of the mesh and positions of the patch are averaged. 1: 56 pairs, 4 and 6: 32
_ROUNDS = 4  # 2: 9 rims and 50 pairs, 8: 5 rims and 26 pairs


def cleared(patched: PatchedMesh, new: NewPatch) -> NewPatch:
    """Splits edges and moves inner vertices in several rounds, and returns the result with the fewest intersections."""
    patch, crossings, best = new.patch, new.crossings, new
    if not len(crossings.mesh):
        return new
    edges = patch.vertices[rim_successors(patch.rims)] - patch.vertices[: patch.boundary_size]
    farthest = _FARTHEST * float(np.linalg.norm(edges, axis=1).mean())
    wall, split, start = _Wall(patched, new.rim, patch, crossings.mesh[:, 1]), new.edges_split, patch.vertices
    for _ in range(_ROUNDS):
        if is_out_of_time():
            break
        faces, count = np.asarray(patch.faces), len(patch.vertices)
        own, old = crossings.mesh[:, 0] - patched.face_count, crossings.mesh[:, 1]
        chords = patch_chords(patch)
        sides = np.sort(faces[own][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        chords = chords[np.isin(chords @ [count, 1], sides @ [count, 1])]
        unmoved = None
        if len(chords):
            patch = patched.as_stored(split_chords(patch, chords, new.surface), new.rim)
            split += len(chords)
            start = np.concatenate([start, patch.vertices[count:]])
        else:
            folded = np.unique(faces[crossings.own.ravel() - patched.face_count])
            moved = _moved(patch, wall.steps(patch, own, old), folded[folded >= patch.boundary_size])
            moved = patched.as_stored(moved, new.rim)
            a, b, c = (moved.vertices != patch.vertices).any(axis=1)[faces.T]
            patch, unmoved = moved, np.where(a | b | c, -1, np.arange(len(faces)))
        displacement = float(np.linalg.norm(patch.vertices - start, axis=1).max())
        if displacement > farthest:
            break
        try:
            crossings = patched.crossings(patch, crossings, unmoved)
        except OutOfTimeError:
            break
        if len(crossings) < len(best.crossings):
            best = replace(new, patch=patch, crossings=crossings, edges_split=split, displacement=displacement)
        if not len(crossings.mesh) and not len(crossings.own):
            break
    return best


class _Wall:
    """The mesh around the rim of a patch, and the side of it on which the patch lies."""

    def __init__(
        self, patched: PatchedMesh, rim: Int[np.ndarray, " m"], patch: Patch, intersected: Int[np.ndarray, " k"]
    ) -> None:
        """Averages normals of the mesh around the rim and some intersected faces."""
        self._mesh = mesh = patched.mesh
        ids = np.concatenate([rim, mesh.faces[intersected].ravel()])
        for _ in range(_RINGS):
            near = patched.faces_at(ids)
            ids = np.unique(mesh.faces[near])
        faces = np.searchsorted(ids, mesh.faces[near])
        around = _averaging(unique_edges(faces, len(ids)), len(ids))
        self._ids, self._normals = ids, _averaged(vertex_normals(mesh.vertices[ids], faces), around)
        # the sign, along the normals, of the displacement from the averaged rim to the averaged patch
        after = rim_successors(patch.rims)
        along = _averaging(np.stack([np.arange(len(after)), after], axis=1), len(after))
        inside = _averaging(unique_edges(np.asarray(patch.faces), len(patch.vertices)), len(patch.vertices))
        bulk, edge = _averaged(patch.vertices, inside)[: len(after)], _averaged(patch.vertices[: len(after)], along)
        side = np.einsum("md,md->m", self._normals[np.searchsorted(ids, rim)], bulk - edge)
        self._side = np.where(_averaged(side, along) > 0, 1.0, -1.0)
        self._rim = cKDTree(patch.vertices[: len(after)])

    def steps(self, patch: Patch, own: Int[np.ndarray, " k"], old: Int[np.ndarray, " k"]) -> Float[np.ndarray, "n 3"]:
        """Displacements that move the patch faces `own` to the patch's side of the mesh faces `old` that they meet."""
        corners = self._mesh.faces[old]
        near = np.minimum(np.searchsorted(self._ids, corners), len(self._ids) - 1)
        known = self._ids[near] == corners
        normals = face_normals(self._mesh.vertices, corners)
        towards = (self._normals[near] * known[..., None]).sum(axis=1)
        towards = np.where(known.any(axis=1)[:, None], towards, normals)
        towards /= np.maximum(np.linalg.norm(towards, axis=1), np.finfo(np.float64).tiny)[:, None]
        side = self._side[self._rim.query(self._mesh.vertices[corners].mean(axis=1))[1]][:, None]
        towards, normals = side * towards, side * normals
        vertices = np.asarray(patch.faces)[own]
        clearance = _CLEARANCE * _edge_lengths(patch)[vertices]
        height = np.einsum("kcd,kd->kc", patch.vertices[vertices] - self._mesh.vertices[corners[:, :1]], normals)
        # vertices that are high enough, but belong to an intersecting face, move by the clearance
        missing = np.where(height < clearance, clearance - height, clearance).ravel()
        # if a vertex has several steps, the longest is written last and kept
        order = np.argsort(missing, kind="stable")
        steps = np.zeros_like(patch.vertices)
        steps[vertices.ravel()[order]] = (missing[:, None] * np.repeat(towards, 3, axis=0))[order]
        steps[: patch.boundary_size] = 0
        return steps


def _moved(patch: Patch, steps: Float[np.ndarray, "n 3"], folded: Int[np.ndarray, " k"]) -> Patch:
    """Moves vertices, and their neighbours by the mean step. `folded` vertices move to the mean of their neighbours."""
    around = _averaging(unique_edges(np.asarray(patch.faces), len(steps)), len(steps))
    following = (np.arange(len(steps)) >= patch.boundary_size) & ~steps.any(axis=1)
    vertices = patch.vertices + np.where(following[:, None], around @ steps, steps)
    vertices[folded] = (around @ vertices)[folded]
    return replace(patch, vertices=vertices)


def _averaging(edges: Int[np.ndarray, "e 2"], count: int) -> csr_array:
    """The matrix of the mean over each vertex and its neighbours."""
    ends = np.concatenate([edges, edges[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)])
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(count, count)).tocsr()
    return csr_array(diags_array(1 / graph.sum(axis=1)) @ graph)


def _averaged(values: Float[np.ndarray, "n *k"], matrix: csr_array) -> Float[np.ndarray, "n *k"]:
    for _ in range(_RINGS):
        values = matrix @ values
    return values


def _edge_lengths(patch: Patch) -> Float[np.ndarray, " n"]:
    """Mean length of the edges at each vertex, in mesh units."""
    ends, count = unique_edges(np.asarray(patch.faces), len(patch.vertices)), len(patch.vertices)
    length = np.repeat(np.linalg.norm(patch.vertices[ends[:, 0]] - patch.vertices[ends[:, 1]], axis=1), 2)
    return np.bincount(ends.ravel(), length, count) / np.bincount(ends.ravel(), minlength=count)
