"""The closed polygons around regions of a patch, and their triangulations without inner vertices."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.discrete.first_fill import LONGEST
from spinor_geom.discrete.flattest_triangulation import FlattestTriangulation
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.operators import face_normals
from spinor_geom.mesh.topology import HalfEdges, disks

# An outline is left after this number of triangulations without fewer intersections. 43 patches over rims of scans and
# noisy bowls keep 4,138 pairs of faces with 3, and 4,114 with 5. With 6 they keep 4,107 and take a ninth longer.
# With 3, one of 60 noisy bowls that can be filled without intersections keeps some.
_PATIENCE = 5
# Intersections per face from which one such triangulation is enough: the patch lies along the mesh there. The patches
# keep 4,163 pairs with 1, and 4,114 with 3. Without a limit they keep 4,111 and take a seventh longer.
_MANY = 3


class Outline:
    """The closed polygon around some faces of a patch, and successive triangulations of it.

    Intersections of a triangle are charged to it in later triangulations. If the least charge of a triangulation is not
    below the number of intersections of the best faces, there is no better one.

    Attributes:
        faces: the faces of the patch inside the polygon.
        current: the faces that replace them, by vertices of the patch. At first they are the same.
        is_open: whether there may be triangulations with fewer intersections.
    """

    def __init__(
        self,
        faces: Int[np.ndarray, " k"],
        inside: Int[np.ndarray, "k 3"],
        polygon: Int[np.ndarray, " n"],
        triangulation: FlattestTriangulation,
    ) -> None:
        """`inside` are the vertices of the faces, `polygon` those around them in order, which `triangulation` spans."""
        self.faces, self.current, self.is_open = faces, inside, True
        self._inside, self._polygon, self._triangulation = inside, polygon, triangulation
        self._triangles: Int[np.ndarray, "t 3"] | None = None  # the current ones, by places in the polygon
        self._best, self._fewest, self._fewest_new, self._idle = inside, math.inf, math.inf, 0

    @property
    def is_new(self) -> bool:
        """Whether the current faces were not judged before."""
        return self._triangles is not None

    def is_replaced(self, is_replaced: Bool[np.ndarray, " f"]) -> Bool[np.ndarray, " g"]:
        """Which of the current faces are not those of the surface, from the same for all faces of the patch."""
        return is_replaced[self.faces] if self.current is self._inside else np.ones(len(self.current), dtype=bool)

    def advance(self) -> None:
        """Takes the next triangulation, or the best faces so far if no other is wanted or possible."""
        if self.is_open:
            self._triangles = self._triangulation.triangles()
            self.is_open = self.is_new and self._triangulation.least < self._fewest
        if not self.is_open:
            self._triangles = None
        self.current = self._best if self._triangles is None else self._polygon[self._triangles]

    def judge(self, count: int, charges: Int[np.ndarray, " t"]) -> None:
        """Takes the number of intersections of the current faces, and of each of them."""
        if count < self._fewest:
            self._fewest, self._best = count, self.current
        if self._triangles is None:
            return
        self._idle = 0 if count < self._fewest_new else self._idle + 1
        self._fewest_new = min(count, self._fewest_new)
        patience = _PATIENCE if self._fewest_new < _MANY * len(charges) else 1
        self.is_open = count > 0 and self._idle < patience
        self._triangulation.charge(self._triangles, charges)


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
        triangulation = FlattestTriangulation(patch.vertices[polygon], normals, taken)
        outlines.append(Outline(piece, faces[piece], polygon, triangulation))
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
