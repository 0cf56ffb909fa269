"""Values at the vertices of a patch from those on its rim: harmonic interpolation, normals from the surface."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from spinor_geom.mesh.operators import cotangent_laplacian
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

NORMAL = "normal"


def harmonic_values(patch: Patch, rim_values: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "n k"]:
    """The discrete harmonic functions on a patch with given values on its rim.

    Solves L x = 0 at the inner vertices, L the cotangent Laplacian. L is that of the patch's triangulation in Ω: the
    Dirichlet energy is conformally invariant, so the harmonic functions are those of the surface, and the triangles in
    Ω are never degenerate.

    Args:
        patch: M rim vertices first, then the inner ones.
        rim_values: (M, k) values at the rim vertices, in any unit.

    Returns:
        (n − M, k) values at the inner vertices, in the same unit.

    Source: Pinkall & Polthier (1993), the discrete Dirichlet energy.
    """
    rim = patch.boundary_size
    inner = len(patch.vertices) - rim
    if inner == 0:
        return np.empty((0, rim_values.shape[1]))
    plane = np.column_stack([patch.points.real, patch.points.imag, np.zeros(len(patch.points))])
    laplacian = cotangent_laplacian(plane, np.asarray(patch.faces)).tocsc()
    rows = laplacian[rim:]
    factor = splu(
        rows[:, rim:].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.asarray(factor.solve(-(rows[:, :rim] @ rim_values)))


def patch_attributes(
    attributes: Mapping[str, Float[np.ndarray, "v _"]],
    rim: Int[np.ndarray, " m"],
    patch: Patch,
    surface: SpinorSurface,
) -> dict[str, Float[np.ndarray, "n _"]]:
    """Every attribute of a mesh at the inner vertices of a patch.

    Attributes are interpolated harmonically, all columns in one solve; "normal" is the unit normal of the surface
    instead, on the side the patch's faces look to.

    Args:
        attributes: the mesh's own, (V, k) each.
        rim: mesh vertices of the patch's boundary vertices.
        patch: the patch.
        surface: gives the normals at the patch's points of Ω.

    Returns:
        (n − M, k) float64 under the same names.
    """
    names = [name for name in attributes if name != NORMAL]
    values: dict[str, Float[np.ndarray, "n _"]] = {}
    if names:
        columns = [np.asarray(attributes[name])[rim] for name in names]
        inner = harmonic_values(patch, np.hstack(columns))
        ends = np.cumsum([column.shape[1] for column in columns])[:-1]
        values = dict(zip(names, np.split(inner, ends, axis=1), strict=True))
    if NORMAL in attributes:
        values[NORMAL] = np.asarray(surface.normal(patch.points[patch.boundary_size :]), dtype=np.float64).reshape(
            -1, 3
        )
    return values
