"""A closed boundary polygon in space with its measures and corners."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.arrays import backwards, median, norm, shifted
from spinor_geom.errors import LoopTooShortError, MeshError, MeshShapeError, OptionError, RepeatedPointError
from spinor_geom.mesh.array_checks import freeze_points, frozen, shared
from spinor_geom.mesh.interpolation import missed
from spinor_geom.mesh.spacing import edge_lengths, graded_spacing, have_similar_lengths, with_long_edges_divided

MIN_CORNER_TURN = np.radians(35.0)
# Least ratio of a corner's turn to its neighbours', where cubics predict the points between corners and elsewhere. The
# first alone finds one in 1 of 750 coarse samples of smooth curves and, of 230 rims of meshes, in those along arcs.
CONTRAST_OF_PREDICTED, CONTRAST = 2.0, 4.0
PREDICTED = 0.05  # of an edge, largest distance of predicted points. With noise of 0.02 edges some are farther
# Of an edge and of the median: larger misses beside a turn are those of a sharp bend. At corners of 40 polygons with
# curved sides the ratio is at most 8.5, at bends of smooth curves of more than 50 points above 10 with few exceptions.
MISSED_AT_BEND, WORSE_AT_BEND = 0.02, 10.0
STRAIGHT = float(np.finfo(np.float32).eps) ** 0.5  # largest turn on a straight side, by rounding
MIN_LOOP_WITH_CORNERS = 8
# Least ratio of the turn beside a straight line to that on it. At points of inflection it is at most 25.
BESIDE_LINES = 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """A plane through a set of points, in mesh units."""

    centroid: Float[np.ndarray, " 3"]  # a point of the plane
    normal: Float[np.ndarray, " 3"]  # of length 1
    rms_distance: float  # root of the mean squared distance of the points from the plane


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryLoop:
    """A closed polygon of M ≥ 3 points: a hole of a mesh, or a curve without a mesh.

    The loop has the orientation of the boundary of a patch over it, opposite to the half-edges of the faces beside the
    hole: a patch with this boundary is oriented like the mesh. Without a mesh, the normal of the patch follows from the
    order of the points by the right-hand rule.

    Attributes:
        points: (M, 3) float64, in mesh units.
        vertex_ids: (M,) int64 indices of the points in the mesh, or 0 to M − 1 without a mesh.
        corners: (M,) bool, where the curve through the points has a kink.
        corners_given: whether the caller named the corners, or False if `detect_corners` found them.
        slit_fraction: share of the perimeter, 0 to 1, on edges that coincide with an oppositely directed edge of the
            same loop. 1 is a slit of zero width.
        seam_edges: (k, 2) int64 vertex ids, from and to, of the edges that coincide with an edge of another loop.
        seam_distance: the largest distance between the two sides of slits and seams, in mesh units.
        junctions: (k, 3) int64 vertex ids of T-junctions of this loop: a vertex, and the two ends of the boundary edge
            on which the vertex and one of its own edges lie.
        beside: (M, 3) positions of the mesh's vertices opposite the loop's edges, or None without a mesh.
        obstacle: the error that prevents joining a patch to the mesh along the loop, or None if a patch can be joined.
        remarks: inconsistencies of the faces that touch the loop, one sentence each.

    Raises:
        MeshShapeError: an array has the wrong shape or dtype.
        NonFiniteVertexError: a point is NaN or infinite.
        LoopTooShortError: fewer than three points.
    """

    points: Float[np.ndarray, "m 3"]
    vertex_ids: Int[np.ndarray, " m"]
    corners: Bool[np.ndarray, " m"]
    corners_given: bool = False
    slit_fraction: float = 0.0
    seam_edges: Int[np.ndarray, "k 2"] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    seam_distance: float = 0.0
    junctions: Int[np.ndarray, "j 3"] = field(default_factory=lambda: np.empty((0, 3), dtype=np.int64))
    beside: Float[np.ndarray, "m 3"] | None = None
    obstacle: MeshError | None = None
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        corners = f", {int(self.corners.sum())} corners" if self.corners.any() else ""
        return f"BoundaryLoop({len(self)} points, perimeter {self.perimeter:.6g}{corners})"

    def __post_init__(self) -> None:
        points = freeze_points(self.points, name="points")
        count = len(points)
        if count < 3:
            raise LoopTooShortError(points=count)
        self.__dict__.update(
            points=points,
            vertex_ids=frozen(self.vertex_ids, "integers", count, name="vertex_ids"),
            corners=frozen(self.corners, "booleans", count, name="corners"),
            seam_edges=frozen(self.seam_edges, "integers", None, 2, name="seam_edges"),
            junctions=frozen(self.junctions, "integers", None, 3, name="junctions"),
        )

    @classmethod
    def from_points(cls, points: ArrayLike, *, corners: Literal["auto"] | ArrayLike = "auto") -> BoundaryLoop:
        """A closed curve without a mesh from its points in order. A last point equal to the first is dropped.

        Args:
            points: (M, 3) real numbers, in mesh units.
            corners: "auto" for the rule of `detect_corners`, or the indices of the points that are corners.

        Raises:
            MeshShapeError: `points` are not (M, 3) real numbers.
            NonFiniteVertexError: a point is NaN or infinite.
            LoopTooShortError: fewer than three points.
            RepeatedPointError: two neighbouring points are equal.
            OptionError: `corners` is neither "auto" nor indices of points.
        """
        given = freeze_points(points, name="points")
        if len(given) > 1 and (given[0] == given[-1]).all():
            given = given[:-1]
        # `==` of an array of indices is elementwise
        is_given = not (isinstance(corners, str) and corners == "auto")
        if not is_given:
            flags = detect_corners(given)
        else:
            try:
                indices = frozen(corners, "integers", np.size(corners), name="corners")
            except MeshShapeError as error:
                raise OptionError(f"corners must be 'auto' or point indices, got {corners!r}") from error
            outside = indices[(indices < 0) | (indices >= len(given))]
            if len(outside):
                raise OptionError(f"corners contains index {outside[0]}, but the loop has points 0 to {len(given) - 1}")
            flags = np.isin(np.arange(len(given)), indices)
        loop = cls(points=given, vertex_ids=np.arange(len(given)), corners=flags, corners_given=is_given)
        require_distinct_neighbours(loop)
        return loop

    def __len__(self) -> int:
        """The number M of points."""
        return len(self.points)

    def reversed(self) -> BoundaryLoop:
        """The loop with the opposite direction and the same first point."""
        back = backwards(len(self))
        points, ids, corners = self.points[back], self.vertex_ids[back], self.corners[back]
        beside = None if self.beside is None else self.beside[::-1]
        return replace(
            self, points=points, vertex_ids=ids, corners=corners, seam_edges=self.seam_edges[:, ::-1], beside=beside
        )

    def from_point(self, first: int) -> BoundaryLoop:
        """The loop with another first point."""
        order = (first + np.arange(len(self))) % len(self)
        beside = None if self.beside is None else self.beside[order]
        return replace(
            self,
            points=self.points[order],
            vertex_ids=self.vertex_ids[order],
            corners=self.corners[order],
            beside=beside,
        )

    @cached_property
    def edge_lengths(self) -> Float[np.ndarray, " m"]:
        """Edge lengths, (M,), in mesh units. Edge i runs from point i to point i + 1 (mod M)."""
        return shared(edge_lengths(self.points))

    @cached_property
    def divided(self) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        """The points, with points added on long edges, and a mask of the loop's own points."""
        return with_long_edges_divided(self.points)

    @cached_property
    def perimeter(self) -> float:
        """Sum of the edge lengths, in mesh units."""
        return float(self.edge_lengths.sum())

    @property
    def mean_edge_length(self) -> float:
        """Perimeter over number of edges, in mesh units."""
        return self.perimeter / len(self)

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the axis-parallel bounding box of the points, in mesh units."""
        return float(diagonals(self.points))

    @cached_property
    def centroid(self) -> Float[np.ndarray, " 3"]:
        """(3,) centre of mass of the polygon's edges, in mesh units, invariant under subdivision of edges."""
        return shared(centroids(self.points))

    @property
    def area_vector(self) -> Float[np.ndarray, " 3"]:
        """Vector area ½ Σ P_i × P_{i+1} of any surface that the loop bounds, (3,), in squared mesh units."""
        centred = self.points - self.centroid
        # all components in one product, which is several times as fast as cross products
        moments = centred.T @ shifted(centred, -1, axis=-2)
        return np.asarray(0.5 * (moments - moments.T)[[1, 2, 0], [2, 0, 1]])

    @cached_property
    def plane(self) -> Plane:
        """The least-squares plane of the points, each weighted by half the length of its two edges.

        The normal is on the side of `area_vector`. For collinear points it is any plane through their line.
        """
        axes, _ = self._principal_axes
        normal = -axes[2] if axes[2] @ self.area_vector < 0 else axes[2]
        return Plane(centroid=self.centroid, normal=normal, rms_distance=self.height)

    @property
    def height(self) -> float:
        """Root mean squared distance of the points from `plane`, in mesh units."""
        return float(self._principal_axes[1][2])

    @cached_property
    def elongation(self) -> float:
        """Ratio of the two longest sides of the box along the principal axes, ≥ 1, and ∞ for collinear points."""
        axes, _ = self._principal_axes
        return float(_elongations(self.points - self.centroid, axes))

    @cached_property
    def _principal_axes(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        """Principal axes as rows, widest first, and the root mean squared deviation along each."""
        return _weighted_axes(self.points - self.centroid, _point_weights(self.points))


def measure(loops: Iterable[BoundaryLoop]) -> None:
    """Computes the measures of loops that are kept on first use, of all loops with the same number of points at once.

    For thousands of small loops this takes a tenth of the time.
    """
    by_count = defaultdict[int, list[BoundaryLoop]](list)
    for loop in loops:
        by_count[len(loop)].append(loop)
    for same in by_count.values():
        points = np.stack([loop.points for loop in same])
        lengths, centres = edge_lengths(points), centroids(points)
        centred = points - centres[:, None]
        axes, deviations = _weighted_axes(centred, _point_weights(points))
        measures: dict[str, Iterable[object]] = {
            "edge_lengths": shared(lengths),
            "perimeter": lengths.sum(axis=-1).tolist(),
            "diagonal": diagonals(points).tolist(),
            "centroid": shared(centres),
            "elongation": _elongations(centred, axes).tolist(),
            "_principal_axes": zip(axes, deviations, strict=True),
        }
        for loop, *values in zip(same, *measures.values(), strict=True):
            loop.__dict__.update(zip(measures, values, strict=True))


def _weighted_axes(
    centred: Float[np.ndarray, "*b m 3"], weights: Float[np.ndarray, "*b m"]
) -> tuple[Float[np.ndarray, "*b 3 3"], Float[np.ndarray, "*b 3"]]:
    """Principal axes of weighted points as rows, widest first, and the root mean squared deviation along each."""
    _, deviations, axes = np.linalg.svd(centred * np.sqrt(weights)[..., None], full_matrices=False)
    return axes, deviations


def _elongations(centred: Float[np.ndarray, "*b m 3"], axes: Float[np.ndarray, "*b 3 3"]) -> Float[np.ndarray, "*b"]:
    """Ratios of the two longest sides of boxes along axes, ∞ if the second is 0."""
    sides = np.sort(np.ptp(centred @ axes.swapaxes(-1, -2), axis=-2), axis=-1)
    second, longest = sides[..., 1], sides[..., 2]
    return np.asarray(np.divide(longest, second, out=np.full_like(longest, np.inf), where=second > 0))


def diagonals(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b"]:
    """Diagonals of the axis-parallel bounding boxes of polygons."""
    return np.asarray(np.linalg.norm(np.ptp(points, axis=-2), axis=-1))


def centroids(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b 3"]:
    """Centres of mass of the edges of closed polygons."""
    # relative to point 0, so that no digits are lost far from the origin
    first = points[..., :1, :]
    moments = _point_weights(points)[..., None] * (points - first)
    return np.asarray(first[..., 0, :] + moments.sum(axis=-2))


def _point_weights(points: Float[np.ndarray, "*b m 3"]) -> Float[np.ndarray, "*b m"]:
    """Half the length of the two edges at each point of a closed polygon over the perimeter."""
    lengths = edge_lengths(points)
    both, perimeter = (lengths + shifted(lengths, 1), lengths.sum(axis=-1, keepdims=True))
    even = np.full_like(both, 1 / both.shape[-1])
    return np.asarray(np.divide(both, 2 * perimeter, out=even, where=perimeter > 0))


def detect_corners(points: Float[np.ndarray, "m 3"]) -> Bool[np.ndarray, " m"]:
    """Mask of the points of a closed polygon that are corners of the sampled curve, (M,) bool.

    Corners of a smooth curve are isolated, but large turns of a noisy rim are adjacent. Point i is a corner if the
    polygon turns there by θ_i ≥ 35°, and by at most θ_i/2 at the two points before and the two points after it, or only
    at the next one if a straight side begins there. It must not be a sharp bend (see `_are_bends`), and the points
    between the corners must be predicted (see `have_predicted_sides`). If they are not, its neighbours turn by at most
    θ_i/4, and half of all points by at most 35°/4.

    Let s be an edge's `graded_spacing`. The end of a longer edge is a corner if a smooth curve with that turning angle
    would leave the edge by more than about s/4.

    Polygons of fewer than 8 points have no corners. Ends of an edge of length 0 are not corners.
    """
    if len(points) < MIN_LOOP_WITH_CORNERS:
        return np.zeros(len(points), dtype=bool)
    turn, length = turning_angles(points), edge_lengths(points)
    turn[np.isnan(turn)] = 0.0
    corners: Bool[np.ndarray, " m"] = np.zeros(len(points), dtype=bool)
    if not have_similar_lengths(length):
        spacing = graded_spacing(length)
        at_start, at_end = ((length > spacing) & (length * angle > spacing) for angle in (turn, shifted(turn, -1)))
        corners = at_start | shifted(at_end, 1)
    # beyond a point on a straight side there may be another corner
    pairs = [(shifted(turn, step), shifted(turn, 2 * step)) for step in (-1, 1)]
    beside = np.max([np.where(near > STRAIGHT, np.maximum(near, far), 0.0) for near, far in pairs], axis=0)
    isolated = (turn >= MIN_CORNER_TURN) & (turn >= CONTRAST_OF_PREDICTED * beside)
    if isolated.any():
        isolated &= ~_are_bends(points, corners | isolated, turn)
        if not have_predicted_sides(points, corners | isolated):
            is_half_small = 2 * np.count_nonzero(turn <= MIN_CORNER_TURN / CONTRAST) >= len(turn)
            isolated &= is_half_small & (turn >= CONTRAST * beside)
    corners |= isolated
    return corners


def straight_edges(points: Float[np.ndarray, "m 3"], corners: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Mask of the edges of a closed polygon in straight lines of at least three edges that end at curves or corners.

    There are none if two lines meet without a corner, a line ends at a turn like one, or the polygon turns little more
    beside a line than on it, as at points of inflection of smooth curves.
    """
    none = np.zeros(len(points), dtype=bool)
    turn = np.nan_to_num(turning_angles(points), nan=np.inf)
    straight = turn <= STRAIGHT
    inner = straight & (shifted(straight, 1) | shifted(straight, -1))
    if not inner.any() or straight.all():
        return none
    lines = inner | shifted(inner, -1)
    ends = ~inner & (lines | shifted(lines, 1)) & ~corners
    at, beyond = turn[ends], np.where(lines, shifted(turn, 1), shifted(turn, -1))[ends]
    meet = (lines & shifted(lines, 1))[ends]
    are_sharp = (at >= MIN_CORNER_TURN) & (at >= CONTRAST_OF_PREDICTED * beyond)
    are_smooth = np.maximum(at, beyond) < BESIDE_LINES * turn[inner].max()
    return none if (meet | are_sharp | are_smooth).any() else lines


def _are_bends(
    points: Float[np.ndarray, "m 3"], corners: Bool[np.ndarray, " m"], turn: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " m"]:
    """Which points of a closed polygon are sharp bends of a smooth curve, if they are among possible corners.

    Two points from a bend, cubics miss the curve by much more than elsewhere, because its curvature grows towards the
    bend. Next to a corner they miss it as little as elsewhere, or as much. Straight parts are left out.
    """
    share, inner = _missed_shares(points, corners)
    curved = share[inner & (turn > STRAIGHT)]
    if not len(curved):
        return np.zeros(len(points), dtype=bool)
    share[~inner] = 0.0
    beside = np.maximum(shifted(share, -2), shifted(share, 2))
    return np.asarray(beside > max(MISSED_AT_BEND, WORSE_AT_BEND * median(curved)))


def _missed_shares(
    points: Float[np.ndarray, "m 3"], corners: Bool[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """`missed` by cubics, relative to the shorter edge at each point, and a mask of points not next to a corner."""
    length = edge_lengths(points)
    inner = ~(corners | shifted(corners, 1) | shifted(corners, -1))
    if not length.all():
        return np.full(len(points), np.inf), inner
    return missed(points, 2) / np.minimum(length, shifted(length, 1)), inner


def have_predicted_sides(points: Float[np.ndarray, "m 3"], corners: Bool[np.ndarray, " m"]) -> bool:
    """Whether points of a closed polygon lie on smooth curves between its corners.

    The cubics over chord lengths through two neighbours on each side miss the points by at most 0.05 of their shorter
    edge. Points next to a corner are left out. Of the others there are at least as many as corners.
    """
    share, inner = _missed_shares(points, corners)
    return bool(np.count_nonzero(inner) >= np.count_nonzero(corners) and (share[inner] <= PREDICTED).all())


def turning_angles(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Angle between the incoming and the outgoing edge at each point of a closed polygon, (M,), in radians.

    0 is straight, π is a reversal, NaN is beside an edge of length 0.
    """
    edges = shifted(points, -1, axis=-2) - points
    lengths = norm(edges)[:, None]
    directions = np.divide(edges, lengths, out=np.full_like(edges, np.nan), where=lengths > 0)
    before = shifted(directions, 1, axis=-2)
    # arccos of the scalar product would lose half the digits at small angles
    sine, cosine = norm(directions - before), norm(directions + before)
    return np.asarray(2 * np.arctan2(sine, cosine))


def require_distinct_neighbours(loop: BoundaryLoop) -> None:
    """Raises a RepeatedPointError with the first point of a loop that equals the next one."""
    if loop.edge_lengths.all():
        return
    equal = (loop.points == shifted(loop.points, -1, axis=0)).all(axis=1)
    if equal.any():  # a length of 0 may also be an underflow
        raise RepeatedPointError(index=int(np.argmax(equal)))
