"""Closed plane polygons: crossings, clearance, points inside."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.arrays import EPS, shifted
from spinor_geom.domain.delaunay import cross, flat_coordinates, plane_coordinates
from spinor_geom.mesh.intersections import crossings_between, is_star
from spinor_geom.mesh.near_edges import near_edges
from spinor_geom.mesh.operators import winding_numbers


def crossing_edges(polygon: Complex[np.ndarray, " m"]) -> Int[np.ndarray, "c 2"]:
    """Pairs i < j of edges of a closed polygon that cross, or are adjacent and overlap."""
    m = len(polygon)
    ends = np.stack([polygon, shifted(polygon, -1)])
    edge = ends[1] - ends[0]
    on_line = 1e-12 * np.abs(edge) * np.abs(polygon - polygon[0]).max()

    def has_ends_on_both_sides(one: Int[np.ndarray, " k"], other: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        side = np.imag(np.conj(edge[one]) * (ends[:, other] - polygon[one]))
        # edges of one straight side must not cross by rounding errors
        side[np.abs(side) <= on_line[one]] = 0
        return np.asarray(side[0] * side[1] < 0)

    def cross_each_other(i: Int[np.ndarray, " k"], j: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        apart = (j - i > 1) & (j - i < m - 1)
        return np.asarray(apart & has_ends_on_both_sides(i, j) & has_ends_on_both_sides(j, i))

    hits = near_edges(flat_coordinates(ends[0]), flat_coordinates(ends[1]), 0.0, cross_each_other)
    turn = np.conj(edge) * shifted(edge, -1)
    back = np.flatnonzero((turn.imag == 0) & (turn.real < 0))
    folds = np.sort(np.stack([back, (back + 1) % m], axis=1), axis=1)
    pairs = np.concatenate([hits, folds])
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


def is_simple(polygon: Complex[np.ndarray, " m"]) -> bool:
    """Whether a closed polygon runs counter-clockwise, has no edge of length 0 and does not cross itself."""
    after = shifted(polygon, -1)
    edges = np.abs(after - polygon)
    # shorter edges are lost in the rounding of the arc length
    has_length = bool((edges > EPS * edges.sum()).all())
    if not has_length or not np.imag(np.conj(polygon) * after).sum() > 0:
        return False
    return bool(is_star(flat_coordinates(polygon))) or not len(crossing_edges(polygon))


def bound_domain(rims: tuple[Complex[np.ndarray, "_"], ...]) -> bool:
    """Whether the first polygon is simple and the others, simple and clockwise, lie inside it and not in each other."""
    outer, *holes = rims
    if not is_simple(outer) or not all(is_simple(hole[::-1]) for hole in holes):
        return False
    flat = [flat_coordinates(rim) for rim in rims]
    if any(len(crossings_between(*pair)) for pair in itertools.combinations(flat, 2)):
        return False
    # holes run clockwise: the winding number of a point is 1 if it lies in the outer polygon and in no other hole
    for hole in flat[1:]:
        winding = sum(winding_numbers(other[:, :2], hole[:1, :2])[0] for other in flat if other is not hole)
        if round(winding) != 1:
            return False
    return True


def untangled(polygon: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"] | None:
    """The polygon with its small self-crossing lobes removed, or None if distant parts cross or a lobe remains.

    The vertices of each lobe are moved towards the chord that closes it until nothing crosses. Flattened rims of ragged
    scans have such lobes.
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


