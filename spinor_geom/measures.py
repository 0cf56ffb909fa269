"""Measures of meshes: Hausdorff distance by sampling, mean curvature, angles of triangles."""

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Float, Int

from spinor_geom.errors import OptionError, require_count
from spinor_geom.mesh.array_checks import igl_arrays
from spinor_geom.mesh.operators import (
    cotangent_laplacian,
    internal_angles,
    mass_matrix,
    nearest_on_mesh,
    vertex_normals,
)
from spinor_geom.mesh.topology import boundary_edges, referenced_vertices


@dataclass(frozen=True, kw_only=True)
class OneSidedDistance:
    """Distances from the points of one mesh to the nearest points of another, in mesh units."""

    max: float  # over the samples
    mean: float  # weighted by area
    samples: int
    spacing: float  # largest distance of a point from a sample: the maximum over all points is at most max + spacing


@dataclass(frozen=True, kw_only=True)
class HausdorffDistance:
    """Distances between two meshes in both directions, in mesh units."""

    forward: OneSidedDistance  # from the first mesh to the second
    backward: OneSidedDistance  # from the second mesh to the first

    @property
    def max(self) -> float:
        """Symmetric Hausdorff distance: the larger of the two directions' largest distances."""
        return max(self.forward.max, self.backward.max)

    @property
    def mean(self) -> float:
        """The larger of the two directions' mean distances."""
        return max(self.forward.mean, self.backward.mean)


def hausdorff_distance(
    vertices_a: Float[np.ndarray, "na 3"],
    faces_a: Int[np.ndarray, "fa 3"],
    vertices_b: Float[np.ndarray, "nb 3"],
    faces_b: Int[np.ndarray, "fb 3"],
    *,
    samples: int = 20_000,
) -> HausdorffDistance:
    """Symmetric Hausdorff distance max(max_a d(a, B), max_b d(b, A)) and mean distances of two meshes.

    Distances of samples, see `mesh_samples`, to the faces of the other mesh are exact.

    Raises:
        OptionError: a mesh has no faces, or `samples` is not a positive whole number.
    """
    require_count(samples=samples)
    if len(faces_a) == 0 or len(faces_b) == 0:
        raise OptionError("a Hausdorff distance needs two meshes with at least one face each")
    a, b = mesh_samples(vertices_a, faces_a, samples), mesh_samples(vertices_b, faces_b, samples)
    return HausdorffDistance(
        forward=a.summary(distances_to_mesh(a.points, vertices_b, faces_b)),
        backward=b.summary(distances_to_mesh(b.points, vertices_a, faces_a)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSamples:
    """Points of a surface, the area around each, and the largest distance of the surface from its nearest sample."""

    points: Float[np.ndarray, "k 3"]
    areas: Float[np.ndarray, " k"]
    spacing: float

    def summary(self, distance: Float[np.ndarray, " k"]) -> OneSidedDistance:
        """Maximum and area-weighted mean of distances, given one per point."""
        mean = float(np.average(distance, weights=self.areas if self.areas.any() else None))
        return OneSidedDistance(max=float(distance.max()), mean=mean, samples=len(distance), spacing=self.spacing)


def mesh_samples(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], count: int) -> SurfaceSamples:
    """The vertices of a mesh after as many subdivisions of all faces into four as give at least `count` faces."""
    times = max(0, int(np.ceil(np.log(count / len(faces)) / np.log(4))))
    fine, fine_faces = igl.upsample(*igl_arrays(vertices, faces), times)
    fine_faces = fine_faces.astype(np.int64)  # libigl returns another 64-bit type
    used = np.unique(fine_faces)
    corners = fine[fine_faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    return SurfaceSamples(
        points=fine[used],
        areas=mass_matrix(fine, fine_faces, "barycentric").diagonal()[used],
        # a triangle with longest edge l is covered by disks of radius l/√3 about its corners
        spacing=float(longest / np.sqrt(3)),
    )


def distances_to_mesh(
    points: Float[np.ndarray, "k 3"], vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f c"]
) -> Float[np.ndarray, " k"]:
    """Exact distances of points from a mesh of triangles or of segments."""
    squared, _, _ = nearest_on_mesh(points, vertices, faces)
    return np.asarray(np.sqrt(squared))


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMeanCurvature:
    """|H| at the inner vertices of a mesh, in 1/mesh units."""

    vertices: Int[np.ndarray, " k"]  # indices of the inner vertices
    values: Float[np.ndarray, " k"]  # |H| there
    tangential: Float[np.ndarray, " k"]  # the same for the area gradient's tangential part, due to uneven triangles
    areas: Float[np.ndarray, " k"]  # mixed Voronoi areas there, in squared mesh units

    @property
    def max(self) -> float:
        """Largest |H|, or 0 without inner vertices."""
        return float(self.values.max(initial=0.0))

    @property
    def rms(self) -> float:
        """Root mean square of H, weighted by area, or 0 without inner vertices."""
        return self._root_mean_square(self.values)

    @property
    def tangential_rms(self) -> float:
        """Root mean square of `tangential`."""
        return self._root_mean_square(self.tangential)

    def _root_mean_square(self, values: Float[np.ndarray, " k"]) -> float:
        total = self.areas.sum()
        return float(np.sqrt(self.areas @ values**2 / total)) if total > 0 else 0.0


def discrete_mean_curvature(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> DiscreteMeanCurvature:
    """Mean curvature |H_i| = |n_i · Σ_j ½(cot α_ij + cot β_ij)(x_i − x_j)| / (2 A_i) at inner vertices.

    The sum is the gradient of the mesh's area with respect to x_i. α_ij and β_ij are the angles opposite to edge ij,
    A_i is the mixed Voronoi area, n_i the area-weighted normal. H is the mean of the principal curvatures, 1/R on a
    sphere. Vertices on the boundary and unreferenced ones are left out.

    Source: Meyer, Desbrun, Schröder & Barr (2003), Discrete differential-geometry operators for triangulated
    2-manifolds.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    used = referenced_vertices(faces, vertices=len(vertices))
    used[boundary_edges(faces)] = False
    inner = np.flatnonzero(used)
    gradient = (cotangent_laplacian(vertices, faces) @ vertices)[inner]
    area = mass_matrix(vertices, faces, "voronoi").diagonal()[inner]
    normal = vertex_normals(vertices, faces)[inner]
    along = np.einsum("ik,ik->i", gradient, normal)
    across = np.linalg.norm(gradient - along[:, None] * normal, axis=1)
    # without a normal, if those of the faces cancel, the whole gradient is used
    bend = np.where(normal.any(axis=1), np.abs(along), across)

    def by_area(magnitude: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        # for an area of 0: infinite, or 0 if the gradient is 0
        still = np.where(magnitude > 0, np.inf, 0.0)
        return np.asarray(np.divide(magnitude, 2 * area, out=still, where=area > 0))

    return DiscreteMeanCurvature(vertices=inner, values=by_area(bend), tangential=by_area(across), areas=area)


def smallest_angles(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Smallest angle of every triangle of a mesh, in degrees, or 0 if two corners are equal."""
    return np.asarray(np.nan_to_num(np.degrees(internal_angles(vertices, faces)), nan=0.0).min(axis=1))
