"""Patches over domains that differ from the polygon through the loop's places: long edges are split in Ω.

Ω is bounded by arcs. Where a loop has a long edge, the chord of its arc may cross other chords, a hole's too, though
the arcs do not cross, or run far outside Ω, where p and q have poles. Points beside the arc, inside Ω, then divide it;
the polygon through them is triangulated, and triangles between these points and the edge close the gap that is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Complex, Int

from spinor_geom.domain.delaunay import flat_coordinates, rim_successors, unique_edges
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.polygons import crossing_edges
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError
from spinor_geom.mesh.intersections import crossings_between
from spinor_geom.plateau.solution import RimMatch

_ROUNDS = 6  # in which edges are split in half: one gets up to 63 points
# So much farther outside Ω, per edge, no inner point lies: the nearest poles are about an edge outside.
_FAR_OUTSIDE = 0.1

Polygons = Sequence[Complex[np.ndarray, "_"]]
Triangulate = Callable[[Polygons], PlaneTriangulation]


def edges_far_from_arcs(domain: PlaneDomain, plane: PlaneTriangulation) -> Int[np.ndarray, " e"]:
    """The edges of the boundary beside which inner points lie far outside Ω."""
    m = plane.boundary_size
    outside = domain.distance_outside(plane.points[m:])
    some = outside > 0
    z, boundary = plane.points[m:][some], plane.points[:m]
    edge = boundary[rim_successors(plane.rims)] - boundary
    away = (z[:, None] - boundary) / edge
    distance = np.abs(away - np.clip(away.real, 0, 1)) * np.abs(edge)
    nearest = distance.argmin(axis=1)
    return np.unique(nearest[outside[some] > _FAR_OUTSIDE * np.abs(edge)[nearest]])


def triangulated_with_split_edges(
    rims: Sequence[RimMatch], domain: PlaneDomain, triangulate: Triangulate
) -> PlaneTriangulation:
    """The part of Ω inside the arcs between the loops' points, with these points alone as its boundary.

    Triangles beside a split edge may be clockwise in Ω.

    Raises:
        DomainError: the boundary is not simple however finely its edges are split.
    """
    parts = [np.ones(len(rim.loop), dtype=np.int64) for rim in rims]
    own = [rim.points_in_domain() for rim in rims]
    polygons: Polygons = own
    for _ in range(_ROUNDS):
        try:
            plane = triangulate(polygons)
            edges = edges_far_from_arcs(domain, plane)
            closed = None if len(edges) else _closed(plane, parts, np.concatenate(own))
            if closed is not None:
                return closed
        except DomainError:
            edges = np.zeros(0, dtype=np.int64)
        _split(parts, edges if len(edges) else _crossing(polygons))
        polygons = [_divided(*each) for each in zip(rims, own, parts, strict=True)]
    raise DomainError(
        "the boundary of the plane domain is not simple, even between the points of the loop: two of its parts cross "
        "or touch; check that the loop does not nearly touch itself",
        vertices=sum(map(len, own)),
    )


def _divided(rim: RimMatch, own: Complex[np.ndarray, " m"], parts: Int[np.ndarray, " m"]) -> Complex[np.ndarray, " n"]:
    """The polygon of a rim with edges divided into so many parts."""
    after = np.cumsum(parts)
    polygon = np.empty(after[-1], dtype=np.complex128)
    polygon[after - parts] = own
    for edge in np.flatnonzero(parts > 1).tolist():
        polygon[after[edge] - parts[edge] + 1 : after[edge]] = rim.points_between(edge, int(parts[edge]) - 1)
    return polygon


def _crossing(polygons: Polygons) -> Int[np.ndarray, " e"]:
    """Of each pair of crossing edges the longer one; the longest of all where none cross."""
    first = _starts(polygons)
    pairs = [crossing_edges(polygon) + start for polygon, start in zip(polygons, first, strict=True)]
    flat = [flat_coordinates(polygon) for polygon in polygons]
    for one, other in combinations(range(len(polygons)), 2):
        pairs.append(crossings_between(flat[one], flat[other]) + first[[one, other]])
    crossing = np.concatenate(pairs).astype(np.int64)
    length = np.concatenate([np.abs(np.roll(polygon, -1) - polygon) for polygon in polygons])
    if not len(crossing):
        return np.array([length.argmax()])
    return np.asarray(crossing[np.arange(len(crossing)), length[crossing].argmax(axis=1)])


def _split(parts: Sequence[Int[np.ndarray, " _"]], chosen: Int[np.ndarray, " e"]) -> None:
    """Divides the loops' edges that some of the polygons' belong to twice as finely."""
    edges = np.unique(np.repeat(np.arange(sum(map(len, parts))), np.concatenate(parts))[chosen])
    for each, start in zip(parts, _starts(parts), strict=True):
        each[edges[(edges >= start) & (edges < start + len(each))] - start] *= 2


def _closed(
    plane: PlaneTriangulation, parts: Sequence[Int[np.ndarray, " _"]], own: Complex[np.ndarray, " m"]
) -> PlaneTriangulation | None:
    """With triangles between split edges and their points; None where an edge would get a third triangle."""
    every = np.concatenate(parts)
    m, start = len(own), np.cumsum(every) - every
    is_own = np.zeros(len(plane.points), dtype=bool)
    is_own[start] = True
    number = np.where(is_own, np.cumsum(is_own) - 1, m + np.cumsum(~is_own) - 1)
    after = rim_successors(tuple(map(len, parts)))
    fans = []
    for edge in np.flatnonzero(every > 1).tolist():
        points = number[start[edge] + np.arange(1, every[edge])]
        chain = np.append(points, after[edge])
        fans.append(np.column_stack([np.full(len(points), edge), chain[1:], chain[:-1]]))
    faces = np.concatenate([number[plane.faces], *fans])
    count = len(plane.points)
    # of a disk with holes each inner edge has two triangles, and each edge of the boundary one
    if len(unique_edges(faces, count)) != (3 * len(faces) + m) // 2:
        return None
    points = np.concatenate([own, plane.points[~is_own]])
    return PlaneTriangulation(points=points, faces=faces, boundary_size=m, hole_sizes=tuple(map(len, parts[1:])))


def _starts(parts: Sequence[np.ndarray]) -> Int[np.ndarray, " r"]:
    """The number of the first of each part's members, of all."""
    return np.cumsum([0, *map(len, parts[:-1])])
