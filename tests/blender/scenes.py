"""Objects of Blender, and what their meshes hold as arrays. Modules that import this are skipped without `bpy`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

bpy: Any = pytest.importorskip("bpy", reason="bpy has wheels for one version of Python only")
bmesh: Any = pytest.importorskip("bmesh")

# the values of each type of attribute: their name, and how many there are
FIELDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "BOOLEAN": ("value", 1),
    "INT16_2D": ("value", 2),
    "INT32_2D": ("value", 2),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "QUATERNION": ("value", 4),
    "FLOAT4X4": ("value", 16),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color_srgb", 4),
}


def empty_file() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)


def mesh_of(vertices: np.ndarray, faces: Any) -> Any:
    mesh = bpy.data.meshes.new("mesh")
    mesh.from_pydata(np.asarray(vertices).tolist(), [], [list(map(int, face)) for face in faces])
    return mesh


def object_of(vertices: np.ndarray, faces: Any) -> Any:
    """An object in the scene, the active and only selected one."""
    made = bpy.data.objects.new("object", mesh_of(vertices, faces))
    bpy.context.collection.objects.link(made)
    for other in bpy.context.view_layer.objects:
        other.select_set(other == made)
    bpy.context.view_layer.objects.active = made
    return made


def positions(mesh: Any) -> np.ndarray:
    return np.array([vertex.co for vertex in mesh.vertices], dtype=np.float64).reshape(-1, 3)


def held(mesh: Any) -> dict[str, np.ndarray]:
    """All that a mesh holds: attributes, groups, shape keys and faces, each with its name."""
    arrays = {}
    for attribute in mesh.attributes:
        if attribute.data_type == "STRING":
            arrays[attribute.name] = np.array([item.value for item in attribute.data])
        elif "select" not in attribute.name and attribute.name != ".corner_edge":
            name, width = FIELDS[attribute.data_type]
            values = np.zeros(len(attribute.data) * width)
            attribute.data.foreach_get(name, values)
            arrays[attribute.name] = values.reshape(-1, width)
    arrays["weights"] = np.array([sum(g.weight * 9.0**g.group for g in vertex.groups) for vertex in mesh.vertices])
    for key in mesh.shape_keys.key_blocks if mesh.shape_keys else ():
        arrays[f"key {key.name}"] = np.array([point.co for point in key.data])
    arrays["sizes"] = np.array([face.loop_total for face in mesh.polygons])
    arrays["material"] = np.array([face.material_index for face in mesh.polygons])
    return arrays
