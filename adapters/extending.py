"""Checks and conversions that every adapter needs to append an extension."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real

from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.topology import linked
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_existing_vertices


def grown_attributes(
    carried: Mapping[str, np.ndarray], extension: MeshExtension, *, vertices: int
) -> dict[str, np.ndarray]:
    """The attributes (V, ...) of a mesh of `vertices` vertices, followed by an extension's in their own dtypes.

    Raises what `Adapter.extend` says; an extension without new vertices needs no attributes.
    """
    require_existing_vertices(extension.faces, vertices=vertices + len(extension.vertices))
    result = {}
    for name, values in carried.items():
        width = columns(values).shape[1]
        rows = extension.vertex_attributes.get(name) if len(extension.vertices) else np.zeros((0, width))
        if rows is None:
            raise MeshShapeError(
                f"the extension lacks the vertex attribute {name!r} that the mesh has; give its values"
            )
        if rows.shape[1] != width:
            raise MeshShapeError(
                f"vertex attribute {name!r} has {width} numbers a vertex in the mesh and {rows.shape[1]} in the "
                "extension; give the same number"
            )
        result[name] = grown(values, rows)
    return result


def parts_of_faces(extension: MeshExtension, starts: Sequence[int], vertices: int) -> Int[np.ndarray, "t parts"]:
    """How many vertices of each part of a mesh, part i from starts[i] on, the patch of each new face hangs on."""
    faces = extension.faces
    labels = linked(np.concatenate([faces[:, :2], faces[:, 1:]]), vertices + len(extension.vertices))
    patches, patch_of_face = np.unique(labels[faces[:, 0]], return_inverse=True)
    old = np.unique(faces[faces < vertices])
    votes = np.zeros((len(patches), len(starts)), dtype=np.int64)
    part = np.searchsorted(starts, old, side="right") - 1
    np.add.at(votes, (np.searchsorted(patches, labels[old]), part), 1)
    return np.asarray(votes[patch_of_face], dtype=np.int64)


def cast_values(values: Real[np.ndarray, "k c"], dtype: np.dtype[Any]) -> np.ndarray:
    """Numbers in another dtype; for integers and truth values rounded to the nearest one that the dtype holds."""
    if dtype.kind == "b":
        return values >= 0.5
    if dtype.kind not in "iu":
        return values.astype(dtype)
    limits = np.iinfo(dtype)
    # 2**63 - 1 is no float64, and its neighbour 2**63 no int64: the largest float64 below the limit bounds instead
    highest = np.nextafter(float(limits.max), 0.0) if float(limits.max) > limits.max else float(limits.max)
    return np.asarray(np.clip(np.rint(np.nan_to_num(values)), float(limits.min), highest), dtype=dtype)


def grown(values: np.ndarray, rows: Float[np.ndarray, "k c"]) -> np.ndarray:
    """An attribute (V, ...) of any real dtype followed by new rows in its own dtype and trailing shape."""
    new = cast_values(rows, values.dtype).reshape(len(rows), *values.shape[1:])
    return np.concatenate([values, new])


def most_frequent_row(values: np.ndarray) -> np.ndarray:
    """The row that occurs most often among (n, ...) values, (1, ...); zeros for what cannot be compared, or no rows."""
    if len(values) == 0 or values.dtype.kind not in "biuf":
        return np.zeros((1, *values.shape[1:]), dtype=values.dtype)
    _, first, counts = np.unique(values.reshape(len(values), -1), axis=0, return_index=True, return_counts=True)
    return values[[first[np.argmax(counts)]]]


def columns(values: np.ndarray) -> Real[np.ndarray, "v c"]:
    """An attribute (V, ...) of any real dtype as (V, k) numbers, truth values as 0 and 1."""
    rows = values.reshape(len(values), math.prod(values.shape[1:]))
    return rows.astype(np.float64) if rows.dtype.kind == "b" else rows


def repeated(values: np.ndarray, count: int) -> np.ndarray:
    """Values (F, ...) at faces, followed by `count` times the one that occurs most often."""
    return np.concatenate([values, np.repeat(most_frequent_row(values), count, axis=0)])


def real_attributes(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Those of some arrays that hold real numbers or truth values."""
    found = {name: np.asarray(values) for name, values in arrays.items()}
    return {name: values for name, values in found.items() if values.dtype.kind in "biuf"}


def triangles_of(vertices: np.ndarray, faces: np.ndarray, carried: Mapping[str, np.ndarray]) -> TriangleMesh:
    """A mesh with attributes (V, ...) of any real dtype."""
    return TriangleMesh(vertices, faces, vertex_attributes={name: columns(own) for name, own in carried.items()})


def padded(values: Any, count: int) -> np.ndarray:
    """Values (V, ...) of any dtype, followed by `count` rows of zeros or empty entries."""
    array = np.asarray(values)
    return np.concatenate([array, np.zeros((count, *array.shape[1:]), dtype=array.dtype)])
