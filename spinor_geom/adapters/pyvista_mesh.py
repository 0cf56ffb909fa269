"""`pyvista.PolyData`, and the surface cells of a `pyvista.UnstructuredGrid`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.contents import grown, grown_attributes, padded, real_attributes, repeated, triangles_of
from spinor_geom.adapters.polygon_faces import Polygons, without_seams
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within

if TYPE_CHECKING:
    import pyvista

TRIANGLE = 5  # VTK's numbers of cell types
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
        """The triangles, quads split, closed along seams; a MeshShapeError if cells are no faces, points or lines."""
        polygons, vertices = polygons_of(obj), np.asarray(obj.points, dtype=np.float64)
        return without_seams(triangles_of(vertices, polygons.triangulated(vertices)[0], carried_by(obj)))

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new mesh of the same type with the extension appended: its cells after the old ones, as triangles.

        Field data, and which arrays are active, are copied. New cells get the cell data that occur most often; point
        data that are no real numbers get zeros or empty entries at new points.
        """
        import pyvista

        polygons, names = polygons_of(obj), _names(obj)
        attributes = grown_attributes(carried_by(obj), extension, vertices=obj.n_points)
        points = grown(np.asarray(obj.points), extension.vertices)
        new_cells = np.column_stack([np.full(len(extension.faces), 3), extension.faces]).ravel()
        made: Any
        if isinstance(obj, pyvista.UnstructuredGrid):
            types = np.concatenate([obj.celltypes, np.full(len(extension.faces), TRIANGLE, dtype=np.uint8)])
            made = pyvista.UnstructuredGrid(np.concatenate([obj.cells, new_cells]), types, points)
        else:
            faces = polygons.followed_by(extension.faces)
            cells = pyvista.CellArray.from_arrays(faces.starts, faces.corners)
            made = pyvista.PolyData(points, faces=cells, lines=obj.lines, verts=obj.verts)
        for name, values in obj.point_data.items():
            key = names[name]
            made.point_data[name] = attributes[key] if key in attributes else padded(values, len(extension.vertices))
        for name, values in obj.cell_data.items():
            made.cell_data[name] = repeated(np.asarray(values), len(extension.faces))
        for name, values in obj.field_data.items():
            made.field_data[name] = values
        _activate(obj.point_data, made.point_data)
        _activate(obj.cell_data, made.cell_data)
        return made

    def merged(self, obj: Any, within: Within) -> Any:
        """A new mesh of the same type with points merged; cells, lines and data are copied."""
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


def _activate(old: Any, new: Any) -> None:
    """Makes the same arrays active as in other data."""
    new.active_scalars_name = old.active_scalars_name
    new.active_normals_name = old.active_normals_name
    new.active_texture_coordinates_name = old.active_texture_coordinates_name


def polygons_of(mesh: pyvista.PolyData | pyvista.UnstructuredGrid) -> Polygons:
    """The faces of a mesh, quads and polygons whole; raises as `PyVistaAdapter.to_mesh`."""
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
    return real_attributes({key: mesh.point_data[name] for name, key in _names(mesh).items()})


def _polygons(cells: Any, chosen: Any) -> Polygons:
    import pyvista

    starts = pyvista.convert_array(cells.GetOffsetsArray())
    corners = pyvista.convert_array(cells.GetConnectivityArray())
    if len(starts) == 0:
        return Polygons.of_triangles(np.zeros((0, 3), dtype=np.int64))
    sizes = np.diff(starts)
    if starts[0] or starts[-1] != len(corners) or (sizes < 0).any():
        raise MeshShapeError("the offsets of the cells do not fit their connectivity; make the cells anew")
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
