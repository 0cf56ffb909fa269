"""Where triangle meshes pass through themselves or each other, and where closed polygons meet themselves.

Two faces cross where a point inside one of them belongs to the other. So faces that touch in corners or sides do not,
whether these are shared by index or only lie in the same place, and nor do neighbours in one plane. A face without area
has no inside and crosses nothing.
"""

from collections.abc import Callable

import igl.predicates
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array

from spinor_geom.errors import SelfCrossingLoopError
from spinor_geom.mesh.arrays import igl_arrays
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.boxes import edges_with_near_boxes

Points = Float[np.ndarray, "k 3"]
Chain = Float[np.ndarray, "m 3"]
Numbers = Int[np.ndarray, " k"]
InPlane = Float[np.ndarray, "k 2"]
OtherPoints = Float[np.ndarray, "l 3"]
Faces = Int[np.ndarray, "_ 3"]
Triangles = Float[np.ndarray, "k 3 3"]
Sides = Int[np.ndarray, "k 3"]  # 1, −1, or 0
Pairs = Int[np.ndarray, "k 2"]

MEETING_PER_DIAGONAL = 1e-12  # edges of a polygon that come nearer than this share of its diagonal meet
MIN_NORMAL_COSINE = 1e-3  # normals of a graph: so far from 90° to its direction that their round-off does not matter
SEPARATION = 1e-12  # heights over a plane, in cubes of the extent of two triangles, whose sign needs no exact predicate
# of a star's sides: the angle under which each is seen from its middle, and its distance from there per radius; their
# product is far above the distance at which edges meet
LEAST_ANGLE, LEAST_DISTANCE = 1e-4, 1e-6


def self_intersections(vertices: Points, faces: Faces) -> Pairs:
    """Pairs of faces that cross, by exact predicates: smaller index first, sorted; none for an embedded mesh.

    Source: Shewchuk (1997), Adaptive precision floating-point arithmetic and fast robust geometric predicates; Guigue &
    Devillers (2003), Fast and robust triangle-triangle overlap test using orientation predicates.
    """
    corners, indices = igl_arrays(vertices, faces)
    # exact for faces without a common vertex; its tests of the others depend on the scale and the order of the corners
    _, apart, _ = igl.predicates.find_self_intersections(corners, indices)
    apart = apart.astype(np.int64)  # igl's are as wide, but of a type of their own
    shared = (indices[apart[:, 0], :, None] == indices[apart[:, 1], None, :]).any(axis=(1, 2))
    pairs = np.concatenate([apart[~shared], _neighbours_not_separated(corners, indices)])
    return _sorted(np.sort(pairs[_insides_meet(corners[indices[pairs[:, 0]]], corners[indices[pairs[:, 1]]])], axis=1))


def intersections_between(vertices: Points, faces: Faces, other_vertices: OtherPoints, other_faces: Faces) -> Pairs:
    """Pairs of a face of one mesh and a face of another that cross, as in `self_intersections`."""
    if not len(faces) or not len(other_faces):
        return np.zeros((0, 2), dtype=np.int64)
    if len(faces) > len(other_faces):  # igl grows a tree over the first mesh, which costs more than asking it
        return _sorted(intersections_between(other_vertices, other_faces, vertices, faces)[:, ::-1])
    corners, indices = igl_arrays(vertices, faces)
    other_corners, other_indices = igl_arrays(other_vertices, other_faces)
    _, pairs, _ = igl.predicates.find_intersections(corners, indices, other_corners, other_indices)
    pairs = pairs.astype(np.int64)
    f, g = corners[indices[pairs[:, 0]]], other_corners[other_indices[pairs[:, 1]]]
    left = np.flatnonzero(~_are_separated(f, g))
    return _sorted(pairs[left[_insides_meet(f[left], g[left])]])


