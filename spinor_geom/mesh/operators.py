"""Differential operators, areas, angles and curvature of triangle meshes, by libigl."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from spinor_geom.arrays import TINY, norm, shifted
from spinor_geom.deadline import require_time
from spinor_geom.errors import NoFacesError, NonFiniteVertexError, SingularMatrixError
from spinor_geom.kernel import call, checked
from spinor_geom.mesh.array_checks import igl_arrays
from spinor_geom.mesh.topology import HalfEdges

Vertices = Float[np.ndarray, "v d"]
Faces = Int[np.ndarray, "f 3"]
# starts of columns, rows and values of a sparse matrix, with room for more
CompiledMatrix: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]

# Least circumcentric area, which may be negative at obtuse corners, per barycentric area.
_LEAST_SHARE = 0.3
# Least excess of two sides of a mollified triangle over the third, per longest side: it bounds the cotangents.
_SLACK = 1e-6
_NEAR = 64  # usual bound of the number of vertices within three edges of one
# Upper bound of the seconds of a factorisation, for matrices of plane meshes with n entries: 6e-8 n^(4/3). Measured are
# 2.5e-8 to 3.9e-8 for Laplacians of 2,000 to 180,000 vertices, and 1.3e-8 to 3.4e-8 for their squares.
_FACTOR_SECONDS, _FACTOR_POWER = 6e-8, 4 / 3


def cotangent_laplacian(vertices: Vertices, faces: Faces) -> csc_array:
    """The cotangent Laplacian L, (V, V), symmetric and positive semidefinite.

    L_ij = −½ (cot α_ij + cot β_ij) with the angles opposite to edge ij, and rows sum to 0. uᵀLu is the Dirichlet
    energy ∫|∇u|² of the piecewise linear u. Dimensionless.

    Source: Pinkall & Polthier (1993), Computing discrete minimal surfaces and their conjugates.
    """
    return csc_array(-igl.cotmatrix(*igl_arrays(vertices, faces)))


def side_lengths(vertices: Vertices, faces: Faces) -> Float[np.ndarray, "f 3"]:
    """Lengths of the sides of faces, (F, 3), from each corner to the next."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.stack([norm(b - a), norm(c - b), norm(a - c)], axis=1)


def mollified_edge_lengths(vertices: Vertices, faces: Faces) -> Float[np.ndarray, "f 3"]:
    """Lengths of the edges opposite to the corners of faces, (F, 3), increased for degenerate faces.

    If two sides of a face exceed the third by less than a millionth of the longest, all three are increased by the
    difference. The Laplacian of these lengths is finite and positive semidefinite for any faces.

    Source: Sharp & Crane (2020), "A Laplacian for nonmanifold triangle meshes", for mollified lengths.
    """
    corners = vertices[faces]
    length = np.linalg.norm(corners[:, [1, 2, 0]] - corners[:, [2, 0, 1]], axis=2)
    # fourth powers of the ratios of lengths, in the areas, must not underflow
    longest = np.maximum(length.max(axis=1), max(TINY**0.2 * length.max(initial=0.0), TINY))
    slack = length.sum(axis=1) - 2 * length.max(axis=1)
    return np.asarray(length + np.maximum(_SLACK * longest - slack, 0.0)[:, None])


def intrinsic_laplacian(lengths: Float[np.ndarray, "f 3"], faces: Faces, count: int) -> csc_array:
    """`cotangent_laplacian` of `count` vertices from the lengths of the edges opposite to the corners."""
    matrix = _room(count, count + 6 * len(faces))
    sides = np.ascontiguousarray(lengths, dtype=np.float64)
    call("intrinsic_laplacian", count, len(faces), sides, _corners(faces, count), *matrix)
    return _sparse(*matrix)


def _corners(faces: Faces, count: int) -> Int[np.ndarray, "f 3"]:
    return checked("faces", faces, np.int64, None, 3, least=0, most=count - 1)


def _room(count: int, room: int) -> CompiledMatrix:
    return np.empty(count + 1, dtype=np.int32), np.empty(room, dtype=np.int32), np.empty(room)


def _sparse(starts: np.ndarray, rows: np.ndarray, values: np.ndarray) -> csc_array:
    count, filled = len(starts) - 1, starts[-1]
    return csc_array((values[:filled], rows[:filled], starts), shape=(count, count))


def mollified_laplacian(vertices: Vertices, faces: Faces) -> csc_array:
    """`cotangent_laplacian` of the `mollified_edge_lengths`: finite for any faces."""
    return intrinsic_laplacian(mollified_edge_lengths(vertices, faces), faces, len(vertices))


