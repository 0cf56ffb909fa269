"""A first point, a direction, and coordinates of closed polygons that do not depend on how they are given."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import backwards, norm, shifted
from spinor_geom.mesh.boundary_loop import BoundaryLoop, centroids, diagonals
from spinor_geom.mesh.spacing import edge_lengths

_ALIKE = 1e-9  # points whose distances differ by less than this share are equally far
# Lengths count as equal if rounding may make the difference: 1e-13 of the polygon's size, and this share of its largest
# coordinate. The polygon's copies with another first point then nearly always have the same rounded coordinates.
_ROUNDED, _ROUNDED_COORDINATE = 1e-13, 1e-15
# Local coordinates are multiples of 2^-36 of the size (1.5e-11), and of about 2^-20 of the shortest edge if that is
# shorter. Positions with errors of 1e-15 then nearly always have the same local coordinates.
_BITS, _BITS_OF_EDGE = 36, 20
_FLAT = 1e-9  # share of the size below which points do not determine an axis


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopFrame:
    """Coordinates that move with a closed polygon, or with several, at unit size.

    Polygons that differ by rotation, reflection, translation, scale, direction, or the first point have the same local
    coordinates up to rounding, and nearly always bit for bit, because these are rounded. If several points or both
    directions of a symmetric polygon are alike, one of them is taken.

    Attributes:
        first: the point at which the first polygon starts.
        is_backward: whether the local direction is opposite to the given one, of all polygons.
        centre: origin of the local coordinates.
        axes: orthonormal rows, right-handed or left-handed.
        size: unit of the local coordinates, the diagonal of the bounding box along the axes.
        step: local coordinates are multiples of it.
    """

    first: int
    is_backward: bool
    centre: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    size: float
    step: float

    @classmethod
    def of(cls, loop: BoundaryLoop, *others: BoundaryLoop) -> LoopFrame:
        """The frame of loops. `BoundaryLoop.beside` decides where the first loop itself is symmetric or plane."""
        beside = _beside(loop, others)
        first, is_backward = first_point(loop.points, beside)
        starts = first, *(0 for _ in others)
        ordered = np.concatenate(
            [
                each.points[_ordered(len(each), start, is_backward)]
                for each, start in zip((loop, *others), starts, strict=True)
            ]
        )
        centre = centroids(ordered)
        axes = _axes(ordered - centre, None if beside is None else beside.mean(axis=0) - centre)
        size = float(diagonals((ordered - centre) @ axes.T)) or 1.0
        edges = np.concatenate([edge_lengths(each.points) for each in (loop, *others)])
        shortest = float(edges[edges > 0].min(initial=size)) / size
        bits = max(_BITS, _BITS_OF_EDGE - int(np.frexp(shortest)[1]))
        return cls(
            first=first, is_backward=is_backward, centre=centre, axes=axes, size=size, step=float(np.ldexp(1.0, -bits))
        )

    def order(self, *rims: int) -> Int[np.ndarray, " m"]:
        """The points of polygons in the local direction, from the given first points. It is its own inverse."""
        return backwards(*rims) if self.is_backward else np.arange(sum(rims))

    @property
    def inverse(self) -> LoopFrame:
        """The frame whose `outside` gives local coordinates, which are not rounded."""
        return replace(
            self, centre=-self.centre @ self.axes.T / self.size, axes=self.axes.T, size=1 / self.size, first=0
        )

    def rounded(self, local: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Local coordinates rounded to multiples of the step."""
        return np.asarray(np.rint(local / self.step) * self.step + 0.0)  # without −0

    def local(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Local coordinates of points, rounded."""
        return self.rounded((points - self.centre) @ self.axes.T / self.size)

    def outside(self, local: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points from their local coordinates."""
        return np.asarray(self.size * local @ self.axes + self.centre)

    def faces(self, faces: Int[np.ndarray, "f 3"], *rims: int) -> Int[np.ndarray, "f 3"]:
        """Faces over polygons, in either direction, whose first vertices are their points, in the other."""
        if not self.is_backward:
            return faces
        numbers = np.arange(max(sum(rims), int(faces.max(initial=0)) + 1))
        numbers[: sum(rims)] = backwards(*rims)
        return np.asarray(numbers[faces][:, ::-1])

    def loop(self, loop: BoundaryLoop) -> BoundaryLoop:
        """A loop in local coordinates and direction, without the data of the adjacent mesh."""
        order = self.order(len(loop))
        return BoundaryLoop(
            points=self.local(loop.points[order]),
            vertex_ids=loop.vertex_ids[order],
            corners=loop.corners[order],
            corners_given=loop.corners_given,
        )


def ordered_loops(loops: Sequence[BoundaryLoop]) -> list[BoundaryLoop]:
    """Several loops in an order, and from first points, that do not depend on how they are given.

    The longest is first. Of a symmetric loop's points the others decide which is its first.
    """
    points = np.concatenate([loop.points for loop in loops])
    size = norm(points - points.mean(axis=0)).max() or 1.0
    # about the mean of the loops, because loops of one length are often equal
    centre = np.mean([centroids(loop.points) for loop in loops], axis=0)

    def lengths(loop: BoundaryLoop) -> list[int]:
        apart = norm(loop.points - centre)
        found = np.array([loop.perimeter, len(loop) * size, apart.max(), apart.min(), apart.sum()])
        return [round(-x / (_ALIKE * size)) for x in found.tolist()]

    starts = [
        first_point(loop.points, _beside(loop, [each for each in loops if each is not loop]))[0] for loop in loops
    ]
    return sorted((loop.from_point(start) for loop, start in zip(loops, starts, strict=True)), key=lengths)


def _beside(loop: BoundaryLoop, others: Sequence[BoundaryLoop]) -> Float[np.ndarray, "m 3"] | None:
    """The points beside a loop's edges, moved by the vector from its centre to that of other loops."""
    if loop.beside is None or not others:
        return loop.beside
    to = np.mean([centroids(each.points) for each in others], axis=0)
    return np.asarray(loop.beside + to - centroids(loop.points))


def first_point(points: Float[np.ndarray, "m 3"], beside: Float[np.ndarray, "m 3"] | None = None) -> tuple[int, bool]:
    """`first_points` of one polygon."""
    first, is_backward = first_points(points[None], None if beside is None else beside[None])
    return int(first[0]), bool(is_backward[0])


def first_points(
    points: Float[np.ndarray, "b m 3"], beside: Float[np.ndarray, "b m 3"] | None = None
) -> tuple[Int[np.ndarray, " b"], Bool[np.ndarray, " b"]]:
    """A point of each closed polygon, and whether it is passed backwards from there, by distances between points.

    The first one and its direction have the largest sequence of `_lengths`, then the same from the next point on.
    """
    m = points.shape[1]
    size = norm(points - centroids(points)[:, None]).max(axis=1, keepdims=True)
    allowed = np.maximum(_ROUNDED * size, _ROUNDED_COORDINATE * np.abs(points).max(axis=2).max(axis=1, keepdims=True))
    is_best = np.ones((len(points), 2 * m), dtype=bool)  # the points forwards, then the points backwards
    features = []
    for both in _lengths(points, beside):
        features.append(np.concatenate(both, axis=1))
        largest = np.where(is_best, features[-1], -np.inf).max(axis=1, keepdims=True)
        is_best &= features[-1] >= largest - allowed
        if np.count_nonzero(is_best) == len(points):
            break
    else:
        rows = np.flatnonzero(is_best.sum(axis=1) > 1)
        own = np.stack([values[rows] for values in features], axis=2)
        is_best[rows] = _with_largest_sequence(is_best[rows], own, allowed[rows])
    best = is_best.argmax(axis=1)
    return best % m, best >= m


def _lengths(
    points: Float[np.ndarray, "b m 3"], beside: Float[np.ndarray, "b m 3"] | None
) -> Iterator[tuple[Float[np.ndarray, "b m"], Float[np.ndarray, "b m"]]]:
    """Lengths at the points of polygons, in both directions.

    They are those of the next edge, and the distances from the centroid, to the second and third next point and, with
    points beside the edges, from the mean of these and from the one beside the next edge.
    """
    for steps in (1, 0, 2, 3):
        to = shifted(points, -steps, axis=1) if steps else centroids(points)[:, None]
        values = norm(to - points)
        yield values, shifted(values, steps, axis=1)
    if beside is not None:
        values = norm(points - beside.mean(axis=1, keepdims=True))
        yield values, values
        yield norm(beside - points), shifted(norm(beside - shifted(points, -1, axis=1)), 1, axis=1)


def _with_largest_sequence(
    is_best: Bool[np.ndarray, "b n"], features: Float[np.ndarray, "b n k"], allowed: Float[np.ndarray, "b 1"]
) -> Bool[np.ndarray, "b n"]:
    """Those of the given points of each polygon, forwards or backwards, with the largest sequence of features."""
    is_best, m = is_best.copy(), is_best.shape[1] // 2
    rows = np.arange(len(is_best))
    while len(rows):
        # polygons with the same candidates are compared together
        alike = defaultdict[bytes, list[int]](list)
        for row in rows.tolist():
            alike[is_best[row].tobytes()].append(row)
        changed = []
        for same in map(np.array, alike.values()):
            candidates = np.flatnonzero(is_best[same[0]])
            backward, place = np.divmod(candidates, m)
            # sequences that agree up to the next candidate are equal
            gaps = [np.diff(own, append=own[:1] + m) for own in (place[backward == 0], place[backward == 1])]
            ahead = np.arange(max(own.max(initial=1) for own in gaps))
            passed = (place[:, None] + np.where(backward, -1, 1)[:, None] * ahead) % m + m * backward[:, None]
            sequences = features[same[:, None, None], passed].reshape(len(same), len(candidates), -1)
            differ = np.ptp(sequences, axis=1) > allowed[same]
            which = np.flatnonzero(differ.any(axis=1))
            values = sequences[which, :, differ[which].argmax(axis=1)]
            is_largest = values >= values.max(axis=1, keepdims=True) - allowed[same[which]]
            is_best[same[which, None], candidates] = is_largest
            changed.append(same[which][is_largest.sum(axis=1) > 1])
        rows = np.concatenate(changed)
    return is_best


def _ordered(count: int, first: int, is_backward: bool) -> Int[np.ndarray, " {count}"]:
    """Indices of all points from the first one on."""
    return np.asarray((first + np.arange(count) * (-1 if is_backward else 1)) % count)


def _axes(points: Float[np.ndarray, "m 3"], beside: Float[np.ndarray, "3"] | None) -> Float[np.ndarray, "3 3"]:
    """Axes towards the farthest point, the point farthest from that axis, and the one farthest from their plane.

    Of several that are farthest up to rounding the first is taken. Where the points have no extent, the axis is towards
    a point beside them, and if that has no distance either, any direction.
    """
    axes = np.zeros((0, 3))
    size = norm(points).max() or 1.0
    for candidates in (points, points[:1] if beside is None else beside[None], size * np.eye(3)):
        least = _FLAT * max(size, norm(candidates).max())
        rest = candidates - candidates @ axes.T @ axes
        while len(axes) < 3:
            distance = norm(rest)
            far = int(np.argmax(distance >= (1 - _ALIKE) * distance.max()))
            if not distance[far] > least:
                break
            axis = rest[far] / distance[far]
            axis = axis - axis @ axes.T @ axes
            axes = np.concatenate([axes, (axis / norm(axis))[None]])
            rest = rest - (rest @ axes[-1])[:, None] * axes[-1]
    return axes
