"""`bpy.types.Mesh` and `bpy.types.Object` of Blender, also while they are edited."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.vertex_data import attribute_rows
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_existing_vertices, stored_as

# of Blender's attributes of real numbers: the name of the values, and how many there are
_FIELDS = {
    "FLOAT": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color_srgb", 4),
}
# kinds of layers of `bmesh` with real numbers, how many of them, and kinds with something else
_REAL_LAYERS = {"float": 1, "float_vector": 3, "float_color": 4, "color": 4, "uv": 2}
_OTHER_LAYERS = ("int", "bool", "string")
_GROUP = "vertex group "
_SINGLE = stored_as(np.dtype(np.float32))  # Blender's positions


class BlenderMeshAdapter:
    """`bpy.types.Mesh` with quads and polygons, in its own coordinates, and as it is shown if it is being edited.

    Attributes of real numbers at vertices and at corners, such as texture coordinates, are called "attribute NAME". At
    a vertex whose corners differ, one of them counts. "shape key NAME" is the offset from the position. "vertex group
    I" are the weights in the I-th group at vertices of boundary edges, and 0 elsewhere.
    """

    name = "bpy.types.Mesh"
    types = ("_bpy_types.Mesh", "bpy_types.Mesh")  # of Blender 5 and before

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles, quads and polygons split."""
        with _current(obj) as mesh:
            vertices = _values(mesh.vertices, "co", 3)
            corners = _values(mesh.loops, "vertex_index", 1, np.int32)[:, 0]
            polygons = Polygons.of_sizes(corners, _values(mesh.polygons, "loop_total", 1, np.int32)[:, 0])
            faces = polygons.triangulated(vertices)[0]
            attributes = _attributes(mesh, vertices, polygons.corners) | _weights(mesh, faces)
        return TriangleMesh(vertices, faces, vertex_attributes=attributes, stored=_SINGLE)

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new `Mesh` of the file with the extension appended. All that the old one has is copied.

        See `append` for the values at new vertices and faces.
        """
        import bmesh

        _flush(obj)
        edited = bmesh.new()
        try:
            edited.from_mesh(obj)
            append(edited, extension)
            made = obj.copy()
            edited.to_mesh(made)
        finally:
            edited.free()
        return made


class BlenderObjectAdapter:
    """`bpy.types.Object` with a mesh, without its modifiers, in the coordinates of the world.

    So the area is minimal, and an edge length has its units, however the object is scaled.
    """

    name = "bpy.types.Object"
    types = ("_bpy_types.Object", "bpy_types.Object")

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles. Raises a MeshShapeError for objects of other types, and if a scale is 0."""
        mesh, (axes, origin) = _MESHES.to_mesh(self._mesh(obj)), self._transform(obj)
        attributes = mesh.vertex_attributes
        stored = partial(_stored_in_object, axes, origin)
        return TriangleMesh(mesh.vertices @ axes + origin, mesh.faces, vertex_attributes=attributes, stored=stored)

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A copy of the object, in no collection, with a new `Mesh` and the same materials, groups and modifiers."""
        filled = _MESHES.extend(self._mesh(obj), self.in_own_coordinates(obj, extension))
        made = obj.copy()
        made.data = filled
        return made

    def in_own_coordinates(self, obj: Any, extension: MeshExtension) -> MeshExtension:
        """An extension of the mesh in the coordinates of the world, in those of the object."""
        axes, origin = self._transform(obj)
        return replace(extension, vertices=(extension.vertices - origin) @ np.linalg.inv(axes))

    def _mesh(self, obj: Any) -> Any:
        if obj.type != "MESH":
            raise MeshShapeError(f"the object {obj.name!r} has the type {obj.type}; convert it to a mesh first")
        return obj.data

    def _transform(self, obj: Any) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        """The axes of the object in the world, as rows, and its origin."""
        matrix = np.array(obj.matrix_world, dtype=np.float64)
        if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
            raise MeshShapeError(f"the object {obj.name!r} has no extent along an axis; give it a scale other than 0")
        return matrix[:3, :3].T, matrix[:3, 3]


def _stored_in_object(
    axes: Float[np.ndarray, "3 3"],
    origin: Float[np.ndarray, " 3"],
    points: Float[np.ndarray, "n 3"],
    rim: Int[np.ndarray, " m"],
) -> Float[np.ndarray, "n 3"]:
    return np.asarray(_SINGLE((points - origin) @ np.linalg.inv(axes), rim) @ axes + origin)


_MESHES = BlenderMeshAdapter()


def append(edited: Any, extension: MeshExtension, shape_key: int = 0) -> list[Any]:
    """Appends an extension to a `bmesh.types.BMesh`, and returns the new faces.

    New vertices have the attributes of the extension, and for the rest (integers, texts) those of the nearest vertex of
    the rim. New faces have the material, the shading and the attributes of a face beside the rim, one with the most
    frequent material there. Vertices that no face uses are left out.

    Args:
        edited: the mesh, which is changed.
        extension: of its triangles, in its coordinates.
        shape_key: the index of the shape key whose positions the mesh has.

    Raises:
        VertexIndexError, MeshShapeError: as for `Adapter.extend`, and for a face over the vertices of another one.
    """
    count = len(edited.verts)
    require_existing_vertices(extension.faces, vertices=count + len(extension.vertices))
    edited.verts.ensure_lookup_table()
    old = {index: edited.verts[index] for index in np.unique(extension.faces[extension.faces < count]).tolist()}
    # before there are new ones
    corner = {index: vertex.link_loops[0] for index, vertex in old.items() if vertex.link_loops}
    nearest: dict[int, int] = {}
    face_beside = {}
    for loop in np.unique(extension.face_loops).tolist():
        used = np.unique(extension.faces[extension.face_loops == loop])
        rim, new = used[used < count].tolist(), used[used >= count]
        found = cKDTree([old[index].co for index in rim]).query(extension.vertices[new - count])[1]
        nearest |= {index: rim[place] for index, place in zip(new.tolist(), np.asarray(found).tolist(), strict=True)}
        beside = [face for index in rim for face in old[index].link_faces]
        materials = Counter(face.material_index for face in beside).most_common(1)
        face_beside[loop] = next((face for face in beside if face.material_index == materials[0][0]), None)
    new_vertices = {
        index: edited.verts.new(extension.vertices[index - count], old[near]) for index, near in sorted(nearest.items())
    }
    _set_vertices(edited, new_vertices, extension, shape_key)
    vertices, faces = old | new_vertices, []
    try:
        for corners, loop in zip(extension.faces.tolist(), extension.face_loops.tolist(), strict=True):
            faces.append(edited.faces.new([vertices[index] for index in corners], face_beside[loop]))
    except ValueError as error:
        raise MeshShapeError(f"face {len(faces)} of the extension has the same vertices as another face") from error
    places = {index: corner[near] for index, near in [*zip(old, old, strict=True), *nearest.items()] if near in corner}
    _set_corners(edited, faces, extension, places)
    edited.normal_update()
    return faces


def _set_vertices(edited: Any, new: dict[int, Any], extension: MeshExtension, shape_key: int) -> None:
    """Sets the attributes, groups and shape keys of new vertices, by index."""
    for kind, layer, rows in _real_layers(edited.verts.layers, extension):
        for vertex, row in zip(new.values(), rows, strict=True):
            _set(vertex, kind, layer, row)
    groups = {
        int(name.removeprefix(_GROUP)): values[:, 0].tolist()
        for name, values in extension.vertex_attributes.items()
        if name.startswith(_GROUP)
    }
    layer = edited.verts.layers.deform.active
    for row, vertex in enumerate(new.values() if groups else ()):
        vertex[layer].clear()
        for group, weights in groups.items():
            if weights[row] > 0:
                vertex[layer][group] = min(weights[row], 1.0)
    keys = edited.verts.layers.shape.values()
    for layer in keys:
        offsets = attribute_rows(extension, f"shape key {layer.name}", 3)
        for vertex, position in zip(new.values(), (extension.vertices + offsets).tolist(), strict=True):
            vertex[layer] = position
    for vertex in new.values() if keys else ():
        vertex.co = vertex[keys[shape_key]]


def _set_corners(edited: Any, faces: list[Any], extension: MeshExtension, places: dict[int, Any]) -> None:
    """Sets the attributes at the corners of new faces. `places` has an old corner for each vertex, or one near it."""
    layers, count = edited.loops.layers, len(edited.verts) - len(extension.vertices)
    others: list[tuple[str, Any, list[Any]]] = [
        (kind, layer, []) for kind in _OTHER_LAYERS for layer in getattr(layers, kind).values()
    ]
    corners = zip((corner for face in faces for corner in face.loops), extension.faces.ravel().tolist(), strict=True)
    kinds = _real_layers(layers, extension) + others
    for corner, index in corners:
        for kind, layer, rows in kinds:
            if rows and index >= count:
                _set(corner, kind, layer, rows[index - count])
            elif index in places:
                corner[layer] = places[index][layer]


def _real_layers(layers: Any, extension: MeshExtension) -> list[tuple[str, Any, list[Any]]]:
    """Kind and layer of each attribute of real numbers, and its values at new vertices."""
    names = [
        (kind, layer) for kind in _REAL_LAYERS if hasattr(layers, kind) for layer in getattr(layers, kind).values()
    ]
    if not len(extension.vertices):
        return [(kind, layer, []) for kind, layer in names]
    return [
        (kind, layer, attribute_rows(extension, f"attribute {layer.name}", _REAL_LAYERS[kind]).tolist())
        for kind, layer in names
    ]


def _set(element: Any, kind: str, layer: Any, row: list[float]) -> None:
    """Sets one value of an attribute of real numbers."""
    if kind == "uv":
        element[layer].uv = row
    else:
        element[layer] = row[0] if kind == "float" else row


@contextmanager
def _current(mesh: Any) -> Iterator[Any]:
    """A mesh as it is shown, a copy while it is being edited, when Blender does not give its attributes."""
    import bpy

    if not mesh.is_editmode:
        yield mesh
        return
    _flush(mesh)
    copy = mesh.copy()
    try:
        yield copy
    finally:
        bpy.data.meshes.remove(copy)


def _flush(mesh: Any) -> None:
    """Copies what was edited to the mesh itself."""
    import bpy

    if mesh.is_editmode:
        next(user for user in bpy.data.objects if user.data == mesh).update_from_editmode()


def _values(items: Any, name: str, width: int, dtype: type = np.float32) -> Any:
    """The values of a collection of Blender's, (n, width), real ones in double precision."""
    values: np.ndarray = np.empty(len(items) * width, dtype=dtype)
    items.foreach_get(name, values)
    return values.reshape(-1, width).astype(np.float64 if dtype is np.float32 else np.int64)


