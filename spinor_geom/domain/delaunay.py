"""Constrained Delaunay triangles of a polygon with inner points, and what is read off them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.errors import DomainError

# numbers of vertices of the closed polygons that bound a plane region, with that on their left: the outer one first
Rims = tuple[int, ...]

# a walk that has not arrived after so many triangles counts as blocked
_LONGEST_WALK = 16
_NONE = np.iinfo(np.uint32).max


class ConstrainedDelaunay:
    """Constrained Delaunay triangulation of the inside of a polygon, or between polygons, to which points can be added.

    Attributes:
        faces: Counter-clockwise triangles; those outside the polygon stay among them, with vertices that mean nothing.
        inside: Numbers of the triangles inside.
    """

    faces: Int[np.ndarray, "t 3"]
    inside: Int[np.ndarray, " i"]

    def __init__(self, points: Complex[np.ndarray, " n"], rims: Rims) -> None:
        """Takes the polygons' vertices, then points inside.

        Raises:
            DomainError: Two edges of the polygon cross, or two points are equal.
        """
        import pythoncdt

        self._cdt = pythoncdt.Triangulation(
            pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
        )
        after = rim_successors(rims)
        # Any: numpy's stubs do not say that arrays are buffers
        edges: Any = np.stack([np.arange(len(after)), after], axis=1).astype(np.uint32)
        self._m = len(after)
        self._insert(points)
        with self._typed_errors():
            self._cdt.insert_edges(edges)
        outer = self._cdt.collect_outer_triangles_and_holes()
        # no point is ever added out there, so these stay as they are
        self._outer = np.fromiter(outer, dtype=np.int64, count=len(outer))
        self._read()

    def insert(self, points: Complex[np.ndarray, " k"]) -> None:
        """Adds points inside the polygon and off its edges; the numbers of the triangles change.

        Raises:
            DomainError: Two points are equal.
        """
        self._insert(points)
        self._read()

    @property
    def neighbours(self) -> Int[np.ndarray, "t 3"]:
        """For each triangle inside: number k lies across the edge from vertex k to the next, −1 across the polygon."""
        number = np.full(len(self.faces), -1)
        number[self.inside] = self.inside
        neighbours = self._cdt.triangles_array(copy=False)["neighbors"].astype(np.int64)
        return np.where(neighbours == _NONE, -1, number[np.where(neighbours == _NONE, 0, neighbours)])

    def _insert(self, points: Complex[np.ndarray, " k"]) -> None:
        vertices: Any = plane_coordinates(points)
        with self._typed_errors():
            self._cdt.insert_vertices(vertices)

    def _read(self) -> None:
        # the vertices of a triangle around everything come first
        self.faces = self._cdt.triangles_array(copy=False)["vertices"].astype(np.int64) - 3
        is_inside = np.ones(len(self.faces), dtype=bool)
        is_inside[self._outer] = False
        self.inside = np.flatnonzero(is_inside)

    @contextmanager
    def _typed_errors(self) -> Iterator[None]:
        try:
            yield
        except RuntimeError as error:
            # what the library says is of its own numbering
            raise DomainError(
                "the boundary of the plane domain is not simple: two of its edges cross, or two of its points are "
                "equal; check that the loop does not nearly touch itself",
                vertices=self._m,
            ) from error


def constrained_delaunay(points: Complex[np.ndarray, " n"], rims: Rims) -> Int[np.ndarray, "t 3"]:
    """Counter-clockwise faces of a polygon with inner points, or between polygons.

    Args:
        points: The polygons' vertices, then points inside.
        rims: Numbers of the polygons' vertices.

    Raises:
        DomainError: Two edges of the polygon cross, or two points are equal.
    """
    mesh = ConstrainedDelaunay(points, rims)
    return np.asarray(mesh.faces[mesh.inside])


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


def circumcircles(
    p: Complex[np.ndarray, "t 3"],
) -> tuple[Complex[np.ndarray, " t"], Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Circumcentre, circumradius, and shortest edge of each counter-clockwise triangle."""
    b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    bb, cc = b.real**2 + b.imag**2, c.real**2 + c.imag**2
    # a flat triangle gets a huge circle instead of a division by zero
    twice = np.maximum(2 * cross(b, c), np.finfo(np.float64).tiny ** 0.5)
    offset = 1j * (b * cc - c * bb) / twice
    shortest = np.sqrt(np.minimum(np.abs(c - b) ** 2, np.minimum(bb, cc)))
    return p[:, 0] + offset, np.abs(offset), shortest


def reachable(
    points: Complex[np.ndarray, " n"],
    faces: Int[np.ndarray, "t 3"],
    neighbours: Int[np.ndarray, "t 3"],
    start: Int[np.ndarray, " k"],
    target: Complex[np.ndarray, " k"],
) -> Bool[np.ndarray, " k"]:
    """Whether a walk over the triangles from number `start` towards `target` arrives without leaving the polygon."""
    arrived = np.zeros(len(start), dtype=bool)
    active, at = np.arange(len(start)), start
    for _ in range(_LONGEST_WALK):
        p = points[faces[at]]
        side = cross(p[:, [1, 2, 0]] - p, target[active][:, None] - p)
        way_out = side.argmin(axis=1)
        inside = side[np.arange(len(at)), way_out] >= 0
        arrived[active[inside]] = True
        following = neighbours[at, way_out]
        go = ~inside & (following >= 0)
        active, at = active[go], following[go]
        if len(active) == 0:
            break
    return arrived
