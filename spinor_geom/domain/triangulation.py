"""Triangulation of simple plane polygons with holes that keeps the boundary vertices and adds none."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import ConstrainedDelaunay, Lengths, Owners, Places, Rims, rim_successors, unique_edges
from spinor_geom.domain.polygons import lattices_inside
from spinor_geom.domain.refinement import (
    BoundaryEdges,
    independent,
    place_in_region,
    polish,
    refine,
    smooth,
    split_long_bridges,
)
from spinor_geom.domain.sizes import NearestPoints, Polygon, RegionSizes, SizeFunction, graded_size
from spinor_geom.errors import DomainError, OptionError, SpinorGeomError
from spinor_geom.mesh.array_checks import shared

MOST_POINTS = 200_000  # default limit for a triangulation
_SIZE_SAMPLES = 100  # points at which the largest wanted size is searched
_ROOM_AT_BOUNDARY = 2.0  # least distance of lattice points from boundary vertices, in lattice spacings
_MOST_ROWS = 20_000  # of a lattice
_FROM_TIPS, _FROM_VERTICES = 0.75, 1.2  # least distance of lattices from tips and boundary vertices, in edge lengths
_LEAST_SPACING = 0.7  # of lattices, in wanted edge lengths

T = TypeVar("T")
R = TypeVar("R")


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

    @property
    def rims(self) -> Rims:
        """Number of vertices of each rim, the outer one first."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

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


