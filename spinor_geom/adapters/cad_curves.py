"""Closed curves of the edges of CAD models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from spinor_geom.adapters.cad_edges import CadEdge, EdgeKind, free_edges
from spinor_geom.adapters.polygon_faces import chained
from spinor_geom.errors import BranchingEdgesError, NoEdgesError, OpenWireError
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.joined_splines import JoinedSplines
from spinor_geom.mesh.rational_splines import NurbsCurve
from spinor_geom.mesh.topology import linked

# Ends of edges at most this far apart are joined, relative to the diagonal of the bounding box of all edges.
CLOSING = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CadCurve(ClosedCurve):
    """A closed curve of edges of a CAD model, by arc length; its points are on the edges, to rounding."""

    length: float  # in units of the model
    edges: int  # number of its edges
    kind: EdgeKind  # "edges" that belong to no face, or the "free boundary" of faces
    # the largest distance between ends of edges that were joined, in units of the model. Both were moved by half of it,
    # and the other points of their edges in proportion.
    gap: float

    def __repr__(self) -> str:
        return f"CadCurve({self.edges} edges, {len(self.corners)} corners, length {self.length:.6g})"


def closed_curves(shapes: Sequence[Any]) -> list[CadCurve]:
    """The closed curves that the `free_edges` of shapes form, in the order of their first edges.

    Ends of edges are joined if they are at most 1e-6 of the size of all edges apart, or within the tolerance of their
    vertices. Each curve has the direction of its first edge. Raises a NoEdgesError without such edges, an OpenWireError
    if an end meets no other one, a BranchingEdgesError if more than two meet, and a CurveError if the derivative of a
    spline is 0 at a point.
    """
    kind, edges = free_edges(shapes)
    return [_joined(splines, kind, gap) for splines, gap in _loops(edges)]


def _joined(splines: Sequence[NurbsCurve], kind: EdgeKind, gap: float) -> CadCurve:
    whole = JoinedSplines.of(splines)
    return CadCurve(**vars(whole.curve()), length=whole.length, edges=len(splines), kind=kind, gap=gap)


def _loops(edges: Sequence[CadEdge]) -> Iterator[tuple[list[NurbsCurve], float]]:
    """The splines in order around each closed curve, with equal ends, and the largest gap between their ends."""
    poles = np.concatenate([edge.spline.control_points for edge in edges])
    closing = CLOSING * float(diagonals(poles))
    edges = [edge for edge in edges if np.ptp(edge.spline.control_points, axis=0).max() > max(edge.tolerance, closing)]
    if not edges:
        raise NoEdgesError(what="only edges shorter than their tolerance")
    ends = np.concatenate([edge.spline.ends for edge in edges])
    near = np.repeat([max(edge.tolerance, closing) for edge in edges], 2)
    nodes = _nodes(ends, near)
    links, count = nodes.reshape(-1, 2), np.bincount(nodes)
    _require_cycles(ends, nodes, count, float(near.max()))
    places = np.stack([np.bincount(nodes, weights=x) for x in ends.T], axis=1) / count[:, None]
    gaps = 2 * np.linalg.norm(ends - places[nodes], axis=1).reshape(-1, 2).max(axis=1)
    # each piece has a number of its own between the numbers of its ends, which identifies it in a chain
    pieces = [np.array([first, len(count) + number, last]) for number, (first, last) in enumerate(links.tolist())]
    for _, chain in chained(pieces):
        numbers = chain[1::2] - len(count)
        splines = [edges[number].spline.between(places[links[number]]) for number in numbers]
        is_forward = links[numbers, 0] == chain[:-1:2]
        yield (
            [one if forward else one.reversed() for one, forward in zip(splines, is_forward, strict=True)],
            float(gaps[numbers].max()),
        )


def _nodes(ends: Float[np.ndarray, "n 3"], near: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Numbers, from 0, of the places where ends meet."""
    pairs = cKDTree(ends).query_pairs(float(near.max()), output_type="ndarray")
    pairs = pairs[np.linalg.norm(ends[pairs[:, 0]] - ends[pairs[:, 1]], axis=1) <= near[pairs].max(axis=1)]
    return linked(pairs, len(ends))


def _require_cycles(
    ends: Float[np.ndarray, "n 3"], nodes: Int[np.ndarray, " n"], count: Int[np.ndarray, " k"], closing: float
) -> None:
    """Checks that two ends meet at every place."""
    if (count > 2).any():
        where = ends[nodes == int(np.argmax(count))]
        raise BranchingEdgesError(count=len(where), point=_shown(where[0]))
    loose = ends[count[nodes] == 1]
    if len(loose):
        distance, other = (np.asarray(each)[:, 1] for each in cKDTree(loose).query(loose, k=2))
        first = int(distance.argmin())
        between = [_shown(loose[number]) for number in (first, int(other[first]))]
        raise OpenWireError(gap=float(distance[first]), ends=between, closing=closing)


def _shown(point: Float[np.ndarray, " 3"]) -> list[float]:
    """A point with six digits, for messages."""
    return [float(f"{x:.6g}") for x in point]
