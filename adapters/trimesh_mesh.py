"""`trimesh.Trimesh`."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.extending import grown_attributes, padded, real_attributes, repeated, triangles_of
from spinor_geom.adapters.seams import without_seams
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh

if TYPE_CHECKING:
    import trimesh


class TrimeshAdapter:
    """`trimesh.Trimesh`, with its vertex colours, texture coordinates, normals and vertex attributes.

    The attributes are called "color" (0 to 255), "uv", "normal" (where normals were given or have been computed) and
    by the names in `vertex_attributes`; one of these that clashes gets the prefix "attribute ". On a mesh with a
    texture (`TextureVisuals`) edges along which texture coordinates, normals or colours differ are seams, and closed.
    """

    name = "trimesh.Trimesh"
    types = ("trimesh.Trimesh",)

    def to_mesh(self, obj: trimesh.Trimesh) -> TriangleMesh:
        """The triangles, closed along texture seams."""
        mesh = triangles_of(np.asarray(obj.vertices), np.asarray(obj.faces), _carried(obj))
        visual: Any = obj.visual
        return without_seams(mesh) if visual.kind == "texture" else mesh

    def extend(self, obj: trimesh.Trimesh, extension: MeshExtension) -> trimesh.Trimesh:
        """A new `Trimesh` with the extension appended; material, metadata and attributes are copied.

        New faces get the face colour and the face attributes that occur most often. Attributes that are no real
        numbers get zeros or empty entries at new vertices. Normals are kept only if the extension has them, else
        trimesh computes them when they are asked for.
        """
        import trimesh

        carried = _carried(obj)
        if "normal" not in extension.vertex_attributes:
            # trimesh caches normals whenever it computes them: they may have come after to_mesh
            carried.pop("normal", None)
        grown = grown_attributes(carried, extension, vertices=len(obj.vertices))
        own = {_attribute_name(obj, name): name for name in obj.vertex_attributes}
        count = len(extension.vertices)
        return trimesh.Trimesh(
            vertices=np.concatenate([np.asarray(obj.vertices), extension.vertices]),
            faces=np.concatenate([np.asarray(obj.faces), extension.faces]),
            vertex_normals=grown.pop("normal", None),
            vertex_attributes={
                name: grown.pop(key) if key in grown else padded(obj.vertex_attributes[name], count)
                for key, name in own.items()
            },
            face_attributes={
                name: repeated(np.asarray(values), len(extension.faces)) for name, values in obj.face_attributes.items()
            },
            visual=_grown_visual(obj, grown, new_faces=len(extension.faces)),
            metadata=deepcopy(obj.metadata),
            process=False,
            validate=False,
        )


def _carried(mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
    """The real-valued attributes at the vertices under the names they have in a `TriangleMesh`."""
    carried: dict[str, Any] = dict(_visual_attributes(mesh))
    # the only place where trimesh keeps normals that were given; asking for mesh.vertex_normals would compute them
    if "vertex_normals" in mesh._cache:
        carried["normal"] = np.asarray(mesh._cache["vertex_normals"])
    carried |= {_attribute_name(mesh, name): values for name, values in mesh.vertex_attributes.items()}
    count = len(mesh.vertices)
    return {name: values for name, values in real_attributes(carried).items() if values.shape[:1] == (count,)}


def _visual_attributes(mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
    visual: Any = mesh.visual
    if visual.kind == "vertex":
        return {"color": np.asarray(visual.vertex_colors)}
    if visual.kind == "texture":
        return {name: np.asarray(values) for name, values in visual.vertex_attributes.items()}
    return {}


def _attribute_name(mesh: trimesh.Trimesh, name: str) -> str:
    taken = {"normal", "uv", "color", *_visual_attributes(mesh)}
    return f"attribute {name}" if name in taken else name


def _grown_visual(mesh: trimesh.Trimesh, grown: dict[str, np.ndarray], *, new_faces: int) -> Any:
    """A copy of the mesh's visual with the grown attributes and one entry for each new face."""
    from trimesh.visual import ColorVisuals

    old: Any = mesh.visual
    if old.kind == "vertex":
        return ColorVisuals(vertex_colors=grown["color"])
    if old.kind == "face":
        return ColorVisuals(face_colors=repeated(np.asarray(old.face_colors), new_faces))
    if old.kind != "texture":
        return None
    visual = old.copy()
    for name in old.vertex_attributes:
        if name in grown:
            visual.vertex_attributes[name] = grown[name]
    if visual.face_materials is not None:
        visual.face_materials = repeated(np.asarray(visual.face_materials), new_faces)
    return visual
