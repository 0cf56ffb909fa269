"""Mixin of surfaces and meshes: display in notebooks and conversion to other libraries."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.errors import require

if TYPE_CHECKING:
    import pyvista
    import trimesh

    from spinor_geom.render.shapes import Shape

MOST_SHOWN = 300  # characters of a description


def shortened(text: str) -> str:
    """A description, shortened in the middle to at most 300 characters."""
    half = (MOST_SHOWN - 3) // 2
    return text if len(text) <= MOST_SHOWN else f"{text[:half]} … {text[-half:]}"


class Shown:
    """A surface or mesh with a view in Jupyter and conversions to types of other libraries.

    A SpinorSurface is meshed first, with about 4000 vertices. Values at the vertices are converted too: "normal" and
    "gauss_curvature" of a minimal surface, of a mesh "mean_curvature" (|H|, NaN at the boundary) and its attributes.
    """

    def _shape(self) -> Shape:
        from spinor_geom.render.shapes import shape_of

        return shape_of(self)

    def _repr_html_(self) -> str:
        """An interactive view, for Jupyter."""
        return self._shape().framed(title=type(self).__name__)

    def to_pyvista(self) -> pyvista.PolyData:
        """A `pyvista.PolyData` with the values as point data. Raises MissingPackageError without pyvista."""
        require("pyvista", extra="render")
        import pyvista

        shape = self._shape()
        mesh: pyvista.PolyData = pyvista.PolyData.from_regular_faces(np.array(shape.vertices), np.array(shape.faces))
        for name, values in shape.values.items():
            mesh.point_data[name] = np.array(values)
        return mesh

    def to_trimesh(self) -> trimesh.Trimesh:
        """A `trimesh.Trimesh` with the same vertices and faces, and the values as vertex attributes."""
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

    def to_gltf(self, path: str | os.PathLike[str]) -> None:
        """Writes a binary glTF file coloured by Gauss curvature (minimal surface) or |H| (mesh), grey where undefined.

        Args:
            path: `.glb` file, replaced as a whole.

        Raises:
            MeshFileError: the suffix is not .glb, or the file cannot be written.
        """
        self._shape().write_gltf(path)
