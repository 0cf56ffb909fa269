"""A plane domain for any closed curve: its minimum-area triangulation, unfolded."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.sparse import coo_array

from spinor_geom.domain.flattening import flatten_boundary
from spinor_geom.errors import DomainError, FirstFillError

# The triangulation costs O(n³) time and O(n²) memory: longer loops are thinned to this many points for it.
_LONGEST = 200
# Share of the squared diagonals in the cost: decides where areas tie (plane loops, straight sides).
_DIAGONAL_WEIGHT = 1e-4
# Share of the way to 60° by which angles are drawn: none is below 3° then.
_TO_EQUILATERAL = 0.05


def unfolded_loop(points: Float[np.ndarray, "m 3"], *, saws: bool = False) -> Complex[np.ndarray, " m"]:
    """A simple plane polygon with a vertex for each point of a closed curve, near to an isometric image of a fill.

    The minimum-area triangulation of the curve alone has no inner vertex, so it unfolds into the plane without
    distortion; slits and folds come out right. Where the unfolding overlaps it is straightened (see `flatten`).
    Curves of more than 200 points are thinned for this, the points left out are put on the polygon's sides.

    Args:
        points: of the curve, in order.
        saws: as for `flatten_boundary`.

    Raises:
        FirstFillError: no simple polygon was found.
    """
    kept = _thinned(points)
    corners = points[kept]
    triangles = minimum_area_triangulation(corners)
    distance = np.linalg.norm(corners[:, None] - corners, axis=2)
    angles = _angles(distance, triangles)
    turning = np.pi - np.bincount(triangles.ravel(), angles.ravel(), minlength=len(corners))
    edge = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    try:
        flat = flatten_boundary(edge, turning, _laplacian(angles, triangles, len(corners)), clearance=1.0, saws=saws)
    except DomainError as error:
        raise FirstFillError(
            f"no first fill was found for a loop of {len(points)} points: its least-area triangulation does not unfold "
            "into a simple polygon; check that the loop does not cross itself"
        ) from error
    if len(kept) == len(points):
        return flat.boundary
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    closed = np.append(flat.boundary, flat.boundary[0])
    total = along[-1] + np.linalg.norm(points[0] - points[-1])
    knots = np.append(along[kept], total)
    return np.asarray(np.interp(along, knots, closed.real) + 1j * np.interp(along, knots, closed.imag))


def minimum_area_triangulation(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "t 3"]:
    """Triangles (i, j, k), i < j < k, of least total area that span a closed curve without inner vertices.

    Dynamic programming over the splits of every chord, O(n³) time.

    Source: Barequet & Sharir, "Filling gaps in the boundary of a polyhedron", CAGD 12 (1995).
    """
    n = len(points)
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    index = np.arange(n)
    # ahead[i, l] belongs to the chord from i to i + l, behind[k, l] to the chord from k − l to k: both are slices
    ahead = distance[index[:, None], (index[:, None] + index) % n]
    behind = distance[index[:, None], (index[:, None] - index) % n]
    cost_ahead, cost_behind = np.zeros((n, n)), np.zeros((n, n))
    split = np.zeros((n, n), dtype=np.int64)
    for d in range(2, n):
        count = n - d
        a, b = ahead[:count, 1:d], behind[d:, d - 1 : 0 : -1]
        c = ahead[:count, d : d + 1]
        product = ((a + b) ** 2 - c * c) * (c * c - (a - b) ** 2)  # Heron: 16·area²
        cost = 0.25 * np.sqrt(np.maximum(product, 0.0))
        cost += cost_ahead[:count, 1:d]
        cost += cost_behind[d:, d - 1 : 0 : -1]
        best = cost.argmin(axis=1)
        value = cost[index[:count], best] + _DIAGONAL_WEIGHT * c[:, 0] ** 2
        cost_ahead[:count, d] = value
        cost_behind[d:, d] = value
        split[:count, d] = index[:count] + 1 + best
    triangles = []
    first, last = np.array([0]), np.array([n - 1])
    while len(first):
        middle = split[first, last - first]
        triangles.append(np.stack([first, middle, last], axis=1))
        first, last = np.concatenate([first, middle]), np.concatenate([middle, last])
        open_chord = last - first > 1
        first, last = first[open_chord], last[open_chord]
    return np.concatenate(triangles)


def spanning_triangulation(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "t 3"]:
    """Triangles without inner vertices over a closed curve of any length, oriented like it.

    They are of least area up to 200 points. Longer curves are thinned to so many for the largest triangles; each part
    between two of these points is spanned likewise.
    """
    kept = _thinned(points)
    faces = [kept[minimum_area_triangulation(points[kept])]]
    if len(kept) < len(points):
        for first, last in zip(kept, np.append(kept[1:], len(points) + kept[0]), strict=True):
            part = np.arange(first, last + 1) % len(points)
            if len(part) > 2:
                faces.append(part[spanning_triangulation(points[part])])
    return np.concatenate(faces)


def _thinned(points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " k"]:
    m = len(points)
    if m <= _LONGEST:
        return np.arange(m)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    total = along[-1] + np.linalg.norm(points[0] - points[-1])
    return np.unique(np.searchsorted(along, np.arange(_LONGEST) * (total / _LONGEST)).clip(0, m - 1))


def _angles(distance: Float[np.ndarray, "n n"], triangles: Int[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 3"]:
    """Corner angles from edge lengths, right for degenerate triangles too."""
    i, j, k = triangles.T
    a, b, c = distance[j, k], distance[k, i], distance[i, j]

    def angle(
        opposite: Float[np.ndarray, " t"], left: Float[np.ndarray, " t"], right: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        # half-angle form: no loss of digits at 0 and π
        top = np.maximum(opposite**2 - (left - right) ** 2, 0.0)
        bottom = np.maximum((left + right) ** 2 - opposite**2, 0.0)
        return np.asarray(2 * np.arctan2(np.sqrt(top), np.sqrt(bottom)))

    return np.stack([angle(a, b, c), angle(b, c, a), angle(c, a, b)], axis=1)


def _laplacian(angles: Float[np.ndarray, "t 3"], triangles: Int[np.ndarray, "t 3"], n: int) -> Float[np.ndarray, "n n"]:
    """Cotangent Laplacian with angles drawn a little to 60°: slivers must not dominate the straightening.

    The angles of each triangle still sum to π, without which the matrix would not be positive.
    """
    weight = 0.5 / np.tan(angles + _TO_EQUILATERAL * (np.pi / 3 - angles))
    i, j = np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)
    off = coo_array((weight.ravel(), (i.ravel(), j.ravel())), shape=(n, n)).toarray()
    off += off.T
    return np.asarray(np.diag(off.sum(axis=1)) - off)
