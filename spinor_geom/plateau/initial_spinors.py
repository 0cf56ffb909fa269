"""Initial spinors of a fit, from the frames of a discrete surface along its boundary."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from spinor_geom.arrays import EPS, Array, Place, cross, norm, replaced
from spinor_geom.domain.delaunay import Rims, edge_codes, rim_successors
from spinor_geom.surface.frames import phi_from_frames, spinors_from_phi


def lifted_spinors(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    points: Complex[np.ndarray, " n"],
    rims: Rims,
    place: Place,
    *,
    branch: complex | None = None,
) -> Complex[Array, "m 2"]:
    """Spinors p and q on each boundary edge of a discrete surface, with signs that are continuous on the surface.

    The vertices of the rims come first, in order. `points` are the images of all vertices in Ω. With a point c,
    `branch`, in a hole around which p and q change sign, p/√(z − c) and q/√(z − c) are returned.

    On a ragged boundary the sign of a spinor cannot be determined from its neighbours. Frames of adjacent faces differ
    less, so signs are propagated along a minimum spanning tree of the faces.
    """
    after = rim_successors(rims)
    boundary, along = points[: len(after)], _faces_along(faces, after)

    def single_valued(phi: Complex[np.ndarray, "k 3"], z: Complex[np.ndarray, " k"]) -> Complex[np.ndarray, "k 2"]:
        if branch is not None:
            phi = phi / (z - branch)[:, None]
        return np.stack(spinors_from_phi(phi), axis=-1)

    corner, image = vertices[faces], points[faces]
    tangent, step = corner[:, 1] - corner[:, 0], image[:, 1] - image[:, 0]
    normal = cross(tangent, corner[:, 2] - corner[:, 0])
    spinors = single_valued(lifted_frames(vertices, normal[along], boundary, after), (boundary + boundary[after]) / 2)
    inner = single_valued(phi_from_frames(tangent, normal, step, np.ones(len(faces))), image.mean(axis=1))
    # face adjacency, without libigl, which would start threads
    codes = edge_codes(faces, len(points))
    order = codes.argsort()
    shared = np.flatnonzero(np.diff(codes[order]) == 0)
    face, beside = order[shared] // 3, order[shared + 1] // 3
    difference = 1 - np.abs((inner[face].conj() * inner[beside]).sum(axis=1).real / 2)
    difference[~np.isfinite(difference)] = 1.0
    pairs = face.astype(np.int32), beside.astype(np.int32)  # scipy 1.15 takes no others for a spanning tree
    graph = csr_array((difference, pairs), shape=(len(faces), len(faces)))
    _, before = breadth_first_order(minimum_spanning_tree(graph), 0, directed=False)
    before[0] = 0
    sign = np.where((inner.conj() * inner[before]).sum(axis=1).real < 0, -1.0, 1.0)
    # pointer jumping: each round multiplies the signs over twice as many faces
    while (before != before[before]).any():
        sign, before = sign * sign[before], before[before]
    sign *= sign[before]
    first = (sign[:, None] * inner)[along]
    agrees = (first.conj() * spinors).sum(axis=-1, keepdims=True).real >= 0
    return place.put(np.where(agrees, spinors, -spinors))


def lifted_frames(
    vertices: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "m 3"],
    boundary: Complex[np.ndarray, " m"],
    after: Int[np.ndarray, " m"],
) -> Complex[np.ndarray, "m 3"]:
    """φ on each boundary edge of a discrete surface, from normals of the faces there.

    `after` is the next vertex of each boundary vertex, and `boundary` are their images in Ω.
    """
    tangent = vertices[after] - vertices[: len(after)]
    length = norm(tangent)
    # a degenerate face has no normal: use any direction perpendicular to the edge
    flat = np.flatnonzero(norm(normal) <= EPS * length**2)
    if len(flat):
        normal = replaced(normal, flat, cross(tangent[flat], np.eye(3)[np.abs(tangent[flat]).argmin(axis=1)]))
    edge = boundary[after] - boundary
    scale = length / np.abs(edge)
    return np.asarray(phi_from_frames(tangent, normal, edge, scale))


def _faces_along(faces: Int[np.ndarray, "f 3"], after: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """The face at each boundary edge, from a vertex to the next one."""
    # no vertex follows an inner one
    following = np.append(after, np.full(int(faces.max()) + 1 - len(after), -1))
    face, side = np.nonzero(following[faces] == faces[:, [1, 2, 0]])
    owner = np.empty(len(after), dtype=np.int64)
    owner[faces[face, side]] = face
    return owner
