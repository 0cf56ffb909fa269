"""Constrained Delaunay triangles of a polygon with inner points, and what is read off them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pythoncdt
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.errors import DomainError

# numbers of vertices of the closed polygons that bound a plane region, with that on their left: the outer one first
Rims = tuple[int, ...]

Places = Complex[np.ndarray, " k"]
Lengths = Float[np.ndarray, " k"]
Owners = Int[np.ndarray, " k"]  # the regions of points

_LONGEST_WALK = 16  # a walk that has not arrived after so many triangles counts as blocked


class ConstrainedDelaunay:
    """Constrained Delaunay triangulations of regions, each as by itself; all polygons' vertices, then inner points."""

    def __init__(
        self, points: Complex[np.ndarray, " n"], regions: Sequence[Rims], region: Int[np.ndarray, " n"] | None = None
    ) -> None:
        """Takes the polygons' vertices, then points inside.

        A point that is not finite, two equal points, or edges of a polygon that cross, are a DomainError.
        """
        self.points, self.regions = points, tuple(regions)
        self.region = np.zeros(len(points), dtype=np.int64) if region is None else region
        self.boundary_size = sum(map(sum, regions))  # of all polygons
        self.own = _members(self.region, len(regions))  # the numbers of each region's points
        self.parts = [_Region(points[own], rims) for own, rims in zip(self.own, regions, strict=True)]
        self._read()

    @property
    def triangles(self) -> Int[np.ndarray, "i 3"]:
        """The faces inside."""
        return np.asarray(self.faces[self.inside])

    def insert(self, points: Places, region: Owners) -> None:
        """Adds points inside the polygons and off their edges, and to no other; the triangles' numbers change."""
        for number, some in enumerate(_members(region, len(self.regions))):
            if len(some):
                self.parts[number].insert(points[some])
                self.own[number] = np.append(self.own[number], len(self.points) + some)
        self.points, self.region = np.append(self.points, points), np.append(self.region, region)
        self._read()

    def move(self, points: Complex[np.ndarray, " n"], regions: Int[np.ndarray, " r"]) -> None:
        """Puts points elsewhere, those of some regions and to no other, and triangulates these regions anew."""
        self.points = points
        for number in regions:
            self.parts[number] = _Region(points[self.own[number]], self.regions[number])
        self._read()

    def _read(self) -> None:
        # counter-clockwise, one region after the other; those outside the polygons have vertices that mean nothing
        self.faces = np.concatenate([own[one.faces] for own, one in zip(self.own, self.parts, strict=True)])
        first = np.cumsum([0, *(len(one.faces) for one in self.parts[:-1])])
        # their numbers inside; across the edge from vertex k of one of these to the next lies neighbour k, −1 for none
        self.inside = np.concatenate([k + one.inside for k, one in zip(first, self.parts, strict=True)])
        across = [np.where(one.across < 0, -1, k + one.across) for k, one in zip(first, self.parts, strict=True)]
        self.neighbours = np.concatenate(across)

    def reaches(self, start: Int[np.ndarray, " k"], target: Places) -> Bool[np.ndarray, " k"]:
        """Whether a walk over the triangles from number `start` towards each `target` arrives inside the polygon."""
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
    """The triangulation of one region, by the numbers of its own points."""

    def __init__(self, points: Complex[np.ndarray, " n"], rims: Rims) -> None:
        self._cdt = pythoncdt.Triangulation(
            pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
        )
        after = rim_successors(rims)
        self._m = len(after)
        self._call(self._cdt.insert_vertices, plane_coordinates(points))
        self._call(self._cdt.insert_edges, np.stack([np.arange(self._m), after], axis=1).astype(np.uint32))
        outer = self._cdt.collect_outer_triangles_and_holes()
        self._outer = np.fromiter(outer, dtype=np.int64)  # no point is ever added out there, so these stay as they are
        self._read()

    def insert(self, points: Places) -> None:
        self._call(self._cdt.insert_vertices, plane_coordinates(points))
        self._read()

    def _read(self) -> None:
        triangles = self._cdt.triangles_array(copy=False)
        # the vertices of a triangle around everything come first
        self.faces = triangles["vertices"].astype(np.int64) - 3
        across = triangles["neighbors"].astype(np.int32)  # none, the largest number that there is, becomes −1
        is_inside = np.append(np.ones(len(self.faces), dtype=bool), False)
        is_inside[self._outer] = False
        self.across, self.inside = np.where(is_inside[across], across, -1), np.flatnonzero(is_inside)

    def _call(self, insert: Callable[[Any], None], what: np.ndarray) -> None:
        if not np.isfinite(what).all():  # of these the library takes all memory
            raise DomainError(
                "a point of the plane domain is not finite; check the loop and the sizes", vertices=self._m
            )
        try:
            insert(what)
        except RuntimeError as error:
            # what the library says is of its own numbering
            raise DomainError(
                "the boundary of the plane domain is not simple: two of its edges cross, or two of its points are "
                "equal; check that the loop does not nearly touch itself",
                vertices=self._m,
            ) from error


def _members(region: Int[np.ndarray, " n"], count: int) -> list[Int[np.ndarray, " _"]]:
    """The numbers of the points of each of so many regions, ascending."""
    return np.split(np.argsort(region, kind="stable"), np.cumsum(np.bincount(region, minlength=count))[:-1])


def rim_successors(rims: Rims) -> Int[np.ndarray, " m"]:
    """For each vertex of several closed polygons, one after the other, the next one on its polygon."""
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
    """Every edge of the faces once, smaller index first, sorted."""
    code = np.unique(edge_codes(faces, n))
    return np.stack([code // n, code % n], axis=1)


def circumcircles(p: Complex[np.ndarray, "t 3"]) -> tuple[Places, Lengths, Lengths]:
    """Circumcentre, circumradius, and shortest edge of each counter-clockwise triangle."""
    b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    bb, cc = b.real**2 + b.imag**2, c.real**2 + c.imag**2
    # a flat triangle gets a huge circle instead of a division by zero
    twice = np.maximum(2 * cross(b, c), np.finfo(np.float64).tiny ** 0.5)
    offset = 1j * (b * cc - c * bb) / twice
    shortest = np.sqrt(np.minimum(np.abs(c - b) ** 2, np.minimum(bb, cc)))
    return p[:, 0] + offset, np.abs(offset), shortest
