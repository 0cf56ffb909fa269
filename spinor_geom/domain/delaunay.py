"""Constrained Delaunay triangulation of polygons with inner points, and geometry of triangles."""

from typing import Any

import numpy as np
import pythoncdt
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import distinct
from spinor_geom.errors import DomainError

# numbers of vertices of the polygons that bound a plane region, the outer one first. The region is on their left
Rims = tuple[int, ...]

Places = Complex[np.ndarray, " k"]
Lengths = Float[np.ndarray, " k"]


def constrained_delaunay(points: Complex[np.ndarray, " n"], rims: Rims) -> Int[np.ndarray, "t 3"]:
    """The constrained Delaunay triangulation of polygons and inner points: the faces inside the polygons.

    The vertices of the polygons come first. Faces are counter-clockwise.

    Raises:
        DomainError: a point is not finite, two points are equal, or edges of the polygons cross.
    """
    if not np.isfinite(points).all():  # the library would allocate without limit
        raise DomainError("a point of the plane domain is not finite; check the loop and the sizes", vertices=sum(rims))
    cdt: Any = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
    )
    try:
        cdt.insert_vertices(plane_coordinates(points))
        cdt.insert_edges(rim_edges(rims).astype(np.uint32))
        cdt.erase_outer_triangles_and_holes()
    except RuntimeError as error:
        # the library's message has its own vertex numbers
        raise DomainError(
            "the boundary of the plane domain is not simple: two of its edges cross, or two of its points are equal; "
            "check that the loop does not nearly touch itself",
            vertices=sum(rims),
        ) from error
    return np.asarray(cdt.triangles_array(copy=False)["vertices"].astype(np.int64))


def rim_successors(rims: Rims) -> Int[np.ndarray, " m"]:
    """The next vertex on its polygon for each vertex of several polygons, which are numbered one after the other."""
    after = np.arange(1, sum(rims) + 1)
    last = np.cumsum(rims) - 1
    after[last] -= rims
    return after


def rim_edges(rims: Rims) -> Int[np.ndarray, "m 2"]:
    """The edges of several polygons whose vertices are numbered one after the other."""
    after = rim_successors(rims)
    return np.stack([np.arange(len(after)), after], axis=1)


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
    code = distinct(edge_codes(faces, n))
    return np.stack([code // n, code % n], axis=1)