def one_by_one_on_error(make: Callable[[Sequence[T]], list[R]], items: Sequence[T]) -> list[R | SpinorGeomError]:
    """The results of `make` for many items at once; in place of a failed item's result the error that it raises.

    The result of `make` for an item must not depend on the other items.
    """
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

    Delaunay refinement inserts circumcentres of triangles that are too large or have an angle below 25°, in batches of
    independent points and never close to a boundary edge, so no boundary edge is split. Then inner edges between two
    boundary vertices are split where there is room, inner points are smoothed, and points of triangles that are still
    poor are moved one by one. Small angles that the boundary imposes remain.

    Args:
        boundary: the polygon, counter-clockwise.
        size: wanted edge length at points (k,), in units of the polygon; by default `graded_size`.
        holes: polygons inside, clockwise, which are left out.

    Raises:
        OptionError: a size is not positive and finite.
        DomainError: a polygon runs in the wrong direction, has fewer than three vertices, a vertex that is not finite,
            or touches or crosses itself or another one; or a hole is not inside.

    Source: Ruppert (1995), A Delaunay refinement algorithm for quality 2-dimensional mesh generation, J. Algorithms 18.
    """
    _require_polygons((boundary, *holes))
    wanted = size or graded_size(boundary, *holes)
    return triangulate_regions([(boundary, *holes)], lambda z, _: wanted(z))[0]


def triangulate_regions(
    regions: Sequence[Sequence[Polygon]],
    size: RegionSizes,
    *,
    seeds: Sequence[Seeds | None] = (),
    max_points: Sequence[int] | int = MOST_POINTS,
) -> list[PlaneTriangulation]:
    """`triangulate_polygon` for many regions at once; each triangulation is bit-equal to that of the region alone.

    A region is a polygon and its holes; `size` takes points and their regions. Refinement starts from `seeds` in each
    region, of which those outside or too near to the boundary are omitted and to which points along the boundary are
    added, and stops at `max_points`. By default they are lattices with the largest wanted size as spacing.
    """
    parts = [[np.array(polygon, dtype=np.complex128) for polygon in region] for region in regions]
    rims = [tuple(map(len, region)) for region in parts]
    given = [np.concatenate(region) for region in parts]
    for region in parts:
        _require_polygons(region)
    centre = np.array([each.mean() for each in given])
    scale = np.array([np.abs(each - middle).max() for each, middle in zip(given, centre, strict=True)])
    owner = np.repeat(np.arange(len(rims)), [len(each) for each in given])
    boundary = np.concatenate(given)
    edges = BoundaryEdges((boundary - centre[owner]) / scale[owner], rim_successors(sum(rims, ())), owner)
    _require_simple(ConstrainedDelaunay(edges.points, rims, owner))

    def wanted(z: Places, region: Owners) -> Lengths:
        h = size(z * scale[region] + centre[region], region)
        wrong = ~((h > 0) & np.isfinite(h))
        if wrong.any():
            raise OptionError(f"the size function must give positive, finite lengths, got {h[wrong][0]}")
        return np.asarray(h / scale[region])

    # triangles get no inner points
    m = np.array([len(each) for each in given])
    room = np.where(m > 3, np.maximum(max_points - m, 0), 0)
    normalised = [
        one and Seeds((one.points - c) / r, one.spacing / r)
        for one, c, r in zip(seeds or [None] * len(rims), centre, scale, strict=True)
    ]
    inner, of = _first_points(edges, wanted, room, normalised)
    some = place_in_region(of) < room[of]
    # all points at once, which takes less time than inserting many later
    mesh = ConstrainedDelaunay(np.append(edges.points, inner[some]), rims, np.append(owner, of[some]))
    refine(mesh, edges, wanted, room)
    split_long_bridges(mesh, edges, wanted)
    smooth(mesh, edges)
    polish(mesh, edges)
    points = mesh.points * scale[mesh.region] + centre[mesh.region]
    points[: mesh.boundary_size] = boundary
    return [
        PlaneTriangulation(points=points[at], faces=one.faces[one.inside], boundary_size=sum(rims), hole_sizes=rims[1:])
        for at, one, rims in zip(mesh.own, mesh.parts, mesh.regions, strict=True)
    ]


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


def _require_simple(mesh: ConstrainedDelaunay) -> None:
    """Checks by their triangulations without inner points that polygons are simple, with their holes inside."""
    for one, rims in zip(mesh.parts, mesh.regions, strict=True):
        m, sides = sum(rims), (one.across[one.inside] < 0).sum()
        count = m - 2 + 2 * (len(rims) - 1)
        faces = one.faces[one.inside]
        if len(faces) != count or len(unique_edges(faces, m)) != (3 * count + m) // 2 or sides != m:
            problem = "a vertex lies on another edge, or a hole is not inside the polygon"
            raise DomainError(f"the boundary is not simple: {problem}", vertices=m)


def _area(polygon: Complex[np.ndarray, " m"]) -> float:
    return 0.5 * float((np.conj(polygon) * np.roll(polygon, -1)).imag.sum())


def _first_points(
    boundary: BoundaryEdges, size: RegionSizes, room: Int[np.ndarray, " r"], seeds: Sequence[Seeds | None]
) -> tuple[Places, Owners]:
    """The inner points from which refinement starts, and their regions, in ascending order."""
    given = {k: one for k, one in enumerate(seeds) if one is not None}
    is_bare, found = np.array([one is None for one in seeds]), []
    if is_bare.any():
        found.append(_lattices(boundary, size, np.where(is_bare, room, 0)))
    if given:
        points, spacing = map(np.concatenate, zip(*given.values(), strict=True))
        of = np.repeat([*given], [len(one.points) for one in given.values()])
        found.append(_tips_and_seeds(boundary, size, [*given], points, of, spacing))
    inner, of = map(np.concatenate, zip(*found, strict=True))
    order = np.argsort(of, kind="stable")
    return inner[order], of[order]


def _lattices(boundary: BoundaryEdges, size: RegionSizes, room: Int[np.ndarray, " r"]) -> tuple[Places, Owners]:
    """Points of lattices in each region with room whose spacing is the largest wanted size there."""
    points, after, owner = boundary.points, boundary.after, boundary.region
    area = 0.5 * np.bincount(owner, (np.conj(points) * points[after]).imag)
    # limits the number of rows in very thin polygons
    shortest = np.bincount(owner, np.abs(boundary.edge)) / _MOST_ROWS
    spacing = np.maximum(np.sqrt(area / _SIZE_SAMPLES), shortest)
    spacing[room == 0] = np.inf
    sample, of = lattices_inside(points, spacing[owner], after, owner)
    largest = np.zeros(boundary.count)
    np.maximum.at(largest, of, size(sample, of))
    spacing = np.maximum(np.maximum(largest, shortest), np.sqrt(area / np.maximum(room, 1)))
    spacing[largest == 0] = np.inf
    lattice, of = lattices_inside(points, spacing[owner], after, owner)
    distance, _ = NearestPoints(points, owner).query(lattice, of)
    free = distance[:, 0] > _ROOM_AT_BOUNDARY * spacing[of]
    lattice, of = lattice[free], of[free]
    free = boundary.has_room(lattice, of)
    return lattice[free], of[free]


def _tips_and_seeds(
    boundary: BoundaryEdges, size: RegionSizes, regions: Sequence[int], z: Places, of: Owners, spacing: Lengths
) -> tuple[Complex[np.ndarray, " j"], Int[np.ndarray, " j"]]:
    """Tips of equilateral triangles on the boundary edges of regions, and the lattice points z far enough from them.

    All of them lie inside their regions and not too near to an edge; a region where tips are too near to each other has
    none. Returns the points and their regions.
    """
    own = np.flatnonzero(np.isin(boundary.region, regions))
    polygon, owner, edge = boundary.points[own], boundary.region[own], boundary.edge[own]
    tips, length = 0.5 * (polygon + boundary.points[boundary.after[own]]) + 1j * np.sqrt(0.75) * edge, np.abs(edge)
    kept = np.bincount(owner[independent(tips, owner, _FROM_TIPS * length, length)], minlength=boundary.count)
    free = (kept == np.bincount(owner, minlength=boundary.count))[owner] & boundary.has_room(tips, owner)
    row = np.concatenate([tips[free], polygon])
    away = np.concatenate([_FROM_TIPS * length[free], _FROM_VERTICES * length])
    tree = NearestPoints(row, np.concatenate([owner[free], owner]))
    distance, nearest = tree.query(z, of, within=away.max())  # (inf, n) beyond
    clear = (distance[:, 0] > np.append(away, 0.0)[nearest[:, 0]]) & boundary.has_room(z, of)
    z, spacing, of = z[clear], spacing[clear], of[clear]
    wide = spacing > _LEAST_SPACING * size(z, of)
    return np.concatenate([tips[free], z[wide]]), np.concatenate([owner[free], of[wide]])
