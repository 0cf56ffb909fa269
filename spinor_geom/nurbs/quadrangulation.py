"""Division of polygons into convex quadrilaterals. Some corners of a polygon may be skipped."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Complex, Int

from spinor_geom.domain.delaunay import Rims, cross

LEAST_SINE = 0.1  # least sine of the angles of quadrilaterals


def cut_open(inner: Complex[np.ndarray, " n"], sizes: Rims) -> Int[np.ndarray, " m"]:
    """Indices of the corners of one closed polygon along all rims, connected by cuts between their nearest corners.

    It begins at the end of a cut, if there are cuts.
    """
    outer, *holes = np.split(np.arange(len(inner)), np.cumsum(sizes)[:-1])
    polygon, rest = outer.tolist(), [hole.tolist() for hole in holes]
    while rest:
        distances = [np.abs(np.subtract.outer(inner[polygon], inner[hole])) for hole in rest]
        number = int(np.argmin([each.min() for each in distances]))
        i, j = divmod(int(distances[number].argmin()), len(rest[number]))
        hole = rest.pop(number)
        polygon = [*polygon[: i + 1], *hole[j:], *hole[: j + 1], *polygon[i:]]
    ends = np.flatnonzero(np.bincount(polygon)[polygon] > 1)
    return np.roll(polygon, -ends[-1]) if len(ends) else np.array(polygon)


def sides_of(
    polygon: Int[np.ndarray, " m"], joins: Int[np.ndarray, "j 2"], steps: Int[np.ndarray, " j"]
) -> Int[np.ndarray, "s 2"]:
    """Pairs of positions in the polygon: ends of its sides, and of joins of sides that contain no end of a cut.

    `joins` has the indices of the corners at both ends of each join, `steps` the number of its sides.
    """
    m = len(polygon)
    places = np.zeros((2, int(polygon.max()) + 1), dtype=np.int64)  # first and last position: ends of cuts occur twice
    places[1, polygon] = np.arange(m)
    places[0, polygon[::-1]] = np.arange(m)[::-1]
    own = np.stack([np.arange(m), (np.arange(m) + 1) % m], axis=1)
    found = [own]
    for start, end in itertools.product(places, places):
        pairs = np.stack([start[joins[:, 0]], end[joins[:, 1]]], axis=1)
        found.append(pairs[(pairs[:, 1] - pairs[:, 0]) % m == steps])
    return np.unique(np.concatenate(found), axis=0)


def quadrangulated(z: Complex[np.ndarray, " m"], sides: Int[np.ndarray, "s 2"]) -> Int[np.ndarray, "q 4"] | None:
    """Convex quadrilaterals that fill a polygon, with the least total cost, or None if none do.

    The corners z are counter-clockwise. Equal points may occur twice. `sides` has the pairs of corners that a side may
    connect. The corners between them are skipped. The cost of a quadrilateral is the largest 1/sin of its angles. The
    division is found by dynamic programming over the chords of the polygon.
    """
    m = len(z)
    with np.errstate(invalid="ignore"):
        step = z - z[:, None]
        step /= np.abs(step)
    cost, between = np.full((m, m), np.inf), np.zeros((m, m, 2), dtype=np.int64)
    start, end = sides[sides[:, 1] > 0].T
    cost[start, end] = 0.0
    every = 2 if len(sides) == m else 1  # without joins, both sides of a chord have an even number of corners
    for width in range(3, m, every):
        i = np.arange(m - width)[:, None]
        # third and fourth corners of all quadrilaterals on the chords from i to i + width
        second, third = np.nonzero(np.triu(np.ones((width // every,) * 2, dtype=bool)))
        second, third = every * second + 1, every * third + 2
        second, third = second[third < width], third[third < width]
        total = cost[i, i + second] + cost[i + second, i + third] + cost[i + third, i + width]
        chord, choice = np.nonzero(np.isfinite(total))
        corners = [chord, chord + second[choice], chord + third[choice], chord + width]
        along = [step[one, two] for one, two in itertools.pairwise([corners[-1], *corners, corners[0]])]
        sine = np.minimum.reduce([cross(one, two) for one, two in itertools.pairwise(along)])
        with np.errstate(divide="ignore"):
            total[chord, choice] += 1 / np.where(sine > LEAST_SINE, sine, 0.0)
        best, i = total.argmin(axis=1), i[:, 0]
        least = total[i, best]
        better = least < cost[i, i + width]
        i, best = i[better], best[better]
        cost[i, i + width] = least[better]
        between[i, i + width] = np.stack([i + second[best], i + third[best]], axis=1)
    last = sides[sides[:, 1] == 0, 0]  # ends of the sides to the first corner
    final = int(last[cost[0, last].argmin()])
    if not np.isfinite(cost[0, final]):
        return None
    quads, chords = [], [(0, final)]
    while chords:
        a, d = chords.pop()
        b, c = between[a, d].tolist()
        if c:
            quads.append((a, b, c, d))
            chords += [(a, b), (b, c), (c, d)]
    return np.array(quads)
