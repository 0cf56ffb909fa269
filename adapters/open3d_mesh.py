"""`open3d.geometry.TriangleMesh`."""

from __future__ import annotations

from typing import Any

import numpy as np

from spinor_geom.adapters.contents import unit_vectors
from spinor_geom.adapters.extending import grown_attributes, repeated
from spinor_geom.adapters.polygons import without_seams
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh


class Open3DAdapter:
    """`open3d.geometry.TriangleMesh`, with its vertex normals ("normal") and colours ("color", 0 to 1).

    Edges along which normals or colours differ are seams, and closed.
    """

    name = "open3d.geometry.TriangleMesh"
    types = ("open3d.TriangleMesh",)

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles; a MeshShapeError if the mesh is one of tensors."""
        carried = _carried(obj)
        return without_seams(
            TriangleMesh(np.asarray(obj.vertices), np.asarray(obj.triangles), vertex_attributes=carried)
        )

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new mesh with the extension appended; textures are copied.

        New triangles get their normals if the old ones have some, texture coordinates (0, 0), and the material that
        occurs most often.
        """
        from open3d.geometry import TriangleMesh as Open3DMesh
        from open3d.utility import IntVector, Vector2dVector, Vector3dVector, Vector3iVector

        attributes = grown_attributes(_carried(obj), extension, vertices=len(obj.vertices))
        count = len(extension.faces)
        grown = Open3DMesh(obj)
        grown.vertices = Vector3dVector(np.concatenate([np.asarray(obj.vertices), extension.vertices]))
        grown.triangles = Vector3iVector(np.concatenate([np.asarray(obj.triangles), extension.faces.astype(np.int32)]))
        if "normal" in attributes:
            grown.vertex_normals = Vector3dVector(attributes["normal"])
        if "color" in attributes:
            grown.vertex_colors = Vector3dVector(np.clip(attributes["color"], 0.0, 1.0))
        if obj.has_triangle_normals():
            a, b, c = np.moveaxis(np.asarray(grown.vertices)[extension.faces], 1, 0)
            normals = unit_vectors(np.cross(b - a, c - a))
            grown.triangle_normals = Vector3dVector(np.concatenate([np.asarray(obj.triangle_normals), normals]))
        if obj.has_triangle_uvs():
            zeros = np.zeros((3 * count, 2))
            grown.triangle_uvs = Vector2dVector(np.concatenate([np.asarray(obj.triangle_uvs), zeros]))
        if obj.has_triangle_material_ids():
            grown.triangle_material_ids = IntVector(repeated(np.asarray(obj.triangle_material_ids), count))
        if obj.has_adjacency_list():
            grown.compute_adjacency_list()
        return grown


def _carried(mesh: Any) -> dict[str, np.ndarray]:
    if hasattr(mesh, "to_legacy"):
        raise MeshShapeError("the mesh is an open3d.t.geometry.TriangleMesh; give mesh.to_legacy()")
    carried = {}
    if mesh.has_vertex_normals():
        carried["normal"] = np.asarray(mesh.vertex_normals)
    if mesh.has_vertex_colors():
        carried["color"] = np.asarray(mesh.vertex_colors)
    return carried
