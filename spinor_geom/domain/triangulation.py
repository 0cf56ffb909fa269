"""Triangulation of a simple plane polygon, with holes or not, whose boundary stays as it is, vertex by vertex."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import ConstrainedDelaunay, Lengths, Owners, Places, Rims, rim_successors, unique_edges
from spinor_geom.domain.polygons import lattices_inside
from spinor_geom.domain.refinement import Boundary, independent, long_bridges, place_in_region, polish, refine, smooth
from spinor_geom.domain.sizes import NearestPoints, Polygon, RegionSizes, SizeFunction, graded_size
from spinor_geom.errors import DomainError, OptionError, SpinorGeomError
from spinor_geom.mesh.array_checks import shared

MOST_POINTS = 200_000  # of a triangulation, if nothing else is said
# points at which the largest size is looked for, and shares of it by which lattice points keep off the boundary
_SIZE_SAMPLES, _ROOM_AT_BOUNDARY = 100, 2.0
_MOST_ROWS = 20_000
_STRAIGHT = 1e-9  # in radians, from which on a polygon's turn to the left is no rounding error
# seeds keep these shares of edges' lengths from the tips on the boundary and its vertices, of the wanted size apart
_FROM_TIPS, _FROM_VERTICES, _LEAST_SPACING = 0.75, 1.2, 0.7

# points inside a region, about as far from each other as is wanted, and the distance of each from its neighbours
Seeds = tuple[Places, Lengths]
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneTriangulation:
    """A triangulated simple polygon, with holes or without.

    The boundary comes first, equal to the input bit for bit: counter-clockwise, then those of holes, clockwise.
    """

    points: Complex[np.ndarray, " n"]
    faces: Int[np.ndarray, "t 3"]  # counter-clockwise
    boundary_size: int  # number of boundary vertices, those of holes included
    hole_sizes: tuple[int, ...] = ()

    @property
    def rims(self) -> Rims:
        """Numbers of vertices of each boundary, the outer one first."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

    @cached_property
    def angles(self) -> Float[np.ndarray, "t 3"]:
        """Inner angles in degrees, column k at the face's vertex k."""
        p = self.points[self.faces]
        ahead, back = p[:, [1, 2, 0]] - p, p[:, [2, 0, 1]] - p
        return shared(np.degrees(np.angle(back * np.conj(ahead))))

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Every edge once, smaller index first, sorted."""
        return shared(unique_edges(self.faces, len(self.points)))


def one_by_one_on_error(make: Callable[[Sequence[T]], list[R]], items: Sequence[T]) -> list[R | SpinorGeomError]:
    """What is made of many things together, where each comes out as it does by itself; for some the error it raises."""
    try:
        return [*make(items)] if len(items) else []
    except SpinorGeomError as error:
        if len(items) == 1:
            return [error]
    half = len(items) // 2
    return [made for some in (items[:half], items[half:]) for made in one_by_one_on_error(make, some)]


def triangulate_polygon(
    boundary: Polygon, size: SizeFunction | None = None, *, holes: Sequence[Polygon] = ()
) -> PlaneTriangulation:
    """Triangulates a simple polygon with inner points so that edges are about `size` long and angles are large.

    Delaunay refinement: circumcentres of triangles that are too large for the size function or have an angle below
    25° are inserted in batches of mutually distant ones, never close to a boundary edge, so no boundary edge is
    ever split. Then edges that bridge the polygon between two boundary vertices get a point where there is room (where
    the polygon is one triangle wide they stay), the inner points are smoothed, and those of triangles that are still
    poor are moved one by one. Small angles that the boundary itself forces stay.

    The polygon runs counter-clockwise, the holes inside it, which are left out, clockwise. The size is the wanted edge
    length at points (k,), in units of the polygon; by default `graded_size`. One that is not positive and finite is an
    OptionError; a polygon or a hole that runs the other way, has fewer than three vertices or one that is not finite,
    touches or crosses itself, or a hole that is not inside, is a DomainError.

    Source: Ruppert (1995), A Delaunay refinement algorithm for quality 2-dimensional mesh generation, J. Algorithms 18.
    """
    wanted = size or graded_size(boundary, *holes)
    return triangulate_regions([(boundary, *holes)], lambda z, _: wanted(z))[0]


def triangulate_regions(
    regions: Sequence[Sequence[Polygon]],
    size: RegionSizes,
    *,
    seeds: Sequence[Seeds] = (),
    max_points: Sequence[int] | int = MOST_POINTS,
) -> list[PlaneTriangulation]:
    """As `triangulate_polygon` for many regions at once: the triangulation of each is the same, to the last bit.

    A region is a polygon and its holes. Seeds are by default the points of lattices as wide as the largest of the sizes
    wanted; those too near to the boundary are not taken. No further points are inserted when there are so many.
    """
    parts = [[np.array(polygon, dtype=np.complex128) for polygon in region] for region in regions]
    rims = [tuple(map(len, region)) for region in parts]
    given = [np.concatenate(region) for region in parts]
    centre, scale = (np.array(one) for one in zip(*map(_require_region, parts), strict=True))
    owner = np.repeat(np.arange(len(rims)), [len(boundary) for boundary in given])
    boundary = np.concatenate(given)
    edges = Boundary((boundary - centre[owner]) / scale[owner], rim_successors(sum(rims, ())), owner)

    def wanted(z: Places, region: Owners) -> Lengths:
        h = size(z * scale[region] + centre[region], region)
        wrong = ~((h > 0) & np.isfinite(h))
        if wrong.any():
            raise OptionError(f"the size function must give positive, finite lengths, got {h[wrong][0]}")
        return np.asarray(h / scale[region])

    # nothing is put into a triangle
    m = np.array([len(boundary) for boundary in given])
    room = np.where(m > 3, np.maximum(max_points - m, 0), 0)
    if not seeds:
        inner, of = _seeds(edges, wanted, room)
        lengths = wanted(inner, of)
    else:
        of = np.repeat(np.arange(len(seeds)), [len(points) for points, _ in seeds])
        places, spacing = map(np.concatenate, zip(*seeds, strict=True))
        inner, of, lengths = _behind_a_row(edges, wanted, (places - centre[of]) / scale[of], spacing / scale[of], of)
    some = place_in_region(of) < room[of]
    inner, of, lengths = inner[some], of[some], lengths[some]
    mesh = ConstrainedDelaunay(np.append(edges.points, inner), rims, np.append(owner, of))
    refine(mesh, np.append(wanted(edges.points, owner), lengths), edges, wanted, room)
    for _ in range(3):
        middle, of = long_bridges(mesh, edges, wanted)
        if len(middle) == 0:
            break
        mesh.insert(middle, of)
    smooth(mesh, edges)
    polish(mesh, edges)
    points = mesh.points * scale[mesh.region] + centre[mesh.region]
    points[: mesh.boundary_size] = boundary
    return [
        PlaneTriangulation(points=points[at], faces=one.faces[one.inside], boundary_size=sum(rims), hole_sizes=rims[1:])
        for at, one, rims in zip(mesh.own, mesh.parts, mesh.regions, strict=True)
    ]


def _require_region(polygons: Sequence[Polygon]) -> tuple[complex, float]:
    """Checks a polygon and its holes; gives an origin and a unit in which nothing depends on its place and size."""
    for number, polygon in enumerate(polygons):
        name, sign, ways = "the polygon", 1, ("clockwise", "counter-clockwise")
        if number:
            name, sign, ways = "a hole", -1, ways[::-1]
        m = len(polygon)
        if m < 3 or not np.isfinite(polygon).all():
            raise DomainError(f"{name} needs at least 3 finite vertices, got {m}", vertices=m)
        if sign * _area(polygon) <= 0:
            raise DomainError(f"{name} runs {ways[0]} or has no area; give it {ways[1]}", vertices=m)
    boundary = np.concatenate(polygons)
    if sum(map(_area, polygons)) <= 0:
        raise DomainError("a hole is not inside the polygon", vertices=len(boundary))
    centre = boundary.mean()
    scale = np.abs(boundary - centre).max()
    edge = (np.roll(boundary, -1) - boundary) / scale
    turn = np.angle(np.roll(edge, -1) * np.conj(edge))
    # a polygon that turns to the left at each vertex, and once in all, is simple
    if len(polygons) > 1 or not ((turn > _STRAIGHT).all() and turn.sum() < 3 * np.pi):
        mesh = ConstrainedDelaunay((boundary - centre) / scale, [tuple(map(len, polygons))])
        m, faces, sides = len(boundary), mesh.triangles, (mesh.neighbours[mesh.inside] < 0).sum()
        count = m - 2 + 2 * (len(polygons) - 1)
        if len(faces) != count or len(unique_edges(faces, m)) != (3 * count + m) // 2 or sides != m:
            problem = "a vertex lies on another edge, or a hole is not inside the polygon"
            raise DomainError(f"the boundary is not simple: {problem}", vertices=m)
    return centre, scale


def _area(polygon: Complex[np.ndarray, " m"]) -> float:
    return 0.5 * float((np.conj(polygon) * np.roll(polygon, -1)).imag.sum())


def _seeds(boundary: Boundary, size: RegionSizes, room: Int[np.ndarray, " r"]) -> tuple[Places, Owners]:
    """Points of lattices as wide as the largest of the sizes wanted in each region: inner points to start from."""
    points, after, owner = boundary.points, boundary.after, boundary.region
    area = 0.5 * np.bincount(owner, (np.conj(points) * points[after]).imag)
    # a polygon that is hardly wider than a line must not be crossed by millions of rows
    shortest = np.bincount(owner, np.abs(boundary.edge)) / _MOST_ROWS
    spacing = np.maximum(np.sqrt(area / _SIZE_SAMPLES), shortest)
    sample, of = lattices_inside(points, spacing[owner], after, owner)
    largest = np.zeros(boundary.count)
    np.maximum.at(largest, of, size(sample, of))
    spacing = np.maximum(np.maximum(largest, shortest), np.sqrt(area / np.maximum(room, 1)))
    spacing[(largest == 0) | (room == 0)] = np.inf  # no row crosses regions without room
    lattice, of = lattices_inside(points, spacing[owner], after, owner)
    distance, _ = NearestPoints(points, owner).query(lattice, of)
    free = distance[:, 0] > _ROOM_AT_BOUNDARY * spacing[of]
    lattice, of = lattice[free], of[free]
    free = boundary.has_room(lattice, of)
    return lattice[free], of[free]


def _behind_a_row(
    boundary: Boundary, size: RegionSizes, z: Places, spacing: Lengths, of: Owners
) -> tuple[Complex[np.ndarray, " j"], Int[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """The tips of equilateral triangles on the edges of polygons, and behind them the seeds that stand wide enough.

    All of them lie inside their polygons and are not too near to an edge.

    Their regions, which ascend, and the sizes wanted there come with them. Edges that turn much have no room for tips.
    """
    polygon, owner, edge = boundary.points, boundary.region, boundary.edge
    tips, length = 0.5 * (polygon + polygon[boundary.after]) + 1j * np.sqrt(0.75) * edge, np.abs(edge)
    kept = np.bincount(owner[independent(tips, owner, _FROM_TIPS * length, length)], minlength=boundary.count)
    free = (kept == np.bincount(owner))[owner] & boundary.has_room(tips, owner)
    row = np.concatenate([tips[free], polygon])
    away = np.concatenate([_FROM_TIPS * length[free], _FROM_VERTICES * length])
    distance, nearest = NearestPoints(row, np.concatenate([owner[free], owner])).query(z, of)
    clear = (distance[:, 0] > away[nearest[:, 0]]) & boundary.has_room(z, of)
    z, spacing, of = z[clear], spacing[clear], of[clear]
    wanted = size(z, of)
    wide = spacing > _LEAST_SPACING * wanted
    inner, region = np.concatenate([tips[free], z[wide]]), np.concatenate([owner[free], of[wide]])
    lengths = np.concatenate([size(tips[free], owner[free]), wanted[wide]])
    order = np.argsort(region, kind="stable")
    return inner[order], region[order], lengths[order]
