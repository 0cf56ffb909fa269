"""The closed polygons around regions of a patch, and their triangulations without inner vertices."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.discrete.first_fill import LONGEST
from spinor_geom.discrete.flattest_triangulation import FlattestTriangulation
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.operators import face_normals
from spinor_geom.mesh.topology import HalfEdges, disks


class Outline:
    """The closed polygon around some faces of a patch, and its flattest triangulation without those forbidden so far.

    Attributes:
        faces: the faces of the patch to be replaced.
        ids: the vertices of the patch on the polygon, in order.
    """

    def __init__(
        self,
        faces: Int[np.ndarray, " k"],
        ids: Int[np.ndarray, " n"],
        points: Float[np.ndarray, "n 3"],
        around: Float[np.ndarray, "n 3"],
        taken: Bool[np.ndarray, "n n"],
    ) -> None:
        """The other arguments are those of `FlattestTriangulation`."""
        self.faces, self.ids = faces, ids
        self._flattest = FlattestTriangulation(points, around, taken)
        self._found: Int[np.ndarray, "t 3"] | None = None
        self._is_current = False  # whether nothing was forbidden since `_found`

    def triangles(self) -> Int[np.ndarray, "t 3"] | None:
        """The flattest allowed triangulation, as indices of the polygon's points; None if there is none."""
        if not self._is_current:
            self._found = self._flattest.triangles()
            self._is_current = True
        return self._found

    def forbid(self, triangles: Int[np.ndarray, "k 3"]) -> None:
        """Excludes triangles from later triangulations."""
        self._flattest.forbid(triangles)
        self._is_current = self._is_current and not len(triangles)


def outlines_of(patched: PatchedMesh, new: NewPatch, region: Int[np.ndarray, " r"]) -> list[Outline]:
    """The outlines of the components of some faces of a patch.

    Single faces, components that are not disks, and those with more than 160 points around them are left out.
    """
    patch, rim, mesh = new.patch, new.rim, patched.mesh
    faces = np.asarray(patch.faces)
    # mesh faces at the rim, with the patch's numbers for rim vertices and later numbers for the others
    beside = mesh.faces[patched.faces_at(rim)]
    others = np.setdiff1d(beside, rim)
    ids = np.concatenate([rim, others])
    numbers = np.concatenate([np.arange(len(rim)), len(patch.vertices) + np.arange(len(others))])
    order = np.argsort(ids, kind="stable")
    joined_faces = np.concatenate([faces, numbers[order[np.searchsorted(ids[order], beside)]]])
    vertices, joined = np.concatenate([patch.vertices, mesh.vertices[others]]), HalfEdges.of(joined_faces)

    own = HalfEdges.of(faces[region])
    component, sides = own.components, own.boundary
    at, is_one = component[sides // 3], disks(own)
    outlines = []
    for k in np.flatnonzero(is_one & (np.bincount(component) > 1) & (np.bincount(at) <= LONGEST)):
        piece, around = region[component == k], _in_order(own, sides[at == k])
        around = 3 * region[around // 3] + around % 3
        polygon, twin = joined.origin[around], joined.twin[around]
        normals = face_normals(vertices, joined_faces[twin // 3])
        normals[joined.origin[twin] == polygon] *= -1
        normals[twin < 0] = np.nan
        taken = _edges_outside(patched, rim, polygon, np.delete(joined_faces, piece, axis=0))
        outlines.append(Outline(piece, polygon, patch.vertices[polygon], normals, taken))
    return outlines


def _edges_outside(
    patched: PatchedMesh, rim: Int[np.ndarray, " m"], polygon: Int[np.ndarray, " n"], outside: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, "n n"]:
    """Whether pairs of a polygon's points are edges of the mesh or of faces outside the polygon."""
    n = len(polygon)
    taken = np.zeros((n, n), dtype=bool)
    on_rim = np.flatnonzero(polygon < len(rim))
    pairs = np.stack(np.meshgrid(on_rim, on_rim, indexing="ij"), axis=2).reshape(-1, 2)
    taken[pairs[:, 0], pairs[:, 1]] = patched.has_edges(rim[polygon[pairs]])
    place = np.full(max(outside.max(initial=0), polygon.max()) + 1, -1)
    place[polygon] = np.arange(n)
    ends = place[np.concatenate([outside, np.roll(outside, -1, axis=1)], axis=0).reshape(2, -1).T]
    ends = ends[(ends >= 0).all(axis=1)]
    taken[ends[:, 0], ends[:, 1]] = taken[ends[:, 1], ends[:, 0]] = True
    return taken


def _in_order(half_edges: HalfEdges, sides: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The half-edges of a disk's boundary, in order."""
    following = dict(zip(half_edges.origin[sides].tolist(), sides.tolist(), strict=True))
    order = [int(sides[0])]
    while len(order) < len(sides):
        order.append(following[int(half_edges.target[order[-1]])])
    return np.array(order)