def intrinsic_angles(lengths: Float[np.ndarray, "*f 3"]) -> Float[np.ndarray, "*f 3"]:
    """Angles of triangles, in radians, from the lengths of the edges opposite to the corners, accurate at 0 and π."""
    before, after = shifted(lengths, 1), shifted(lengths, -1)
    top = np.maximum(lengths**2 - (before - after) ** 2, 0.0)
    bottom = np.maximum((before + after) ** 2 - lengths**2, 0.0)
    return np.asarray(2 * np.arctan2(np.sqrt(top), np.sqrt(bottom)))


def graph_laplacian(faces: Faces) -> csc_array:
    """The graph Laplacian of a mesh's edges, all of weight 1."""
    if not len(faces):  # libigl would look for the largest index
        return csc_array((0, 0))
    adjacent = csc_array(igl.adjacency_matrix(np.ascontiguousarray(faces, dtype=np.int64)), dtype=np.float64)
    return csc_array(diags_array(adjacent.sum(axis=0)) - adjacent)


def vertices_to_factor(seconds: float) -> float:
    """Number of vertices of a mesh whose Laplacian, of seven entries for each, is factored in some seconds."""
    return float((max(seconds, 0.0) / _FACTOR_SECONDS) ** (1 / _FACTOR_POWER) / 7)


def factor_symmetric(matrix: csc_array) -> SuperLU:
    """Sparse LU of a symmetric matrix, with its inertia in the signs of U's diagonal.

    Raises:
        SingularMatrixError: the matrix is singular or not finite.
        OutOfTimeError: the estimated time is longer than what is left of the time limit.
    """
    require_time(_FACTOR_SECONDS * matrix.nnz**_FACTOR_POWER)
    if not np.isfinite(matrix.data).all():
        raise SingularMatrixError(size=matrix.shape[0])
    try:
        # with panels of one column it takes 0.6 to 0.9 times as long for Laplacians of plane meshes and their squares
        return splu(matrix.tocsc(), "MMD_AT_PLUS_A", 0.0, panel_size=1, options={"SymmetricMode": True})
    except RuntimeError as error:  # for an exactly singular matrix
        raise SingularMatrixError(size=matrix.shape[0]) from error


def mass_matrix(vertices: Vertices, faces: Faces, kind: Literal["voronoi", "barycentric"]) -> csc_array:
    """The diagonal mass matrix, (V, V), in squared mesh units: mixed Voronoi cells, or a third of each face.

    Source: Meyer, Desbrun, Schröder & Barr (2003), Discrete differential-geometry operators for triangulated
    2-manifolds, for the mixed Voronoi cells.
    """
    count = len(vertices)
    if not len(faces):  # libigl would look for the largest index
        return csc_array((count, count))
    matrix = csc_array(igl.massmatrix(*igl_arrays(vertices, faces), getattr(igl, f"MASSMATRIX_TYPE_{kind.upper()}")))
    matrix.resize((count, count))  # the last vertices may be unused
    return matrix


def face_areas(vertices: Vertices, faces: Faces) -> Float[np.ndarray, " f"]:
    """Area of every face, (F,), in squared mesh units."""
    return np.asarray(igl.doublearea(*igl_arrays(vertices, faces)), dtype=np.float64).reshape(-1) / 2


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Faces) -> Float[np.ndarray, "v 3"]:
    """Unit normals at the vertices, (V, 3): the mean of the faces' normals weighted by area, or 0 where they cancel."""
    by_area = igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_AREA
    return np.asarray(np.nan_to_num(igl.per_vertex_normals(*igl_arrays(vertices, faces), by_area)))


def internal_angles(vertices: Vertices, faces: Faces) -> Float[np.ndarray, "f 3"]:
    """Angle of every face at each of its corners, (F, 3), in radians."""
    return np.asarray(igl.internal_angles(*igl_arrays(vertices, faces)), dtype=np.float64)


def vertex_angles(vertices: Vertices, faces: Faces) -> Float[np.ndarray, " v"]:
    """Sum of the angles of the faces at each vertex, (V,), in radians."""
    return np.bincount(faces.ravel(), internal_angles(vertices, faces).ravel(), minlength=len(vertices))


def winding_numbers(polygon: Float[np.ndarray, "m 2"], points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " k"]:
    """Winding numbers of a closed plane polygon about points, (K,): 0 outside, ±1 inside a simple polygon."""
    m = np.arange(len(polygon))
    edges = np.stack([m, shifted(m, -1)], axis=1)
    return np.asarray(igl.winding_number(*igl_arrays(polygon, edges), np.ascontiguousarray(points))).reshape(-1)


