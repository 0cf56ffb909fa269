"""Files that libraries read and write: VTK's polygonal data (.vtp, .vtk) by PyVista."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from spinor_geom.adapters.contents import FileContents
from spinor_geom.adapters.polygon_faces import appearance_of, seam_representatives
from spinor_geom.adapters.pyvista_mesh import polygons_of
from spinor_geom.adapters.registry import extend, to_mesh
from spinor_geom.adapters.vertex_data import cast_values
from spinor_geom.adapters.vtk_legacy import read_legacy
from spinor_geom.adapters.vtk_xml import read_xml
from spinor_geom.mesh.triangle_mesh import MeshExtension

_READERS = {".vtp": read_xml, ".vtk": read_legacy}


def read_vtk(data: bytes, *, suffix: str) -> FileContents:
    """Polygonal data in XML (.vtp), or legacy polygonal data or an unstructured grid of faces (.vtk)."""
    surface = _READERS[suffix](data).to_pyvista()

    def appended(extension: MeshExtension) -> bytes:
        extended = extend(surface, extension)
        if "patch" not in surface.cell_data:
            _label_patches(extended, extension.face_loops)
        return _vtk_bytes(extended, suffix)

    return _contents(surface, suffix, appended)


def encode_vtk(contents: FileContents, *, suffix: str) -> bytes:
    """A new .vtp or .vtk (binary) file with undivided faces, curves as lines and all attributes as point data."""
    import pyvista

    polygons = contents.polygons
    lines = [number for curve in contents.polylines for number in (len(curve), *curve.tolist())]
    faces = pyvista.CellArray.from_arrays(polygons.starts, polygons.corners)
    mesh = pyvista.PolyData(np.array(contents.vertices), faces=faces, lines=lines or None)
    if contents.face_loops is not None:
        _label_patches(mesh, contents.face_loops)
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
    return _vtk_bytes(mesh, suffix)


def _contents(mesh_object: Any, suffix: str, appended: Callable[[MeshExtension], bytes]) -> FileContents:
    mesh, polygons = to_mesh(mesh_object), polygons_of(mesh_object)
    patches = np.asarray(mesh_object.cell_data.get("patch", np.zeros(0)))
    has_patches = patches.shape == (len(polygons),) and patches.dtype.kind == "i"
    return FileContents(
        vertices=mesh.vertices,
        polygons=polygons,
        attributes=mesh.vertex_attributes,
        labels=mesh.labels,
        color_scale=255.0,
        face_loops=patches.astype(np.int64) if has_patches else None,
        stored=mesh.stored,
        representatives=seam_representatives(mesh.vertices, polygons, appearance_of(mesh.vertex_attributes)),
        suffix=suffix,
        appended=appended,
    )


def _label_patches(mesh: Any, face_loops: np.ndarray) -> None:
    """Adds the cell data "patch": the indices of the loops for the last cells, −1 for those before."""
    mesh.cell_data["patch"] = np.concatenate([np.full(mesh.n_cells - len(face_loops), -1), face_loops])


def _vtk_bytes(mesh: Any, suffix: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"mesh{suffix}"
        mesh.save(path)
        return path.read_bytes()
