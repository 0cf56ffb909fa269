"""The second derivative of the area of a minimal surface with respect to displacements X of its boundary Γ.

The outer conormal ν has ν ds = Γ′ × n dt. The first variation is ∮ ν·X ds. When Γ moves by X,

    δ(ν ds) = X′ × n dt + Γ′ × δn dt ,   δn = −∇u + dn(Xᵀ) ,   u = n·X ,

so that the second variation is ∮ (X′ × n)·X dt + ∮ u (∂_ν u + II(Xᵀ, ν)) ds, where u is extended inside by Jacobi's
equation Δu + |dn|²u = 0. The form ∮ u ∂_ν u ds = ∫ |∇u|² − |dn|²u² is computed by linear finite elements.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from spinor_geom.domain.delaunay import flat_coordinates
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.mesh.operators import cotangent_laplacian
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface


def boundary_form(
    surface: ArraySurface, mesh: PlaneTriangulation, u: Float[np.ndarray, "m k"]
) -> Float[np.ndarray, "k k"]:
    """The form ∫ |∇u|² − |dn|²u² of Jacobi fields u, given at the boundary vertices of a triangulation of Ω."""
    points, faces, m = mesh.points, np.asarray(mesh.faces), mesh.boundary_size
    a, b, c = points[faces].T
    areas, middle = np.abs(np.imag(np.conj(b - a) * (c - a))) / 2, (a + b + c) / 3
    density = -2 * surface.gauss_curvature(middle) * surface.conformal_factor(middle) ** 2
    share = np.where(np.isfinite(density), density, 0) * areas / 3
    mass = np.bincount(faces.ravel(), np.repeat(share, 3), len(points))
    form = csc_array(cotangent_laplacian(flat_coordinates(points), faces) - diags_array(mass))
    inner = form[m:, :m] @ u
    return np.asarray(u.T @ (form[:m, :m] @ u) - inner.T @ splu(form[m:, m:]).solve(inner))


def rim_terms(
    solution: PlateauSolution, nodes: RimNodes
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 3 3"]]:
    """The normals at nodes, and matrices R and S with weights: the other terms are Σ X′·RX + X·SX, X′ by length."""
    surface = solution.array_surface
    n, weight = surface.normal(nodes.z), np.linalg.norm(nodes.conormal, axis=1)
    tangent, conormal = (part / weight[:, None] for part in (nodes.velocity.real, nodes.conormal))
    ahead = nodes.steps / np.abs(nodes.steps)
    plane = _plane_vectors(ahead), _plane_vectors(-1j * ahead)
    form = surface.second_fundamental_form(nodes.z) / surface.conformal_factor(nodes.z)[:, None, None] ** 2
    along, across = (np.einsum("ka,kab,kb->k", one, form, plane[1]) for one in plane)
    turned = weight[:, None, None] * np.cross(np.eye(3), n[:, None])
    bent = weight[:, None, None] * n[:, :, None] * (along[:, None] * tangent + across[:, None] * conormal)[:, None]
    return n, turned, bent


def _plane_vectors(z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, "k 2"]:
    return np.stack([z.real, z.imag], axis=1)
