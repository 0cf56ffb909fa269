"""Intersections of triangle meshes with themselves and each other, and of closed polygons.

Two faces cross if the interior of one meets the other. Faces that only touch at corners or sides, by index or by
position, do not cross. A face without area crosses another one if a side of it passes through the plane of the other
one inside that.
"""

from collections.abc import Callable

import igl.predicates
import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import EPS, cross, norm, shifted
from spinor_geom.errors import SelfCrossingLoopError
from spinor_geom.kernel import checked
from spinor_geom.mesh.boundary_loop import BoundaryLoop, diagonals
from spinor_geom.mesh.near_edges import Wanted, found_pairs, near_edges

Points = Float[np.ndarray, "k 3"]
Chain = Float[np.ndarray, "m 3"]
Numbers = Int[np.ndarray, " _"]
Faces = Int[np.ndarray, "_ 3"]
Triangles = Float[np.ndarray, "k 3 3"]
Sides = Int[np.ndarray, "k 3"]  # 1, −1, or 0
Pairs = Int[np.ndarray, "_ 2"]

MOST_CROSSINGS = 100_000  # of polygons, after which the search for more ends: random ones have as many as squared edges
MEETING_PER_DIAGONAL = 1e-12  # largest distance of edges of a polygon that meet, per diagonal
MIN_NORMAL_COSINE = 1e-3  # least cosine between the face normals and the direction of a graph, above rounding
SEPARATION = 1e-12  # volume, per cubed extent of two triangles, above which rounding cannot change its sign
# Least angle that an edge of a star subtends at its centre, and least distance from it per radius
_LEAST_ANGLE, _LEAST_DISTANCE = 1e-4, 1e-6


def self_intersections(vertices: Points, faces: Faces) -> Pairs:
    """Pairs of faces that cross, by exact predicates, smaller index first, sorted.

    Source: Shewchuk (1997), Adaptive precision floating-point arithmetic and fast robust geometric predicates; Guigue &
    Devillers (2003), Fast and robust triangle-triangle overlap test using orientation predicates.
    """
    corners = vertices[faces]

    def meet(i: Numbers, j: Numbers) -> Bool[np.ndarray, " k"]:
        # faces with the same vertices do not cross
        differ = (np.sort(faces[i], axis=1) != np.sort(faces[j], axis=1)).any(axis=1)
        differ[differ] = _insides_meet(corners[i[differ]], corners[j[differ]])
        return np.asarray(differ)

    return sorted_pairs(_near_faces(corners, None, meet))


def intersections_between(
    vertices: Points,
    faces: Faces,
    other_vertices: Float[np.ndarray, "l 3"],
    other_faces: Faces,
    *,
    wanted: Callable[[Numbers, Numbers], Bool[np.ndarray, " _"]] | None = None,
) -> Pairs:
    """Pairs of a face of one mesh and a face of another that cross, as in `self_intersections`.

    With `wanted` only the pairs for which it is True are tested.
    """
    f, g = vertices[faces], other_vertices[other_faces]

    def meet(i: Numbers, j: Numbers) -> Bool[np.ndarray, " k"]:
        tested = np.ones(len(i), dtype=bool) if wanted is None else wanted(i, j)
        tested[tested] = _insides_meet(f[i[tested]], g[j[tested]])
        return tested

    return sorted_pairs(_near_faces(f, g, meet))


def _near_faces(f: Triangles, g: Float[np.ndarray, "l 3 3"] | None, meet: Wanted) -> Pairs:
    """The pairs of f and g, or i < j of f, that are not clearly separated and for which `meet` is True."""
    if g is not None and len(f) < len(g):  # a search tree of the fewer triangles takes less time
        return _near_faces(g, f, lambda i, j: meet(j, i))[:, ::-1]
    others, partners = (f[:0], -1) if g is None else (g, len(g))
    f, others = (checked("corners", corners, np.float64, None, 3, 3) for corners in (f, others))
    return found_pairs("near_faces", len(f), max(partners, len(f)), (f, partners, others, SEPARATION), meet)


