"""Reads the mesh or the surface that a command works on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.errors import MeshFileError

if TYPE_CHECKING:
    from spinor_geom.render.shapes import Shape

SURFACE_SUFFIX = ".safetensors"


def read_surface(path: Path, *, merge: bool) -> MeshFile:
    """A mesh file with faces.

    Args:
        path: the file.
        merge: makes vertices of equal position one.

    Raises:
        MeshFileError: the file is missing, malformed, or has no faces.
        NonFiniteVertexError: a coordinate is NaN or infinite.
    """
    mesh = read_mesh(path)
    if not len(mesh.mesh.faces):
        raise MeshFileError(
            f"{path}: has no faces, so nothing to fill or to draw; 'spinor-geom batch' spans the curves of OBJ files",
            path=path,
        )
    return mesh.merged() if merge else mesh


def read_shape(path: Path) -> Shape:
    """A mesh file with faces, or a saved surface as triangles.

    Raises:
        MeshFileError: the file is missing, malformed, or has no faces.
        StorageError: the saved surface is missing or cannot be read.
        SurfaceError: the surface is not finite on its domain.
    """
    from spinor_geom.render.shapes import shape_of

    if path.suffix.lower() != SURFACE_SUFFIX:
        return shape_of(read_surface(path, merge=False))
    from spinor_geom.surface.spinor_surface import SpinorSurface

    return shape_of(SpinorSurface.load(path))
