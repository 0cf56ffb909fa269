"""Points of triangular lattices inside plane polygons."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int


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


def _ranges(
    first: Int[np.ndarray, " n"], count: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Numbers first, first + 1, … for each of n ranges, one range after the other, and whose each number is."""
    owner = np.repeat(np.arange(len(first)), count)
    before = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (first - before)[owner]
