"""What a mesh file holds, whatever its format, and what formats and mesh types share to read it and to append to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Int, Real

from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.errors import MeshFileError, MeshShapeError
from spinor_geom.mesh.topology import linked
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_existing_vertices

BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # what some editors put before UTF-8 text
LONGEST_PROBLEM = 240  # letters
Value = TypeVar("Value")
METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""The units of 3MF files, in metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FileContents:
    """What a mesh file holds."""

    vertices: Float[np.ndarray, "v 3"]  # in the file's order
    polygons: Polygons  # the faces as the file has them, over the file's own vertices
    # "color" in the file's own scale, "normal", "uv" (origin at the lower left), others by their names in the file
    attributes: Mapping[str, Float[np.ndarray, "v _"]] = field(default_factory=dict)
    labels: frozenset[str] = frozenset()  # names of the attributes whose values name classes
    color_scale: float = 1.0  # what full intensity is in "color": 1, 255 or 65535
    # the vertex that stands for the place of each: itself, and another at texture and normal seams only
    representatives: Int[np.ndarray, " v"]
    # the place of the loop whose patch each polygon belongs to, −1 for those that were read; None where none was added
    face_loops: Int[np.ndarray, " p"] | None = None
    # curves beside faces, of vertex indices; a closed one repeats its first
    polylines: tuple[Int[np.ndarray, " _"], ...] = ()
    unit: str = ""  # of lengths, one of `METRES`, where the format says it
    first_nonfinite: str = ""  # where the first vertex stands that is NaN or infinite, as "line 12"; may be empty
    is_text_stl: bool = False  # whether it is to be a text STL file again, with all digits
    notes: tuple[str, ...] = ()  # what was changed on the way from the file, a sentence each
    suffix: str = ""  # the format of the file that the contents follow, as ".obj"; "" where they follow none
    # gives that file with new elements after those that were in it, which stay as they are
    appended: Callable[[MeshExtension], bytes] | None = None

    @property
    def loop_of_faces(self) -> Int[np.ndarray, " p"]:
        """The place of each polygon's loop, −1 for those that were read."""
        return np.full(len(self.polygons), -1) if self.face_loops is None else self.face_loops

    @classmethod
    def without_faces(cls, vertices: np.ndarray, *polylines: np.ndarray) -> FileContents:
        """Points and curves alone."""
        none = Polygons.of_triangles(np.zeros((0, 3), dtype=np.int64))
        return cls(vertices=vertices, polygons=none, representatives=np.arange(len(vertices)), polylines=polylines)


def malformed(place: str, problem: str, advice: str) -> MeshFileError:
    """The error for a file that cannot be read: at which place, as "line 12", what is wrong, and what to do."""
    if len(problem) > LONGEST_PROBLEM:
        problem = f"{problem[: LONGEST_PROBLEM // 2]} ... {problem[-LONGEST_PROBLEM // 2 :]}"
    return MeshFileError(f"{place}{': ' if place else ''}{problem}; {advice}", place=place)


def real(word: bytes) -> float:
    """A number in a text file; a ValueError if it is none, or has underscores in it, which are Python's only."""
    if b"_" in word:
        raise ValueError(word)
    return float(word)


def integer(word: bytes) -> int:
    """An integer of 64 bits in a text file; a ValueError as of `real`."""
    value = int(word)
    if b"_" in word or not -(2**63) <= value < 2**63:
        raise ValueError(word)
    return value


def nonfinite_rows(vertices: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, " n"]:
    """The numbers of the vertices that are NaN or infinite, ascending."""
    return np.flatnonzero(~np.isfinite(vertices).all(axis=1))


def text_rows(*tables: Real[np.ndarray, "n _"]) -> list[str]:
    """Tables side by side as text, a line for each row, from which the very same numbers are read."""
    columns = [list(map(repr, column.tolist())) for table in tables for column in table.T]
    return list(map(" ".join, zip(*columns, strict=True)))


def color_scale_of(values: np.ndarray) -> float:
    """What full intensity is in colours given as real numbers: 1, or 255 if one of them is larger than 1."""
    return 255.0 if values.max(initial=0.0) > 1.0 else 1.0


def converted(
    words: Sequence[bytes], convert: Callable[[bytes], Value], error: Callable[[int, str], MeshFileError]
) -> list[Value]:
    """Words as `convert` understands them; where it does not, `error` makes an exception of number and word."""
    try:
        return list(map(convert, words))
    except ValueError:
        number, word = next(entry for entry in enumerate(words) if not is_readable(entry[1], convert))
        raise error(number, word.decode("utf-8", "replace")) from None


def is_readable(text: Value, convert: Callable[[Value], object]) -> bool:
    """Whether `convert` understands a word or a line."""
    try:
        convert(text)
    except (ValueError, OverflowError):
        return False
    return True


def single_precision(values: np.ndarray) -> np.ndarray:
    """Finite numbers rounded to float32, for formats that hold no others; a MeshFileError if one is too large."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest > float(np.finfo(np.float32).max):
        raise MeshFileError(
            f"a number of size {largest:.3g} is too large for the 32-bit numbers of this format; "
            "write .obj, .ply or .off, or scale the mesh"
        )
    return values.astype(np.float32)


def unit_vectors(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors of length 1 in the same directions; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0))


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
    np.add.at(votes, (np.searchsorted(patches, labels[old]), np.searchsorted(starts, old, side="right") - 1), 1)
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
