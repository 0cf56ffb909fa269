"""Minimum-area triangulations of closed curves, and their unfolding into the plane, the domain of the first fill."""

import itertools
import math

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.sparse import csc_array

from spinor_geom.arrays import cross, norm, shifted
from spinor_geom.deadline import seconds_left
from spinor_geom.domain.flattening import DirichletToNeumann, flatten_boundary
from spinor_geom.errors import DomainError, FirstFillError
from spinor_geom.kernel import call, checked
from spinor_geom.mesh.operators import intrinsic_angles, intrinsic_laplacian
from spinor_geom.mesh.spacing import edge_lengths

LONGEST = 160  # points of a loop beyond which it is thinned: the triangulation costs O(n³) time and O(n²) memory
_STRAIGHT = 1e-6  # sine of the turning angle at a point of a straight side
_DIAGONAL_WEIGHT = 1e-4  # of squared diagonals in the cost: breaks ties of the area (plane loops, straight sides)
_TO_EQUILATERAL = 0.05  # weight of 60° in the angles of the straightening: none is then below 3°


def unfolded_loop(points: Float[np.ndarray, "m 3"]) -> Complex[np.ndarray, " m"]:
    """A simple plane polygon with a vertex for each point of a closed curve, with nearly the same edge lengths.

    The minimum-area triangulation of the curve has no inner vertices, so it unfolds into the plane without distortion,
    also for slits and folds. An unfolding that overlaps itself is straightened (see `flatten`). Points inside straight
    sides, and others if more than 160 remain, are removed first and then put on the polygon's edges.

    Raises:
        FirstFillError: no simple polygon was found.
    """
    kept = _thinned(points)
    corners = points[kept]
    triangles = minimum_area_triangulation(corners, seconds=seconds_left())
    side = corners[triangles[:, [2, 0, 1]]] - corners[triangles[:, [1, 2, 0]]]
    angles = intrinsic_angles(norm(side))
    turning = np.pi - np.bincount(triangles.ravel(), angles.ravel(), minlength=len(corners))
    edge = edge_lengths(corners)

    def laplacian() -> csc_array:
        # closer to equilateral, because slivers would dominate the straightening
        rounder = angles + _TO_EQUILATERAL * (np.pi / 3 - angles)
        # the sides of a triangle are proportional to the sines of its angles
        return intrinsic_laplacian(np.sin(rounder), triangles, len(corners))

    try:
        neumann = DirichletToNeumann(laplacian, len(corners))
        flat = flatten_boundary(edge, turning, neumann, clearance=1.0)
    except DomainError as error:
        raise FirstFillError(
            f"no first fill was found for a loop of {len(points)} points: its least-area triangulation does not unfold "
            "into a simple polygon; check that the loop does not cross itself"
        ) from error
    if len(kept) == len(points):
        return flat.boundary
    edge = edge_lengths(points)
    along = np.cumsum(edge) - edge
    return np.asarray(np.interp(along, along[kept], flat.boundary, period=edge.sum()))


def minimum_area_triangulation(
    points: Float[np.ndarray, "n 3"], *, seconds: float = math.inf
) -> Int[np.ndarray, "t 3"]:
    """Triangles (i, j, k), i < j < k, of least total area that span a closed curve without inner vertices.

    Dynamic programming over the splits of every chord, O(n³) time.

    Source: Barequet & Sharir, "Filling gaps in the boundary of a polyhedron", CAGD 12 (1995).
    """
    split = np.zeros((len(points), len(points)), dtype=np.int64)
    points = checked("points", points, np.float64, None, 3)
    call("minimum_area_splits", len(points), points, _DIAGONAL_WEIGHT, seconds, split)
    return triangles_of(split)


def triangles_of(split: Int[np.ndarray, "n n"]) -> Int[np.ndarray, "t 3"]:
    """Triangles (i, j, k), i < j < k, over a closed curve. `split[i, l]` is the apex over the chord i to i + l."""
    triangles, chords = [], [(0, len(split) - 1)]
    for first, last in chords:  # a few hundred at most, and arrays for each generation take several times as long
        middle = split.item(first, last - first)
        triangles.append((first, middle, last))
        chords += [chord for chord in ((first, middle), (middle, last)) if chord[1] - chord[0] > 1]
    return np.array(triangles)


def disk_without_inner_points(points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "t 3"]:
    """Faces of about the least area over a closed curve. Long curves are divided at every k-th point."""
    m = len(points)
    if m == 3:  # most parts of long curves
        return np.array([[0, 1, 2]])
    if m <= LONGEST:
        return minimum_area_triangulation(points)
    kept = np.arange(0, m, math.ceil(m / LONGEST))
    parts = [kept[minimum_area_triangulation(points[kept])]]
    for first, last in itertools.pairwise([*kept.tolist(), m]):
        piece = np.arange(first, last + 1) % m
        if len(piece) > 2:
            parts.append(piece[disk_without_inner_points(points[piece])])
    return np.concatenate(parts)


def _thinned(points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " k"]:
    """Indices of at most `LONGEST` points of a closed curve, no three on a line.

    Points that span the least area with their neighbours are removed, at most every other point per round.

    Source: Visvalingam & Whyatt, "Line generalisation by repeated elimination of points", Cartographic J. 30 (1993).
    """
    kept = np.arange(len(points))
    while True:
        p = points[kept]
        ahead, back = shifted(p, -1, axis=0) - p, shifted(p, 1, axis=0) - p
        area = norm(cross(ahead, back))
        cosine = np.einsum("ij,ij->i", ahead, back)
        least = area < -_STRAIGHT * cosine
        surplus = len(kept) - LONGEST
        if surplus > 0:
            least |= area <= np.partition(area, surplus)[surplus]
        drop = least & ((np.arange(len(kept)) % 2 == 0) | ~shifted(least, 1))
        if not drop.any() or len(kept) - drop.sum() < 3:
            return kept
        kept = kept[~drop]
