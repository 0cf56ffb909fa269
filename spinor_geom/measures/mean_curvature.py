"""Discrete mean curvature of a triangle mesh, and how well shaped its triangles are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.operators import cotangent_laplacian, internal_angles, mass_matrix, vertex_normals
from spinor_geom.mesh.topology import boundary_edges, referenced_vertices


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMeanCurvature:
    """|H| at the inner vertices of a mesh, in 1/mesh units."""

    vertices: Int[np.ndarray, " k"]  # indices of the inner vertices
    values: Float[np.ndarray, " k"]  # |H| there
    tangential: Float[np.ndarray, " k"]  # what pulls them along the surface: how uneven the triangles are, no curvature
    areas: Float[np.ndarray, " k"]  # mixed Voronoi areas there, in squared mesh units

    @cached_property
    def max(self) -> float:
        """Largest |H|; 0 without inner vertices."""
        return float(self.values.max(initial=0.0))

    @cached_property
    def rms(self) -> float:
        """Root of the mean of H² by area; 0 without inner vertices."""
        return self._root_mean_square(self.values)

    @cached_property
    def tangential_rms(self) -> float:
        """The same of `tangential`."""
        return self._root_mean_square(self.tangential)

    def _root_mean_square(self, values: Float[np.ndarray, " k"]) -> float:
        total = self.areas.sum()
        return float(np.sqrt(self.areas @ values**2 / total)) if total > 0 else 0.0


def discrete_mean_curvature(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> DiscreteMeanCurvature:
    """Mean curvature |H_i| = |n_i · Σ_j ½(cot α_ij + cot β_ij)(x_i − x_j)| / (2 A_i) at inner vertices.

    The sum is the gradient of the mesh's area by x_i, α_ij and β_ij are the angles opposite to edge ij, A_i is the
    mixed Voronoi area, n_i the normal, the mean of those of the faces by area. H is the mean of the principal
    curvatures, 1/R on a sphere. The part of the gradient across n_i is no curvature: it comes from uneven triangles,
    and is given beside it. Vertices on the boundary and unreferenced ones are left out.

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
    # where the faces' normals cancel there is none: all of the gradient counts
    bend = np.where(normal.any(axis=1), np.abs(along), across)

    def by_area(magnitude: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        # a vertex whose faces have no area has no curvature: infinite where they pull at it
        still = np.where(magnitude > 0, np.inf, 0.0)
        return np.asarray(np.divide(magnitude, 2 * area, out=still, where=area > 0))

    return DiscreteMeanCurvature(vertices=inner, values=by_area(bend), tangential=by_area(across), areas=area)


def smallest_angles(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Smallest angle of every triangle of a mesh, in degrees; 0 for a triangle without area."""
    # two equal corners leave the angles undefined
    return np.asarray(np.nan_to_num(np.degrees(internal_angles(vertices, faces)), nan=0.0).min(axis=1))
