"""`trimesh.Trimesh`, and `trimesh.Scene`: all its meshes as one, in the coordinates of the scene."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.polygon_faces import closed_along_seams, without_seams
from spinor_geom.adapters.textures import Textured, pixels_of
from spinor_geom.adapters.vertex_data import (
    append_attributes,
    append_most_frequent,
    parts_of_faces,
    triangles_of,
    unit_vectors,
)
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within, require_existing_vertices

if TYPE_CHECKING:
    import trimesh


class TrimeshAdapter:
    """`trimesh.Trimesh`, with its vertex colours, texture coordinates, normals and vertex attributes.

    The attributes are called "color" (0 to 255), "uv", "normal" (if normals were given or have been computed) and by
    the names in `vertex_attributes`. One whose name clashes gets the prefix "attribute ". On a mesh with a texture
    (`TextureVisuals`) edges along which texture coordinates, normals or colours differ are seams, and closed.
    """

    name = "trimesh.Trimesh"
    types = ("trimesh.Trimesh",)

    def to_mesh(self, obj: trimesh.Trimesh) -> TriangleMesh:
        """The triangles, closed along texture seams."""
        visual: Any = obj.visual
        return without_seams(_triangles(obj)) if visual.kind == "texture" else _triangles(obj)

    def textured(self, obj: trimesh.Trimesh, largest: int) -> Textured | None:
        """The image of the material, if it has one."""
        visual: Any = obj.visual
        material = getattr(visual, "material", None)
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        if image is None or visual.uv is None:
            return None
        _, kept = closed_along_seams(_triangles(obj))
        return pixels_of(image, largest), np.asarray(visual.uv, dtype=np.float64)[np.asarray(obj.faces)[kept], :2]

    def extend(self, obj: trimesh.Trimesh, extension: MeshExtension) -> trimesh.Trimesh:
        """A new `Trimesh` with the extension appended. Material, metadata and attributes are copied.

        New faces get the most frequent face colour and face attributes. Attributes that are not real numbers get zeros
        or empty entries at new vertices. Normals are kept only if the extension has them. Otherwise trimesh computes
        them when they are read.
        """
        import trimesh

        arrays = _arrays(obj)
        if "normal" not in extension.vertex_attributes:
            # trimesh caches normals when it computes them, which may have been after to_mesh
            arrays.pop("normal", None)
        attributes = append_attributes(arrays, extension, vertices=len(obj.vertices))
        new_faces = len(extension.faces)
        return trimesh.Trimesh(
            vertices=np.concatenate([np.asarray(obj.vertices), extension.vertices]),
            faces=np.concatenate([np.asarray(obj.faces), extension.faces]),
            vertex_normals=attributes.get("normal"),
            vertex_attributes={name: attributes[_attribute_name(obj, name)] for name in obj.vertex_attributes},
            face_attributes={
                name: append_most_frequent(values, new_faces) for name, values in obj.face_attributes.items()
            },
            visual=_extended_visual(obj, attributes, new_faces),
            metadata=deepcopy(obj.metadata),
            process=False,
            validate=False,
        )

    def merged(self, obj: trimesh.Trimesh, within: Within) -> trimesh.Trimesh:
        """A new `Trimesh` with vertices merged. Material, metadata and attributes are copied."""
        kept, new_index = self.to_mesh(obj).merge_map(within)
        # before update_vertices drops them
        normals = _arrays(obj).get("normal")
        made = obj.copy()
        made.update_vertices(kept, inverse=new_index)
        if normals is not None:
            # trimesh types this property as a method
            made.vertex_normals = normals[kept]  # type: ignore[method-assign]
        return made


def _triangles(mesh: trimesh.Trimesh) -> TriangleMesh:
    """The triangles with their seams."""
    return triangles_of(np.asarray(mesh.vertices), np.asarray(mesh.faces), _arrays(mesh))


def _arrays(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """The arrays at the vertices under their names in a `TriangleMesh`."""
    arrays = _visual_arrays(mesh)
    # the only place where trimesh keeps normals that were given. Reading mesh.vertex_normals would compute them
    if "vertex_normals" in mesh._cache:
        arrays["normal"] = np.asarray(mesh._cache["vertex_normals"])
    return arrays | {_attribute_name(mesh, name): values for name, values in mesh.vertex_attributes.items()}


def _visual_arrays(mesh: trimesh.Trimesh) -> dict[str, Any]:
    visual: Any = mesh.visual
    if visual.kind == "vertex":
        return {"color": np.asarray(visual.vertex_colors)}
    return dict(visual.vertex_attributes) if visual.kind == "texture" else {}


def _attribute_name(mesh: trimesh.Trimesh, name: str) -> str:
    return f"attribute {name}" if name in {"normal", "uv", "color", *_visual_arrays(mesh)} else name


def _extended_visual(mesh: trimesh.Trimesh, attributes: dict[str, np.ndarray], new_faces: int) -> Any:
    """A copy of the mesh's visual with other attributes and one more entry for each new face."""
    from trimesh.visual import ColorVisuals

    old: Any = mesh.visual
    if old.kind == "vertex":
        return ColorVisuals(vertex_colors=attributes["color"])
    if old.kind == "face":
        return ColorVisuals(face_colors=append_most_frequent(old.face_colors, new_faces))
    if old.kind != "texture":
        return None
    visual = old.copy()
    visual.vertex_attributes.update({name: attributes[name] for name in old.vertex_attributes})
    if visual.face_materials is not None:
        visual.face_materials = append_most_frequent(visual.face_materials, new_faces)
    return visual


