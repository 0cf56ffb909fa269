"""Checked, read-only copies of the arrays that meshes and loops hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.errors import MeshShapeError, NonFiniteVertexError


def freeze_points(points: ArrayLike, *, name: str) -> Float[np.ndarray, "n 3"]:
    """A read-only C-contiguous float64 copy of (n, 3) finite coordinates.

    Raises:
        MeshShapeError: not real numbers of shape (n, 3).
        NonFiniteVertexError: a coordinate is NaN or infinite.
    """
    copy = _real_copy(points, name=name, shape="(n, 3)")
    if copy.size == 0:
        copy = copy.reshape(0, 3)
    if copy.ndim != 2 or copy.shape[1] != 3:
        raise MeshShapeError(f"{name} must have shape (n, 3), got {copy.shape}; give one row of x, y, z a vertex")
    finite = np.isfinite(copy).all(axis=1)
    if not finite.all():
        raise NonFiniteVertexError(vertex=int(np.argmin(finite)))
    return _read_only(copy)


def freeze_faces(faces: ArrayLike) -> Int[np.ndarray, "f 3"]:
    """A read-only C-contiguous int64 copy of (f, 3) vertex indices.

    Raises:
        MeshShapeError: not integers of shape (f, 3).
    """
    copy = _integer_copy(faces, name="faces", shape="(f, 3)")
    if copy.size == 0:
        copy = copy.reshape(0, 3)
    if copy.ndim != 2 or copy.shape[1] != 3:
        raise MeshShapeError(f"faces must have shape (f, 3), got {copy.shape}; triangulate larger polygons first")
    return _read_only(copy)


def freeze_integers(values: ArrayLike, *, name: str, length: int) -> Int[np.ndarray, " n"]:
    """A read-only int64 copy of one integer an item.

    Raises:
        MeshShapeError: not `length` integers in one row.
    """
    copy = _integer_copy(values, name=name, shape=f"({length},)")
    if copy.shape != (length,):
        raise MeshShapeError(f"{name} must have shape ({length},), got {copy.shape}; give one integer an item")
    return _read_only(copy)


def freeze_pairs(values: ArrayLike, *, name: str) -> Int[np.ndarray, "k 2"]:
    """A read-only int64 copy of pairs of integers.

    Raises:
        MeshShapeError: not integers of shape (k, 2).
    """
    copy = _integer_copy(values, name=name, shape="(k, 2)")
    if copy.size == 0:
        copy = copy.reshape(0, 2)
    if copy.ndim != 2 or copy.shape[1] != 2:
        raise MeshShapeError(f"{name} must have shape (k, 2), got {copy.shape}; give one pair a row")
    return _read_only(copy)


def freeze_flags(values: ArrayLike, *, name: str, length: int) -> Bool[np.ndarray, " n"]:
    """A read-only copy of one truth value an item.

    Raises:
        MeshShapeError: not `length` truth values in one row.
    """
    copy = np.array(_as_array(values, name=name, shape=f"({length},)"))
    if copy.dtype != np.bool_ or copy.shape != (length,):
        raise MeshShapeError(
            f"{name} must be truth values of shape ({length},), got {copy.dtype} {copy.shape}; give one an item"
        )
    return _read_only(copy)


def freeze_attributes(
    attributes: Mapping[str, ArrayLike], *, vertices: int
) -> Mapping[str, Float[np.ndarray, "{vertices} _"]]:
    """Read-only float64 copies of per-vertex values, each of shape (vertices, k); one number a vertex becomes k = 1.

    Raises:
        MeshShapeError: an attribute is not numeric or has not one row a vertex.
    """
    frozen = {}
    for name, values in attributes.items():
        copy = _real_copy(values, name=f"vertex attribute {name!r}", shape=f"({vertices}, k)")
        if copy.ndim == 1:
            copy = copy[:, None]
        if copy.ndim != 2 or len(copy) != vertices:
            raise MeshShapeError(
                f"vertex attribute {name!r} must have shape ({vertices}, k), got {copy.shape}; give one row a vertex"
            )
        frozen[name] = _read_only(copy)
    return frozen


def _real_copy(values: ArrayLike, *, name: str, shape: str) -> np.ndarray:
    array = _as_array(values, name=name, shape=shape)
    if array.dtype.kind not in "fiu":
        raise MeshShapeError(f"{name} must be real numbers of shape {shape}, got dtype {array.dtype}; convert it first")
    return np.array(array, dtype=np.float64, order="C")


def _integer_copy(values: ArrayLike, *, name: str, shape: str) -> np.ndarray:
    array = _as_array(values, name=name, shape=shape)
    if array.dtype.kind not in "iu" and array.size:
        raise MeshShapeError(f"{name} must be integers of shape {shape}, got dtype {array.dtype}; convert it first")
    return np.array(array, dtype=np.int64, order="C")


def _as_array(values: ArrayLike, *, name: str, shape: str) -> np.ndarray:
    try:
        return np.asarray(values)
    except ValueError as error:
        raise MeshShapeError(f"{name} must have shape {shape}, but its rows differ; give full rows") from error


def _read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


def igl_arrays(
    vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f c"]
) -> tuple[Float[np.ndarray, "v d"], Int[np.ndarray, "f c"]]:
    """Vertices and faces as libigl takes them: contiguous, of 64 bits."""
    return np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int64)
