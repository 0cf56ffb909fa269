"""Patches meshed anew: where their edges have become long, and where their domain fits the mesh around badly."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float

from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.domain.delaunay import flat_coordinates, plane_coordinates
from spinor_geom.domain.flattening import dirichlet_to_neumann, flatten_boundary
from spinor_geom.mesh.arrays import igl_arrays
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import Piece, triangulate_pieces


def remesh(patch: Patch, target: float) -> Patch:
    """A patch meshed anew for edges of a length in space: its boundary kept, new inner vertices on its faces."""
    faces, m = np.asarray(patch.faces), patch.boundary_size
    flat = flat_coordinates(patch.points)
    areas = np.stack([face_areas(patch.vertices, faces), face_areas(flat, faces)])
    space, plane = (np.bincount(faces.ravel(), np.repeat(each, 3), minlength=len(flat)) for each in areas)
    tiny = np.finfo(np.float64).tiny
    stretch = np.sqrt(np.maximum(space, tiny) / np.maximum(plane, tiny))
    rims = np.split(patch.points[:m], np.cumsum(patch.rims)[:-1])
    piece = Piece(rims=rims, samples=patch.points, factor=stretch, target=target, area=patch.area)
    (plan,) = triangulate_pieces([piece])
    at = flat_coordinates(plan.points[m:])
    if not len(at):
        return Patch.over(plan, patch.vertices[:m])
    _, face, nearest = igl.point_mesh_squared_distance(at, *igl_arrays(flat, faces))
    corners = faces[np.asarray(face).reshape(-1)]
    weights = igl.barycentric_coordinates(np.ascontiguousarray(nearest), *(flat[corners[:, k]] for k in range(3)))
    inner = np.einsum("ki,kid->kd", np.asarray(weights), patch.vertices[corners])
    return Patch.over(plan, np.concatenate([patch.vertices[:m], inner]))


def over_domain_of_angles(patch: Patch, angles: Float[np.ndarray, " m"], target: float) -> Patch:
    """A patch over the same loop whose domain has given angles, in radians, at the loop's points.

    The domain has the loop's edge lengths too, as nearly as a simple polygon can; what the angles lack to close it, as
    those of a curved patch do, is spread over its length. Where it must be straightened, it is so by the patch's shape.
    The new patch is the harmonic map of it. A DomainError tells that no simple domain was found, a SingularMatrixError
    that the patch's triangles are degenerate, a TooManyPointsError that there would be too many vertices.

    Source: Sawhney & Crane (2018), Boundary First Flattening, ACM TOG 37, for domains of given angles.
    """
    m, rim = patch.boundary_size, patch.vertices[: patch.boundary_size]
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1)
    share = (edge + np.roll(edge, 1)) / (2 * edge.sum())
    turning = np.pi - angles
    turning += (2 * np.pi - turning.sum()) * share
    neumann, _ = dirichlet_to_neumann(patch.vertices, np.asarray(patch.faces), m)
    boundary = flatten_boundary(edge, turning, neumann).boundary
    piece = Piece(rims=[boundary], samples=boundary, factor=np.ones(m), target=target, area=patch.area)
    (plan,) = triangulate_pieces([piece])
    vertices = harmonic_extension(cotangent_laplacian(plane_coordinates(plan.points), plan.faces), rim)
    return Patch.over(plan, vertices)
