"""Triangulation of simple plane polygons with holes that keeps the boundary vertices and adds none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import backwards
from spinor_geom.domain.delaunay import Rims, constrained_delaunay, unique_edges
from spinor_geom.domain.sizes import Polygon, SizeField
from spinor_geom.errors import DomainError
from spinor_geom.mesh.array_checks import shared

MOST_POINTS = 200_000  # default limit for the inner points of a triangulation


class Seeds(NamedTuple):
    """Points inside a region from which its triangulation starts."""

    points: Complex[np.ndarray, "_"]
    spacing: Float[np.ndarray, "_"]  # distance of each from its neighbours


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneTriangulation:
    """A triangulated simple polygon with holes.

    The boundary vertices come first, bit-equal to the input: the outer rim, counter-clockwise, then holes, clockwise.
    """

    points: Complex[np.ndarray, " n"]
    faces: Int[np.ndarray, "t 3"]  # counter-clockwise
    boundary_size: int  # number of boundary vertices, including those of holes
    hole_sizes: tuple[int, ...] = ()
    is_complete: bool = True  # false if a limit on points or on time ended the refinement

    @property
    def rims(self) -> Rims:
        """Number of vertices of each rim, the outer one first."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

    def mirrored(self) -> PlaneTriangulation:
        """The mirror image z̄, with the same first vertices of the polygons."""
        numbers = np.arange(len(self.points))
        numbers[: self.boundary_size] = backwards(self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)
        return replace(self, points=self.points[numbers].conj(), faces=numbers[self.faces][:, ::-1])

    @cached_property
    def angles(self) -> Float[np.ndarray, "t 3"]:
        """Inner angles in degrees, column k at the face's vertex k."""
        p = self.points[self.faces]
        ahead, back = p[:, [1, 2, 0]] - p, p[:, [2, 0, 1]] - p
        return shared(np.degrees(np.angle(back * np.conj(ahead))))

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """The edges, smaller index first, sorted."""
        return shared(unique_edges(self.faces, len(self.points)))


def triangulate_polygon(
    boundary: Polygon,
    size: SizeField | None = None,
    *,
    holes: Sequence[Polygon] = (),
    seeds: Seeds | None = None,
    max_points: int = MOST_POINTS,
    seconds: float = math.inf,
) -> PlaneTriangulation:
    """Triangulates a simple polygon with inner points so that edges are about `size` long and angles are large.

    Delaunay refinement inserts circumcentres of triangles that are too large or have an angle below 25°, and never
    close to a boundary edge, so no boundary edge is split. Then inner edges between two boundary vertices are split
    where there is room, inner points are smoothed, and points of triangles that are still poor are moved one by one.
    Small angles that the boundary imposes remain.

    Args:
        boundary: the polygon, counter-clockwise.
        size: wanted edge lengths, in units of the polygon, by default those of `SizeField()`.
        holes: polygons inside, clockwise, which are left out.
        seeds: inner points to start from. Those outside or too near to the boundary are omitted, and points along the
            boundary are added. By default a lattice with the largest wanted size as spacing.
        max_points: limit for the number of inner points. The largest triangles are refined first.
        seconds: limit for the time of the refinement.

    Raises:
        DomainError: a polygon runs in the wrong direction, has fewer than three vertices, a vertex that is not finite,
            or touches or crosses itself or another one, or a hole is not inside.

    Source: Ruppert (1995), A Delaunay refinement algorithm for quality 2-dimensional mesh generation, J. Algorithms 18;
    Bowyer (1981) and Watson (1981), Comput. J. 24, for the insertion of points.
    """
    polygons = [np.array(polygon, dtype=np.complex128) for polygon in (boundary, *holes)]
    _require_polygons(polygons)
    rims, given = tuple(map(len, polygons)), np.concatenate(polygons)
    region = (size or SizeField()).over(*polygons)
    faces = constrained_delaunay(region.points, rims)
    _require_simple(faces, rims)
    # triangles get no inner points
    is_triangle = len(given) == 3
    inner, faces, is_complete = region.refined(faces, seeds, 0 if is_triangle else max_points, seconds)
    return PlaneTriangulation(
        points=np.concatenate([given, inner]),
        faces=faces,
        boundary_size=len(given),
        hole_sizes=rims[1:],
        is_complete=is_complete or is_triangle,
    )


def _require_polygons(polygons: Sequence[Polygon]) -> None:
    """Checks the number of vertices and the direction of a polygon and its holes."""
    for number, polygon in enumerate(polygons):
        name, sign, directions = "the polygon", 1, ("clockwise", "counter-clockwise")
        if number:
            name, sign, directions = "a hole", -1, directions[::-1]
        m = len(polygon)
        if m < 3:
            raise DomainError(f"{name} needs at least 3 vertices, got {m}", vertices=m)
        if not np.isfinite(polygon).all():
            first = int(np.argmin(np.isfinite(polygon)))
            raise DomainError(f"vertex {first} of {name} is NaN or infinite; correct it", vertices=m)
        if sign * _area(polygon) <= 0:
            raise DomainError(f"{name} runs {directions[0]} or has no area; give it {directions[1]}", vertices=m)
    if sum(map(_area, polygons)) <= 0:
        raise DomainError("a hole is not inside the polygon", vertices=sum(map(len, polygons)))


def _require_simple(faces: Int[np.ndarray, "t 3"], rims: Rims) -> None:
    """Checks by a triangulation without inner points that polygons are simple, with the holes inside."""
    m, edges = sum(rims), len(unique_edges(faces, sum(rims)))
    count = m - 2 + 2 * (len(rims) - 1)
    # each edge belongs to two faces, and those of the polygons to one
    if len(faces) != count or edges != (3 * count + m) // 2:
        problem = "a vertex lies on another edge, or a hole is not inside the polygon"
        raise DomainError(f"the boundary is not simple: {problem}", vertices=m)


def _area(polygon: Complex[np.ndarray, " m"]) -> float:
    return 0.5 * float((np.conj(polygon) * np.roll(polygon, -1)).imag.sum())
