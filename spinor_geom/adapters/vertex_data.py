"""Values at the vertices and faces of meshes of any type, followed by those of an extension."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real

from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.topology import linked
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_existing_vertices


def triangles_of(vertices: np.ndarray, faces: np.ndarray, arrays: Mapping[str, Any]) -> TriangleMesh:
    """A mesh whose attributes are those arrays (V, ...) that hold real numbers or booleans."""
    attributes = {name: _columns(np.asarray(own)) for name, own in arrays.items() if _is_attribute(own, len(vertices))}
    return TriangleMesh(vertices, faces, vertex_attributes=attributes)


def as_float64(values: np.ndarray) -> np.ndarray:
    """Numbers in double precision. NaN of any kind is NaN, and no warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def append_attributes(arrays: Mapping[str, Any], extension: MeshExtension, *, vertices: int) -> dict[str, np.ndarray]:
    """Arrays (V, ...) of a mesh of `vertices` vertices, each followed by values at new vertices in its own dtype.

    The new values are the extension's attributes. Arrays that `triangles_of` leaves out get zeros or empty entries. An
    extension without new vertices needs no attributes. Raises as `Adapter.extend`.
    """
    count = len(extension.vertices)
    require_existing_vertices(extension.faces, vertices=vertices + count)
    result = {}
    for name, own in arrays.items():
        values = np.asarray(own)
        if count == 0 or not _is_attribute(values, vertices):
            result[name] = np.concatenate([values, np.zeros((count, *values.shape[1:]), dtype=values.dtype)])
            continue
        rows = attribute_rows(extension, name, _columns(values).shape[1])
        result[name] = append_rows(values, rows)
    return result


def attribute_rows(extension: MeshExtension, name: str, width: int) -> Float[np.ndarray, "k {width}"]:
    """An attribute of an extension that the mesh has `width` columns of. Raises a MeshShapeError if it has not."""
    if name not in extension.vertex_attributes:
        raise MeshShapeError(f"the extension lacks the vertex attribute {name!r} that the mesh has; give its values")
    rows = extension.vertex_attributes[name]
    if rows.shape[1] != width:
        raise MeshShapeError(
            f"vertex attribute {name!r} has {width} columns in the mesh and {rows.shape[1]} in the extension; "
            "give the same number"
        )
    return rows


def _is_attribute(values: Any, vertices: int) -> bool:
    array = np.asarray(values)
    return array.dtype.kind in "biuf" and array.shape[:1] == (vertices,)


def _columns(values: np.ndarray) -> Real[np.ndarray, "v c"]:
    """Values (V, ...) as (V, k) numbers, booleans as 0 and 1."""
    rows = values.reshape(len(values), math.prod(values.shape[1:]))
    return rows.astype(np.float64) if rows.dtype.kind == "b" else rows


def append_rows(values: np.ndarray, rows: Float[np.ndarray, "k c"]) -> np.ndarray:
    """Values (V, ...) of any real dtype followed by new rows in the same dtype and trailing shape."""
    new = cast_values(rows, values.dtype).reshape(len(rows), *values.shape[1:])
    return np.concatenate([values, new])


def cast_values(values: Real[np.ndarray, "k c"], dtype: np.dtype[Any]) -> np.ndarray:
    """Numbers in another dtype, rounded to the nearest one that it holds for integers and booleans."""
    if dtype.kind == "b":
        return values >= 0.5
    if dtype.kind not in "iu":
        return values.astype(dtype)
    limits = np.iinfo(dtype)
    # 2**63 - 1 is not a float64, and 2**63 not an int64. The bound is the largest float64 below the limit
    highest = np.nextafter(float(limits.max), 0.0) if float(limits.max) > limits.max else float(limits.max)
    return np.asarray(np.clip(np.rint(np.nan_to_num(values)), float(limits.min), highest), dtype=dtype)


def append_most_frequent(values: Any, count: int) -> np.ndarray:
    """An array of values (F, ...) at faces, followed by `count` times the most frequent one."""
    array = np.asarray(values)
    return np.concatenate([array, np.repeat(most_frequent_row(array), count, axis=0)])


def most_frequent_row(values: np.ndarray) -> np.ndarray:
    """The most frequent of (n, ...) values, (1, ...), or zeros if there are none, or if they are not real numbers."""
    if len(values) == 0 or values.dtype.kind not in "biuf":
        return np.zeros((1, *values.shape[1:]), dtype=values.dtype)
    _, first, counts = np.unique(values.reshape(len(values), -1), axis=0, return_index=True, return_counts=True)
    return values[[first[np.argmax(counts)]]]


def unit_vectors(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors of length 1 in the same directions, and zero for zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0))


def parts_of_faces(extension: MeshExtension, starts: Sequence[int], vertices: int) -> Int[np.ndarray, "t parts"]:
    """The number of vertices of each part of a mesh in the patch of each new face. Part i begins at starts[i]."""
    faces = extension.faces
    labels = linked(np.concatenate([faces[:, :2], faces[:, 1:]]), vertices + len(extension.vertices))
    patches, patch_of_face = np.unique(labels[faces[:, 0]], return_inverse=True)
    old = np.unique(faces[faces < vertices])
    counts = np.zeros((len(patches), len(starts)), dtype=np.int64)
    np.add.at(counts, (np.searchsorted(patches, labels[old]), np.searchsorted(starts, old, side="right") - 1), 1)
    return np.asarray(counts[patch_of_face], dtype=np.int64)