def _attributes(
    mesh: Any, vertices: Float[np.ndarray, "v 3"], corners: Int[np.ndarray, " c"]
) -> dict[str, Float[np.ndarray, "v _"]]:
    """The attributes of real numbers at vertices and corners, and the shape keys."""
    attributes = {}
    for attribute in mesh.attributes:
        if attribute.data_type in _FIELDS and attribute.domain in ("POINT", "CORNER") and attribute.name != "position":
            values = _values(attribute.data, *_FIELDS[attribute.data_type])
            if attribute.domain == "CORNER":
                of_corners, values = values, np.zeros((len(vertices), values.shape[1]))
                values[corners] = of_corners
            attributes[f"attribute {attribute.name}"] = values
    for key in mesh.shape_keys.key_blocks if mesh.shape_keys else ():
        attributes[f"shape key {key.name}"] = _values(key.data, "co", 3) - vertices
    return attributes


def _weights(mesh: Any, faces: Int[np.ndarray, "t 3"]) -> dict[str, Float[np.ndarray, "v 1"]]:
    """The weights of the vertex groups at boundary edges: Blender has them for one vertex at a time only."""
    weights: dict[str, np.ndarray] = {}
    for vertex in np.unique(boundary_edges(faces)).tolist():
        for element in mesh.vertices[vertex].groups:
            name = f"{_GROUP}{element.group}"
            weights.setdefault(name, np.zeros((len(mesh.vertices), 1)))[vertex] = element.weight
    return weights
