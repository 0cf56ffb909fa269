"""Files whose formats other libraries own: VTK's polygonal data (.vtp, .vtk) through PyVista, 3MF through trimesh.

What such a file holds is what its library reads of it, and it is written anew by that library, which has to be there:
`require_library`.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from spinor_geom.adapters.contents import FileContents, malformed
from spinor_geom.adapters.extending import cast_values
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.pyvista_mesh import polygons_of
from spinor_geom.adapters.registry import extend, to_mesh
from spinor_geom.adapters.seams import appearance_of, seam_representatives
from spinor_geom.errors import MeshError, MeshFileError, NonFiniteVertexError, UnknownMeshTypeError
from spinor_geom.mesh.extension import MeshExtension
from spinor_geom.optional import require

if TYPE_CHECKING:
    import pyvista
    import trimesh

_VTK = {".vtp": ("vtkIOXML", "vtkXMLPolyData"), ".vtk": ("vtkIOLegacy", "vtkGenericDataObject")}
_LIBRARIES = {".vtp": ("pyvista",), ".vtk": ("pyvista",), ".3mf": ("lxml", "networkx")}


@dataclass(frozen=True, kw_only=True, eq=False)
class LibrarySource:
    """A file as its library read it.

    Attributes:
        suffix: the format, as ".vtp".
        held: the library's object, which an adapter can extend.
        encode: what makes a file of such an object.
    """

    suffix: str
    held: Any
    encode: Callable[[Any], bytes]

    def appended(self, extension: MeshExtension) -> bytes:
        """A new file of what the old one held, with the extension after it."""
        return self.encode(extend(self.held, extension))


def require_library(suffix: str) -> None:
    """Checks that what reads and writes a format is installed; most formats need nothing.

    Raises:
        MissingPackageError: it is not.
    """
    for package in _LIBRARIES.get(suffix, ()):
        require(package, extra="formats")


def read_vtk(data: bytes, path: Path | None, *, suffix: str) -> FileContents:
    """A file of VTK: XML polygonal data (.vtp), or legacy polygonal data or an unstructured grid of faces (.vtk).

    Faces, points and lines, and all point data.

    Raises:
        MeshFileError: VTK reports an error or a warning, or what the file holds is no surface.
        NonFiniteVertexError: a coordinate is NaN or infinite.
    """
    mesh = _read_by_vtk(_vtk_class(suffix, "Reader"), data, path)
    return _contents(
        mesh, path, source=LibrarySource(suffix=suffix, held=mesh, encode=partial(_written, suffix=suffix))
    )


def read_3mf(data: bytes, path: Path | None) -> FileContents:
    """All meshes of a 3MF file in the coordinates of its build; colours and materials are not read.

    Raises:
        MeshFileError: the file is malformed.
        NonFiniteVertexError: a coordinate is NaN or infinite.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type="3mf", process=False)
    # what trimesh and lxml raise for files that do not follow the format; lxml's errors are SyntaxErrors
    except (BadZipFile, SyntaxError, KeyError, IndexError, StopIteration, TypeError, ValueError) as error:
        raise malformed(path, "", f"trimesh cannot read it ({type(error).__name__}: {error})", "check it") from error
    return _contents(scene, path, source=LibrarySource(suffix=".3mf", held=scene, encode=_3mf))


def encode_vtk(contents: FileContents, *, suffix: str) -> bytes:
    """A new .vtp or .vtk (binary) file with faces whole, curves as lines and all attributes as point data."""
    return _written(_poly_data(contents), suffix=suffix)


def encode_3mf(contents: FileContents) -> bytes:
    """A new 3MF file of one mesh: positions and triangles alone."""
    import trimesh

    triangles, _ = contents.polygons.triangulated(contents.vertices)
    return _3mf(trimesh.Scene([trimesh.Trimesh(contents.vertices, triangles, process=False)]))


def _contents(held: Any, path: Path | None, *, source: LibrarySource) -> FileContents:
    """What a library's object holds.

    Raises:
        MeshFileError: it is no surface.
        NonFiniteVertexError: a coordinate is NaN or infinite.
    """
    try:
        mesh = to_mesh(held)
    except NonFiniteVertexError as error:
        raise NonFiniteVertexError(vertex=error.fields["vertex"], place=str(path or "")) from None
    except (MeshError, UnknownMeshTypeError) as error:
        raise MeshFileError(f"{path}: {error}", path=path, place="") from error
    polygons = Polygons.of_triangles(mesh.faces) if source.suffix == ".3mf" else polygons_of(held)
    appearance = appearance_of(mesh.vertex_attributes)
    return FileContents(
        vertices=mesh.vertices,
        polygons=polygons,
        attributes=mesh.vertex_attributes,
        labels=mesh.labels,
        color_scale=255.0,
        representatives=seam_representatives(mesh.vertices, polygons, appearance),
        source=source,
    )


def _read_by_vtk(reader: Any, data: bytes, path: Path | None) -> Any:
    """What a reader of VTK makes of a file, as PyVista's object.

    Raises:
        MeshFileError: VTK says anything at all: after an error it goes on with what it has, or with nothing.
    """
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    reader.SetReadFromInputString(True)
    reader.SetBinaryInputString(data, len(data))
    window, usual = vtkStringOutputWindow(), vtkOutputWindow.GetInstance()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader.Update()
    finally:
        vtkOutputWindow.SetInstance(usual)
        vtkLogger.SetStderrVerbosity(verbosity)
    lines = [line for line in window.GetOutput().splitlines()[1:] if line]
    if lines:
        raise malformed(path, "", f"VTK cannot read it ({lines[0].rpartition('): ')[2]})", "check that it is complete")
    return pyvista.wrap(reader.GetOutput())


def _vtk_class(suffix: str, kind: str) -> Any:
    """A new reader or writer."""
    module, name = _VTK[suffix]
    return getattr(import_module(f"vtkmodules.{module}"), f"{name}{kind}")()


def _written(mesh: pyvista.PolyData | pyvista.UnstructuredGrid, *, suffix: str) -> bytes:
    writer = _vtk_class(suffix, "Writer")
    writer.SetInputData(mesh)
    if suffix == ".vtk":
        writer.SetFileTypeToBinary()
    writer.SetWriteToOutputString(True)
    writer.Write()
    return bytes(writer.GetOutputStdString() if suffix == ".vtk" else writer.GetOutputString().encode("utf-8"))


def _3mf(scene: trimesh.Scene) -> bytes:
    untyped: Any = scene
    return bytes(untyped.export(file_type="3mf"))


def _poly_data(contents: FileContents) -> pyvista.PolyData:
    import pyvista

    polygons = contents.polygons
    lines = [number for curve in contents.polylines for number in (len(curve), *curve.tolist())]
    faces = pyvista.CellArray.from_arrays(polygons.starts, polygons.corners)
    mesh = pyvista.PolyData(np.array(contents.vertices), faces=faces, lines=lines or None)
    for name, values in contents.attributes.items():
        if name == "color":
            values = cast_values(values * (255.0 / contents.color_scale), np.dtype(np.uint8))
        elif name in contents.labels:
            values = values.astype(np.int64)
        mesh.point_data[name] = np.array(values[:, 0] if values.shape[1] == 1 else values)
    if "normal" in contents.attributes:
        mesh.point_data.active_normals_name = "normal"
    if "uv" in contents.attributes:
        mesh.point_data.active_texture_coordinates_name = "uv"
    return mesh
