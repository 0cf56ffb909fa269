"""`open3d.geometry.TriangleMesh`, `meshio.Mesh` (so every format that meshio reads and writes), `pymeshlab.MeshSet`."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.polygon_faces import Polygons, closed_along_seams, without_seams
from spinor_geom.adapters.textures import Textured, pixels_of
from spinor_geom.adapters.vertex_data import (
    append_attributes,
    append_most_frequent,
    append_rows,
    most_frequent_row,
    triangles_of,
    unit_vectors,
)
from spinor_geom.errors import MeshShapeError, require
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within

if TYPE_CHECKING:
    import meshio
    import pymeshlab

FACES = ("triangle", "quad", "polygon")  # meshio's names of cells
NO_FACES = ("vertex", "line")  # kept as they are


class Open3DAdapter:
    """`open3d.geometry.TriangleMesh`, with its vertex normals ("normal") and colours ("color", 0 to 1).

    Edges along which normals or colours differ are seams, and closed.
    """

    name = "open3d.geometry.TriangleMesh"
    types = ("open3d.TriangleMesh",)

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles. Raises a MeshShapeError if the mesh is one of tensors."""
        return without_seams(self._triangles(obj))

    def textured(self, obj: Any, largest: int) -> Textured | None:
        """The only texture. Open3D stores images with the lowest row first."""
        images = [np.asarray(texture) for texture in obj.textures if not texture.is_empty()]
        if not obj.has_triangle_uvs() or len(images) != 1:
            return None
        require("PIL", extra="render")
        from PIL import Image

        _, kept = closed_along_seams(self._triangles(obj))
        coordinates = np.asarray(obj.triangle_uvs).reshape(-1, 3, 2)[kept]
        return pixels_of(Image.fromarray(images[0][::-1]), largest), coordinates

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new mesh with the extension appended. Textures are copied.

        New triangles get normals if the old ones have some, texture coordinates (0, 0), and the most frequent material.
        """
        from open3d.utility import IntVector, Vector2dVector, Vector3dVector

        attributes = append_attributes(self._arrays(obj), extension, vertices=len(obj.vertices))
        vertices = np.concatenate([np.asarray(obj.vertices), extension.vertices])
        made = self._copy(obj, vertices, np.concatenate([np.asarray(obj.triangles), extension.faces]), attributes)
        count = len(extension.faces)
        if obj.has_triangle_normals():
            a, b, c = np.moveaxis(vertices[extension.faces], 1, 0)
            normals = unit_vectors(np.cross(b - a, c - a))
            made.triangle_normals = Vector3dVector(np.concatenate([np.asarray(obj.triangle_normals), normals]))
        if obj.has_triangle_uvs():
            zeros = np.zeros((3 * count, 2))
            made.triangle_uvs = Vector2dVector(np.concatenate([np.asarray(obj.triangle_uvs), zeros]))
        if obj.has_triangle_material_ids():
            made.triangle_material_ids = IntVector(append_most_frequent(obj.triangle_material_ids, count))
        return made

    def merged(self, obj: Any, within: Within) -> Any:
        """A new mesh with vertices merged. Data of triangles are copied."""
        kept, new_index = self.to_mesh(obj).merge_map(within)
        attributes = {name: values[kept] for name, values in self._arrays(obj).items()}
        return self._copy(obj, np.asarray(obj.vertices)[kept], new_index[np.asarray(obj.triangles)], attributes)

    def _triangles(self, obj: Any) -> TriangleMesh:
        """The triangles with their seams."""
        arrays = self._arrays(obj)  # refuses meshes of tensors
        return triangles_of(np.asarray(obj.vertices), np.asarray(obj.triangles), arrays)

    def _arrays(self, obj: Any) -> dict[str, np.ndarray]:
        if hasattr(obj, "to_legacy"):
            raise MeshShapeError("the mesh is an open3d.t.geometry.TriangleMesh; give mesh.to_legacy()")
        arrays = {}
        if obj.has_vertex_normals():
            arrays["normal"] = np.asarray(obj.vertex_normals)
        if obj.has_vertex_colors():
            arrays["color"] = np.asarray(obj.vertex_colors)
        return arrays

    def _copy(self, obj: Any, vertices: np.ndarray, triangles: np.ndarray, attributes: dict[str, np.ndarray]) -> Any:
        """A copy of a mesh with other vertices and triangles."""
        from open3d.geometry import TriangleMesh as Open3DMesh
        from open3d.utility import Vector3dVector, Vector3iVector

        made = Open3DMesh(obj)
        made.vertices = Vector3dVector(vertices)
        made.triangles = Vector3iVector(triangles.astype(np.int32))
        if "normal" in attributes:
            made.vertex_normals = Vector3dVector(attributes["normal"])
        if "color" in attributes:
            made.vertex_colors = Vector3dVector(np.clip(attributes["color"], 0.0, 1.0))
        if obj.has_adjacency_list():
            made.compute_adjacency_list()
        return made


class MeshioAdapter:
    """`meshio.Mesh` of triangles, quads and polygons, with its point data under their own names."""

    name = "meshio.Mesh"
    types = ("meshio.Mesh",)

    def to_mesh(self, obj: meshio.Mesh) -> TriangleMesh:
        """The triangles, quads and polygons split, block after block.

        Raises a MeshShapeError for plane meshes (two coordinates a point) and cells other than faces, points and lines.
        """
        points, polygons = self._points_and_polygons(obj)
        return triangles_of(points, polygons.triangulated(points.astype(np.float64))[0], obj.point_data)

    def extend(self, obj: meshio.Mesh, extension: MeshExtension) -> meshio.Mesh:
        """A new mesh with the extension appended: its faces are a block of triangles of their own.

        Point sets, cell sets and field data are copied. New cells get the most frequent cell data of faces. Point data
        that are not real numbers get zeros or empty entries at new points.
        """
        import meshio

        points, _ = self._points_and_polygons(obj)

        def of_new_cells(values: list[Any]) -> np.ndarray:
            blocks = zip(values, obj.cells, strict=True)
            of_faces = np.concatenate([np.asarray(own) for own, block in blocks if block.type in FACES])
            return np.repeat(most_frequent_row(of_faces), len(extension.faces), axis=0)

        return meshio.Mesh(
            points=append_rows(points, extension.vertices),
            cells=[*((block.type, block.data) for block in obj.cells), ("triangle", extension.faces)],
            point_data=append_attributes(obj.point_data, extension, vertices=len(points)),
            cell_data={name: [*values, of_new_cells(values)] for name, values in obj.cell_data.items()},
            cell_sets={name: [*own, np.zeros(0, dtype=np.int64)] for name, own in obj.cell_sets.items()},
            **{name: deepcopy(getattr(obj, name)) for name in ("field_data", "point_sets", "gmsh_periodic", "info")},
        )

    def merged(self, obj: meshio.Mesh, within: Within) -> meshio.Mesh:
        """A new mesh with points merged. Cells, data and sets are copied."""
        import meshio

        kept, new_index = self.to_mesh(obj).merge_map(within)
        same = ("cell_data", "cell_sets", "field_data", "gmsh_periodic", "info")
        return meshio.Mesh(
            points=np.asarray(obj.points)[kept],
            cells=[(block.type, new_index[np.asarray(block.data)]) for block in obj.cells],
            point_data={name: np.asarray(values)[kept] for name, values in obj.point_data.items()},
            point_sets={name: np.unique(new_index[np.asarray(own)]) for name, own in obj.point_sets.items()},
            **{name: deepcopy(getattr(obj, name)) for name in same},
        )

    def _points_and_polygons(self, mesh: meshio.Mesh) -> tuple[np.ndarray, Polygons]:
        points = np.asarray(mesh.points)
        if points.shape[1:] != (3,):
            raise MeshShapeError(
                "the points are not three-dimensional; append a third coordinate, zeros for a plane mesh"
            )
        others = sorted({block.type for block in mesh.cells} - {*FACES, *NO_FACES})
        if others:
            raise MeshShapeError(f"the mesh has cells that are not faces ({', '.join(others)}); extract its surface")
        blocks = [np.asarray(block.data) for block in mesh.cells if block.type in FACES]
        none = np.zeros(0, dtype=np.int64)
        corners = np.concatenate([none, *(data.reshape(-1) for data in blocks)])
        return points, Polygons.of_sizes(corners, np.concatenate([none, *(np.full(*d.shape) for d in blocks)]))


class MeshSetAdapter:
    """The current mesh of a `pymeshlab.MeshSet`, with its vertex colours, scalars and texture coordinates.

    The attributes are called "color" (RGBA, 0 to 1), "scalar" and "uv". Positions are those before the mesh's
    transform. MeshLab stores triangles only, and computes normals for every mesh, so normals are not copied.
    """

    name = "pymeshlab.MeshSet"
    types = ("pymeshlab.MeshSet",)

    def to_mesh(self, obj: pymeshlab.MeshSet) -> TriangleMesh:
        """The triangles of the current mesh. Raises a MeshShapeError if the set holds none."""
        mesh = self._current(obj)
        return TriangleMesh(mesh.vertex_matrix(), mesh.face_matrix(), vertex_attributes=self._arrays(mesh))

    def extend(self, obj: pymeshlab.MeshSet, extension: MeshExtension) -> pymeshlab.MeshSet:
        """A new `MeshSet` whose current mesh is the old one with the extension appended, before copies of the others.

        Label, transform, vertex colours, scalars and texture coordinates, face colours and scalars, and wedge texture
        coordinates are kept. New faces get the most frequent face colour and scalar, and wedge texture coordinates
        (0, 0). pymeshlab cannot copy texture images, custom attributes, and which edges are diagonals of polygons.
        """
        mesh = self._current(obj)
        vertices = np.concatenate([mesh.vertex_matrix(), extension.vertices])
        attributes = append_attributes(self._arrays(mesh), extension, vertices=mesh.vertex_number())
        return self._copy(obj, vertices, np.concatenate([mesh.face_matrix(), extension.faces]), attributes)

    def merged(self, obj: pymeshlab.MeshSet, within: Within) -> pymeshlab.MeshSet:
        """A new `MeshSet` with the vertices of its current mesh merged. The rest is copied as by `extend`."""
        mesh = self._current(obj)
        kept, new_index = self.to_mesh(obj).merge_map(within)
        attributes = {name: values[kept] for name, values in self._arrays(mesh).items()}
        return self._copy(obj, mesh.vertex_matrix()[kept], new_index[mesh.face_matrix()], attributes)

    def _current(self, meshes: pymeshlab.MeshSet) -> pymeshlab.Mesh:
        if meshes.mesh_number() == 0:
            raise MeshShapeError("the MeshSet holds no mesh; load or add one first")
        return meshes.current_mesh()

    def _arrays(self, mesh: pymeshlab.Mesh) -> dict[str, np.ndarray]:
        arrays = {}
        if mesh.has_vertex_color():
            arrays["color"] = mesh.vertex_color_matrix()
        if mesh.has_vertex_scalar():
            arrays["scalar"] = mesh.vertex_scalar_array()[:, None]
        if mesh.has_vertex_tex_coord():
            arrays["uv"] = mesh.vertex_tex_coord_matrix()
        return arrays

    def _copy(
        self, meshes: pymeshlab.MeshSet, vertices: np.ndarray, faces: np.ndarray, attributes: dict[str, np.ndarray]
    ) -> pymeshlab.MeshSet:
        """A copy of a set with another current mesh, whose faces begin with those of the old one."""
        import pymeshlab

        mesh = meshes.current_mesh()
        arrays: dict[str, Any] = {}
        if "color" in attributes:
            arrays["v_color_matrix"] = np.clip(attributes["color"], 0.0, 1.0)
        if "scalar" in attributes:
            arrays["v_scalar_array"] = attributes["scalar"][:, 0]
        if "uv" in attributes:
            arrays["v_tex_coords_matrix"] = attributes["uv"]
        new = len(faces) - mesh.face_number()
        if mesh.has_face_color():
            arrays["f_color_matrix"] = append_most_frequent(mesh.face_color_matrix(), new)
        if mesh.has_face_scalar():
            arrays["f_scalar_array"] = append_most_frequent(mesh.face_scalar_array(), new)
        if mesh.has_wedge_tex_coord():
            arrays["w_tex_coords_matrix"] = np.concatenate([mesh.wedge_tex_coord_matrix(), np.zeros((3 * new, 2))])
        result = pymeshlab.MeshSet(verbose=False)
        result.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32), **arrays), mesh.label())
        if not np.array_equal(mesh.transform_matrix(), np.eye(4)):
            result.set_matrix(transformmatrix=mesh.transform_matrix(), freeze=False)
        for other in meshes:
            if other.id() != mesh.id():
                result.add_mesh(other, other.label(), set_as_current=False)
        return result
