"""Constrained Delaunay triangulation of polygons with inner points, and geometry of triangles."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pythoncdt
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.arrays import TINY
from spinor_geom.errors import DomainError

# numbers of vertices of the polygons that bound a plane region, the outer one first; the region is on their left
Rims = tuple[int, ...]

Places = Complex[np.ndarray, " k"]
Lengths = Float[np.ndarray, " k"]
Owners = Int[np.ndarray, " k"]  # the regions of points

_LONGEST_WALK = 16  # triangles after which a walk counts as blocked


class ConstrainedDelaunay:
    """Constrained Delaunay triangulations of several regions, which are independent of each other.

    Points are numbered together: first the vertices of all polygons, then inner points.
    """

    def __init__(
        self, points: Complex[np.ndarray, " n"], regions: Sequence[Rims], region: Int[np.ndarray, " n"] | None = None
    ) -> None:
        """Triangulates all points, given the rims of each region and the region of each point.

        Raises:
            DomainError: a point is not finite, two points are equal, or edges of polygons cross.
        """
        self.points, self.regions = points, tuple(regions)
        self.region = np.zeros(len(points), dtype=np.int64) if region is None else region
        self.boundary_size = sum(map(sum, regions))  # of all polygons
        self.own = _members(self.region, len(regions))  # the points of each region
        self.parts = [_Region(points[own], rims) for own, rims in zip(self.own, regions, strict=True)]
        self._read()

    @property
    def triangles(self) -> Int[np.ndarray, "i 3"]:
        """The faces inside the polygons."""
        return np.asarray(self.faces[self.inside])

    def insert(self, points: Places, region: Owners) -> None:
        """Adds points that lie inside the polygons and not on edges; triangles are renumbered."""
        for number, some in enumerate(_members(region, len(self.regions))):
            if len(some):
                self.parts[number].insert(points[some])
                self.own[number] = np.concatenate([self.own[number], len(self.points) + some])
        self.points = np.concatenate([self.points, points])
        self.region = np.concatenate([self.region, region])
        self._read()

    def move(self, points: Complex[np.ndarray, " n"], regions: Int[np.ndarray, " r"]) -> None:
        """Replaces all points, which may differ in the given regions, and triangulates these again."""
        self.points = points
        for number in regions:
            self.parts[number] = _Region(points[self.own[number]], self.regions[number])
        self._read()

    def _read(self) -> None:
        # counter-clockwise, region after region; faces outside the polygons have invalid vertices
        self.faces = np.concatenate([own[one.faces] for own, one in zip(self.own, self.parts, strict=True)])
        first = np.cumsum([0, *(len(one.faces) for one in self.parts[:-1])])
        # `inside` are the faces inside; neighbour k lies across the edge from vertex k to the next, −1 if there is none
        self.inside = np.concatenate([k + one.inside for k, one in zip(first, self.parts, strict=True)])
        across = [np.where(one.across < 0, -1, k + one.across) for k, one in zip(first, self.parts, strict=True)]
        self.neighbours = np.concatenate(across)

    def reaches(self, start: Int[np.ndarray, " k"], target: Places) -> Bool[np.ndarray, " k"]:
        """Whether a straight walk over the triangles from face `start` to each `target` stays inside the polygons."""
        arrived = np.zeros(len(start), dtype=bool)
        active, at = np.arange(len(start)), start
        for _ in range(_LONGEST_WALK):
            p = self.points[self.faces[at]]
            side = cross(p[:, [1, 2, 0]] - p, target[active][:, None] - p)
            way_out = side.argmin(axis=1)
            inside = side[np.arange(len(at)), way_out] >= 0
            arrived[active[inside]] = True
            following = self.neighbours[at, way_out]
            go = ~inside & (following >= 0)
            active, at = active[go], following[go]
            if len(active) == 0:
                break
        return arrived


class _Region:
    """The triangulation of one region."""

    def __init__(self, points: Complex[np.ndarray, " n"], rims: Rims) -> None:
        self._cdt = pythoncdt.Triangulation(
            pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
        )
        after = rim_successors(rims)
        self._m = len(after)
        self._call(self._cdt.insert_vertices, plane_coordinates(points))
        self._call(self._cdt.insert_edges, np.stack([np.arange(self._m), after], axis=1).astype(np.uint32))
        outer = self._cdt.collect_outer_triangles_and_holes()
        self._outer = np.fromiter(outer, dtype=np.int64)  # never changes: points are added inside only
        self._read()

    def insert(self, points: Places) -> None:
        self._call(self._cdt.insert_vertices, plane_coordinates(points))
        self._read()

    def _read(self) -> None:
        triangles = self._cdt.triangles_array(copy=False)
        # the first three vertices are those of a triangle around all others
        self.faces = triangles["vertices"].astype(np.int64) - 3
        across = triangles["neighbors"].astype(np.int32)  # the largest unsigned number, for none, becomes −1
        is_inside = np.ones(len(self.faces) + 1, dtype=bool)
        is_inside[self._outer] = is_inside[-1] = False
        self.across, self.inside = np.where(is_inside[across], across, -1), np.flatnonzero(is_inside)

    def _call(self, insert: Callable[[Any], None], what: np.ndarray) -> None:
        if not np.isfinite(what).all():  # the library would allocate without limit
            raise DomainError(
                "a point of the plane domain is not finite; check the loop and the sizes", vertices=self._m
            )
        try:
            insert(what)
        except RuntimeError as error:
            # the library's message has its own vertex numbers
            raise DomainError(
                "the boundary of the plane domain is not simple: two of its edges cross, or two of its points are "
                "equal; check that the loop does not nearly touch itself",
                vertices=self._m,
            ) from error


def _members(region: Int[np.ndarray, " n"], count: int) -> list[Int[np.ndarray, " _"]]:
    """The points of each of `count` regions, ascending."""
    order, ends = np.argsort(region, kind="stable"), np.cumsum(np.bincount(region, minlength=count)).tolist()
    return [order[start:end] for start, end in pairwise([0, *ends])]


def rim_successors(rims: Rims) -> Int[np.ndarray, " m"]:
    """The next vertex on its polygon for each vertex of several polygons, which are numbered one after the other."""
    after = np.arange(1, sum(rims) + 1)
    last = np.cumsum(rims) - 1
    after[last] -= rims
    return after


def plane_coordinates(z: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """Complex numbers as rows (x, y), without a copy where possible."""
    return np.ascontiguousarray(z).view(np.float64).reshape(-1, 2)


def flat_coordinates(z: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Complex numbers as points (x, y, 0) of space."""
    return np.column_stack([plane_coordinates(z), np.zeros(len(z))])


