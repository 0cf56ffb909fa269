"""Remarks on a whole mesh: that it is closed or not orientable, or that merging vertices would close loops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.spatial import cKDTree

from spinor_geom.arrays import shifted
from spinor_geom.errors import advised_distance, merge_advice
from spinor_geom.mesh.array_checks import nonfinite_rows
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import Sheets, count_boundary_loops
from spinor_geom.mesh.topology import SHARE_OF_EDGE, HalfEdges, face_components, linked
from spinor_geom.mesh.triangle_mesh import TriangleMesh


class Merging(NamedTuple):
    """That vertices up to a distance apart can be merged, and how many boundary loops are left then."""

    distance: float  # in mesh units
    loops: int


def mesh_notes(
    mesh: TriangleMesh, loops: Sequence[BoundaryLoop], sheets: Sheets, merging: Merging | None
) -> tuple[str, ...]:
    """Sentences on a mesh with its boundary loops and the sheets of its faces. `merging` as by `useful_merging`."""
    return tuple(_notes(mesh, loops, sheets, merging)) if len(mesh.faces) else ()


def _notes(mesh: TriangleMesh, loops: Sequence[BoundaryLoop], sheets: Sheets, merging: Merging | None) -> Iterator[str]:
    half_edges = sheets.half_edges
    if len(wrong := nonfinite_rows(mesh.vertices)):
        which = f"{len(wrong)} vertices, first vertex {wrong[0]}, have" if len(wrong) > 1 else f"vertex {wrong[0]} has"
        yield f"{which} a NaN or infinite coordinate, but no face uses {'them' if len(wrong) > 1 else 'it'}"
    if not is_orientable(half_edges):
        yield "the mesh is not orientable, so the orientation of patches is arbitrary"
    elif len(sheets.face_ids) == len(mesh.faces) and (half_edges.counts == 2).all():
        pieces, genus = _pieces_and_genus(mesh.faces)
        name = f"genus {genus}" if pieces == 1 else f"{pieces} pieces of total genus {genus}"
        yield f"the mesh is closed, {name}: it has no {'boundary loops; a tunnel is not a hole' if genus else 'hole'}"
    if merging is not None:
        yield (
            f"merging vertices up to {merging.distance:.2g} apart would leave {merging.loops} of the {len(loops)} "
            f"loops: {merge_advice(merging.distance)}"
        )


def is_orientable(half_edges: HalfEdges) -> bool:
    """Whether faces can be reversed so that the two half-edges of each inner edge are opposite."""
    if _is_oriented(half_edges):
        return True
    # each face and its reverse: a mesh is not orientable if a face is connected with its own reverse
    count, (first, second) = len(half_edges.origin) // 3, half_edges.pairs.T
    turned = np.where(half_edges.origin[first] == half_edges.origin[second], count, 0)
    face, other = first // 3, second // 3
    ahead, back = np.stack([face, other + turned]), np.stack([face + count, other + count - turned])
    sides = linked(np.concatenate([ahead, back], axis=1).T, 2 * count).reshape(2, count)
    return bool((sides[0] != sides[1]).all())


def _is_oriented(half_edges: HalfEdges) -> bool:
    first, second = half_edges.origin[half_edges.pairs].T
    return bool((first != second).all())


def _pieces_and_genus(faces: Int[np.ndarray, "f 3"]) -> tuple[int, int]:
    """Number of connected pieces of a closed mesh, and their total genus from V − E + F = 2 (pieces − genus).

    A vertex in which pieces touch counts for each of them.
    """
    piece = face_components(faces)
    pieces = int(piece.max()) + 1
    vertices = len(np.unique(np.repeat(piece, 3) * (int(faces.max()) + 1) + faces.ravel()))
    euler = vertices - len(faces) // 2  # each edge has two faces, so E = 3/2 F
    return pieces, pieces - euler // 2


def useful_merging(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> Merging | None:
    """A merging of near boundary vertices that closes loops, or None if there is none.

    The distance is that of the nearest vertices, or twice, four times ... that, while this closes more loops.
    """
    if not loops:
        return None
    points = np.concatenate([loop.points for loop in loops])
    edge = np.concatenate([np.maximum(loop.edge_lengths, shifted(loop.edge_lengths, 1)) for loop in loops])
    ids = np.concatenate([loop.vertex_ids for loop in loops])
    found = cKDTree(points).query(points, k=2, distance_upper_bound=SHARE_OF_EDGE * float(edge.max()))
    near, other = (np.asarray(column)[:, 1] for column in found)
    is_near = np.isfinite(near)
    pair = np.stack([np.arange(len(points)), np.where(is_near, other, 0)], axis=1)
    is_near &= (near <= SHARE_OF_EDGE * edge[pair].min(axis=1)) & (ids[pair[:, 0]] != ids[pair[:, 1]])
    if not is_near.any():
        return None
    distance, best, left = float(near[is_near].max()), None, len(loops)
    while distance <= SHARE_OF_EDGE * float(edge.max()):
        closed = count_boundary_loops(mesh.merged(advised_distance(distance))[0])
        if closed >= left:
            break
        best, left = Merging(distance, closed), closed
        distance = 2 * distance or np.inf
    return best
