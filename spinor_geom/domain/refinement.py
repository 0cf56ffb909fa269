"""Delaunay refinement of plane regions, and smoothing of the inner points."""

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import (
    ConstrainedDelaunay,
    Lengths,
    Owners,
    Places,
    circumcircles,
    cross,
    plane_coordinates,
)
from spinor_geom.domain.polygons import are_inside
from spinor_geom.domain.sizes import NearestPoints, RegionSizes

GOOD_ANGLE = np.radians(25.0)  # triangles without smaller angles are kept; above 30° the number of points grows quickly
_LEAST_SINE = np.sin(GOOD_ANGLE)
# a triangle is too large when its circumradius exceeds this times the wanted edge length (equilateral: 1.3 edges)
_LARGEST_RADIUS = 0.75
_DOUBTFUL = 0.8  # share of that radius above which the size at the centroid replaces the mean of the vertices
_BATCH_SPACING = 0.8  # least distance of new points of one batch, per smaller circumradius
_BATCHES = 60  # the number of points grows geometrically with the batches
# a boundary edge subtends at most 110° at new points; 90° would leave no room beside short edges next to long ones
_WIDEST_VIEW = np.cos(np.radians(180 - 110))
# longest inner edge between two boundary vertices, in wanted edge lengths; shorter where it cuts off one vertex
_LONGEST_BRIDGE, _LONGEST_EAR = 1.45, 1.05
_ROUND_ENOUGH = 0.4  # smoothing must not reduce the roundness (1: equilateral) of triangles below this
_MOVES = 2  # more do not improve the angles
# a point of a poor triangle is tried at eight places around it, at these multiples of the length of its edges
POLISHING_STEPS, AROUND = (0.3, 0.3, 0.15, 0.15, 0.08, 0.08), np.exp(2j * np.pi * np.arange(8) / 8)


class BoundaryEdges:
    """The boundary edges of all regions, by their first vertices, and tests of points against them."""

    def __init__(
        self, points: Complex[np.ndarray, " m"], after: Int[np.ndarray, " m"], region: Int[np.ndarray, " m"]
    ) -> None:
        self.points, self.after, self.region = points, after, region
        self.edge, self.count = points[after] - points, int(region[-1]) + 1
        self._half = 0.5 * self.edge
        # an edge subtends a right angle on the circle of which it is a diameter, and larger angles inside
        self._centres, self._radii = points + self._half, np.abs(self._half)

    def too_near(self, z: Places, region: Owners) -> Bool[np.ndarray, " k"]:
        """Whether a boundary edge of its region subtends too large an angle at each point."""
        near_edge = np.zeros(len(z), dtype=bool)
        if len(z):
            point, edge = NearestPoints(z, region).within(self._radii, of=self._centres, region=self.region)
            offset, half = z[point] - self._centres[edge], self._half[edge]
            seen = (offset + half) * np.conj(offset - half)
            near_edge[point[seen.real < -_WIDEST_VIEW * np.abs(seen)]] = True
        return near_edge

    def has_room(self, z: Places, region: Owners) -> Bool[np.ndarray, " k"]:
        """Whether each point lies inside its region and is not too near to an edge."""
        inside = are_inside(z, region, self.points, self.after, self.region)
        return np.asarray(inside & ~self.too_near(z, region))


def refine(
    mesh: ConstrainedDelaunay,
    boundary: BoundaryEdges,
    size: RegionSizes,
    room: Int[np.ndarray, " r"],
) -> None:
    """Inserts batches of circumcentres until no triangle is poor, except where a circumcentre has no room.

    `room` is the largest number of inner points of each region.
    """
    at_points = size(mesh.points, mesh.region)
    at_centres = np.zeros(boundary.count, dtype=bool)  # regions whose sizes are also computed at centroids
    # triangles with an open vertex are tested: new vertices, and those of triangles whose centre was not inserted
    is_open = np.ones(len(mesh.points), dtype=bool)
    for _ in range(_BATCHES):
        seen = mesh.inside[is_open[mesh.triangles].any(axis=1)]
        faces = mesh.faces[seen]
        p, owner = mesh.points[faces], mesh.region[faces[:, 0]]
        # the mean of the sizes at the vertices is enough until the triangles are nearly small enough
        wanted = at_points[faces].mean(axis=1)
        centre, radius, shortest = circumcircles(p)
        doubtful = np.flatnonzero(at_centres[owner] & (radius > _DOUBTFUL * _LARGEST_RADIUS * wanted))
        if len(doubtful):
            wanted[doubtful] = size(p[doubtful].mean(axis=1), owner[doubtful])
        excess = radius / (_LARGEST_RADIUS * wanted)
        poor = np.flatnonzero((excess > 1) | (shortest < 2 * radius * _LEAST_SINE))
        poor = poor[~boundary.too_near(centre[poor], owner[poor])]
        if len(poor):
            poor = poor[mesh.reaches(seen[poor], centre[poor])]
        some = independent(centre[poor], owner[poor], _BATCH_SPACING * radius[poor], excess[poor])
        chosen = poor[some]
        there = np.bincount(mesh.region[mesh.boundary_size :], minlength=boundary.count)
        new = chosen[place_in_region(owner[chosen]) < (room - there)[owner[chosen]]]
        has_new = np.zeros(boundary.count, dtype=bool)
        has_new[owner[new]] = True
        switched = ~has_new & ~at_centres
        if not (has_new | switched).any():
            break
        at_centres |= switched
        lost = np.delete(poor, some)
        is_open = switched[mesh.region]
        is_open[faces[lost[has_new[owner[lost]]]]] = True
        is_open = np.concatenate([is_open, np.ones(len(new), dtype=bool)])
        at_points = np.concatenate([at_points, size(centre[new], owner[new])])
        mesh.insert(centre[new], owner[new])