def nearest_on_mesh(
    points: Float[np.ndarray, "k 3"], vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f c"]
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """The nearest point of a mesh of triangles or of segments for each point: squared distance, face and position.

    Raises:
        NoFacesError: the mesh is empty.
        NonFiniteVertexError: a distance is not finite. libigl then gives any number as face.
    """
    if not len(faces):
        raise NoFacesError(vertices=len(vertices))
    squared, face, nearest = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points, dtype=np.float64), *igl_arrays(vertices, faces)
    )
    finite = np.isfinite(squared)
    if not finite.all():
        raise NonFiniteVertexError(vertex=int(np.argmin(finite)), place="points whose distance from a mesh is searched")
    # round-off can make it negative
    return np.maximum(squared, 0.0), np.asarray(face, dtype=np.int64), np.asarray(nearest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bending:
    """The mean curvature of a mesh and the quantities it is computed from.

    With these areas H is 1/R at the inner vertices of any mesh inscribed in a sphere, up to the error of the normals:
    for x, y on the unit sphere (x − y)·x = |x − y|²/2, so along x the gradient of the area is twice the area, with any
    weights of the edges. Where faces are stretched in one direction, H is a mean of the normal curvatures in which that
    of this direction has less weight.
    """

    matrix: CompiledMatrix  # of the cotangent Laplacian L
    areas: Float[np.ndarray, " n"]  # circumcentric, in squared mesh units, at least 0.3 of the barycentric ones
    normals: Float[np.ndarray, "n 3"]  # unit vectors
    curvature: Float[np.ndarray, " n"]  # n·Lx/(2A), positive where a mesh with outer normals is convex

    @classmethod
    def of(
        cls, vertices: Float[np.ndarray, "n 3"], faces: Faces, stretch: Float[np.ndarray, "f 3 3"] | None = None
    ) -> Bending:
        """The bending of a mesh, which is 0 at unused vertices.

        With `stretch` the Laplacian is that of the metric 1 + S in each face, with a symmetric matrix S for each.
        """
        n, f = len(vertices), len(faces)
        matrix = _room(n, n + 6 * f)
        areas, normals, curvature = np.empty(n), np.empty((n, 3)), np.empty(n)
        points = np.ascontiguousarray(vertices, dtype=np.float64)
        stretch = np.zeros((f, 3, 3)) if stretch is None else np.ascontiguousarray(stretch)
        call("bending", n, points, f, _corners(faces, n), stretch, _LEAST_SHARE, *matrix, areas, normals, curvature)
        return cls(matrix=matrix, areas=areas, normals=normals, curvature=curvature)

    @cached_property
    def laplacian(self) -> csc_array:
        """The cotangent Laplacian L."""
        return _sparse(*self.matrix)


@dataclass(frozen=True, kw_only=True, eq=False)
class BendingForm:
    """The operator L W (A + ℓ²G), with L and A of a mesh, at its first vertices."""

    bending: Bending
    free: int  # number of these vertices
    weights: Float[np.ndarray, " n"]  # the diagonal of W
    squared_length: float  # ℓ²
    gradient: CompiledMatrix  # G

    @property
    def _arguments(self) -> tuple[Any, ...]:
        bending = self.bending
        own = len(self.weights), self.free, *bending.matrix, self.weights, bending.areas
        return *own, self.squared_length, *self.gradient

    def of(self, function: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
        """The operator applied to a function on the vertices."""
        values = np.empty(self.free)
        call("bending_residual", *self._arguments, function, values)
        return values

    @property
    def stiffness(self) -> csc_array:
        """½ L W (A + ℓ²G) W L between the first vertices."""
        room, filled = 0, _NEAR * self.free
        while filled > room:
            room = filled
            matrix = _room(self.free, room)
            call("bending_stiffness", *self._arguments, room, *matrix)
            filled = int(matrix[0][-1])
        return _sparse(*matrix)


def radii_of_curvature(vertices: Float[np.ndarray, "n 3"], faces: Faces) -> Float[np.ndarray, " n"]:
    """1/√(κ₁² + κ₂²) at the inner vertices of a mesh, from H and the angle defect, without meaning at the boundary."""
    bending = Bending.of(vertices, faces)
    gauss = (2 * np.pi - vertex_angles(vertices, faces)) / bending.areas
    return np.asarray(1 / np.sqrt(np.fmax(4 * bending.curvature**2 - 2 * gauss, TINY)))


def face_normals(vertices: Float[np.ndarray, "n 3"], faces: Faces) -> Float[np.ndarray, "f 3"]:
    """Unit normals of faces, or 0 for one without area."""
    return np.asarray(igl.per_face_normals(*igl_arrays(vertices, faces), np.zeros(3)))


def crossing_angles(half_edges: HalfEdges, vertices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " h"]:
    """Angle between the normals of the faces of each half-edge and its twin, in radians, and 0 without a twin."""
    corners, points = half_edges.origin, np.ascontiguousarray(vertices, dtype=np.float64)
    angles = np.empty(len(corners))
    call("crossing_angles", len(corners) // 3, corners, points, half_edges.twin, angles)
    return angles
