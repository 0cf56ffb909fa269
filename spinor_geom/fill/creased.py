"""Continues a crease of the mesh through a hole: the patch is made of pieces that meet along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from spinor_geom.arrays import TINY
from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.errors import OutOfTimeError, SpinorGeomError
from spinor_geom.fill.collar import Collar, bend_across, collar_of
from spinor_geom.fill.continuation import KINK, continue_patch
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
_MOST_TURN, _ALIKE = np.radians(75), np.radians(20)
_SAMPLES = 16  # per edge, of the curve between them. A vertex is on it if it is nearer than a sixth of an edge


@dataclass(frozen=True, kw_only=True, eq=False)
class _Crease:
    """A crease that goes on through a patch."""

    rim: Int[np.ndarray, " k"]  # the boundary vertices on it, in its order. The first and the last are its ends
    # the points between two of them that are not joined by an edge of the boundary
    gaps: dict[tuple[int, int], Float[np.ndarray, "_ 3"]]


def continue_across_crease(
    patched: PatchedMesh, rim: Int[np.ndarray, " m"], patch: Patch, collar: Collar, lengths: EdgeLengths
) -> Faired | None:
    """The continuation by pieces on both sides of a crease, or None if no single crease goes on.

    The pieces bend freely along the crease, and are continued on their own. `rim` are the mesh vertices of the patch's
    boundary.

    Raises:
        OutOfTimeError: a time limit has passed.
    """
    crease = _crease(patch, collar)
    if crease is None:
        return None
    mesh, m, on_crease = patched.mesh, patch.boundary_size, crease.rim
    made = np.concatenate([np.zeros((0, 3)), *crease.gaps.values()])
    points, ids = np.concatenate([patch.vertices[:m], made]), np.append(rim, len(mesh.vertices) + np.arange(len(made)))
    pieces = _cut(crease, m)
    owns = [np.setdiff1d(piece[piece < m], on_crease) for piece in pieces]
    if not pieces or not all(map(len, owns)):
        return None
    loops = [
        BoundaryLoop(points=points[at], vertex_ids=ids[at], corners=np.zeros(len(at), dtype=bool)) for at in pieces
    ]
    corners, sides = np.concatenate([mesh.vertices, made]), _sides(mesh, float(collar.crease_angles.min() - _ALIKE))
    vertices, faces, steps, left, is_coarse = [points], [], 0, 0.0, False
    for piece, loop, own in zip(pieces, loops, owns, strict=True):
        # the mesh on the piece's side of the creases
        near = sides[patched.faces_at(rim[own])]
        beside = PatchedMesh(TriangleMesh(corners, mesh.faces[np.isin(sides, near)]), loops)
        try:
            flat = NewPatch(patch=graded_patch(loop, float(loop.mean_edge_length)), rims=[loop], reason="")
            start = flat.split(beside).patch
            around = collar_of(beside, loop.vertex_ids, start)
            if len(start.vertices) > len(piece):
                faired = continue_patch(start, around, lengths)
            elif bend_across(around, start).rms <= around.bend.rms + KINK:
                faired = Faired(patch=start, steps=0, next_step=0.0, stretch=1.0)
            else:
                return None
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
    return Faired(patch=joined, steps=steps, next_step=left, stretch=1.0, is_coarse=is_coarse, crease=on_crease)


def _cut(crease: _Crease, m: int) -> list[Int[np.ndarray, " _"]]:
    """The loops of the pieces: a boundary of m vertices cut along a crease, whose points are numbered from m on.

    Empty if the crease crosses itself or the boundary.
    """
    pieces, count = [np.arange(m)], m
    for (a, b), points in crease.gaps.items():
        both = [k for k, piece in enumerate(pieces) if np.isin([a, b], piece).all()]
        if not both:
            return []
        piece = pieces.pop(both[0])
        piece = np.roll(piece, -int(np.flatnonzero(piece == a)[0]))
        end, between = int(np.flatnonzero(piece == b)[0]), count + np.arange(len(points))
        pieces.append(np.concatenate([piece[: end + 1], between[::-1]]))
        pieces.append(np.concatenate([piece[end:], piece[:1], between]))
        count += len(points)
    return pieces


def _sides(mesh: TriangleMesh, crease: float) -> Int[np.ndarray, " f"]:
    """The number of each face's region between edges at which the faces bend by more than `crease`, in radians."""
    half_edges, count = HalfEdges.of(mesh.faces), len(mesh.faces)
    smooth = np.flatnonzero((half_edges.twin >= 0) & (crossing_angles(half_edges, mesh.vertices) <= crease))
    pairs = smooth // 3, half_edges.twin[smooth] // 3
    return np.asarray(
        connected_components(csr_array((np.ones(len(smooth), dtype=bool), pairs), shape=(count, count)))[1]
    )


