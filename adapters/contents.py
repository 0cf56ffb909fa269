"""What a mesh file holds, whatever its format, and how its formats give back the original with something appended."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.polygons import Polygons
from spinor_geom.errors import MeshFileError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # what some editors put before UTF-8 text
LONGEST_PROBLEM = 240  # letters


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """What is appended to a file: new vertices, and triangles over old and new ones.

    Attributes:
        first: the number of vertices of the file as it was read, and so the index of the first new one.
        vertices: (K, 3) positions of the new vertices.
        faces: (T, 3) vertex indices.
        attributes: (K, k) values at the new vertices by name.
    """

    first: int
    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "t 3"]
    attributes: Mapping[str, Float[np.ndarray, "k _"]]


@runtime_checkable
class Source(Protocol):
    """A file as it was read, able to give back its own bytes with something appended."""

    @property
    def suffix(self) -> str:
        """The format, as ".obj"."""
        ...

    def appended(self, addition: Addition) -> bytes:
        """The file with the addition: everything that was in it, unchanged, and the new elements after it."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class FileContents:
    """What a mesh file holds.

    Attributes:
        vertices: (V, 3) float64 positions, in the file's order.
        polygons: the faces as the file has them, over the file's own vertices.
        attributes: (V, k) float64 per-vertex values: "color" in the file's own scale, "normal", "uv" (origin at the
            lower left), and others by their names in the file.
        labels: names of the attributes whose values name classes.
        color_scale: what full intensity is in "color": 1, 255 or 65535.
        representatives: (V,) int64, the vertex that stands for the place of each; differs from the vertex itself at
            texture and normal seams only.
        polylines: curves that the file holds beside faces, each (k,) vertex indices; a closed one repeats its first.
        first_nonfinite: where in the file the first vertex stands that is NaN or infinite, as "line 12"; may be empty.
        is_text_stl: whether this was read from a text STL file, and so is written as one again, with all digits.
        notes: what was changed on the way from the file, a sentence each.
        source: the file as it was read, or None where the contents no longer follow it.
    """

    vertices: Float[np.ndarray, "v 3"]
    polygons: Polygons
    attributes: Mapping[str, Float[np.ndarray, "v _"]] = field(default_factory=dict)
    labels: frozenset[str] = frozenset()
    color_scale: float = 1.0
    representatives: Int[np.ndarray, " v"]
    polylines: tuple[Int[np.ndarray, " _"], ...] = ()
    first_nonfinite: str = ""
    is_text_stl: bool = False
    notes: tuple[str, ...] = ()
    source: Source | None = None


def malformed(path: Path | None, place: str, problem: str, advice: str) -> MeshFileError:
    """The error for a file that cannot be read.

    Args:
        path: the file.
        place: where in the file, as "line 12"; may be empty.
        problem: what is wrong there; cut where it quotes too much of the file.
        advice: what to do.
    """
    where = ", ".join(part for part in (str(path) if path else "", place) if part)
    if len(problem) > LONGEST_PROBLEM:
        problem = f"{problem[: LONGEST_PROBLEM // 2]} ... {problem[-LONGEST_PROBLEM // 2 :]}"
    return MeshFileError(f"{where}: {problem}; {advice}", path=path, place=place)


def real(word: bytes) -> float:
    """A number in a text file.

    Raises:
        ValueError: it is none, or has underscores in it, which are Python's only.
    """
    if b"_" in word:
        raise ValueError(word)
    return float(word)


def integer(word: bytes) -> int:
    """An integer of 64 bits in a text file.

    Raises:
        ValueError: it is none, or has underscores in it, which are Python's only.
    """
    value = int(word)
    if b"_" in word or not -(2**63) <= value < 2**63:
        raise ValueError(word)
    return value


def nonfinite_rows(vertices: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, " n"]:
    """The numbers of the vertices that are NaN or infinite, ascending."""
    return np.flatnonzero(~np.isfinite(vertices).all(axis=1))


def numbers(row: Float[np.ndarray, " k"] | list[float]) -> str:
    """Numbers as text from which the very same float64 values are read."""
    return " ".join(map(repr, row.tolist() if isinstance(row, np.ndarray) else row))


def color_scale_of(values: np.ndarray) -> float:
    """What full intensity is in colours given as real numbers: 1, or 255 if one of them is larger than 1."""
    return 255.0 if values.max(initial=0.0) > 1.0 else 1.0


def first_unreadable(rows: Iterable[Iterable[bytes]], convert: Callable[[bytes], object]) -> tuple[int, str]:
    """The number of the first row with a word that cannot be converted, and that word."""
    number, word = next(
        (number, word) for number, row in enumerate(rows) for word in row if not _is_readable(word, convert)
    )
    return number, word.decode("utf-8", "replace")


def _is_readable(word: bytes, convert: Callable[[bytes], object]) -> bool:
    try:
        convert(word)
    except ValueError:
        return False
    return True


def single_precision(values: np.ndarray) -> np.ndarray:
    """Finite numbers rounded to float32, for formats that hold no others.

    Raises:
        MeshFileError: a number is too large.
    """
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
