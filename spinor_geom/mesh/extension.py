"""What a fill adds to a mesh, in a form every mesh type can append."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from spinor_geom.mesh.arrays import freeze_attributes, freeze_points, frozen


@dataclass(frozen=True, eq=False, init=False)
class MeshExtension:
    """New vertices and faces to be appended to a mesh of V vertices, which itself stays as it is.

    Attributes:
        vertices: (K, 3) float64 positions of the new vertices, in mesh units; vertex k gets the index V + k.
        faces: (T, 3) int64 indices into [the V original vertices | the K new ones].
        vertex_attributes: (K, k) float64 values at the new vertices, under the names of the mesh's own
            `TriangleMesh.vertex_attributes`.
        face_loops: (T,) int64, which boundary loop each new face fills.

    Raises:
        MeshShapeError: an array has the wrong shape or dtype.
        NonFiniteVertexError: a new vertex is NaN or infinite.
    """

    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "t 3"]
    face_loops: Int[np.ndarray, " t"]
    vertex_attributes: Mapping[str, Float[np.ndarray, "k _"]]

    def __init__(
        self,
        *,
        vertices: ArrayLike,
        faces: ArrayLike,
        face_loops: ArrayLike,
        vertex_attributes: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        points = freeze_points(vertices, name="vertices")
        corners = frozen(faces, "integers", None, 3, name="faces (triangles)")
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "faces", corners)
        object.__setattr__(self, "face_loops", frozen(face_loops, "integers", len(corners), name="face_loops"))
        object.__setattr__(self, "vertex_attributes", freeze_attributes(vertex_attributes or {}, vertices=len(points)))
