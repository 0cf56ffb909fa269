"""What every surface and mesh of the package can do with itself: be seen, and become another library's object."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.errors import require

if TYPE_CHECKING:
    import pyvista
    import torch
    import trimesh

    from spinor_geom.render.shapes import Shape


MOST_SHOWN = 300  # characters of a description


def shortened(text: str) -> str:
    """A description of at most 300 characters; what is beyond is left out of its middle."""
    half = (MOST_SHOWN - 3) // 2
    return text if len(text) <= MOST_SHOWN else f"{text[:half]} … {text[-half:]}"


class Shown:
    """A surface or mesh that shows itself in Jupyter and converts to what other libraries take.

    A surface in formulas is meshed for it, with about 4000 vertices. What is known at the vertices goes along under
    these names: "normal" and "gauss_curvature" of a minimal surface, "mean_curvature" (|H| at the inner vertices, NaN
    at the boundary) of a mesh, and a mesh's own attributes.
    """

    def _shape(self) -> Shape:
        from spinor_geom.render.shapes import shape_of

        return shape_of(self)

    def _repr_html_(self) -> str:
        """The shape in a frame of its own, to turn and to zoom; Jupyter calls it."""
        return self._shape().framed(title=type(self).__name__)

    def to_pyvista(self) -> pyvista.PolyData:
        """A `pyvista.PolyData` with the values at the vertices as point data; a MissingPackageError without pyvista."""
        require("pyvista", extra="render")
        import pyvista

        shape = self._shape()
        made: pyvista.PolyData = pyvista.PolyData.from_regular_faces(np.array(shape.vertices), np.array(shape.faces))
        for name, values in shape.values.items():
            made.point_data[name] = np.array(values)
        return made

    def to_trimesh(self) -> trimesh.Trimesh:
        """A `trimesh.Trimesh` with the same vertices and faces, none merged, and vertex attributes."""
        import trimesh

        shape = self._shape()
        values: dict[str, Any] = {name: np.array(own) for name, own in shape.values.items()}
        return trimesh.Trimesh(
            vertices=np.array(shape.vertices),
            faces=np.array(shape.faces),
            vertex_normals=values.pop("normal", None),
            vertex_colors=values.pop("color", None),
            vertex_attributes=values,
            process=False,
        )

    def to_torch(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Vertices (V, 3) float64 and faces (F, 3) int64 as tensors."""
        import torch

        shape = self._shape()
        return torch.tensor(np.array(shape.vertices)), torch.tensor(np.array(shape.faces))

    def to_gltf(self, path: str | os.PathLike[str]) -> None:
        """Writes a binary glTF file whose vertex colours tell the curvature, in viridis from low to high.

        It is the Gauss curvature of a minimal surface, and |H| of a mesh; grey where there is none.

        The file at `path`, with the suffix .glb, is replaced as a whole; a MeshFileError where it cannot be written.
        """
        self._shape().write_gltf(path)