_MESHES = TrimeshAdapter()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """One geometry of a scene."""

    geometry: str  # its name
    mesh: TriangleMesh
    transform: Float[np.ndarray, "4 4"]  # to the scene, at the first node that uses it
    start: int  # index of its first vertex among those of all parts
    names: dict[str, str]  # of its attributes among those of all parts

    @property
    def vertices(self) -> slice:
        """The indices of its vertices among those of all parts."""
        return slice(self.start, self.start + len(self.mesh.vertices))

    def oriented(self, faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
        """Faces in the scene's orientation, or back: reversed if the transform mirrors."""
        return faces[:, ::-1] if np.linalg.det(self.transform[:3, :3]) < 0 else faces


class SceneAdapter:
    """`trimesh.Scene`: every `Trimesh` in it once, in the scene's coordinates. Points and paths are not changed.

    A geometry that several nodes use has the position of the first of them. Attributes are those of `trimesh.Trimesh`.
    If two geometries have different attributes of one name, that of the later one gets the geometry's name as a prefix.
    An attribute is 0 at vertices of geometries that do not have it.
    """

    name = "trimesh.Scene"
    types = ("trimesh.Scene",)

    def to_mesh(self, obj: trimesh.Scene) -> TriangleMesh:
        """The triangles of all geometries, one after the other."""
        parts = _parts(obj)
        total = sum(len(part.mesh.vertices) for part in parts)
        vertices = np.zeros((total, 3))
        attributes: dict[str, np.ndarray] = {}
        for part in parts:
            vertices[part.vertices] = part.mesh.vertices @ part.transform[:3, :3].T + part.transform[:3, 3]
            for name, values in part.mesh.vertex_attributes.items():
                if name == "normal":
                    values = unit_vectors(values @ np.linalg.inv(part.transform[:3, :3]))
                attributes.setdefault(part.names[name], np.zeros((total, values.shape[1])))[part.vertices] = values
        faces = [part.oriented(part.mesh.faces) + part.start for part in parts]
        labels = {part.names[name] for part in parts for name in part.mesh.labels}
        none = np.zeros((0, 3), dtype=np.int64)
        return TriangleMesh(vertices, np.concatenate([none, *faces]), vertex_attributes=attributes, labels=labels)

    def textured(self, obj: trimesh.Scene, largest: int) -> Textured | None:
        """The texture of the only mesh of a scene."""
        parts = _parts(obj)
        return _MESHES.textured(obj.geometry[parts[0].geometry], largest) if len(parts) == 1 else None

    def extend(self, obj: trimesh.Scene, extension: MeshExtension) -> trimesh.Scene:
        """A new `Scene` whose geometries are extended. Raises a MeshShapeError for faces that join two of them."""
        parts = _parts(obj)
        extended = obj.copy()
        old = sum(len(part.mesh.vertices) for part in parts)
        total = old + len(extension.vertices)
        require_existing_vertices(extension.faces, vertices=total)
        if not parts:
            return extended
        counts = parts_of_faces(extension, [part.start for part in parts], old)
        joining = counts[(counts > 0).sum(axis=1) > 1]
        if len(joining):
            joined = " and ".join(repr(parts[number].geometry) for number in np.flatnonzero(joining[0])[:2])
            raise MeshShapeError(f"new faces join the geometries {joined} of the scene; give scene.to_mesh() instead")
        owner = counts.argmax(axis=1)
        owner_of_vertex = np.zeros(total, dtype=np.int64)
        owner_of_vertex[extension.faces] = owner[:, None]
        for number, part in enumerate(parts):
            faces, own = owner == number, np.flatnonzero(owner_of_vertex[old:] == number)
            members = np.concatenate([np.arange(total)[part.vertices], old + own])
            new_index = np.zeros(total, dtype=np.int64)
            new_index[members] = np.arange(len(members))
            back = np.linalg.inv(part.transform)
            given = extension.vertex_attributes
            attributes = {name: given[key][own] for name, key in part.names.items() if key in given}
            if "normal" in attributes:
                attributes["normal"] = unit_vectors(attributes["normal"] @ part.transform[:3, :3])
            extended.geometry[part.geometry] = _MESHES.extend(
                obj.geometry[part.geometry],
                MeshExtension(
                    vertices=extension.vertices[own] @ back[:3, :3].T + back[:3, 3],
                    faces=part.oriented(new_index[extension.faces[faces]]),
                    face_loops=extension.face_loops[faces],
                    vertex_attributes=attributes,
                ),
            )
        return extended


def _parts(scene: trimesh.Scene) -> list[_Part]:
    import trimesh

    transforms: dict[object, np.ndarray] = {}
    for node in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[node]
        transforms.setdefault(geometry, np.asarray(transform, dtype=np.float64))
    parts: list[_Part] = []
    kinds: dict[str, tuple[int, bool]] = {}
    for geometry, obj in scene.geometry.items():
        if not isinstance(obj, trimesh.Trimesh):
            continue
        mesh = _MESHES.to_mesh(obj)
        names = {}
        for name, values in mesh.vertex_attributes.items():
            kind = (values.shape[1], name in mesh.labels)
            names[name] = name if kinds.setdefault(name, kind) == kind else f"{geometry} {name}"
        start = parts[-1].vertices.stop if parts else 0
        transform = transforms.get(geometry, np.eye(4))
        parts.append(_Part(geometry=geometry, mesh=mesh, transform=transform, start=start, names=names))
    return parts
