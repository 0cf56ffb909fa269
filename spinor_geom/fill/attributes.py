"""Values at the vertices of a patch from those on its rim: harmonic interpolation, nearest labels, normals."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.mesh.operators import cotangent_laplacian, graph_laplacian, vertex_normals
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

NORMAL = "normal"


def patch_attributes(
    mesh: TriangleMesh, rim: Int[np.ndarray, " m"], patch: Patch, surface: SpinorSurface | None, *, is_planned: bool
) -> dict[str, Float[np.ndarray, "n _"]]:
    """Every attribute of a mesh at the inner vertices of a patch.

    Attributes are interpolated harmonically, all columns in one solve. Labels, which must not be averaged, are those of
    the nearest rim vertex. "normal" is the unit normal of the surface, on the side the patch's faces look to. A value
    on the rim, whose mesh vertices are `rim`, that is not finite counts as that of the nearest with a finite one. A
    patch that `is_planned` was triangulated in Ω, where its triangles have area; of another only the edges count.

    Source: Pinkall & Polthier (1993), the discrete Dirichlet energy.
    """
    size, attributes = patch.boundary_size, mesh.vertex_attributes
    names = [name for name in attributes if name != NORMAL]
    columns = {name: _finite(attributes[name][rim], patch.vertices[:size]) for name in names}
    smooth = [name for name in names if name not in mesh.labels]
    values: dict[str, Float[np.ndarray, "n _"]] = {}
    if smooth:
        joined = np.hstack([columns[name] for name in smooth])
        faces = np.asarray(patch.faces)
        # the Dirichlet energy is conformally invariant: harmonic functions in Ω are those of the surface
        flat = plane_coordinates(patch.points)
        laplacian = cotangent_laplacian(flat, faces) if is_planned else graph_laplacian(faces)
        inner = harmonic_extension(laplacian, joined)[size:]
        ends = np.cumsum([columns[name].shape[1] for name in smooth])[:-1]
        values = dict(zip(smooth, np.split(inner, ends, axis=1), strict=True))
    if len(smooth) < len(names):
        nearest = cKDTree(patch.vertices[:size]).query(patch.vertices[size:])[1]
        values |= {name: columns[name][nearest] for name in names if name in mesh.labels}
    if NORMAL in attributes:
        if surface is None:
            values[NORMAL] = vertex_normals(patch.vertices, np.asarray(patch.faces))[size:]
        else:
            values[NORMAL] = np.asarray(surface.normal(patch.points[size:]))
    return values


def _finite(values: Float[np.ndarray, "m k"], points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
    """Values at points, each row that is not finite replaced by that of the nearest point whose row is."""
    known = np.isfinite(values).all(axis=1)
    if known.all() or not known.any():
        return values
    return values[np.flatnonzero(known)[cKDTree(points[known]).query(points)[1]]]
