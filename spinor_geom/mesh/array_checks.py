"""Checked, read-only copies of arrays."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from spinor_geom.errors import MeshShapeError, NonFiniteVertexError

_KINDS = {"real numbers": ("fiu", np.float64), "integers": ("iu", np.int64), "booleans": ("b", np.bool_)}


def frozen(
    values: ArrayLike, kind: Literal["real numbers", "integers", "booleans"], *shape: int | None, name: str
) -> np.ndarray:
    """A read-only C-contiguous copy of an array, as float64, int64 or bool. Raises a MeshShapeError if that fails.

    None in `shape` allows any length. With None as first length an empty array of any shape is accepted, with None as
    second length a one-dimensional array becomes one column. Integers are accepted as real numbers.
    """
    kinds, dtype = _KINDS[kind]

    def wanted() -> str:
        lengths = ", ".join("n" if length is None else str(length) for length in shape)
        return f"{name} must be {kind} of shape ({lengths})"

    try:
        array = np.asarray(values)
    except ValueError as error:
        raise MeshShapeError(f"{wanted()}, but its rows have different lengths; give equal ones") from error
    if array.dtype.kind not in kinds and array.size:
        raise MeshShapeError(f"{wanted()}, got dtype {array.dtype}; convert it first")
    with np.errstate(invalid="ignore"):  # NaN of any kind is NaN
        copy: np.ndarray = np.array(array, dtype=dtype, order="C")
    if copy.ndim == 1 and shape[1:] == (None,):
        copy = copy[:, None]
    if copy.size == 0 and shape[0] is None:
        copy = copy.reshape([length or 0 for length in shape])
    if copy.ndim != len(shape) or any(b not in (a, None) for a, b in zip(copy.shape, shape, strict=True)):
        raise MeshShapeError(f"{wanted()}, got {copy.shape}; reshape or convert it")
    return shared(copy)


def shared(array: np.ndarray) -> np.ndarray:
    """The same array, made read-only so that it can be shared."""
    array.setflags(write=False)
    return array


def freeze_points(points: ArrayLike, *, name: str) -> Float[np.ndarray, "n 3"]:
    """A read-only float64 copy of (n, 3) coordinates. Raises a MeshShapeError or a NonFiniteVertexError."""
    copy = frozen(points, "real numbers", None, 3, name=name)
    finite = np.isfinite(copy).all(axis=1)
    if not finite.all():
        raise NonFiniteVertexError(vertex=int(np.argmin(finite)))
    return copy


def nonfinite_rows(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " k"]:
    """The indices of the points with a coordinate that is NaN or infinite."""
    return np.flatnonzero(~np.isfinite(points).all(axis=1))


def with_finite_rows(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "*any"]) -> Float[np.ndarray, "n 3"]:
    """The same points, but those that are NaN or infinite, which no face uses, at the position of one that is used."""
    wrong = nonfinite_rows(points)
    if not len(wrong):
        return points
    changed = np.array(points)
    changed[wrong] = points[faces.ravel()[0]] if faces.size else 0.0
    return changed


def freeze_attributes(
    attributes: Mapping[str, ArrayLike], *, vertices: int
) -> Mapping[str, Float[np.ndarray, "{vertices} _"]]:
    """Read-only float64 copies of per-vertex values, each (vertices, k). One number per vertex gives k = 1."""
    return {
        name: frozen(values, "real numbers", vertices, None, name=f"vertex attribute {name!r}")
        for name, values in attributes.items()
    }


def igl_arrays(
    vertices: Float[np.ndarray, "v d"], faces: Int[np.ndarray, "f c"]
) -> tuple[Float[np.ndarray, "v d"], Int[np.ndarray, "f c"]]:
    """Vertices and faces as contiguous float64 and int64 arrays, which libigl requires."""
    return np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int64)
