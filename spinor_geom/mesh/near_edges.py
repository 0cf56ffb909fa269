"""Pairs of segments that are near each other, and of segments and points."""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.deadline import require_time, seconds_left
from spinor_geom.kernel import call, checked

Points = Float[np.ndarray, "m 3"]
Numbers = Int[np.ndarray, " k"]
Pairs = Int[np.ndarray, "k 2"]
Wanted: TypeAlias = Callable[[Numbers, Numbers], Bool[np.ndarray, " k"]]

AT_ONCE = 2**18  # pairs of which temporary arrays are made


def near_edges(starts: Points, ends: Points, distance: float, wanted: Wanted, *, enough: float = math.inf) -> Pairs:
    """The wanted ones of the pairs i < j of segments that are at most a distance from each other, sorted.

    Some pairs are included that are farther apart by up to 1e-7 of their lengths. The search is fast if successive
    segments are close to each other. `wanted` is called for some pairs at a time, so that many that are near but not
    wanted need little memory. The search ends where at least `enough` are found.

    Raises:
        OutOfTimeError: the time limit has expired.
    """
    m = len(starts)
    starts, ends = (checked("points", points, np.float64, m, 3) for points in (starts, ends))
    return found_pairs("near_segments", m, m, (starts, ends, distance), wanted, enough=enough)


def near_points(
    starts: Points, ends: Points, points: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"], wanted: Wanted
) -> Pairs:
    """The wanted ones of the pairs of a segment and a point that is at most its radius from it, sorted by segments.

    Some points are included that are farther away by up to 1e-12 of a segment's length. For n long segments in any
    order and as many points in a plane, the search takes about n^1.5 steps. `wanted` and the error are those of
    `near_edges`.
    """
    m, n = len(starts), len(points)
    starts, ends = (checked("points", ends_of, np.float64, m, 3) for ends_of in (starts, ends))
    points, radii = checked("points", points, np.float64, n, 3), checked("radii", radii, np.float64, n, least=0)
    return found_pairs("near_points", m, n, (starts, ends, n, points, radii), wanted)


def found_pairs(
    name: str, count: int, partners: int, arguments: tuple[Any, ...], wanted: Wanted, *, enough: float = math.inf
) -> Pairs:
    """The wanted pairs of `count` objects and their partners that a function of the compiled part finds."""
    near, done = np.empty((AT_ONCE + partners, 2), dtype=np.int64), np.zeros(2, dtype=np.int64)
    found: list[np.ndarray] = []
    while not found or (done[1] < count and sum(map(len, found)) < enough):
        call(name, count, *arguments, int(done[1]), len(near), seconds_left(), near, done)
        for first in range(0, max(int(done[0]), 1), AT_ONCE):
            require_time()
            pairs = near[first : min(first + AT_ONCE, int(done[0]))]
            found.append(pairs[wanted(*pairs.T)])
    return np.concatenate(found)
