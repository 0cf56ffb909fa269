"""Triangulation of a simple plane polygon, with holes or not, whose boundary stays as it is, vertex by vertex."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import (
    ConstrainedDelaunay,
    Rims,
    circumcircles,
    constrained_delaunay,
    edge_codes,
    plane_coordinates,
    reachable,
    rim_successors,
    unique_edges,
)
from spinor_geom.domain.lattice import lattice_inside
from spinor_geom.domain.sizes import SizeFunction
from spinor_geom.domain.smoothing import polish, smooth
from spinor_geom.errors import DomainError, OptionError

# of a triangulation, if nothing else is said
MOST_POINTS = 200_000
# in degrees, below which a triangle is refined; above 30 the number of points grows quickly
_MIN_ANGLE = 25.0
# points at which the largest size is looked for, and shares of it by which lattice points keep off the boundary
_SIZE_SAMPLES, _ROOM_AT_BOUNDARY = 100, 2.0
_MOST_ROWS = 20_000
# in radians, from which on a polygon's turn to the left is no rounding error
_STRAIGHT = 1e-9
# seeds keep this share of the lengths of edges from the tips of triangles on the boundary, and from its vertices, and
# this share of the wanted size from each other
_FROM_TIPS, _FROM_VERTICES, _LEAST_SPACING = 0.75, 1.2, 0.7
# a triangle is too large when its circumradius exceeds this times the wanted edge length (equilateral: 1.3 edges)
_LARGEST_RADIUS = 0.75
# where it comes near to that by the lengths wanted at its corners, the one wanted in its middle decides
_DOUBTFUL = 0.8
# new points of one batch keep this share of the smaller of their circumradii between them
_BATCH_SPACING = 0.8
# a batch adds points in proportion to those there are, so the number of batches grows like a logarithm
_BATCHES = 60
# no new point sees a boundary edge under more than 110°; a right angle leaves short edges beside long ones no room
_WIDEST_VIEW = np.cos(np.radians(180 - 110))
# an inner edge between two boundary vertices is split from this many wanted edge lengths on, sooner at a corner
_LONGEST_BRIDGE = 1.45
_LONGEST_EAR = 1.05


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneTriangulation:
    """A triangulated simple polygon, with holes or without.

    Attributes:
        points: Vertices x + iy; the boundary comes first, counter-clockwise, equal to the input bit for bit; after it
            the boundaries of holes, clockwise.
        faces: Counter-clockwise triangles, indices into `points`.
        boundary_size: Number of boundary vertices, those of holes included.
        hole_sizes: Numbers of vertices of the holes.
    """

    points: Complex[np.ndarray, " n"]
    faces: Int[np.ndarray, "t 3"]
    boundary_size: int
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
        return np.asarray(np.degrees(np.angle(back * np.conj(ahead))))

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Every edge once, smaller index first, sorted."""
        return unique_edges(self.faces, len(self.points))


