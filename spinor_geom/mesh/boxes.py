"""Candidate pairs of close segments, by their bounding boxes."""

from functools import cache

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.array_checks import shared

Points = Float[np.ndarray, "m 3"]
Numbers = Int[np.ndarray, " k"]

BOXES_TO_START_FROM = 64


def edges_with_near_boxes(starts: Points, ends: Points, distance: float) -> tuple[Numbers, Numbers]:
    """Pairs i < j of segments whose bounding boxes are within a distance of each other along every axis.

    A hierarchy of the boxes of 1, 2, 4, 8, … successive segments is searched from the top, which is
    fast if successive segments are close to each other.
    """
    low, high = np.minimum(starts, ends) - distance / 2, np.maximum(starts, ends) + distance / 2
    levels = [(low, high)]
    while len(low) > BOXES_TO_START_FROM:
        if len(low) % 2:
            # pad with an empty box
            low, high = np.vstack([low, np.full(3, np.inf)]), np.vstack([high, np.full(3, -np.inf)])
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        levels.append((low, high))
    first, second = _all_pairs(len(low))
    for depth, (low, high) in enumerate(reversed(levels)):
        if depth:
            first = np.add.outer(2 * first, [0, 0, 1, 1]).ravel()
            second = np.add.outer(2 * second, [0, 1, 0, 1]).ravel()
            inside = (first <= second) & (second < len(low))
            first, second = first[inside], second[inside]
        near = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
        first, second = first[near], second[near]
    return first[first < second], second[first < second]


@cache
def _all_pairs(count: int) -> tuple[Numbers, Numbers]:
    """Pairs i <= j of some numbers; np.triu_indices takes longer than the test of their boxes."""
    first, second = np.triu_indices(count)
    return shared(first), shared(second)
