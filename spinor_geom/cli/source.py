"""Reads the mesh of a command, and checks the paths of its outputs."""

import os
import sys
from pathlib import Path

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.errors import MeshFileError, RenderError
from spinor_geom.fill.merging import merged


def read_surface(path: Path, *, merge: bool | float) -> MeshFile:
    """Reads a mesh file, which must have faces, and merges its vertices as `fill_hole` does."""
    mesh = read_mesh(path)
    if not len(mesh.mesh.faces):
        raise MeshFileError(f"{path}: has no faces; span the curves of an OBJ file with 'spinor-geom batch'", path=path)
    found: MeshFile = merged(mesh, merge)
    return found


def require_writable(path: Path, *kept: Path) -> None:
    """Raises a MeshFileError if the path cannot be written to, or is one of the files to keep."""
    if os.path.realpath(path) in map(os.path.realpath, kept):
        raise MeshFileError(f"{path} is given twice and would be overwritten; choose another file", path=path)
    if path.is_dir():
        raise MeshFileError(f"{path} is a folder; give the path of a file", path=path)
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise MeshFileError(f"{path} cannot be written: {above} is not a writable folder; choose another", path=path)


def require_display(advice: str) -> None:
    """Raises a RenderError, with advice what to do instead, if there is no display for a window."""
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise RenderError(f"there is no display for a window; {advice}")