def triangulate_polygon(
    boundary: Complex[np.ndarray, " m"],
    size: SizeFunction,
    *,
    holes: Sequence[Complex[np.ndarray, " _"]] = (),
    seeds: Complex[np.ndarray, " k"] | None = None,
    max_points: int = MOST_POINTS,
) -> PlaneTriangulation:
    """Triangulates a simple polygon with inner points so that edges are about `size` long and angles are large.

    Delaunay refinement: circumcentres of triangles that are too large for the size function or have an angle below
    25° are inserted in batches of mutually distant ones, never close to a boundary edge, so no boundary edge is
    ever split. Then edges that bridge the polygon between two boundary vertices get a point where there is room (where
    the polygon is one triangle wide they stay), the inner points are smoothed, and those of triangles that are still
    poor are moved one by one. Small angles that the boundary itself forces stay.

    Args:
        boundary: Vertices of the polygon, counter-clockwise, without repetition of the first.
        size: Wanted edge length at points (k,), in units of the polygon.
        holes: Polygons inside it, clockwise, that are left out.
        seeds: Points inside, about as far from each other as is wanted, to start from; those that are too near to the
            boundary are not taken. By default those of a lattice as wide as the largest of the sizes wanted.
        max_points: No further points are inserted when there are so many in all.

    Raises:
        DomainError: The polygon is clockwise, has fewer than three vertices or a vertex that is not finite, or touches
            or crosses itself; or a hole is counter-clockwise, not inside it, or otherwise such.
        OptionError: `size` gives a value that is not positive and finite.

    Source: Ruppert (1995), A Delaunay refinement algorithm for quality 2-dimensional mesh generation, J. Algorithms 18.
    """
    polygons = [np.array(polygon, dtype=np.complex128) for polygon in (boundary, *holes)]
    for number, polygon in enumerate(polygons):
        _require_polygon(polygon, clockwise=number > 0)
    rims = tuple(map(len, polygons))
    boundary, m, hole_sizes = np.concatenate(polygons), sum(rims), rims[1:]
    if sum(map(_area, polygons)) <= 0:
        raise DomainError("a hole is not inside the polygon", vertices=m)
    if m == 3:
        return PlaneTriangulation(points=boundary, faces=np.array([[0, 1, 2]]), boundary_size=3)
    # at unit size about the origin a polygon is the same wherever and however large it is given
    centre, scale = boundary.mean(), np.abs(boundary - boundary.mean()).max()
    polygon = (boundary - centre) / scale

    def wanted(z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        h = size(z * scale + centre)
        wrong = ~((h > 0) & np.isfinite(h))
        if wrong.any():
            raise OptionError(f"the size function must give positive, finite lengths, got {h[wrong][0]}")
        return np.asarray(h / scale)

    after = rim_successors(rims)
    if holes or not _is_convex(polygon):
        _require_simple(polygon, rims)
    guard = _Guard(polygon, after)
    if seeds is None:
        inner = _seeds(polygon, after, guard, wanted, max_points - m)
        lengths = wanted(inner)
    else:
        inner, lengths = _behind_a_row(polygon, after, guard, wanted, (seeds - centre) / scale)
    some = slice(max(0, max_points - m))
    points, lengths = np.append(polygon, inner[some]), np.append(wanted(polygon), lengths[some])
    points, faces = _refine(points, lengths, ConstrainedDelaunay(points, rims), guard, wanted, max_points)
    for _ in range(3):
        middle = _long_bridges(points, faces, after, wanted, guard)
        if len(middle) == 0:
            break
        points = np.append(points, middle)
        faces = constrained_delaunay(points, rims)
    points, faces = smooth(points, faces, rims)
    points, faces = polish(points, faces, rims, _MIN_ANGLE)
    result = points * scale + centre
    result[:m] = boundary
    return PlaneTriangulation(points=result, faces=faces, boundary_size=m, hole_sizes=hole_sizes)


def _require_polygon(polygon: Complex[np.ndarray, " m"], *, clockwise: bool) -> None:
    m, name = len(polygon), "a hole" if clockwise else "the polygon"
    if m < 3 or not np.isfinite(polygon).all():
        raise DomainError(f"{name} needs at least 3 finite vertices, got {m}", vertices=m)
    area = _area(polygon)
    if clockwise and area >= 0:
        raise DomainError("a hole runs counter-clockwise or has no area; give it clockwise", vertices=m)
    if not clockwise and area <= 0:
        raise DomainError("the polygon runs clockwise or has no area; give it counter-clockwise", vertices=m)


def _is_convex(polygon: Complex[np.ndarray, " m"]) -> bool:
    """Whether a polygon turns to the left at each vertex, and once in all; then it is simple."""
    edge = np.roll(polygon, -1) - polygon
    turn = np.angle(np.roll(edge, -1) * np.conj(edge))
    return bool((turn > _STRAIGHT).all() and turn.sum() < 3 * np.pi)


def _require_simple(polygon: Complex[np.ndarray, " m"], rims: Rims) -> None:
    m = len(polygon)
    mesh = ConstrainedDelaunay(polygon, rims)
    faces = mesh.faces[mesh.inside]
    sides = (mesh.neighbours[mesh.inside] < 0).sum()
    count = m - 2 + 2 * (len(rims) - 1)
    if len(faces) != count or len(unique_edges(faces, m)) != (3 * count + m) // 2 or sides != m:
        raise DomainError(
            "the boundary is not simple: a vertex lies on another edge, or a hole is not inside the polygon", vertices=m
        )


def _area(polygon: Complex[np.ndarray, " m"]) -> float:
    return 0.5 * float((np.conj(polygon) * np.roll(polygon, -1)).imag.sum())


class _Guard:
    """Tells which points lie so near a boundary edge that they see it under too large an angle."""

    def __init__(self, boundary: Complex[np.ndarray, " m"], after: Int[np.ndarray, " m"]) -> None:
        middle, half = 0.5 * (boundary[after] + boundary), 0.5 * (boundary[after] - boundary)
        # edges of about one length share a tree, so that a few nearest ones are enough
        group = np.floor(np.log2(np.abs(half))).astype(int)
        self._groups = [
            (cKDTree(plane_coordinates(middle[group == g])), middle[group == g], half[group == g])
            for g in np.unique(group)
        ]

    def too_near(self, z: Complex[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        """Whether each point sees some boundary edge under too large an angle."""
        inside = np.zeros(len(z), dtype=bool)
        if len(z) == 0:
            return inside
        for tree, middle, half in self._groups:
            reach = np.abs(half).max()
            nearest = np.arange(1, min(4, len(half)) + 1)
            distance, index = tree.query(plane_coordinates(z), k=nearest, distance_upper_bound=reach)
            point, near = np.nonzero(distance < reach)
            edge = np.asarray(index)[point, near]
            offset = z[point] - middle[edge]
            seen = (offset + half[edge]) * np.conj(offset - half[edge])
            inside[point[seen.real < -_WIDEST_VIEW * np.abs(seen)]] = True
        return inside


def _seeds(
    polygon: Complex[np.ndarray, " m"], after: Int[np.ndarray, " m"], guard: _Guard, size: SizeFunction, most: int
) -> Complex[np.ndarray, " k"]:
    """Points of a lattice as wide as the largest of the sizes wanted: inner points to start from."""
    area = 0.5 * (np.conj(polygon) * polygon[after]).imag.sum()
    # a polygon that is hardly wider than a line must not be crossed by millions of rows
    shortest = np.abs(polygon[after] - polygon).sum() / _MOST_ROWS
    sample = lattice_inside(polygon, max(np.sqrt(area / _SIZE_SAMPLES), shortest), after=after)
    if len(sample) == 0 or most <= 0:
        return sample[:0]
    spacing = max(float(size(sample).max()), np.sqrt(area / most), shortest)
    points = lattice_inside(polygon, spacing, after=after)
    distance, _ = cKDTree(plane_coordinates(polygon)).query(plane_coordinates(points))
    points = points[np.asarray(distance) > _ROOM_AT_BOUNDARY * spacing]
    return np.asarray(points[~guard.too_near(points)])


def _behind_a_row(
    polygon: Complex[np.ndarray, " m"],
    after: Int[np.ndarray, " m"],
    guard: _Guard,
    size: SizeFunction,
    seeds: Complex[np.ndarray, " k"],
) -> tuple[Complex[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """The tips of equilateral triangles on the edges of a polygon, and behind them the seeds that stand wide enough.

    The sizes wanted there come with them. Edges that turn much from one to the next have no room for a row of tips.
    """
    edge = polygon[after] - polygon
    tips, length = 0.5 * (polygon + polygon[after]) + 1j * np.sqrt(0.75) * edge, np.abs(edge)
    if len(_independent(tips, _FROM_TIPS * length, length)) < len(tips):
        tips, length = tips[:0], length[:0]
    free = ~guard.too_near(tips)
    tips, length = tips[free], length[free]
    wanted = size(seeds)
    if len(seeds) > 1:
        spacing, _ = cKDTree(plane_coordinates(seeds)).query(plane_coordinates(seeds), k=[2])
        wide = np.asarray(spacing)[:, 0] > _LEAST_SPACING * wanted
        seeds, wanted = seeds[wide], wanted[wide]
    row = np.concatenate([tips, polygon])
    away = np.concatenate([_FROM_TIPS * length, _FROM_VERTICES * np.abs(edge)])
    distance, nearest = cKDTree(plane_coordinates(row)).query(plane_coordinates(seeds))
    clear = np.asarray(distance) > away[np.asarray(nearest)]
    return np.concatenate([tips, seeds[clear]]), np.concatenate([size(tips), wanted[clear]])


def _refine(
    points: Complex[np.ndarray, " n"],
    at_points: Float[np.ndarray, " n"],
    mesh: ConstrainedDelaunay,
    guard: _Guard,
    size: SizeFunction,
    max_points: int,
) -> tuple[Complex[np.ndarray, " k"], Int[np.ndarray, "s 3"]]:
    """Inserts batches of circumcentres until no triangle wants and can have one, given the sizes wanted at points."""
    sine = np.sin(np.radians(_MIN_ANGLE))
    at_centres = False
    # the triangles to look at are those of open vertices: the new ones, and those whose point lost against another
    is_open = np.ones(len(points), dtype=bool)
    for _ in range(_BATCHES):
        faces = mesh.faces
        seen = mesh.inside[is_open[faces[mesh.inside]].any(axis=1)]
        p = points[faces[seen]]
        # sizes at the vertices, each asked for once, are enough until the triangles are nearly small enough
        wanted = at_points[faces[seen]].mean(axis=1)
        centre, radius, shortest = circumcircles(p)
        if at_centres:
            doubtful = np.flatnonzero(radius > _DOUBTFUL * _LARGEST_RADIUS * wanted)
            wanted[doubtful] = size(p[doubtful].mean(axis=1))
        excess = radius / (_LARGEST_RADIUS * wanted)
        poor = np.flatnonzero((excess > 1) | (shortest < 2 * radius * sine))
        poor = poor[~guard.too_near(centre[poor])]
        if len(poor):
            poor = poor[reachable(points, faces, mesh.neighbours, seen[poor], centre[poor])]
        chosen = _independent(centre[poor], _BATCH_SPACING * radius[poor], excess[poor])
        new = centre[poor[chosen]][: max(0, max_points - len(points))]
        if len(new) == 0:
            if at_centres:
                break
            at_centres = True
            is_open[:] = True
            continue
        is_open = np.zeros(len(points) + len(new), dtype=bool)
        is_open[len(points) :] = True
        is_open[faces[seen[np.delete(poor, chosen)]]] = True
        points, at_points = np.append(points, new), np.append(at_points, size(new))
        mesh.insert(new)
    return points, mesh.faces[mesh.inside]


def _independent(
    z: Complex[np.ndarray, " k"], spacing: Float[np.ndarray, " k"], priority: Float[np.ndarray, " k"]
) -> Int[np.ndarray, " s"]:
    """Indices of points no two of which are nearer than the smaller of their spacings, high priority preferred."""
    if len(z) < 2:
        return np.arange(len(z))
    first = _first_in_cell(z, spacing, priority)
    if len(first) == 1:
        return first
    z, spacing, priority = z[first], spacing[first], priority[first]
    rank = np.empty(len(z), dtype=np.int64)
    rank[np.argsort(-priority, kind="stable")] = np.arange(len(z))
    plane = plane_coordinates(z)
    nearest = np.arange(2, min(9, len(z)) + 1)
    distance, index = cKDTree(plane).query(plane, k=nearest, distance_upper_bound=spacing.max())
    own, place = np.nonzero(distance < spacing[:, None])
    other = np.asarray(index)[own, place]
    conflict = np.asarray(distance)[own, place] < spacing[other]
    own, other = own[conflict], other[conflict]
    first_wins = rank[own] < rank[other]
    better, worse = np.where(first_wins, own, other), np.where(first_wins, other, own)
    taken, is_open = np.zeros(len(z), dtype=bool), np.ones(len(z), dtype=bool)
    for _ in range(8):
        blocked = np.zeros(len(z), dtype=bool)
        blocked[worse] = True
        taken |= is_open & ~blocked
        is_open &= blocked
        is_open[worse[taken[better]]] = False
        keep = is_open[better] & is_open[worse]
        better, worse = better[keep], worse[keep]
        if not is_open.any():
            break
    return np.asarray(first[taken])


def _first_in_cell(
    z: Complex[np.ndarray, " k"], spacing: Float[np.ndarray, " k"], priority: Float[np.ndarray, " k"]
) -> Int[np.ndarray, " s"]:
    """Index of the point of highest priority in each occupied square cell, a quarter to half a spacing wide."""
    level = np.floor(np.log2(spacing))
    x, y = np.floor(plane_coordinates(z) / (0.5 * 2.0**level)[:, None]).T
    order = np.lexsort((-priority, level, y, x))
    x, y, level = x[order], y[order], level[order]
    new = np.append(True, (x[1:] != x[:-1]) | (y[1:] != y[:-1]) | (level[1:] != level[:-1]))
    return np.asarray(order[new])


def _long_bridges(
    points: Complex[np.ndarray, " n"],
    faces: Int[np.ndarray, "t 3"],
    after: Int[np.ndarray, " m"],
    size: SizeFunction,
    guard: _Guard,
) -> Complex[np.ndarray, " k"]:
    """Points that split inner edges between boundary vertices, where the polygon has room for one."""
    m = len(after)
    edges = unique_edges(faces[(faces < m).sum(axis=1) > 1], len(points))
    edges = edges[edges[:, 1] < m]
    edges = edges[(after[edges] != edges[:, ::-1]).all(axis=1)]
    if len(edges) == 0:
        return points[:0]
    start, end = edges.T
    place, length = 0.5 * (points[start] + points[end]), np.abs(points[end] - points[start])
    # a bridge that hides one convex vertex from an inner point goes sooner, and its point lies farther in
    blocked = faces[(faces < m).all(axis=1)]
    code, count = np.unique(edge_codes(blocked, m), return_counts=True)
    one_sided = np.isin(start * m + end, code[count == 1])
    is_next = after[after[start]] == end
    ear = (is_next | (after[after[end]] == start)) & one_sided
    tip = points[after[np.where(is_next, start, end)]]
    long = length > np.where(ear, _LONGEST_EAR, _LONGEST_BRIDGE) * size(place)
    place = np.where(ear, tip + 1.1 * (place - tip), place)[long]
    distance, _ = cKDTree(plane_coordinates(points)).query(plane_coordinates(place))
    free = (distance > 0.4 * length[long]) & ~guard.too_near(place)
    place, length = place[free], length[long][free]
    return np.asarray(place[_independent(place, 0.5 * length, length)])
