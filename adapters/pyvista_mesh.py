"""`pyvista.PolyData`, and the surface cells of a `pyvista.UnstructuredGrid`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.extending import (
    attribute_rows,
    check_extension,
    grown_attribute,
    padded,
    real_columns,
    repeated,
)
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import without_seams
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.extension import MeshExtension
from spinor_geom.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    import pyvista

# VTK's numbers of cell types
TRIANGLE = 5
FACES = (TRIANGLE, 7, 9)  # and polygon, quad
NO_FACES = (0, 1, 2, 3, 4)  # empty, vertices, lines: kept as they are


class PyVistaAdapter:
    """`pyvista.PolyData`, and a `pyvista.UnstructuredGrid` of triangles, quads and polygons, with their point data.

    The active normals are called "normal", the active texture coordinates "uv", the first array of three or four bytes
    a point "color" (0 to 255), others as in `point_data`; one of these that clashes gets the prefix "attribute ".
    Edges along which normals, texture coordinates or colours differ are seams, and closed.
    """

    name = "pyvista.PolyData or UnstructuredGrid"
    types = ("pyvista.PolyData", "pyvista.UnstructuredGrid")

    def to_mesh(self, obj: pyvista.PolyData | pyvista.UnstructuredGrid) -> TriangleMesh:
        """The triangles, quads and polygons split, closed along seams.

        Raises:
            MeshShapeError: the mesh has cells that are neither faces nor points nor lines.
            NonFiniteVertexError: a coordinate is NaN or infinite.
            VertexIndexError: a face names a vertex that does not exist.
        """
        polygons, carried = polygons_of(obj), carried_by(obj)
        vertices = np.asarray(obj.points, dtype=np.float64)
        mesh = TriangleMesh(
            vertices,
            polygons.triangulated(vertices)[0],
            vertex_attributes={name: real_columns(values) for name, values in carried.items()},
            labels=[name for name, values in carried.items() if name != "color" and values.dtype.kind in "iu"],
        )
        return without_seams(mesh)

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new mesh of the same type with the extension appended: its cells after the old ones, as triangles.

        Field data, and which arrays are active, are copied. New cells get the cell data that occur most often; point
        data that are no real numbers get zeros or empty entries at new points.

        Raises:
            MeshShapeError: the mesh has cells that are neither faces nor points nor lines, or an attribute of it is
                missing in the extension or has another width.
            VertexIndexError: a new face names a vertex that neither of them has.
        """
        import pyvista

        polygons, carried = polygons_of(obj), carried_by(obj)
        widths = {name: real_columns(values).shape[1] for name, values in carried.items()}
        check_extension(extension, vertices=obj.n_points, attributes=widths)
        points = grown_attribute(np.asarray(obj.points), extension.vertices)
        new_cells = np.column_stack([np.full(len(extension.faces), 3), extension.faces]).ravel()
        grown: Any
        if isinstance(obj, pyvista.UnstructuredGrid):
            types = np.concatenate([obj.celltypes, np.full(len(extension.faces), TRIANGLE, dtype=np.uint8)])
            grown = pyvista.UnstructuredGrid(np.concatenate([obj.cells, new_cells]), types, points)
        else:
            faces = polygons.followed_by(extension.faces)
            cells = pyvista.CellArray.from_arrays(faces.starts, faces.corners)
            grown = pyvista.PolyData(points, faces=cells, lines=obj.lines, verts=obj.verts)
        names = _names(obj)
        for name, values in obj.point_data.items():
            count = len(extension.vertices)
            key = names[name]
            grown.point_data[name] = (
                grown_attribute(carried[key], attribute_rows(extension, key, width=widths[key]))
                if key in carried
                else padded(values, count)
            )
        for name, values in obj.cell_data.items():
            grown.cell_data[name] = repeated(np.asarray(values), len(extension.faces))
        for name, values in obj.field_data.items():
            grown.field_data[name] = values
        for old, new in ((obj.point_data, grown.point_data), (obj.cell_data, grown.cell_data)):
            new.active_scalars_name = old.active_scalars_name
            new.active_normals_name = old.active_normals_name
            new.active_texture_coordinates_name = old.active_texture_coordinates_name
        return grown


def polygons_of(mesh: pyvista.PolyData | pyvista.UnstructuredGrid) -> Polygons:
    """The faces of a mesh, quads and polygons whole.

    Raises:
        MeshShapeError: the mesh has cells that are neither faces nor points nor lines.
    """
    import pyvista

    if isinstance(mesh, pyvista.PolyData):
        if mesh.n_strips:
            raise MeshShapeError("the mesh has triangle strips; call mesh.triangulate() first")
        return _polygons(mesh.GetPolys(), slice(None))
    types = np.asarray(mesh.celltypes)
    others = np.setdiff1d(types, (*FACES, *NO_FACES))
    if len(others):
        kinds = ", ".join(pyvista.CellType(int(number)).name for number in others)
        raise MeshShapeError(f"the grid has cells that are no faces ({kinds}); call grid.extract_surface() first")
    return _polygons(mesh.GetCells(), np.isin(types, FACES))


def carried_by(mesh: pyvista.PolyData | pyvista.UnstructuredGrid) -> dict[str, np.ndarray]:
    """The real-valued point data under the names they have in a `TriangleMesh`."""
    arrays = {key: np.asarray(mesh.point_data[name]) for name, key in _names(mesh).items()}
    return {key: values for key, values in arrays.items() if values.dtype.kind in "biuf"}


def _polygons(cells: Any, chosen: Any) -> Polygons:
    import pyvista

    starts = pyvista.convert_array(cells.GetOffsetsArray())
    corners = pyvista.convert_array(cells.GetConnectivityArray())
    if len(starts) == 0:
        return Polygons.of_triangles(np.zeros((0, 3), dtype=np.int64))
    sizes = np.diff(starts)
    wanted = np.zeros(len(sizes), dtype=bool)
    wanted[chosen] = True
    return Polygons.of_sizes(corners[np.repeat(wanted, sizes)], sizes[wanted])


def _names(mesh: Any) -> dict[str, str]:
    """What each array of the point data is called in a `TriangleMesh`."""
    data = mesh.point_data
    own = {data.active_normals_name: "normal", data.active_texture_coordinates_name: "uv"}
    colors = (name for name, values in data.items() if values.dtype == np.uint8 and values.shape[1:] in ((3,), (4,)))
    own[next(colors, None)] = "color"
    taken = {"normal", "uv", "color"}
    return {name: own.get(name) or (f"attribute {name}" if name in taken else name) for name, _ in data.items()}
