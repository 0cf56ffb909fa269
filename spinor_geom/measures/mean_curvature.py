"""Discrete mean curvature of a triangle mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.operators import cotangent_laplacian, mass_matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMeanCurvature:
    """|H| at the inner vertices of a mesh, in 1/mesh units.

    Attributes:
        vertices: Indices of the inner vertices.
        values: |H| there.
        areas: Mixed Voronoi areas there, in squared mesh units.
    """

    vertices: Int[np.ndarray, " k"]
    values: Float[np.ndarray, " k"]
    areas: Float[np.ndarray, " k"]

    @cached_property
    def max(self) -> float:
        """Largest |H|; 0 without inner vertices."""
        return float(self.values.max(initial=0.0))

    @cached_property
    def rms(self) -> float:
        """Root of the mean of H² by area; 0 without inner vertices."""
        total = self.areas.sum()
        return float(np.sqrt(self.areas @ self.values**2 / total)) if total > 0 else 0.0


def discrete_mean_curvature(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> DiscreteMeanCurvature:
    """Mean curvature |H_i| = |Σ_j ½(cot α_ij + cot β_ij)(x_i − x_j)| / (2 A_i) at inner vertices.

    The sum is the gradient of the mesh's area by x_i, α_ij and β_ij are the angles opposite to edge ij, A_i is the
    mixed Voronoi area; H is the mean of the principal curvatures, 1/R on a sphere. Vertices on the boundary and
    unreferenced ones are left out.

    Source: Meyer, Desbrun, Schröder & Barr (2003), Discrete differential-geometry operators for triangulated
    2-manifolds.
    """
    inner = inner_vertices(faces, len(vertices))
    gradient = cotangent_laplacian(vertices, faces) @ np.asarray(vertices, dtype=np.float64)
    area = mass_matrix(vertices, faces, "voronoi").diagonal()
    magnitude = np.linalg.norm(gradient[inner], axis=1)
    return DiscreteMeanCurvature(
        vertices=inner,
        # a vertex whose faces have no area has no curvature: infinite where they pull at it
        values=np.divide(magnitude, 2 * area[inner], out=np.where(magnitude > 0, np.inf, 0.0), where=area[inner] > 0),
        areas=area[inner],
    )


def inner_vertices(faces: Int[np.ndarray, "f 3"], count: int) -> Int[np.ndarray, " k"]:
    """Vertices that some face uses and no boundary edge (an edge with one face) touches, ascending."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    code, uses = np.unique(edges[:, 0] * count + edges[:, 1], return_counts=True)
    boundary = code[uses == 1]
    inner = np.zeros(count, dtype=bool)
    inner[faces] = True
    inner[boundary // count] = False
    inner[boundary % count] = False
    return np.flatnonzero(inner)