def independent(z: Places, region: Owners, spacing: Lengths, priority: Lengths) -> Int[np.ndarray, " s"]:
    """Indices of a subset of the points in which no two of one region are nearer than their smaller spacing.

    Points of higher priority are preferred.
    """
    if len(z) < 2:
        return np.arange(len(z))
    # first, the point of highest priority in each square cell with sides of a quarter to half a spacing
    level = np.floor(np.log2(spacing))
    cell = np.column_stack([np.floor(plane_coordinates(z) / (0.5 * 2.0**level)[:, None]), level, region])
    order = np.lexsort((-priority, *cell.T))
    first = order[np.append(True, (np.diff(cell[order], axis=0) != 0).any(axis=1))]
    z, region, spacing, priority = z[first], region[first], spacing[first], priority[first]
    rank = np.empty(len(z), dtype=np.int64)
    rank[np.argsort(-priority, kind="stable")] = np.arange(len(z))
    distance, index = NearestPoints(z, region).query(z, region, count=9, within=spacing.max())
    own, place = np.nonzero(distance[:, 1:] < spacing[:, None])
    other = index[own, place + 1]
    conflict = distance[own, place + 1] < spacing[other]
    own, other = own[conflict], other[conflict]
    if not len(own):
        return np.asarray(first)
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


def split_long_bridges(mesh: ConstrainedDelaunay, boundary: BoundaryEdges, size: RegionSizes) -> None:
    """Splits long inner edges between boundary vertices where there is room, in up to three rounds."""
    for _ in range(3):
        middle, of = _long_bridges(mesh, boundary, size)
        if len(middle) == 0:
            break
        mesh.insert(middle, of)


def _long_bridges(mesh: ConstrainedDelaunay, boundary: BoundaryEdges, size: RegionSizes) -> tuple[Places, Owners]:
    """Points that split long inner edges between boundary vertices, where there is room, and their regions."""
    m, points, faces, after = mesh.boundary_size, mesh.points, mesh.triangles, boundary.after
    a, b, c = faces.ravel(), faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    sides = np.flatnonzero((a < m) & (b < m))
    sides = sides[after[a[sides]] != b[sides]]
    # each edge once from either side
    low, high = np.minimum(a[sides], b[sides]), np.maximum(a[sides], b[sides])
    sides = sides[np.lexsort((high, low))].reshape(-1, 2)
    start, end = np.sort(np.stack([a[sides[:, 0]], b[sides[:, 0]]]), axis=0)
    owner = mesh.region[start]
    place, length = 0.5 * (points[start] + points[end]), np.abs(points[end] - points[start])
    # an ear cuts off a single convex vertex: it is split sooner, and its point lies farther inside
    one_sided = (c[sides] < m).sum(axis=1) == 1
    is_next = after[after[start]] == end
    ear = (is_next | (after[after[end]] == start)) & one_sided
    tip = points[after[np.where(is_next, start, end)]]
    long = length > np.where(ear, _LONGEST_EAR, _LONGEST_BRIDGE) * size(place, owner)
    place, length, owner = np.where(ear, tip + 1.1 * (place - tip), place)[long], length[long], owner[long]
    if not len(place):
        return place, owner
    distance, _ = NearestPoints(points, mesh.region).query(place, owner)
    free = (distance[:, 0] > 0.4 * length) & boundary.has_room(place, owner)
    place, length, owner = place[free], length[free], owner[free]
    chosen = independent(place, owner, 0.5 * length, length)
    return place[chosen], owner[chosen]


def place_in_region(region: Owners) -> Owners:
    """The position of each point among those of its region; regions are in ascending order."""
    return np.asarray(np.arange(len(region)) - np.searchsorted(region, region))


