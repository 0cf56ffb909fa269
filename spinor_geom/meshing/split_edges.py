"""Triangulations of Ω between the loop's points where chords cross: long edges are split.

The pieces of ∂Ω between the images of neighbouring points are curved. The chord of a long piece may cross other chords,
or run far outside Ω, where p and q have poles. Such an edge is divided at points near the piece, inside Ω. The polygon
through them is triangulated, and a fan of triangles fills the gap to the edge.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Complex, Int
from scipy.spatial import cKDTree

from spinor_geom.arrays import norm
from spinor_geom.domain.delaunay import Rims, flat_coordinates, plane_coordinates, rim_successors, unique_edges
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.domain.polygons import crossing_edges
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError
from spinor_geom.mesh.intersections import crossings_between
from spinor_geom.mesh.operators import nearest_on_mesh
from spinor_geom.plateau.rim_match import RimMatch

_ROUNDS = 6  # of halving edges
_SAME = 1e-12  # largest distance of equal points, per size of Ω
_AS_NEAR = 2.0  # in units of the largest distance of the arcs from the boundary edges
_FAR_OUTSIDE = 0.1  # distance from Ω in edge lengths. The nearest poles are about one edge length outside

Polygons = Sequence[Complex[np.ndarray, "_"]]
Triangulate = Callable[[Polygons], PlaneTriangulation]


def edges_far_from_arcs(domain: PlaneDomain, plane: PlaneTriangulation) -> Int[np.ndarray, " e"]:
    """The boundary edges nearest to inner points far outside Ω."""
    m = plane.boundary_size
    if _is_polygon(domain, plane.points[:m]):
        return np.zeros(0, dtype=np.int64)
    boundary, after = flat_coordinates(plane.points[:m]), rim_successors(plane.rims)
    edges = np.stack([np.arange(m), after], axis=1)
    # the signed distance of each of a million inner points takes long. Only those beside the arcs can be outside
    points, pieces = domain.fine_polygons
    squared, _, _ = nearest_on_mesh(np.column_stack([points, 0 * points[:, 0]]), boundary, edges)
    reach = _AS_NEAR * np.sqrt(squared.max()) + norm(points[pieces[:, 1]] - points[pieces[:, 0]]).max()
    far, _ = cKDTree(points).query(plane_coordinates(plane.points[m:]), distance_upper_bound=reach)
    z = plane.points[m:][np.isfinite(far)]
    outside = domain.distance_outside(z)
    z, outside = z[outside > 0], outside[outside > 0]
    _, nearest, _ = nearest_on_mesh(flat_coordinates(z), boundary, edges)
    return np.unique(nearest[outside > _FAR_OUTSIDE * norm(boundary[after] - boundary)[nearest]])


def _is_polygon(domain: PlaneDomain, vertices: Complex[np.ndarray, " m"]) -> bool:
    """Whether Ω is bounded by straight edges between the given vertices, up to rounding."""
    for boundary in domain.boundaries:
        if not isinstance(boundary, SplineBoundary) or len(boundary.coefficients) != 2:
            return False
    own = np.concatenate([boundary.vertices for boundary in domain.boundaries])
    return len(own) == len(vertices) and np.allclose(own, vertices, rtol=0, atol=_SAME * np.abs(own).max())


def triangulated_with_split_edges(
    rims: Sequence[RimMatch], domain: PlaneDomain, triangulate: Triangulate
) -> PlaneTriangulation:
    """A triangulation of Ω whose boundary vertices are the images of the loops' points.

    Faces at split edges may be clockwise.

    Raises:
        DomainError: the boundary is not simple even with split edges.
    """
    sizes = tuple(len(rim.loop) for rim in rims)
    own = [rim.points_in_domain() for rim in rims]
    parts = np.ones(sum(sizes), dtype=np.int64)  # number of parts of each edge of the loops
    polygons: Polygons = own
    for _ in range(_ROUNDS):
        try:
            plane = triangulate(polygons)
            edges = edges_far_from_arcs(domain, plane)
            closed = None if len(edges) else _closed(plane, parts, np.concatenate(own), sizes)
            if closed is not None:
                return closed
        except DomainError:
            edges = np.zeros(0, dtype=np.int64)
        chosen = edges if len(edges) else _crossing(polygons)
        parts[np.unique(np.repeat(np.arange(len(parts)), parts)[chosen])] *= 2
        by_rim = np.split(parts, np.cumsum(sizes)[:-1])
        polygons = [_divided(*each) for each in zip(rims, own, by_rim, strict=True)]
    raise DomainError(
        "the boundary of the plane domain crosses or touches itself between the loop's points; check that the loop "
        "does not nearly touch itself",
        vertices=len(parts),
    )


def _divided(rim: RimMatch, own: Complex[np.ndarray, " m"], parts: Int[np.ndarray, " m"]) -> Complex[np.ndarray, " n"]:
    """The polygon of a rim with each edge divided into a number of parts."""
    after = np.cumsum(parts)
    polygon = np.empty(after[-1], dtype=np.complex128)
    polygon[after - parts] = own
    for edge in np.flatnonzero(parts > 1).tolist():
        polygon[after[edge] - parts[edge] + 1 : after[edge]] = rim.points_between(edge, int(parts[edge]) - 1)
    return polygon


def _crossing(polygons: Polygons) -> Int[np.ndarray, " e"]:
    """The longer edge of each pair of crossing edges, or the longest edge of all if none cross."""
    first = np.cumsum([0, *map(len, polygons[:-1])])
    pairs = [crossing_edges(polygon) + start for polygon, start in zip(polygons, first, strict=True)]
    flat = [flat_coordinates(polygon) for polygon in polygons]
    for one, other in combinations(range(len(polygons)), 2):
        pairs.append(crossings_between(flat[one], flat[other]) + first[[one, other]])
    crossing = np.concatenate(pairs).astype(np.int64)
    length = np.concatenate([np.abs(np.roll(polygon, -1) - polygon) for polygon in polygons])
    if not len(crossing):
        return np.array([length.argmax()])
    return np.asarray(crossing[np.arange(len(crossing)), length[crossing].argmax(axis=1)])


def _closed(
    plane: PlaneTriangulation, parts: Int[np.ndarray, " m"], own: Complex[np.ndarray, " m"], sizes: Rims
) -> PlaneTriangulation | None:
    """Adds the triangles between split edges and their points, or None if an edge would get a third triangle."""
    m, start = len(own), np.cumsum(parts) - parts
    is_own = np.zeros(len(plane.points), dtype=bool)
    is_own[start] = True
    number = np.where(is_own, np.cumsum(is_own) - 1, m + np.cumsum(~is_own) - 1)
    after = rim_successors(sizes)
    fans = []
    for edge in np.flatnonzero(parts > 1).tolist():
        points = number[start[edge] + np.arange(1, parts[edge])]
        chain = np.append(points, after[edge])
        fans.append(np.column_stack([np.full(len(points), edge), chain[1:], chain[:-1]]))
    faces = np.concatenate([number[plane.faces], *fans])
    # inner edges have two triangles, boundary edges one
    if len(unique_edges(faces, len(plane.points))) != (3 * len(faces) + m) // 2:
        return None
    points = np.concatenate([own, plane.points[~is_own]])
    return replace(plane, points=points, faces=faces, boundary_size=m, hole_sizes=sizes[1:])
