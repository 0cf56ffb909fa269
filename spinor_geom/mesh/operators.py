"""Differential operators on triangle meshes: the only place that asks libigl for them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from spinor_geom.errors import SingularMatrixError

# igl is imported inside the functions: reading meshes and finding loops does not need it


def cotangent_laplacian(vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f 3"]) -> csc_array:
    """The cotangent Laplacian L, (V, V), symmetric and positive semidefinite.

    L_ij = −½ (cot α_ij + cot β_ij) with the angles opposite to edge ij, and rows sum to 0; uᵀLu is the Dirichlet
    energy ∫|∇u|² of the piecewise linear u. Without unit in 2D.

    Source: Pinkall & Polthier (1993), Computing discrete minimal surfaces and their conjugates.
    """
    import igl

    return csc_array(-igl.cotmatrix(*_for_igl(vertices, faces)))


def factor_symmetric(matrix: csc_array) -> SuperLU:
    """Sparse LU of a symmetric matrix without row exchanges: U's diagonal has the signs of the eigenvalues.

    Raises:
        SingularMatrixError: the matrix is singular or not finite.
    """
    if not np.isfinite(matrix.data).all():
        raise SingularMatrixError(size=matrix.shape[0])
    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:  # what SuperLU raises for an exactly singular matrix
        raise SingularMatrixError(size=matrix.shape[0]) from error


def mass_matrix(
    vertices: Float[np.ndarray, "v d"],
    faces: Int[np.ndarray, "f 3"],
    kind: Literal["voronoi", "barycentric", "full"] = "voronoi",
) -> csc_array:
    """The mass matrix M, (V, V), in squared mesh units; all its entries sum to the area.

    "voronoi" and "barycentric" are diagonal: the area that belongs to each vertex, mixed Voronoi cells or a third of
    each face; "full" is that of piecewise linear functions, uᵀMu = ∫u².

    Source: Meyer, Desbrun, Schröder & Barr (2003), Discrete differential-geometry operators for triangulated
    2-manifolds, for the mixed Voronoi cells.
    """
    import igl

    kinds = {
        "voronoi": igl.MASSMATRIX_TYPE_VORONOI,
        "barycentric": igl.MASSMATRIX_TYPE_BARYCENTRIC,
        "full": igl.MASSMATRIX_TYPE_FULL,
    }
    return csc_array(igl.massmatrix(*_for_igl(vertices, faces), kinds[kind]))


def face_areas(vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Area of every face, (F,), in squared mesh units."""
    import igl

    return np.asarray(igl.doublearea(*_for_igl(vertices, faces)), dtype=np.float64).reshape(-1) / 2


def internal_angles(vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Angle of every face at each of its corners, (F, 3), in radians."""
    import igl

    return np.asarray(igl.internal_angles(*_for_igl(vertices, faces)), dtype=np.float64)


def _for_igl(
    vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "v d"], Int[np.ndarray, "f 3"]]:
    return np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int64)