def is_graph(vertices: Points, faces: Faces, boundary_size: int) -> bool:
    """Whether a mesh with one boundary is the graph of a function over a plane, which then cannot cross itself.

    The plane is the one across the mesh's vector area. A projection that keeps all faces' orientation and whose
    boundary is a simple polygon covers each point as often as that polygon winds around it: never or once. A quick
    test, linear in the number of faces; the boundary's vertices come first, in the order in which it runs.

    Source: Volino & Magnenat-Thalmann (1994), Efficient self-collision detection on smoothly discretized surface
    animations using geometrical shape regularity.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = _cross(b - a, c - a)
    area = normals.sum(axis=0)
    size = np.linalg.norm(area)
    if not (normals @ area > MIN_NORMAL_COSINE * size * np.linalg.norm(normals, axis=1)).all():
        return False
    boundary = vertices[:boundary_size] - vertices[0]
    return not len(loop_crossings(boundary - np.outer(boundary @ area, area / size**2)))


def loop_crossings(points: Chain) -> Pairs:
    """Pairs i < j, sorted, of edges of a closed polygon (M, 3) that meet where a simple polygon's would not.

    Edge i runs from point i to point i + 1 (mod M). Edges that are no neighbours meet where their distance is zero to
    round-off: 1e-12 of the diagonal. Neighbours do where the polygon turns back onto itself. So a point that the
    polygon passes twice, as two vertices in one place or not, is found through the edges that meet there.
    """
    if is_star(points):
        return np.zeros((0, 2), dtype=np.int64)
    m = len(points)
    pairs, tolerance = _meeting_edges(points, np.roll(points, -1, axis=0), lambda i, j: (j - i > 1) & (j - i < m - 1))
    folded = _folds(points, tolerance)
    neighbours = np.stack([(folded - 1) % m, folded], axis=1)
    return _sorted(np.concatenate([pairs, np.sort(neighbours, axis=1)]))


def crossings_between(points: Chain, others: Float[np.ndarray, "n 3"]) -> Pairs:
    """Pairs, sorted, of an edge of one closed polygon and an edge of another that meet, as in `loop_crossings`."""
    starts = np.concatenate([points, others])
    ends = np.concatenate([np.roll(points, -1, axis=0), np.roll(others, -1, axis=0)])
    pairs, _ = _meeting_edges(starts, ends, lambda i, j: (i < len(points)) & (j >= len(points)))
    return _sorted(pairs - [0, len(points)])


def _meeting_edges(starts: Chain, ends: Chain, wanted: Callable[..., Bool[np.ndarray, " k"]]) -> tuple[Pairs, float]:
    """Those of the wanted pairs i < j of edges whose distance is zero to round-off, and what that is in mesh units."""
    tolerance = MEETING_PER_DIAGONAL * float(np.linalg.norm(np.ptp(starts, axis=0)))
    tolerance += 4 * float(np.finfo(np.float64).eps * np.abs(starts).max())
    i, j = edges_with_near_boxes(starts, ends, tolerance)
    pairs = np.stack([i, j], axis=1)[wanted(i, j)]
    i, j = pairs.T
    return pairs[_segment_distances(starts[i], ends[i], starts[j], ends[j]) <= tolerance], tolerance


def require_simple(loop: BoundaryLoop) -> None:
    """Checks that a loop does not meet itself; a SelfCrossingLoopError names the first two edges that do."""
    crossings = loop_crossings(loop.points)
    if len(crossings):
        edges = np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1)[crossings[0]]
        raise SelfCrossingLoopError(edges=edges.tolist(), count=len(crossings))


def _sorted(pairs: Pairs) -> Pairs:
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _cross(u: Float[np.ndarray, "*k 3"], v: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k 3"]:
    """The products u × v, without what np.cross does for other shapes: most of the time of a short loop's test."""
    (a, b, c), (d, e, f) = (np.moveaxis(w, -1, 0) for w in (u, v))
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)


