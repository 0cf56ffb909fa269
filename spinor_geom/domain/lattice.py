"""Points of a triangular lattice inside a plane polygon."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Int


def lattice_inside(
    polygon: Complex[np.ndarray, " m"], spacing: float, *, after: Int[np.ndarray, " m"] | None = None
) -> Complex[np.ndarray, " k"]:
    """The points inside a polygon, or between polygons, of the triangular lattice with rows along the x-axis.

    Row by row: a row enters and leaves the polygon by turns where it crosses the edges. Takes time and memory in
    proportion to the crossings and the points.

    Args:
        polygon: Vertices of a simple polygon, or of several.
        spacing: Distance of neighbouring lattice points.
        after: For each vertex the next one on its polygon; none for a single one, in order.
    """
    height = np.sqrt(0.75) * spacing
    start, end = polygon, np.roll(polygon, -1) if after is None else polygon[after]
    low, high = np.minimum(start.imag, end.imag), np.maximum(start.imag, end.imag)
    # the edges cross the rows from the first at or above their low end to the last below their high end
    first, after = np.ceil(low / height).astype(np.int64), np.ceil(high / height).astype(np.int64)
    edge, row = _ranges(first, after - first)
    share = (row * height - start.imag[edge]) / (end.imag - start.imag)[edge]
    x = start.real[edge] + share * (end.real - start.real)[edge]
    order = np.lexsort((x, row))
    row, x = row[order], x[order]
    shift = 0.5 * (row[::2] % 2)
    left = np.ceil(x[::2] / spacing - shift).astype(np.int64)
    right = np.ceil(x[1::2] / spacing - shift).astype(np.int64)
    piece, column = _ranges(left, right - left)
    return np.asarray((column + shift[piece]) * spacing + 1j * (row[::2][piece] * height))


def _ranges(
    first: Int[np.ndarray, " n"], count: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Numbers first, first + 1, … for each of n ranges, one range after the other, and whose each number is."""
    owner = np.repeat(np.arange(len(first)), count)
    before = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (first - before)[owner]
