"""Coincident boundary edges: slits, seams, and T-junctions, where the two sides are divided differently."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import norm, shifted
from spinor_geom.mesh.near_edges import near_points
from spinor_geom.mesh.topology import SHARE_OF_EDGE, coincident_vertices, near_vertices

Points = Float[np.ndarray, "n 3"]
Numbers = Int[np.ndarray, " _"]

# Boundary points coincide if their distance is at most this share of the mesh's diagonal. Single precision leaves 2e-7,
# and no intended hole is as narrow.
SAME_PLACE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps:
    """The parts of the edges of loops that coincide with other edges. Edge i runs from entry i to the next one."""

    own: Float[np.ndarray, " n"]  # share of its length on oppositely directed edges of its own loop
    other: Float[np.ndarray, " n"]  # share of its length on edges of other loops
    is_matched: Bool[np.ndarray, " n"]  # whether these edges have the same two ends
    distance: Float[np.ndarray, " n"]  # largest distance of its ends from those edges, in mesh units
    junctions: Int[np.ndarray, "k 2"]  # T-junctions: an entry, and the edge on which it and one of its own edges lie


def find_overlaps(points: Points, successor: Numbers, loop: Numbers, size: float) -> Overlaps:
    """The overlaps of loops of points, given the successor and the loop of each, on a mesh of a given diagonal."""
    lengths = norm(points[successor] - points)
    local = lengths.copy()
    np.maximum.at(local, successor, lengths)
    reach = np.minimum(SAME_PLACE * size, SHARE_OF_EDGE * local)
    place = near_vertices(points, reach)
    of_group = np.zeros(len(points))
    np.maximum.at(of_group, place, norm(points - points[place]))
    off = of_group[place]
    start, end = place, place[successor]
    own, other = _shared(start, end, loop)
    is_matched = own | other
    left = np.flatnonzero(~is_matched & (start != end))
    edge, entry, along, height = _points_on_edges(points, successor, left, place, reach)
    own_share, other_share, distance = own.astype(float), other.astype(float), np.maximum(off, off[successor])
    if not len(edge):  # true for nearly all loops
        return Overlaps(
            own=own_share,
            other=other_share,
            is_matched=is_matched,
            distance=np.where(is_matched, distance, 0.0),
            junctions=np.zeros((0, 2), dtype=np.int64),
        )
    # divide each edge at the points on it
    first = np.concatenate([left, edge])
    order = np.lexsort((np.concatenate([np.zeros(len(left)), along]), first))
    parent = first[order]
    share = np.concatenate([np.zeros(len(left)), along])[order]
    piece = np.concatenate([start[left], place[entry]])[order]
    is_last = np.append(parent[1:] != parent[:-1], True)[: len(parent)]
    following = np.where(is_last, end[parent], shifted(piece, -1))
    width = np.where(is_last, 1.0, shifted(share, -1)) - share
    own_piece, other_piece = _shared(piece, following, loop[parent])
    np.add.at(own_share, parent, np.where(own_piece, width, 0.0))
    np.add.at(other_share, parent, np.where(other_piece, width, 0.0))
    before = np.empty_like(successor)
    before[successor] = np.arange(len(successor))
    for beside in (edge, entry, before[entry]):
        np.maximum.at(distance, beside, height)
    covered = (own_share > 0) | (other_share > 0)
    meets = covered[edge] & (covered[entry] | covered[before[entry]])
    return Overlaps(
        own=own_share,
        other=other_share,
        is_matched=is_matched,
        distance=np.where(covered, distance, 0.0),
        junctions=np.stack([entry, edge], axis=1)[meets],
    )


def _shared(start: Numbers, end: Numbers, loop: Numbers) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Whether each edge has the ends of an oppositely directed edge of its loop, and of any edge of another loop."""
    reversed_, other = np.zeros((2, len(start)), dtype=bool)
    count = int(max(start.max(initial=0), end.max(initial=0))) + 1
    pair = np.minimum(start, end) * count + np.maximum(start, end)
    ordered = np.sort(pair)
    if (ordered[1:] != ordered[:-1]).all():  # true for nearly all loops
        return reversed_, other
    forward, on_edge = start < end, _group_sizes(pair)
    # not edges of length 0
    shared = np.flatnonzero((on_edge > 1) & (start != end))
    _, edge = np.unique(pair[shared], return_inverse=True)
    edge_of_loop = edge * (int(loop.max(initial=0)) + 1) + loop[shared]
    on_loop = _group_sizes(edge_of_loop)
    reversed_[shared] = on_loop > _group_sizes(edge_of_loop * 2 + forward[shared])
    other[shared] = on_edge[shared] > on_loop
    return reversed_, other


def _points_on_edges(
    points: Points, successor: Numbers, edges: Numbers, place: Numbers, reach: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Ends of edges in the interior of other edges: the edge, the entry, its share along the edge, its distance."""
    if not len(edges):
        return edges, edges, np.zeros(0), np.zeros(0)
    # edges with near ends follow one another, so that the search for each needs much the same memory
    box = np.ptp(points, axis=0).max()
    cells = np.floor(5.99 * (points - points.min(axis=0)) / (box or 1.0)).astype(np.int64) @ (1, 6, 36)
    edges = edges[np.argsort((cells[edges] + 216 * cells[successor[edges]]).astype(np.uint16), kind="stable")]
    ends = successor[edges]
    # one entry for each position, the one with the largest reach
    entries = np.concatenate([edges, ends])
    entries = entries[np.argsort(-reach[entries], kind="stable")]
    entries = entries[np.unique(coincident_vertices(points[entries]))]

    def is_no_end(side: Numbers, number: Numbers) -> Bool[np.ndarray, " k"]:
        at, edge = place[entries[number]], edges[side]
        return np.asarray((at != place[edge]) & (at != place[successor[edge]]))

    side, number = near_points(points[edges], points[ends], points[entries], reach[entries], is_no_end).T
    edge, entry = edges[side], entries[number]
    side, aside = points[successor[edge]] - points[edge], points[entry] - points[edge]
    along = np.einsum("ni,ni->n", side, aside) / np.einsum("ni,ni->n", side, side)
    height = norm(aside - along[:, None] * side)
    on_edge = np.flatnonzero((along > 0) & (along < 1) & (height <= reach[entry]))
    # one entry for each position on an edge
    key = edge[on_edge] * len(points) + place[entry[on_edge]]
    kept = on_edge[np.unique(key, return_index=True)[1]]
    return edge[kept], entry[kept], along[kept], height[kept]


def _group_sizes(keys: Numbers) -> Numbers:
    """The number of entries equal to each entry."""
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return counts[inverse]
