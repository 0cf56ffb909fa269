"""Continues a crease of the mesh through a hole: the patch is made of two pieces that meet along it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.errors import OutOfTimeError, SpinorGeomError
from spinor_geom.fill.collar import Collar, collar_of
from spinor_geom.fill.continuation import continue_patch
from spinor_geom.fill.discrete_patch import graded_patch
from spinor_geom.fill.fairing import SMALLEST_ANGLE, Faired
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import crossing_angles
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.remeshing import points_at

# Two creases belong together if their directions turn by at most the first angle towards the chord between their ends,
# and the turns and the angles between the faces differ by at most the second one.
_MOST_TURN, _ALIKE = np.radians(45), np.radians(20)


def continue_across_crease(
    patched: PatchedMesh, rim: Int[np.ndarray, " m"], patch: Patch, collar: Collar, lengths: EdgeLengths
) -> Faired | None:
    """The continuation by two pieces on both sides of a crease, or None if no single crease goes on.

    The pieces bend freely along the crease, and are continued on their own. `rim` are the mesh vertices of the patch's
    boundary.

    Raises:
        OutOfTimeError: a time limit has passed.
    """
    crease = _crease(patch, collar)
    if crease is None:
        return None
    mesh, m, k = patched.mesh, patch.boundary_size, len(crease)
    first, last = np.sort(collar.crease_ends)
    points, ids = np.concatenate([patch.vertices[:m], crease]), np.append(rim, len(mesh.vertices) + np.arange(k))
    pieces = (
        np.concatenate([np.arange(first, last + 1), m + np.arange(k)[::-1]]),
        np.concatenate([np.arange(last, m), np.arange(first + 1), m + np.arange(k)]),
    )
    loops = [
        BoundaryLoop(points=points[at], vertex_ids=ids[at], corners=np.zeros(len(at), dtype=bool)) for at in pieces
    ]
    corners, sides = np.concatenate([mesh.vertices, crease]), _sides(mesh, float(collar.crease_angles.min() - _ALIKE))
    vertices, faces, steps, left, is_coarse = [points], [], 0, 0.0, False
    for piece, loop in zip(pieces, loops, strict=True):
        own = piece[(piece < m) & (piece != first) & (piece != last)]
        if not len(own):
            return None
        # the mesh on the piece's side of the creases
        near = sides[patched.faces_at(rim[own])]
        beside = PatchedMesh(TriangleMesh(corners, mesh.faces[np.isin(sides, near)]), loops)
        try:
            flat = NewPatch(patch=graded_patch(loop, float(loop.mean_edge_length)), rims=[loop], reason="")
            start = flat.split(beside).patch
            if len(start.vertices) == len(piece):
                return None
            faired = continue_patch(start, collar_of(beside, loop.vertex_ids, start), lengths)
        except OutOfTimeError:
            raise
        except SpinorGeomError:
            return None
        if faired.defect or faired.lowered or faired.patch.angles.largest_bend > 90:
            return None
        count, inner = sum(map(len, vertices)), faired.patch.vertices[len(piece) :]
        faces.append(np.concatenate([piece, count + np.arange(len(inner))])[faired.patch.faces])
        vertices.append(inner)
        steps, left = steps + faired.steps, max(left, faired.next_step)
        is_coarse |= faired.is_coarse
    positions = np.concatenate(vertices)
    inside = points_at(patch, np.asarray(patch.faces), positions[m:])
    joined = replace(
        patch, vertices=positions, faces=np.concatenate(faces), points=np.concatenate([patch.points[:m], inside])
    )
    # both pieces may have the same chord
    is_manifold = bool((HalfEdges.of(joined.faces).counts <= 2).all())
    if not is_manifold or joined.angles.smallest_free < SMALLEST_ANGLE or len(patched.crossings(joined)):
        return None
    return Faired(patch=joined, steps=steps, next_step=left, stretch=1.0, is_coarse=is_coarse)


def _sides(mesh: TriangleMesh, crease: float) -> Int[np.ndarray, " f"]:
    """The number of each face's region between edges at which the faces bend by more than `crease`, in radians."""
    half_edges, count = HalfEdges.of(mesh.faces), len(mesh.faces)
    smooth = np.flatnonzero((half_edges.twin >= 0) & (crossing_angles(half_edges, mesh.vertices) <= crease))
    pairs = smooth // 3, half_edges.twin[smooth] // 3
    return np.asarray(
        connected_components(csr_array((np.ones(len(smooth), dtype=bool), pairs), shape=(count, count)))[1]
    )


def _crease(patch: Patch, collar: Collar) -> Float[np.ndarray, "k 3"] | None:
    """Points between the ends of two creases that belong together, from the first to the last. None without them.

    The curve is the cubic with the directions of the creases, which is nearly an arc of a circle if they turn alike.
    """
    if len(collar.crease_ends) != 2 or len(np.unique(collar.crease_ends)) != 2 or patch.hole_sizes:
        return None
    order = np.argsort(collar.crease_ends)
    ends, (out, back) = patch.vertices[collar.crease_ends[order]], collar.crease_directions[order]
    one, other = collar.crease_angles
    length = float(np.linalg.norm(ends[1] - ends[0]))
    turns = np.arccos(np.clip(np.array([out, -back]) @ (ends[1] - ends[0]) / length, -1, 1))
    if turns.max() > _MOST_TURN or abs(turns[0] - turns[1]) > _ALIKE or abs(one - other) > _ALIKE:
        return None
    rim = patch.vertices[: patch.boundary_size]
    edge = float(np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1).mean())
    t = np.linspace(0, 1, max(round(length / edge), 2) + 1)[1:-1, None]
    pull = length / np.cos(turns.mean() / 2) ** 2  # of the cubic nearest to an arc
    return np.asarray(
        (1 + 2 * t) * (1 - t) ** 2 * ends[0]
        + t**2 * (3 - 2 * t) * ends[1]
        + pull * (t * (1 - t) ** 2 * out + t**2 * (1 - t) * back)
    )