def outer_clearance(polygon: Complex[np.ndarray, " m"], most: float) -> float:
    """Smallest gap across the outside between far parts of a simple polygon, in local edge lengths, inf above `most`.

    Parts are far if their distance along the boundary exceeds four times the gap plus six edges.
    """
    edge = np.abs(shifted(polygon, -1) - polygon)
    local = (edge + shifted(edge, 1)) / 2
    along = np.cumsum(edge) - edge
    i, j = near_vertices(polygon, most * local)
    gap, longer = np.abs(polygon[i] - polygon[j]), np.maximum(local[i], local[j])
    distance = np.abs(along[i] - along[j])
    once = (i < j) | (gap > most * local[j])  # most pairs are found from both ends
    far = np.flatnonzero(once & (np.minimum(distance, edge.sum() - distance) > 4 * gap + 6 * longer))
    if not len(far):
        return np.inf
    a, b = polygon[i[far]], polygon[j[far]]
    across = (a[:, None] + np.array([0.2, 0.5, 0.8]) * (b - a)[:, None]).ravel()
    outside = ~are_inside(across, polygon).reshape(-1, 3).any(axis=1)
    return float((gap[far] / longer[far]).min(where=outside, initial=np.inf))


def near_vertices(
    polygon: Complex[np.ndarray, " m"], reach: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """All pairs of vertices of which the second lies within the first one's reach, each vertex with itself too."""
    coordinates = plane_coordinates(polygon)
    near = cKDTree(coordinates).query_ball_point(coordinates, reach, return_sorted=False)
    i = np.repeat(np.arange(len(polygon)), [len(some) for some in near])
    return i, np.fromiter(itertools.chain.from_iterable(near), dtype=np.int64, count=len(i))


def lattice_inside(polygon: Complex[np.ndarray, " m"], spacing: float) -> Complex[np.ndarray, " k"]:
    """Points inside a polygon of the triangular lattice with rows along the x-axis.

    The crossings of a lattice row with the edges alternately enter and leave the polygon. Time and memory are
    proportional to the crossings and the points.
    """
    height = np.sqrt(0.75) * spacing
    end = shifted(polygon, -1)
    low, high = np.minimum(polygon.imag, end.imag), np.maximum(polygon.imag, end.imag)
    # an edge crosses the rows at or above its low end and below its high end
    first, last = np.ceil(low / height).astype(np.int64), np.ceil(high / height).astype(np.int64)
    edge, row = _ranges(first, last - first)
    share = (row * height - polygon.imag[edge]) / (end.imag - polygon.imag)[edge]
    x = polygon.real[edge] + share * (end.real - polygon.real)[edge]
    order = np.lexsort((x, row))
    row, x = row[order[::2]], x[order]
    shift = 0.5 * (row % 2)
    left = np.ceil(x[::2] / spacing - shift).astype(np.int64)
    right = np.ceil(x[1::2] / spacing - shift).astype(np.int64)
    piece, column = _ranges(left, right - left)
    return np.asarray((column + shift[piece]) * spacing + 1j * (row[piece] * height))


def are_inside(z: Complex[np.ndarray, " k"], polygon: Complex[np.ndarray, " m"]) -> Bool[np.ndarray, " k"]:
    """Whether points z lie inside a polygon.

    A point is inside if the ray to its right crosses an odd number of edges. Time and memory are proportional to the
    points and the crossings of the horizontal lines through them.
    """
    end = shifted(polygon, -1)
    # at equal heights lower ends come first, then upper ends, then points: a line through a vertex crosses one edge
    heights = np.concatenate([np.minimum(polygon.imag, end.imag), np.maximum(polygon.imag, end.imag), z.imag])
    order = np.argsort(heights, kind="stable")
    is_point = order >= 2 * len(polygon)
    below = np.empty(len(order), dtype=np.int64)
    below[order] = np.cumsum(is_point)
    first, last = below[: len(polygon)], below[len(polygon) : 2 * len(polygon)]
    edge, place = _ranges(first, last - first)
    point = order[is_point][place] - 2 * len(polygon)
    side = cross((end - polygon)[edge], z[point] - polygon[edge])
    right = np.where((end.imag > polygon.imag)[edge], side > 0, side < 0)
    return np.asarray(np.bincount(point[right], minlength=len(z)) % 2 == 1)


def _ranges(
    first: Int[np.ndarray, " n"], count: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Concatenated members of n ranges of integers: the number of the range, and the value, of each."""
    owner = np.repeat(np.arange(len(first)), count)
    return owner, np.arange(len(owner)) + (first + count - np.cumsum(count))[owner]
