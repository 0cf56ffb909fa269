"""`pymeshlab.MeshSet`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.extending import grown_attributes, repeated
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh

if TYPE_CHECKING:
    import pymeshlab


class MeshSetAdapter:
    """The current mesh of a `pymeshlab.MeshSet`, with its vertex colours, scalars and texture coordinates.

    The attributes are called "color" (RGBA, 0 to 1), "scalar" and "uv". Positions are those before the mesh's
    transform. MeshLab holds triangles only, and computes normals anew for every mesh: they are not carried.
    """

    name = "pymeshlab.MeshSet"
    types = ("pymeshlab.MeshSet",)

    def to_mesh(self, obj: pymeshlab.MeshSet) -> TriangleMesh:
        """The triangles of the current mesh; a MeshShapeError if the set holds none."""
        mesh = _current(obj)
        return TriangleMesh(mesh.vertex_matrix(), mesh.face_matrix(), vertex_attributes=_carried(mesh))

    def extend(self, obj: pymeshlab.MeshSet, extension: MeshExtension) -> pymeshlab.MeshSet:
        """A new `MeshSet` whose current mesh is the old one with the extension appended; copies of the others follow.

        Label, transform, vertex colours, scalars and texture coordinates, face colours and scalars, and wedge texture
        coordinates are kept; new faces get the face colour and scalar that occur most often, and wedge texture
        coordinates (0, 0). What pymeshlab gives no way to copy is not: texture images, custom attributes, and which
        edges are diagonals of polygons.
        """
        import pymeshlab

        mesh = _current(obj)
        vertices = mesh.vertex_matrix()
        grown = grown_attributes(_carried(mesh), extension, vertices=len(vertices))
        arrays: dict[str, Any] = {}
        if "color" in grown:
            arrays["v_color_matrix"] = np.clip(grown["color"], 0.0, 1.0)
        if "scalar" in grown:
            arrays["v_scalar_array"] = grown["scalar"][:, 0]
        if "uv" in grown:
            arrays["v_tex_coords_matrix"] = grown["uv"]
        new = len(extension.faces)
        if mesh.has_face_color():
            arrays["f_color_matrix"] = repeated(mesh.face_color_matrix(), new)
        if mesh.has_face_scalar():
            arrays["f_scalar_array"] = repeated(mesh.face_scalar_array(), new)
        if mesh.has_wedge_tex_coord():
            arrays["w_tex_coords_matrix"] = np.concatenate([mesh.wedge_tex_coord_matrix(), np.zeros((3 * new, 2))])
        result = pymeshlab.MeshSet(verbose=False)
        faces = np.concatenate([mesh.face_matrix(), extension.faces.astype(np.int32)])
        result.add_mesh(pymeshlab.Mesh(np.concatenate([vertices, extension.vertices]), faces, **arrays), mesh.label())
        if not np.array_equal(mesh.transform_matrix(), np.eye(4)):
            result.set_matrix(transformmatrix=mesh.transform_matrix(), freeze=False)
        for other in obj:
            if other.id() != mesh.id():
                result.add_mesh(other, other.label(), set_as_current=False)
        return result


def _current(meshes: pymeshlab.MeshSet) -> pymeshlab.Mesh:
    if meshes.mesh_number() == 0:
        raise MeshShapeError("the MeshSet holds no mesh; load or add one first")
    return meshes.current_mesh()


def _carried(mesh: pymeshlab.Mesh) -> dict[str, Float[np.ndarray, "v _"]]:
    carried = {}
    if mesh.has_vertex_color():
        carried["color"] = mesh.vertex_color_matrix()
    if mesh.has_vertex_scalar():
        carried["scalar"] = mesh.vertex_scalar_array()[:, None]
    if mesh.has_vertex_tex_coord():
        carried["uv"] = mesh.vertex_tex_coord_matrix()
    return carried
