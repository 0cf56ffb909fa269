"""`pyvista.PolyData`, and the surface cells of a `pyvista.UnstructuredGrid`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from spinor_geom.adapters.polygon_faces import Polygons, without_seams
from spinor_geom.adapters.vertex_data import (
    append_attributes,
    append_most_frequent,
    append_rows,
    as_float64,
    triangles_of,
)
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within

if TYPE_CHECKING:
    import pyvista

    Mesh: TypeAlias = pyvista.PolyData | pyvista.UnstructuredGrid

TRIANGLE = 5  # VTK's numbers of cell types
FACES = (TRIANGLE, 7, 9)  # and polygon, quad
NO_FACES = (0, 1, 2, 3, 4)  # empty, vertices, lines: kept as they are


class PyVistaAdapter:
    """`pyvista.PolyData`, and a `pyvista.UnstructuredGrid` of triangles, quads and polygons, with their point data.

    The active normals are called "normal", the active texture coordinates "uv", the first array of three or four bytes
    per point "color" (0 to 255), others as in `point_data`, with the prefix "attribute " if the name clashes.
    Edges along which normals, texture coordinates or colours differ are seams, and closed.
    """

    name = "pyvista.PolyData or UnstructuredGrid"
    types = ("pyvista.PolyData", "pyvista.UnstructuredGrid")

    def to_mesh(self, obj: Mesh) -> TriangleMesh:
        """The triangles, quads split, closed along seams. Raises a MeshShapeError for cells of other types."""
        points = np.asarray(obj.points)
        return without_seams(triangles_of(points, polygons_of(obj).triangulated(as_float64(points))[0], _arrays(obj)))

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new mesh of the same type with the extension appended: its cells after the old ones, as triangles.

        Field data are copied, and the same arrays are active. New cells get the most frequent cell data. Point data
        that are not real numbers get zeros or empty entries at new points.
        """
        import pyvista

        polygons = polygons_of(obj)
        attributes = append_attributes(_arrays(obj), extension, vertices=obj.n_points)
        points = append_rows(np.asarray(obj.points), extension.vertices)
        made: Any
        if isinstance(obj, pyvista.UnstructuredGrid):
            new_cells = np.column_stack([np.full(len(extension.faces), 3), extension.faces]).ravel()
            types = np.concatenate([obj.celltypes, np.full(len(extension.faces), TRIANGLE, dtype=np.uint8)])
            made = pyvista.UnstructuredGrid(np.concatenate([obj.cells, new_cells]), types, points)
        else:
            faces = polygons.followed_by(extension.faces)
            cells = pyvista.CellArray.from_arrays(faces.starts, faces.corners)
            made = pyvista.PolyData(points, faces=cells, lines=obj.lines, verts=obj.verts)
        for (name, _), values in zip(obj.point_data.items(), attributes.values(), strict=True):
            set_array(made.point_data, name, values)
        for name, values in obj.cell_data.items():
            set_array(made.cell_data, name, append_most_frequent(values, len(extension.faces)))
        for name, values in obj.field_data.items():
            set_array(made.field_data, name, values)
        _activate(obj.point_data, made.point_data)
        _activate(obj.cell_data, made.cell_data)
        return made

    def merged(self, obj: Any, within: Within) -> Any:
        """A new mesh of the same type with points merged. Cells, lines and data are copied."""
        import pyvista

        kept, new_index = self.to_mesh(obj).merge_map(within)
        made = obj.copy()
        made.point_data.clear()
        is_grid = isinstance(obj, pyvista.UnstructuredGrid)
        for cells in [made.GetCells()] if is_grid else [made.GetPolys(), made.GetLines(), made.GetVerts()]:
            corners = pyvista.convert_array(cells.GetConnectivityArray())
            corners[:] = new_index[corners]
        made.points = np.asarray(obj.points)[kept]
        for name, values in obj.point_data.items():
            made.point_data[name] = np.asarray(values)[kept]
        _activate(obj.point_data, made.point_data)
        return made


def polygons_of(mesh: Mesh) -> Polygons:
    """The faces of a mesh, with undivided quads and polygons. Raises as `PyVistaAdapter.to_mesh`."""
    import pyvista

    if isinstance(mesh, pyvista.UnstructuredGrid):
        types, cells = np.asarray(mesh.celltypes), mesh.GetCells()
        if len(others := np.setdiff1d(types, (*FACES, *NO_FACES))):
            kinds = ", ".join(pyvista.CellType(int(number)).name for number in others)
            raise MeshShapeError(f"the grid has cells that are not faces ({kinds}); call grid.extract_surface() first")
    else:
        if mesh.n_strips:
            raise MeshShapeError("the mesh has triangle strips; call mesh.triangulate() first")
        cells = mesh.GetPolys()
        types = np.full(cells.GetNumberOfCells(), TRIANGLE)  # or polygons
    starts = pyvista.convert_array(cells.GetOffsetsArray())
    corners = pyvista.convert_array(cells.GetConnectivityArray())
    sizes = np.diff(starts)
    if len(starts) and (starts[0] or starts[-1] != len(corners) or (sizes < 0).any()):
        raise MeshShapeError("the offsets of the cells do not fit their connectivity; make the cells anew")
    is_face = np.isin(types, FACES)
    return Polygons.of_sizes(corners[np.repeat(is_face, sizes)], sizes[is_face])


def _arrays(mesh: Any) -> dict[str, Any]:
    """The point data under their names in a `TriangleMesh`, in the same order."""
    data = mesh.point_data
    colors = (name for name, values in data.items() if values.dtype == np.uint8 and values.shape[1:] in ((3,), (4,)))
    special = {
        data.active_normals_name: "normal",
        data.active_texture_coordinates_name: "uv",
        next(colors, None): "color",
    }
    taken = {"normal", "uv", "color"}
    return {special.get(n) or (f"attribute {n}" if n in taken else n): values for n, values in data.items()}


def set_array(data: Any, name: str, values: np.ndarray) -> None:
    """Adds an array to the data of a mesh. PyVista itself refuses texts that are not ASCII."""
    if values.dtype.kind != "U":
        data.set_array(values, name)
        return
    from pyvista import convert_string_array

    texts: Any = convert_string_array(np.empty(0, "U1"), name)
    texts.SetNumberOfComponents(values.size // max(len(values), 1))
    for text in values.ravel().tolist():
        texts.InsertNextValue(text)
    data.VTKObject.AddArray(texts)


def _activate(old: Any, new: Any) -> None:
    """Makes the same arrays active."""
    new.active_scalars_name = old.active_scalars_name
    new.active_normals_name = old.active_normals_name
    new.active_texture_coordinates_name = old.active_texture_coordinates_name
