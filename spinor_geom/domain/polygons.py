"""Closed plane polygons: where they cross themselves, what they bound and with what points, how near they come."""

import itertools

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import cross, flat_coordinates
from spinor_geom.mesh.boxes import edges_with_near_boxes
from spinor_geom.mesh.intersections import crossings_between
from spinor_geom.mesh.operators import winding_numbers

_ROWS = 64  # pairs, or rows of a table of distances, that are looked at together


def crossing_edges(polygon: Complex[np.ndarray, " m"]) -> Int[np.ndarray, "c 2"]:
    """Pairs i < j of edges of a closed polygon that cross; neighbours count where one folds back onto the other."""
    m = len(polygon)
    ends = np.stack([polygon, np.roll(polygon, -1)])
    edge = ends[1] - ends[0]
    i, j = edges_with_near_boxes(flat_coordinates(ends[0]), flat_coordinates(ends[1]), 0.0)
    apart = (j - i > 1) & (j - i < m - 1)
    i, j = i[apart], j[apart]
    on_line = 1e-12 * np.abs(edge) * np.abs(polygon - polygon[0]).max()

    def parts(one: Int[np.ndarray, " k"], other: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        side = np.imag(np.conj(edge[one]) * (ends[:, other] - polygon[one]))
        # points on the line of an edge are on neither side: edges of one straight side do not cross by round-off
        side[np.abs(side) <= on_line[one]] = 0
        return np.asarray(side[0] * side[1] < 0)

    hit = parts(i, j)
    hit[hit] = parts(j[hit], i[hit])
    turn = np.conj(edge) * np.roll(edge, -1)
    back = np.flatnonzero((turn.imag == 0) & (turn.real < 0))
    folds = np.sort(np.stack([back, (back + 1) % m], axis=1), axis=1)
    pairs = np.concatenate([np.stack([i[hit], j[hit]], axis=1), folds])
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


def is_simple(polygon: Complex[np.ndarray, " m"]) -> bool:
    """Whether a closed polygon runs counter-clockwise, stands still nowhere and does not cross itself."""
    after = np.roll(polygon, -1)
    edges = np.abs(after - polygon)
    # a shorter edge is lost in the arc length around
    moves = bool((edges > np.finfo(np.float64).eps * edges.sum()).all())
    return moves and bool(np.imag(np.conj(polygon) * after).sum() > 0) and not len(crossing_edges(polygon))


def bound_domain(rims: tuple[Complex[np.ndarray, "_"], ...]) -> bool:
    """Whether the first of some polygons is simple and has the others, simple and clockwise, inside and apart."""
    outer, *holes = rims
    if not is_simple(outer) or not all(is_simple(hole[::-1]) for hole in holes):
        return False
    flat = [flat_coordinates(rim) for rim in rims]
    if any(len(crossings_between(*pair)) for pair in itertools.combinations(flat, 2)):
        return False
    # in the outer one and in no other hole
    around = [
        sum(winding_numbers(other[:, :2], hole[:1, :2])[0] for other in flat if other is not hole) for hole in flat[1:]
    ]
    return bool((np.rint(around) == 1).all())


def untangled(polygon: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"] | None:
    """A simple polygon near to one that is crossed only by small lobes of itself; None where far parts cross.

    The vertices of each lobe are drawn towards the chord that closes it until it is gone. Ragged rims of scans unfold
    with such lobes; any simple domain will do there, and only a few edges are moved.
    """
    z: Complex[np.ndarray, " m"] = polygon.copy()
    m = len(polygon)
    for _ in range(60):
        pairs = crossing_edges(z)
        if not len(pairs):
            return z
        first, last = pairs.T
        forwards = last - first
        swap = forwards > m - forwards
        first, last = np.where(swap, last, first), np.where(swap, first, last)
        size = np.mod(last - first, m)  # inner vertices of the lobe: first + 1 … last
        if size.max() > min(24, m // 3):
            return None
        for start, count in zip(first.tolist(), size.tolist(), strict=True):
            inner = (start + 1 + np.arange(count)) % m
            share = np.arange(1, count + 1) / (count + 1)
            chord = z[start] + share * (z[(start + count + 1) % m] - z[start])
            z[inner] += 0.5 * (chord - z[inner])
    return None


def outer_clearance(polygon: Complex[np.ndarray, " m"]) -> float:
    """Smallest gap across the outside between far parts of a simple polygon, in local edge lengths.

    Far: the way along the boundary is more than four times the gap plus six edges.
    """
    a, b = polygon, np.roll(polygon, -1)
    edge = np.abs(b - a)
    local = (edge + np.roll(edge, 1)) / 2
    s = np.concatenate([[0.0], np.cumsum(edge)[:-1]])

    def near(rows: slice) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
        along = np.abs(s[rows, None] - s)
        along = np.minimum(along, edge.sum() - along)
        gap, longer = np.abs(a[rows, None] - a), np.maximum(local[rows, None], local)
        relative = gap / longer
        i, j = np.nonzero(np.triu((relative < 8) & (along > 4 * gap + 6 * longer), rows.start))
        return relative[i, j], i + rows.start, j

    # some rows at a time: all pairs of a long boundary take gigabytes
    found = [near(slice(start, start + _ROWS)) for start in range(0, len(a), _ROWS)]
    relative, i, j = (np.concatenate(parts) for parts in zip(*found, strict=True))
    if not len(i):
        return np.inf
    order = np.argsort(relative)
    relative, i, j = relative[order], i[order], j[order]
    # the smallest gaps first: the first that lies outside all along is the answer
    for start in range(0, len(i), _ROWS):
        block = slice(start, start + _ROWS)
        along_gap = a[i[block], None] + np.array([0.2, 0.5, 0.8]) * (a[j[block]] - a[i[block]])[:, None]
        d = a - along_gap[:, :, None]
        outside = (np.angle(np.roll(d, -1, axis=2) * np.conj(d)).sum(axis=2) < np.pi).all(axis=1)
        if outside.any():
            first = start + int(np.argmax(outside))
            return float(relative[first])
    return np.inf


def lattice_inside(polygon: Complex[np.ndarray, " m"], spacing: float) -> Complex[np.ndarray, " k"]:
    """The points inside a polygon of the triangular lattice with rows along the x-axis; see `lattices_inside`."""
    return lattices_inside(polygon, np.full(len(polygon), spacing), np.roll(np.arange(len(polygon)), -1), 0)[0]


def lattices_inside(
    polygons: Complex[np.ndarray, " m"],
    spacing: Float[np.ndarray, " m"],
    after: Int[np.ndarray, " m"],
    region: Int[np.ndarray, " m"] | int,
) -> tuple[Complex[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """The points of triangular lattices inside polygons, or between them, and their regions, which ascend.

    Row by row: a row enters and leaves a region by turns where it crosses the edges. Takes time and memory in
    proportion to the crossings and the points. Of every vertex of the simple polygons come the distance of neighbouring
    points of its region's lattice, the number of the next vertex on its polygon, and the region.
    """
    height = np.sqrt(0.75) * spacing
    end = polygons[after]
    low, high = np.minimum(polygons.imag, end.imag), np.maximum(polygons.imag, end.imag)
    # the edges cross the rows from the first at or above their low end to the last below their high end
    first, last = np.ceil(low / height).astype(np.int64), np.ceil(high / height).astype(np.int64)
    edge, row = _ranges(first, last - first)
    share = (row * height[edge] - polygons.imag[edge]) / (end.imag - polygons.imag)[edge]
    x = polygons.real[edge] + share * (end.real - polygons.real)[edge]
    order = np.lexsort((x, row, np.broadcast_to(region, len(polygons))[edge]))
    edge, row, x = edge[order[::2]], row[order[::2]], x[order]
    shift = 0.5 * (row % 2)
    left = np.ceil(x[::2] / spacing[edge] - shift).astype(np.int64)
    right = np.ceil(x[1::2] / spacing[edge] - shift).astype(np.int64)
    piece, column = _ranges(left, right - left)
    edge, row = edge[piece], row[piece]
    points = (column + shift[piece]) * spacing[edge] + 1j * (row * height[edge])
    return np.asarray(points), np.broadcast_to(region, len(polygons))[edge]


def are_inside(
    z: Complex[np.ndarray, " k"],
    of: Int[np.ndarray, " k"],
    polygons: Complex[np.ndarray, " m"],
    after: Int[np.ndarray, " m"],
    region: Int[np.ndarray, " m"],
) -> Bool[np.ndarray, " k"]:
    """Whether points lie inside the polygons of their regions, or between them; `polygons` are as in `lattices_inside`.

    A ray from a point to the right crosses the edges an odd number of times. Takes time and memory in proportion to the
    points and the crossings of the whole lines.
    """
    end = polygons[after]
    # the edges' lower ends, then the upper ones, then the points: a line through a vertex meets one of its edges
    heights = np.concatenate([np.minimum(polygons.imag, end.imag), np.maximum(polygons.imag, end.imag), z.imag])
    order = np.lexsort((heights, np.concatenate([region, region, of])))
    is_point = order >= 2 * len(polygons)
    below = np.empty(len(order), dtype=np.int64)
    below[order] = np.cumsum(is_point)
    first, last = below[: len(polygons)], below[len(polygons) : 2 * len(polygons)]
    edge, place = _ranges(first, last - first)
    point = order[is_point][place] - 2 * len(polygons)
    side = cross((end - polygons)[edge], z[point] - polygons[edge])
    right = np.where((end.imag > polygons.imag)[edge], side > 0, side < 0)
    return np.asarray(np.bincount(point[right], minlength=len(z)) % 2 == 1)


def _ranges(
    first: Int[np.ndarray, " n"], count: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Numbers first, first + 1, … for each of n ranges, one range after the other, and whose each number is."""
    owner = np.repeat(np.arange(len(first)), count)
    return owner, np.arange(len(owner)) + (first + count - np.cumsum(count))[owner]
