"""Pairs of segments that are near each other."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.deadline import seconds_left
from spinor_geom.kernel import call, checked

Points = Float[np.ndarray, "m 3"]
Numbers = Int[np.ndarray, " k"]

AT_ONCE = 2**18  # pairs of which temporary arrays are made


def near_edges(
    starts: Points, ends: Points, distance: float, wanted: Callable[[Numbers, Numbers], Bool[np.ndarray, " k"]]
) -> Int[np.ndarray, "k 2"]:
    """The wanted ones of the pairs i < j of segments that are at most a distance from each other, sorted.

    Some pairs are included that are farther apart by up to 1e-7 of their lengths. The search is fast if successive
    segments are close to each other. `wanted` is called for some pairs at a time, so that many that are near but not
    wanted need little memory.

    Raises:
        OutOfTimeError: the time limit has expired.
    """
    m = len(starts)
    starts, ends = (checked("points", points, np.float64, m, 3) for points in (starts, ends))
    near, done = np.empty((max(AT_ONCE, m), 2), dtype=np.int64), np.zeros(2, dtype=np.int64)
    found: list[np.ndarray] = []
    while not found or done[1] < m:
        call("near_segments", m, starts, ends, distance, int(done[1]), len(near), seconds_left(), near, done)
        for first in range(0, max(int(done[0]), 1), AT_ONCE):
            pairs = near[first : min(first + AT_ONCE, int(done[0]))]
            found.append(pairs[wanted(*pairs.T)])
    return np.concatenate(found)