def _crease(patch: Patch, collar: Collar) -> _Crease | None:
    """The curve between the ends of two creases that belong together. None without them.

    The curve is the cubic with the directions of the creases, which is nearly an arc of a circle if they turn alike. It
    goes on through boundary vertices beside it.
    """
    if len(collar.crease_ends) != 2 or len(np.unique(collar.crease_ends)) != 2 or patch.hole_sizes:
        return None
    (first, last), (one, other) = collar.crease_ends, collar.crease_angles
    rim = patch.vertices[: patch.boundary_size]
    edge = float(np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1).mean())
    chord = rim[last] - rim[first]
    length = max(float(np.linalg.norm(chord)), TINY)
    along = np.array([chord, -chord]) / length
    turns = np.arccos(np.clip((along * collar.crease_directions).sum(axis=1), -1, 1))
    if turns.max() > _MOST_TURN or abs(turns[0] - turns[1]) > _ALIKE or abs(one - other) > _ALIKE:
        return None
    # a polygon with n more edges turns n + 1 times. The curve through its vertices has turned half as far at its ends
    n = length / edge / np.sinc(turns.mean() / np.pi)
    kept, turned = (k / (n + 1) * np.sinc(k / (n + 1) * turns / np.pi) / np.sinc(turns / np.pi) for k in (n, 1))
    pull = length / np.cos(n / (n + 1) * turns.mean() / 2) ** 2  # of the cubic nearest to an arc
    out, back = pull * (kept[:, None] * collar.crease_directions + turned[:, None] * along)

    def curve(t: Float[np.ndarray, "k 1"]) -> Float[np.ndarray, "k 3"]:
        ends = (1 + 2 * t) * (1 - t) ** 2 * rim[first] + t**2 * (3 - 2 * t) * rim[last]
        return np.asarray(ends + t * (1 - t) ** 2 * out + t**2 * (1 - t) * back)

    samples = np.linspace(0, 1, _SAMPLES * (round(length / edge) + 1) + 1)[:, None]
    away, at = map(np.asarray, cKDTree(curve(samples)).query(rim))
    away[[first, last]], at[[first, last]] = 0, (0, len(samples) - 1)
    # triangles between the crease and boundary edges as near to it would have too small angles
    on = np.flatnonzero(away < np.sin(np.radians(SMALLEST_ANGLE)) * edge)
    on = on[np.argsort(at[on], kind="stable")]
    places = samples[at[on]]
    gaps: dict[tuple[int, int], Float[np.ndarray, "_ 3"]] = {}
    for k, (a, b) in enumerate(pairwise(on.tolist())):
        if (b - a) % len(rim) not in (1, len(rim) - 1):
            t = np.linspace(0, 1, max(round(float(np.linalg.norm(rim[b] - rim[a])) / edge), 2) + 1)[1:-1, None]
            at_ends = rim[[a, b]] - curve(places[[k, k + 1]])
            beside = (1 - t) * at_ends[0] + t * at_ends[1]
            gaps[a, b] = curve((1 - t) * places[k] + t * places[k + 1]) + beside
    return _Crease(rim=on, gaps=gaps)