def smooth(mesh: ConstrainedDelaunay, boundary: BoundaryEdges) -> None:
    """Moves inner points to the mean of their neighbours, twice, and triangulates again.

    Points stay if they would be too near to the boundary, or would flip a face or make it thin.
    """
    points, faces, m = mesh.points, mesh.triangles, mesh.boundary_size
    n = len(points)
    if n == m:
        return
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    degree = np.bincount(a, minlength=n)[m:]
    for _ in range(_MOVES):
        total = np.bincount(a, points.real[b], n) + 1j * np.bincount(a, points.imag[b], n)
        moved = points.copy()
        moved[m:] = total[m:] / degree
        near = m + np.flatnonzero(boundary.too_near(moved[m:], mesh.region[m:]))
        moved[near] = points[near]
        points = _held_back(mesh, points, moved)
    mesh.move(points, np.unique(mesh.region[m:]))


def polish(mesh: ConstrainedDelaunay, boundary: BoundaryEdges) -> None:
    """Moves inner points of triangles with an angle below 25° to the best of a few places nearby.

    Places too near to the boundary are excluded.
    """
    for step in POLISHING_STEPS:
        points, faces = mesh.points, mesh.triangles
        chosen = _worst_points(mesh, faces)
        if not chosen.any():
            break
        # every corner of a face at a chosen point, sorted by point
        corner = np.flatnonzero(chosen[faces].ravel())
        corner = corner[np.argsort(faces.ravel()[corner], kind="stable")]
        own, face, k = faces.ravel()[corner], corner // 3, corner % 3
        p, q = points[faces[face, (k + 1) % 3]], points[faces[face, (k + 2) % 3]]
        start = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
        vertex, count = own[start], np.diff(np.append(start, len(own)))
        reach = np.add.reduceat(np.abs(p - points[own]), start) / count
        mean = np.add.reduceat(p, start) / count
        places = points[vertex][:, None] + step * reach[:, None] * np.append(0, AROUND)
        places = np.append(places, mean[:, None], axis=1)
        sines = smallest_sine(np.repeat(places, count, axis=0), p[:, None], q[:, None])
        quality = np.minimum.reduceat(sines, start, axis=0)
        near = boundary.too_near(places.ravel(), np.repeat(mesh.region[vertex], places.shape[1]))
        best = np.where(near.reshape(places.shape), -1.0, quality).argmax(axis=1)
        points = points.copy()
        points[vertex] = places[np.arange(len(vertex)), best]
        mesh.move(points, np.unique(mesh.region[vertex]))


def smallest_sine(
    a: Complex[np.ndarray, "*#n"], b: Complex[np.ndarray, "*#n"], c: Complex[np.ndarray, "*#n"]
) -> Float[np.ndarray, "*n"]:
    """Sine of the smallest angle of triangles a, b, c; negative for clockwise ones."""
    ab, bc, ca = np.abs(b - a), np.abs(c - b), np.abs(a - c)
    longest = np.maximum(ab, np.maximum(bc, ca))
    middle = ab + bc + ca - longest - np.minimum(ab, np.minimum(bc, ca))
    return np.asarray(cross(b - a, c - a) / (longest * middle))


def _worst_points(mesh: ConstrainedDelaunay, faces: Int[np.ndarray, "t 3"]) -> Bool[np.ndarray, " n"]:
    """Mask of inner points of poor triangles that are worse than all their neighbours, so can move independently."""
    n = len(mesh.points)
    quality = smallest_sine(*mesh.points[faces].T)
    poor = np.flatnonzero(quality < _LEAST_SINE)
    if not len(poor):
        return np.zeros(n, dtype=bool)
    key = np.full(n, np.inf)
    np.minimum.at(key, faces[poor].ravel(), np.repeat(quality[poor], 3))
    key[: mesh.boundary_size] = np.inf
    for own in mesh.own:  # breaks ties between the corners of a triangle
        key[own] += np.arange(len(own)) * 1e-12
    least = np.full(n, np.inf)
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    np.minimum.at(least, a, key[b])
    np.minimum.at(least, b, key[a])
    return np.asarray(np.isfinite(key) & (key < least))


def _held_back(mesh: ConstrainedDelaunay, points: Places, moved: Places) -> Places:
    """The moved points, with the corners of faces that the move would flip or make thin reset."""
    faces = mesh.triangles
    before = _roundness(points[faces])
    for _ in range(10):
        after = _roundness(moved[faces])
        worse = (after < _ROUND_ENOUGH) & (after < before)
        if not worse.any():
            return moved
        back = faces[worse].ravel()
        moved[back] = points[back]
    # regions that still have such faces keep all their points
    return np.where(np.isin(mesh.region, mesh.region[back]), points, moved)


def _roundness(p: Complex[np.ndarray, "t 3"]) -> Float[np.ndarray, " t"]:
    """Area per sum of squared edges, scaled to 1 for an equilateral triangle; not positive for a flipped one."""
    b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    squares = np.abs(b) ** 2 + np.abs(c) ** 2 + np.abs(c - b) ** 2
    return np.asarray(2 * np.sqrt(3.0) * cross(b, c) / squares)
