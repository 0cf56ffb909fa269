"""What every surface and mesh of the package can do with itself: be seen, and become another library's object."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyvista
    import torch
    import trimesh


class Shown:
    """A surface or mesh that shows itself in Jupyter and converts to what other libraries take.

    A surface in formulas is meshed for it, with about 4000 vertices. What is known at the vertices goes along under
    these names: "normal" and "gauss_curvature" of a minimal surface, "mean_curvature" (|H| at the inner vertices, NaN
    at the boundary) of a mesh, and a mesh's own attributes.
    """

    def _repr_html_(self) -> str:
        """The shape in a frame of its own, to turn and to zoom; Jupyter calls it."""
        from spinor_geom.render.shapes import framed, shape_of

        return framed(shape_of(self), title=type(self).__name__)

    def to_pyvista(self) -> pyvista.PolyData:
        """A `pyvista.PolyData` with the values at the vertices as point data.

        Raises:
            MissingPackageError: pyvista is not installed.
        """
        from spinor_geom.render.shapes import as_pyvista, shape_of

        return as_pyvista(shape_of(self))

    def to_trimesh(self) -> trimesh.Trimesh:
        """A `trimesh.Trimesh` with the same vertices and faces, none merged, and vertex attributes."""
        from spinor_geom.render.shapes import as_trimesh, shape_of

        return as_trimesh(shape_of(self))

    def to_torch(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Vertices (V, 3) float64 and faces (F, 3) int64 as tensors."""
        from spinor_geom.render.shapes import as_tensors, shape_of

        return as_tensors(shape_of(self))

    def to_gltf(self, path: str | os.PathLike[str]) -> None:
        """Writes a binary glTF file whose vertex colours tell the curvature, in viridis from low to high.

        It is the Gauss curvature of a minimal surface, and |H| of a mesh; grey where there is none.

        Args:
            path: of the file, with the suffix .glb; replaced as a whole.

        Raises:
            MeshFileError: another suffix, or the file cannot be written.
        """
        from spinor_geom.render.shapes import shape_of, write_gltf

        write_gltf(shape_of(self), path)