def cross(a: Complex[np.ndarray, "*#n"], b: Complex[np.ndarray, "*#n"]) -> Float[np.ndarray, "*n"]:
    """Signed area of the parallelogram from a to b."""
    return np.asarray(a.real * b.imag - a.imag * b.real)


def edge_codes(faces: Int[np.ndarray, "t 3"], n: int) -> Int[np.ndarray, " t3"]:
    """For each edge of each face, from vertex k to the next: smaller index · n + larger index."""
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    return np.asarray(np.minimum(a, b) * n + np.maximum(a, b))


def unique_edges(faces: Int[np.ndarray, "t 3"], n: int) -> Int[np.ndarray, "e 2"]:
    """The edges of faces, smaller index first, sorted."""
    code = np.sort(edge_codes(faces, n))  # np.unique would hash integers first, which takes longer
    code = code[np.append(True, code[1:] != code[:-1])[: len(code)]]
    return np.stack([code // n, code % n], axis=1)


def circumcircles(p: Complex[np.ndarray, "t 3"]) -> tuple[Places, Lengths, Lengths]:
    """Circumcentre, circumradius and shortest edge of counter-clockwise triangles."""
    b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    bb, cc = b.real**2 + b.imag**2, c.real**2 + c.imag**2
    # a flat triangle gets a huge circle instead of a division by zero
    twice = np.maximum(2 * cross(b, c), TINY**0.5)
    offset = 1j * (b * cc - c * bb) / twice
    shortest = np.sqrt(np.minimum(np.abs(c - b) ** 2, np.minimum(bb, cc)))
    return p[:, 0] + offset, np.abs(offset), shortest
