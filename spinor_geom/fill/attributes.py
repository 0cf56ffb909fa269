"""Attributes at the inner vertices of a patch: harmonic interpolation, labels of the nearest vertex, normals."""

from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.mesh.operators import cotangent_laplacian, graph_laplacian, vertex_normals
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.array_surface import ArraySurface

NORMAL = "normal"


def patch_attributes(
    mesh: TriangleMesh,
    rim: Int[np.ndarray, " m"],
    patch: Patch,
    surface: ArraySurface | None,
    *,
    by: Literal["domain", "edges", "nearest"],
) -> dict[str, Float[np.ndarray, "n _"]]:
    """The attributes of a mesh at the inner vertices of a patch. `rim` are the mesh vertices of its boundary.

    Attributes are interpolated harmonically. Integer ones are those of the nearest rim vertex. "normal" is the unit
    normal of the surface, on the side of the patch's faces. A value on the rim that is not finite is replaced by the
    nearest finite one. The Laplacian is the cotangent Laplacian for a patch that was triangulated in Ω ("domain"),
    otherwise the graph Laplacian ("edges"), because triangles in Ω may be degenerate. With "nearest" all values are
    those of the nearest rim vertex.

    Raises:
        OutOfTimeError: the time limit is too short for the interpolation.

    Source: Pinkall & Polthier (1993), the discrete Dirichlet energy.
    """
    size, attributes = patch.boundary_size, mesh.vertex_attributes
    columns = {name: _finite(attributes[name][rim], patch.vertices[:size]) for name in attributes if name != NORMAL}
    values: dict[str, Float[np.ndarray, "n _"]] = {}
    constant = columns if by == "nearest" else mesh.labels
    if smooth := [name for name in columns if name not in constant]:
        faces = np.asarray(patch.faces)
        # the Dirichlet energy is conformally invariant: harmonic functions in Ω are those of the surface
        laplacian = (
            cotangent_laplacian(plane_coordinates(patch.points), faces) if by == "domain" else graph_laplacian(faces)
        )
        inner = harmonic_extension(laplacian, np.hstack([columns[name] for name in smooth]))[size:]
        ends = np.cumsum([columns[name].shape[1] for name in smooth])[:-1]
        values = dict(zip(smooth, np.split(inner, ends, axis=1), strict=True))
    if labels := [name for name in columns if name in constant]:
        nearest = cKDTree(patch.vertices[:size]).query(patch.vertices[size:])[1]
        values |= {name: columns[name][nearest] for name in labels}
    if NORMAL in attributes and surface is None:
        values[NORMAL] = vertex_normals(patch.vertices, np.asarray(patch.faces))[size:]
    elif NORMAL in attributes and surface is not None:
        values[NORMAL] = np.asarray(surface.normal(patch.points[size:]))
    return values


def _finite(values: Float[np.ndarray, "m k"], points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
    """Replaces each row that is not finite by the finite row of the nearest point."""
    known = np.isfinite(values).all(axis=1)
    if known.all() or not known.any():
        return values
    return values[np.flatnonzero(known)[cKDTree(points[known]).query(points)[1]]]
