"""Values at the vertices of a patch from those on its rim: harmonic interpolation, nearest labels, normals."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array
from scipy.spatial import cKDTree

from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.mesh.operators import cotangent_laplacian, graph_laplacian, vertex_normals
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

NORMAL = "normal"


def patch_attributes(
    attributes: Mapping[str, Float[np.ndarray, "v _"]],
    rim: Int[np.ndarray, " m"],
    patch: Patch,
    surface: SpinorSurface | None,
    *,
    is_planned: bool = True,
    labels: Collection[str] = (),
) -> dict[str, Float[np.ndarray, "n _"]]:
    """Every attribute of a mesh at the inner vertices of a patch.

    Attributes are interpolated harmonically, all columns in one solve. Labels, which must not be averaged, are those of
    the nearest rim vertex. "normal" is the unit normal of the surface, on the side the patch's faces look to. A value
    on the rim, whose mesh vertices are `rim`, that is not finite counts as that of the nearest with a finite one. A
    patch that `is_planned` was triangulated in Ω, so that its triangles there have area.

    Source: Pinkall & Polthier (1993), the discrete Dirichlet energy.
    """
    size = patch.boundary_size
    names = [name for name in attributes if name != NORMAL]
    columns = {name: _finite(np.asarray(attributes[name])[rim], patch.vertices[:size]) for name in names}
    smooth = [name for name in names if name not in labels]
    values: dict[str, Float[np.ndarray, "n _"]] = {}
    if smooth:
        joined = np.hstack([columns[name] for name in smooth])
        inner = harmonic_extension(_laplacian(patch, is_planned=is_planned), joined)[size:]
        ends = np.cumsum([columns[name].shape[1] for name in smooth])[:-1]
        values = dict(zip(smooth, np.split(inner, ends, axis=1), strict=True))
    if len(smooth) < len(names):
        nearest = cKDTree(patch.vertices[:size]).query(patch.vertices[size:])[1]
        values |= {name: columns[name][nearest] for name in names if name in labels}
    if NORMAL in attributes:
        normals = (
            vertex_normals(patch.vertices, np.asarray(patch.faces))[size:]
            if surface is None
            else surface.normal(patch.points[size:])
        )
        values[NORMAL] = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    return values


def _laplacian(patch: Patch, *, is_planned: bool) -> csc_array:
    """That of the triangulation in Ω, or for a discrete patch, whose triangles may be degenerate, of its edges."""
    if not is_planned:
        return graph_laplacian(np.asarray(patch.faces))
    # the Dirichlet energy is conformally invariant: harmonic functions in Ω are those of the surface
    return cotangent_laplacian(plane_coordinates(patch.points), np.asarray(patch.faces))


def _finite(values: Float[np.ndarray, "m k"], points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
    """Values at points, each row that is not finite replaced by that of the nearest point whose row is."""
    known = np.isfinite(values).all(axis=1)
    if known.all() or not known.any():
        return values
    return values[np.flatnonzero(known)[cKDTree(points[known]).query(points)[1]]]
