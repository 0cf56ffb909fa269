"""Detection and division of edges of closed polygons that are much longer than their neighbours."""

import numpy as np
from jaxtyping import Bool, Float

from spinor_geom.arrays import median, norm, shifted

LARGEST_GROWTH = 2.0  # ratio of successive edges of a graded spacing
# Length of the first part of a divided edge, per length of the edges beside it, and growth of the parts per length.
# With half of both, one ragged rim of a cut sphere does not converge. With twice, straight sides bulge by up to 8 % of
# the area.
_FIRST_PART, _GROWTH = 2.0, 1.0


def graded_spacing(length: Float[np.ndarray, "*b m"]) -> Float[np.ndarray, "*b m"]:
    """Upper bound of the edge length of a graded sampling at each edge of a closed polygon, from the edges' lengths.

    The bound is the longest of three successive edges, reduced so that it at most doubles from one edge to the next,
    and at least twice the median edge. An edge exceeds it if it is more than four times as long as each of the next
    three edges on one side and more than twice as long as the median edge.
    """
    least = LARGEST_GROWTH * median(length)[..., None]
    if (length <= least).all():  # true for nearly all polygons
        return np.broadcast_to(least, length.shape)
    spacing = _longest_of_three(length)
    step = 1
    while step < min(length.shape[-1], 64):  # no two edges have a ratio of 2^64
        nearest = np.minimum(shifted(spacing, step), shifted(spacing, -step))
        spacing = np.minimum(spacing, LARGEST_GROWTH**step * nearest)
        step *= 2
    return np.asarray(np.maximum(spacing, least))


def are_long(points: Float[np.ndarray, "*b m k"]) -> Bool[np.ndarray, "*b m"]:
    """Which edges of a closed polygon exceed its `graded_spacing`. Edge i runs from point i to point i + 1."""
    length = edge_lengths(points)
    if have_similar_lengths(length):
        return np.zeros(length.shape, dtype=bool)
    return np.asarray(length > graded_spacing(length))


def have_similar_lengths(lengths: Float[np.ndarray, "*b m"]) -> bool:
    """Whether the edges of each closed polygon differ by so little that none exceeds its `graded_spacing`."""
    return bool((lengths.max(axis=-1) <= LARGEST_GROWTH * lengths.min(axis=-1)).all())


def edge_lengths(points: Float[np.ndarray, "*b m k"]) -> Float[np.ndarray, "*b m"]:
    """Lengths of the edges of a closed polygon."""
    return np.asarray(norm(shifted(points, -1, axis=-2) - points))


def with_long_edges_divided(
    points: Float[np.ndarray, "m k"],
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """A closed polygon with its long edges divided, and a mask of the original points.

    The parts of a long edge are about as long as its neighbours at both ends, and grow from there.
    """
    long = np.flatnonzero(are_long(points))
    if not len(long):
        return points, np.ones(len(points), dtype=bool)
    length = edge_lengths(points)
    first = _FIRST_PART * _longest_of_three(length)
    starts, ends = shifted(first, 2)[long], shifted(first, -2)[long]
    shares = [
        _graded_shares(*sizes) for sizes in zip(length[long].tolist(), starts.tolist(), ends.tolist(), strict=True)
    ]
    place = np.repeat(long, [len(share) for share in shares])
    share = np.concatenate([np.zeros(0), *shares])[:, None]
    within = points[place] + share * (shifted(points, -1, axis=0)[place] - points[place])
    is_own = np.insert(np.ones(len(points), dtype=bool), place + 1, False)
    return np.insert(points, place + 1, within, axis=0), is_own


def _longest_of_three(length: Float[np.ndarray, "*b m"]) -> Float[np.ndarray, "*b m"]:
    """The longest of each edge and its two neighbours."""
    return np.asarray(np.maximum(length, np.maximum(shifted(length, 1), shifted(length, -1))))


def _graded_shares(length: float, start: float, end: float) -> Float[np.ndarray, " k"]:
    """Points that divide an edge, as shares of its length. The parts grow linearly from given lengths at both ends."""
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
