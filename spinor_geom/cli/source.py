"""Reads the mesh that a command works on."""

from __future__ import annotations

from pathlib import Path

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.errors import MeshFileError


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
            f"{path}: has curves but no faces, so no holes; give a file with a surface in it", path=path
        )
    return mesh.merged() if merge else mesh