def _neighbours_not_separated(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Pairs:
    """Pairs of different faces with common vertices of which neither surely has the other on one side of it."""
    corners = (np.repeat(np.arange(len(faces)), 3), faces.reshape(-1))
    incidence = coo_array((np.ones(faces.size, dtype=np.int64), corners), shape=(len(faces), len(vertices))).tocsr()
    common = (incidence @ incidence.T).tocoo()
    wanted = (common.row < common.col) & (common.data < 3)
    pairs = np.stack([common.row[wanted], common.col[wanted]], axis=1).astype(np.int64)
    f, g = vertices[faces[pairs[:, 0]]], vertices[faces[pairs[:, 1]]]
    return np.asarray(pairs[~_are_separated(f, g)])


def _are_separated(f: Triangles, g: Triangles) -> Bool[np.ndarray, " k"]:
    """Whether, surely, the corners of one triangle that the other has not lie on one side of the other's plane."""
    f, g = (np.ascontiguousarray(np.moveaxis(t, 0, 2)) for t in (f, g))  # sums over a short last axis are slow
    common = (f[:, None] == g).all(axis=2)
    limit = SEPARATION * np.ptp(np.concatenate([f, g]), axis=0).max(axis=0) ** 3
    separated = np.zeros(f.shape[2], dtype=bool)
    for one, other, shared in ((f, g, common.any(axis=0)), (g, f, common.any(axis=1))):
        normals = _cross((one[1] - one[0]).T, (one[2] - one[0]).T).T
        heights = ((other - one[0]) * normals).sum(axis=1)
        beside = ((heights > limit) | shared).all(axis=0) | ((heights < -limit) | shared).all(axis=0)
        separated |= beside & ~shared.all(axis=0)
    return separated


def _insides_meet(f: Triangles, g: Triangles) -> Bool[np.ndarray, " k"]:
    """For pairs of triangles whether a point inside one belongs to the other."""
    f_sides, g_sides = _sides_of_plane(f, g), _sides_of_plane(g, f)
    f_crosses, g_crosses = ((s.min(axis=1) < 0) & (s.max(axis=1) > 0) for s in (f_sides, g_sides))
    f_reaches, g_reaches = ((s.min(axis=1) <= 0) & (s.max(axis=1) >= 0) & s.any(axis=1) for s in (f_sides, g_sides))
    on_line = np.flatnonzero((f_crosses & g_reaches) | (f_reaches & g_crosses))
    in_plane = np.flatnonzero(~f_sides.any(axis=1) & ~g_sides.any(axis=1))
    meet = np.zeros(len(f), dtype=bool)
    # mostly there are none, and small patches are many
    if len(on_line):
        meet[on_line] = _overlap_on_line(f[on_line], g[on_line], f_sides[on_line], g_sides[on_line])
    if len(in_plane):
        meet[in_plane] = _overlap_in_plane(f[in_plane], g[in_plane])
    return meet


def _side(a: Points, b: Points, c: Points, d: Points) -> Numbers:
    """The exact sign of det(b − a, c − a, d − a): 1 where d lies on the side from which abc is counter-clockwise."""
    return -np.asarray(igl.predicates.orient3d(*(np.ascontiguousarray(points) for points in (a, b, c, d))))


def _sides_of_plane(f: Triangles, g: Triangles) -> Sides:
    """On which side of the plane of g each corner of f lies: 1, −1, or 0 on it."""
    a, b, c = (np.repeat(g[:, k], 3, axis=0) for k in range(3))
    return _side(a, b, c, f.reshape(-1, 3)).reshape(-1, 3)


def _overlap_on_line(f: Triangles, g: Triangles, f_sides: Sides, g_sides: Sides) -> Bool[np.ndarray, " k"]:
    """Whether the intervals that two triangles cut out of the line in which their planes meet overlap."""
    f_apex, f_low, f_high, f_sign = _sides_through_plane(f, f_sides)
    g_apex, g_high, g_low, g_sign = _sides_through_plane(g, g_sides)
    sign = f_sign * g_sign
    from_below = _side(f_apex, f_low, g_apex, g_high) * sign > 0
    from_above = _side(f_apex, f_high, g_apex, g_low) * sign < 0
    return np.asarray(from_below & from_above)


def _sides_through_plane(f: Triangles, sides: Sides) -> tuple[Points, Points, Points, Numbers]:
    """The corner of a triangle that is alone on its side of a plane, the two others, and that side.

    Corners on the plane count to the side on which there is none else. The others are ordered along the direction
    n_f × n of the line in which the planes meet (n the plane's normal): the side to the first crosses it lower.
    """
    filled = np.where(sides == 0, np.where((sides > 0).any(axis=1), -1, 1)[:, None], sides)
    alone = np.argmax(filled == -filled.sum(axis=1, keepdims=True), axis=1)
    k = np.arange(len(f))
    sign = filled[k, alone]
    after, before = f[k, (alone + 1) % 3], f[k, (alone + 2) % 3]
    up = (sign > 0)[:, None]
    return f[k, alone], np.where(up, before, after), np.where(up, after, before), sign


def _overlap_in_plane(f: Triangles, g: Triangles) -> Bool[np.ndarray, " k"]:
    """Whether the insides of two triangles in one plane meet: no side of either has the other triangle beyond it."""
    normals = _cross(f[:, 1] - f[:, 0], f[:, 2] - f[:, 0])
    # seen along an axis: coordinates stay as they are, so the signs stay exact
    across = (np.argmax(np.abs(normals), axis=1)[:, None] + [1, 2]) % 3
    f_flat, g_flat = (np.take_along_axis(t, across[:, None, :], axis=2) for t in (f, g))
    return np.asarray(~(_has_separating_side(f_flat, g_flat) | _has_separating_side(g_flat, f_flat)))


def _has_separating_side(f: Float[np.ndarray, "k 3 2"], g: Float[np.ndarray, "k 3 2"]) -> Bool[np.ndarray, " k"]:
    """Whether a side of one plane triangle has all of another beyond it or on it; always where the first is flat."""
    turn = _turn(f[:, 0], f[:, 1], f[:, 2])
    separates = turn == 0
    for start in range(3):
        a, b = (np.repeat(f[:, k], 3, axis=0) for k in (start, (start + 1) % 3))
        beyond = _turn(a, b, g.reshape(-1, 2)).reshape(-1, 3) * turn[:, None] <= 0
        separates |= beyond.all(axis=1)
    return np.asarray(separates)


def _turn(a: InPlane, b: InPlane, c: InPlane) -> Numbers:
    """The exact sign of det(b − a, c − a) in the plane: that of a tetrahedron whose fourth corner is over a."""
    a, b, c = (np.column_stack([points, np.zeros(len(points))]) for points in (a, b, c))
    return _side(a, b, c, a + np.array([0.0, 0.0, 1.0]))


def is_star(points: Float[np.ndarray, "*b m 3"]) -> Bool[np.ndarray, "*b"]:
    """Whether polygons wind once around their centroids without turning back, seen across their vector areas.

    Then they are simple. Most rims of holes are stars, and this is many times quicker than the general test.
    """
    spokes = points - points.mean(axis=-2, keepdims=True)
    doubled = _cross(spokes, np.roll(spokes, -1, axis=-2))
    area = doubled.sum(axis=-2, keepdims=True)
    size = np.linalg.norm(area, axis=-1, keepdims=True)
    normal = np.divide(area, size, out=np.zeros_like(area), where=size > 0)
    # twice the areas of the triangles at the centroid, and in each the least distance of its side and its angle there
    sectors = (doubled * normal).sum(axis=-1)
    flat = spokes - (spokes * normal).sum(axis=-1, keepdims=True) * normal
    radius = np.linalg.norm(flat, axis=-1)
    nearest = 2 * LEAST_DISTANCE * radius.max(axis=-1, keepdims=True) ** 2
    least = np.maximum(LEAST_ANGLE * radius * np.roll(radius, -1, axis=-1), nearest)
    along = (flat * np.roll(flat, -1, axis=-2)).sum(axis=-1)
    winds_once = np.arctan2(sectors, along).sum(axis=-1) < 3 * np.pi
    return np.asarray((sectors > least).all(axis=-1) & winds_once)


def _segment_distances(a: Points, b: Points, c: Points, d: Points) -> Float[np.ndarray, " k"]:
    """Distances between segments ab and cd: the least of the ends' and of that between two inner points."""
    u, v, w = b - a, d - c, c - a
    normal = _cross(u, v)
    squared = (normal**2).sum(axis=1)
    # the feet of the lines' common perpendicular; parallel segments are nearest at an end
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip((_cross(w, v) * normal).sum(axis=1) / squared, 0, 1)
        t = np.clip((_cross(w, u) * normal).sum(axis=1) / squared, 0, 1)
    inner = np.linalg.norm(a + s[:, None] * u - c - t[:, None] * v, axis=1)
    end, start, stop = (np.concatenate(four) for four in ((a, b, c, d), (c, c, a, a), (d, d, b, b)))
    along = stop - start
    squared = (along**2).sum(axis=1)
    share = np.clip(((end - start) * along).sum(axis=1) / np.where(squared > 0, squared, 1), 0, 1)
    ends = np.linalg.norm(end - start - share[:, None] * along, axis=1)
    return np.asarray(np.fmin(inner, ends.reshape(4, -1).min(axis=0)))


def _folds(points: Chain, tolerance: float) -> Numbers:
    """The points of a polygon at which its two edges lie on each other, to a tolerance in mesh units."""
    u, v = np.roll(points, 1, axis=0) - points, np.roll(points, -1, axis=0) - points
    acute = np.flatnonzero((u * v).sum(axis=1) > 0)
    u, v = u[acute], v[acute]
    u_length, v_length = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
    off = np.linalg.norm(_cross(u, v), axis=1) / np.maximum(u_length, v_length)
    return np.asarray(acute[(off <= tolerance) & (np.minimum(u_length, v_length) > tolerance)])
