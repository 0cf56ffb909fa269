"""Long edges of closed polygons: those that the spacing of the points beside them does not explain."""

import numpy as np
from jaxtyping import Bool, Float

LARGEST_GROWTH = 2.0  # of edges from one to the next along a curve whose spacing is graded
# Length of the first part of a divided edge, in edges beside it, and growth of the parts per length. With half of each
# one ragged rim of a cut sphere is not met; with twice of both half disks' straight sides bulge so that they gain up
# to 8 % of area.
_FIRST_PART, _GROWTH = 2.0, 1.0


def graded_spacing(points: Float[np.ndarray, "*b m k"]) -> Float[np.ndarray, "*b m"]:
    """The longest edge that the points of a closed polygon beside it explain, at each edge, in the points' unit.

    Elsewhere it is the longest of three edges in a row, it may double from each edge to the next, and it is twice the
    median edge at least. So an edge is longer only if it is more than four times as long as three edges beside it, and
    more than twice as long as half of all edges. Few short edges explain nothing, and gradual growth is explained.
    Where no edge is longer than twice the median edge, it is that.
    """
    length = edge_lengths(points)
    least = LARGEST_GROWTH * np.median(length, axis=-1, keepdims=True)
    if (length <= least).all():  # saves the rest for nearly all polygons
        return np.broadcast_to(least, length.shape)
    spacing = _longest_of_three(length)
    step = 1
    # 2^64 is beyond the ratio of any two edges
    while step < min(length.shape[-1], 64):
        nearest = np.minimum(np.roll(spacing, step, axis=-1), np.roll(spacing, -step, axis=-1))
        spacing = np.minimum(spacing, LARGEST_GROWTH**step * nearest)
        step *= 2
    return np.asarray(np.maximum(spacing, least))


def are_long(points: Float[np.ndarray, "*b m k"]) -> Bool[np.ndarray, "*b m"]:
    """Which edges of a closed polygon are longer than its graded spacing; edge i runs from point i to point i + 1."""
    return np.asarray(edge_lengths(points) > graded_spacing(points))


def edge_lengths(points: Float[np.ndarray, "*b m k"]) -> Float[np.ndarray, "*b m"]:
    """Lengths of the edges of a closed polygon."""
    return np.asarray(np.linalg.norm(np.roll(points, -1, axis=-2) - points, axis=-1))


def with_long_edges_divided(
    points: Float[np.ndarray, "m k"],
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """A closed polygon's points with more on its long edges, and which of these are its own.

    The parts of a long edge are about as long as the edges beside it at its ends, and grow from there.
    """
    long = np.flatnonzero(are_long(points))
    length = edge_lengths(points)
    first = _FIRST_PART * _longest_of_three(length)
    starts, ends = np.roll(first, 2)[long], np.roll(first, -2)[long]
    shares = [
        _graded_shares(*sizes) for sizes in zip(length[long].tolist(), starts.tolist(), ends.tolist(), strict=True)
    ]
    place = np.repeat(long, [len(share) for share in shares])
    share = np.concatenate([np.zeros(0), *shares])[:, None]
    within = points[place] + share * (np.roll(points, -1, axis=0)[place] - points[place])
    is_own = np.insert(np.ones(len(points), dtype=bool), place + 1, False)
    return np.insert(points, place + 1, within, axis=0), is_own


def _longest_of_three(length: Float[np.ndarray, "*b m"]) -> Float[np.ndarray, "*b m"]:
    """The longest of each edge and its two neighbours."""
    return np.asarray(np.maximum(length, np.maximum(np.roll(length, 1, axis=-1), np.roll(length, -1, axis=-1))))


def _graded_shares(length: float, start: float, end: float) -> Float[np.ndarray, " k"]:
    """Places inside an edge, as shares of it, whose distances grow linearly from given ones at both of its ends."""
    middle = np.clip((length + (end - start) / _GROWTH) / 2, 0, length)
    first = np.log1p(_GROWTH * middle / start) / _GROWTH
    whole = first + np.log1p(_GROWTH * (length - middle) / end) / _GROWTH
    parts = int(np.ceil(whole))
    part = np.arange(1, parts) * whole / parts
    from_start, to_end = (
        size * np.expm1(_GROWTH * np.minimum(steps, whole)) / _GROWTH
        for size, steps in ((start, part), (end, whole - part))
    )
    return np.asarray(np.where(part <= first, from_start, length - to_end) / length)