def is_graph(vertices: Points, faces: Faces, boundary_size: int) -> bool:
    """Whether a mesh with one boundary is a graph over the plane normal to its vector area, so without intersections.

    A projection that preserves the orientation of all faces and has a simple boundary is injective. Linear in the
    number of faces. The boundary's vertices come first, in order.

    Source: Volino & Magnenat-Thalmann (1994), Efficient self-collision detection on smoothly discretized surface
    animations using geometrical shape regularity.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = cross(b - a, c - a)
    area = normals.sum(axis=0)
    size = np.linalg.norm(area)
    if not (normals @ area > MIN_NORMAL_COSINE * size * norm(normals)).all():
        return False
    boundary = vertices[:boundary_size] - vertices[0]
    return not len(loop_crossings(boundary - np.outer(boundary @ area, area / size**2)))


def loop_crossings(points: Chain) -> Pairs:
    """Pairs i < j, sorted, of edges of a closed polygon (M, 3) that cross or touch, none for a simple polygon.

    Edge i runs from point i to point i + 1 (mod M). Edges without a common point meet if their distance is at most
    1e-12 of the diagonal, adjacent edges if the polygon folds back onto itself. The search ends after 100,000 pairs.
    """
    if is_star(points):
        return np.zeros((0, 2), dtype=np.int64)
    m = len(points)
    pairs, tolerance = _meeting_edges(points, shifted(points, -1, axis=0), lambda i, j: (j - i > 1) & (j - i < m - 1))
    folded = _folds(points, tolerance)
    neighbours = np.stack([(folded - 1) % m, folded], axis=1)
    return sorted_pairs(np.concatenate([pairs, np.sort(neighbours, axis=1)]))


def crossings_between(points: Chain, others: Float[np.ndarray, "n 3"]) -> Pairs:
    """Pairs, sorted, of an edge of one closed polygon and an edge of another that cross or touch."""
    starts = np.concatenate([points, others])
    ends = np.concatenate([shifted(points, -1, axis=0), shifted(others, -1, axis=0)])
    pairs, _ = _meeting_edges(starts, ends, lambda i, j: (i < len(points)) & (j >= len(points)))
    return sorted_pairs(pairs - [0, len(points)])


def _meeting_edges(starts: Chain, ends: Chain, wanted: Callable[..., Bool[np.ndarray, " k"]]) -> tuple[Pairs, float]:
    """The wanted pairs i < j of edges that meet, and the tolerance in mesh units."""
    tolerance = MEETING_PER_DIAGONAL * float(diagonals(starts))
    tolerance += 4 * EPS * float(np.abs(starts).max())

    def meet(i: Numbers, j: Numbers) -> Bool[np.ndarray, " k"]:
        are_meeting = wanted(i, j)
        i, j = i[are_meeting], j[are_meeting]
        are_meeting[are_meeting] = _segment_distances(starts[i], ends[i], starts[j], ends[j]) <= tolerance
        return are_meeting

    return near_edges(starts, ends, tolerance, meet, enough=MOST_CROSSINGS), tolerance


def crossings_found(count: int) -> str:
    """The number of crossings that a search found, for sentences: not all of them where it ended early."""
    return str(count) if count < MOST_CROSSINGS else f"at least {count}"


def require_simple(loop: BoundaryLoop) -> None:
    """Raises a SelfCrossingLoopError with the first two edges of a loop that meet, whatever its direction."""
    crossings = loop_crossings(loop.points)
    if len(crossings):
        edges = np.stack([loop.vertex_ids, shifted(loop.vertex_ids, -1)], axis=1)[crossings[0]].tolist()
        count = len(crossings)
        raise SelfCrossingLoopError(edges=sorted(map(sorted, edges)), count=count, found=crossings_found(count))


def sorted_pairs(pairs: Pairs) -> Pairs:
    """Pairs in ascending order of the first number, then of the second."""
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _insides_meet(f: Triangles, g: Triangles) -> Bool[np.ndarray, " k"]:
    """Whether an inner point of one triangle belongs to the other."""
    f_sides, g_sides = _sides_of_plane(f, g), _sides_of_plane(g, f)
    f_crosses, g_crosses = ((s.min(axis=1) < 0) & (s.max(axis=1) > 0) for s in (f_sides, g_sides))
    f_reaches, g_reaches = ((s.min(axis=1) <= 0) & (s.max(axis=1) >= 0) & s.any(axis=1) for s in (f_sides, g_sides))
    on_line = np.flatnonzero((f_crosses & g_reaches) | (f_reaches & g_crosses))
    in_plane = np.flatnonzero(~f_sides.any(axis=1) & ~g_sides.any(axis=1))
    meet = np.zeros(len(f), dtype=bool)
    # usually both are empty
    if len(on_line):
        meet[on_line] = _overlap_on_line(f[on_line], g[on_line], f_sides[on_line], g_sides[on_line])
    if len(in_plane):
        meet[in_plane] = _overlap_in_plane(f[in_plane], g[in_plane])
    # all points lie in the plane of a face without area
    for one, other, own, others in ((f, g, f_sides, g_sides), (g, f, g_sides, f_sides)):
        flat = np.flatnonzero(own.any(axis=1) & ~others.any(axis=1))
        for start in range(3 if len(flat) else 0):
            meet[flat] |= edges_through(one[flat, start], one[flat, start - 2], other[flat])
    return meet


def edges_through(starts: Points, ends: Points, triangles: Triangles) -> Bool[np.ndarray, " k"]:
    """Whether an edge, in each of k pairs, meets the inside of a triangle without lying in its plane."""
    a, b, c = (triangles[:, corner] for corner in range(3))
    around = np.stack([_side(starts, ends, p, q) for p, q in ((a, b), (b, c), (c, a))], axis=1)
    sides = np.stack([_side(a, b, c, points) for points in (starts, ends)], axis=1)
    return np.asarray((np.abs(around.sum(axis=1)) == 3) & (sides.prod(axis=1) <= 0) & sides.any(axis=1))


def _side(a: Points, b: Points, c: Points, d: Points) -> Numbers:
    """The exact sign of det(b − a, c − a, d − a): 1 if abc is counter-clockwise seen from d."""
    return -np.asarray(igl.predicates.orient3d(*(np.ascontiguousarray(points) for points in (a, b, c, d))))


def _sides_of_plane(f: Triangles, g: Triangles) -> Sides:
    """The side of the plane of g of each corner of f: 1, −1, or 0."""
    a, b, c = (np.repeat(g[:, k], 3, axis=0) for k in range(3))
    return _side(a, b, c, f.reshape(-1, 3)).reshape(-1, 3)


def _overlap_on_line(f: Triangles, g: Triangles, f_sides: Sides, g_sides: Sides) -> Bool[np.ndarray, " k"]:
    """Whether the intersections of two triangles with the common line of their planes overlap."""
    f_apex, f_low, f_high, f_sign = _sides_through_plane(f, f_sides)
    g_apex, g_high, g_low, g_sign = _sides_through_plane(g, g_sides)
    sign = f_sign * g_sign
    from_below = _side(f_apex, f_low, g_apex, g_high) * sign > 0
    from_above = _side(f_apex, f_high, g_apex, g_low) * sign < 0
    return np.asarray(from_below & from_above)


def _sides_through_plane(f: Triangles, sides: Sides) -> tuple[Points, Points, Points, Numbers]:
    """The corner of a triangle that is alone on its side of a plane, the two others, and that side.

    Corners on the plane count as below it if a corner is above it, else as above it. The two others are ordered by
    where their sides cross the common line of the planes, along n_f × n (n the normal of the plane).
    """
    filled = np.where(sides == 0, np.where((sides > 0).any(axis=1), -1, 1)[:, None], sides)
    alone = np.argmax(filled == -filled.sum(axis=1, keepdims=True), axis=1)
    k = np.arange(len(f))
    sign = filled[k, alone]
    after, before = f[k, (alone + 1) % 3], f[k, (alone + 2) % 3]
    up = (sign > 0)[:, None]
    return f[k, alone], np.where(up, before, after), np.where(up, after, before), sign


def _overlap_in_plane(f: Triangles, g: Triangles) -> Bool[np.ndarray, " k"]:
    """Whether the interiors of two coplanar triangles meet: no side of either separates them."""
    normals = cross(f[:, 1] - f[:, 0], f[:, 2] - f[:, 0])
    # projected along an axis, so that the signs stay exact
    across = (np.argmax(np.abs(normals), axis=1)[:, None] + [1, 2]) % 3
    f_flat, g_flat = (np.take_along_axis(t, across[:, None, :], axis=2) for t in (f, g))
    return np.asarray(~(_has_separating_side(f_flat, g_flat) | _has_separating_side(g_flat, f_flat)))


def _has_separating_side(f: Float[np.ndarray, "k 3 2"], g: Float[np.ndarray, "k 3 2"]) -> Bool[np.ndarray, " k"]:
    """Whether a side of a plane triangle f separates it from g, or True if f has no area."""
    turn = _turn(f[:, 0], f[:, 1], f[:, 2])
    separates = turn == 0
    for start in range(3):
        a, b = (np.repeat(f[:, k], 3, axis=0) for k in (start, (start + 1) % 3))
        beyond = _turn(a, b, g.reshape(-1, 2)).reshape(-1, 3) * turn[:, None] <= 0
        separates |= beyond.all(axis=1)
    return np.asarray(separates)


def _turn(a: Float[np.ndarray, "k 2"], b: Float[np.ndarray, "k 2"], c: Float[np.ndarray, "k 2"]) -> Numbers:
    """The exact sign of det(b − a, c − a) in the plane."""
    a, b, c = (np.column_stack([points, np.zeros(len(points))]) for points in (a, b, c))
    return _side(a, b, c, a + np.array([0.0, 0.0, 1.0]))


def is_star(points: Float[np.ndarray, "*b m 3"]) -> Bool[np.ndarray, "*b"]:
    """Whether polygons, projected along their vector areas, are star-shaped about their centroids, and thus simple.

    This holds for most boundary loops, and the test is many times as fast as the general one.
    """
    spokes = points - points.mean(axis=-2, keepdims=True)
    doubled = cross(spokes, shifted(spokes, -1, axis=-2))
    area = doubled.sum(axis=-2, keepdims=True)
    size = np.linalg.norm(area, axis=-1, keepdims=True)
    normal = np.divide(area, size, out=np.zeros_like(area), where=size > 0)
    # twice the areas of the triangles at the centroid, and their lower bounds by least angle and distance
    sectors = (doubled * normal).sum(axis=-1)
    flat = spokes - (spokes * normal).sum(axis=-1, keepdims=True) * normal
    radius = norm(flat)
    nearest = 2 * _LEAST_DISTANCE * radius.max(axis=-1, keepdims=True) ** 2
    least = np.maximum(_LEAST_ANGLE * radius * shifted(radius, -1), nearest)
    along = (flat * shifted(flat, -1, axis=-2)).sum(axis=-1)
    winds_once = np.arctan2(sectors, along).sum(axis=-1) < 3 * np.pi
    return np.asarray((sectors > least).all(axis=-1) & winds_once)


def _segment_distances(a: Points, b: Points, c: Points, d: Points) -> Float[np.ndarray, " k"]:
    """Distances between segments ab and cd: the minimum over their ends and two inner points."""
    u, v, w = b - a, d - c, c - a
    normal = cross(u, v)
    squared = (normal**2).sum(axis=1)
    # the feet of the common perpendicular. Parallel segments are nearest at an end
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip((cross(w, v) * normal).sum(axis=1) / squared, 0, 1)
        t = np.clip((cross(w, u) * normal).sum(axis=1) / squared, 0, 1)
    inner = norm(a + s[:, None] * u - c - t[:, None] * v)
    end, start, stop = (np.concatenate(four) for four in ((a, b, c, d), (c, c, a, a), (d, d, b, b)))
    along = stop - start
    squared = (along**2).sum(axis=1)
    share = np.clip(((end - start) * along).sum(axis=1) / np.where(squared > 0, squared, 1), 0, 1)
    ends = norm(end - start - share[:, None] * along)
    return np.asarray(np.fmin(inner, ends.reshape(4, -1).min(axis=0)))


def _folds(points: Chain, tolerance: float) -> Numbers:
    """The points of a polygon at which it folds back onto itself, to a tolerance in mesh units."""
    u, v = shifted(points, 1, axis=0) - points, shifted(points, -1, axis=0) - points
    acute = np.flatnonzero((u * v).sum(axis=1) > 0)
    u, v = u[acute], v[acute]
    u_length, v_length = norm(u), norm(v)
    off = norm(cross(u, v)) / np.maximum(u_length, v_length)
    return np.asarray(acute[(off <= tolerance) & (np.minimum(u_length, v_length) > tolerance)])
