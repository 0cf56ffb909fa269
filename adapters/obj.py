"""Wavefront OBJ: reading to position indices, and appending to a file without touching what it says.

What is read and what is not: see `obj_stream`. Lines that are not read stay in the file.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import Addition, FileContents
from spinor_geom.adapters.obj_stream import ObjText, read_obj_stream

GROUP = "spinor_geom_fill"


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjSource:
    """An OBJ file as it was read.

    Attributes:
        data: the file's bytes.
        text: what is in it.
    """

    data: bytes
    text: ObjText
    suffix: str = ".obj"

    def appended(self, addition: Addition) -> bytes:
        """The file's own bytes, then the lines of the addition."""
        return self.data + added_lines(self.text, addition)


def added_lines(text: ObjText, addition: Addition) -> bytes:
    """What to write after the last byte of a file: `v` lines (with colours, if the file's have them), a group of faces.

    Texture coordinates and normals are added where the file gives each vertex one.
    """
    if len(addition.vertices) == 0 and len(addition.faces) == 0:
        return b""
    columns = [addition.vertices]
    if text.color_width:
        columns.append(addition.attributes["color"])
    newline = text.newline.decode("ascii")
    lines = [_number_lines("v", np.hstack(columns), newline)]
    corners = [addition.faces.ravel() + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in text.corner_indices:
            lines.append(_number_lines(keyword, addition.attributes[name], newline))
            first = text.counts[name]
            all_indices = np.concatenate([text.corner_indices[name], np.arange(first, first + len(addition.vertices))])
            # a vertex in no face has none: any valid number will do
            corners.append(np.maximum(all_indices[addition.faces.ravel()], 0) + 1)
    lines.append(f"g {GROUP}{newline}")
    sizes = np.full(len(addition.faces), 3)
    lines.append(_face_lines(corners, sizes, newline, skip_uv="uv" not in text.corner_indices))
    return text.ending + "".join(lines).encode("ascii")


def read_obj(data: bytes, path: Path | None) -> FileContents:
    """The vertices, faces and curves of an OBJ file, as `read_obj_stream` reads them, with its text as their source.

    Raises:
        MeshFileError: not text, no vertices, or a line that cannot be understood; names the line.
    """
    text = read_obj_stream(io.BytesIO(data), path)
    return replace(text.contents, source=ObjSource(data=data, text=text))


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    columns = [contents.vertices]
    if "color" in contents.attributes:
        columns.append(contents.attributes["color"] / contents.color_scale)
    lines = [_number_lines("v", np.hstack(columns))]
    corners = [contents.representatives[contents.polygons.corners] + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in contents.attributes:
            lines.append(_number_lines(keyword, contents.attributes[name]))
            corners.append(contents.polygons.corners + 1)
    lines.append(_face_lines(corners, contents.polygons.sizes, skip_uv="uv" not in contents.attributes))
    lines += ["l " + " ".join(map(str, (curve + 1).tolist())) + "\n" for curve in contents.polylines]
    return "".join(lines).encode("ascii")


def _number_lines(keyword: str, rows: Float[np.ndarray, "n k"], newline: str = "\n") -> str:
    """A line for each row, of numbers from which the very same float64 values are read."""
    return (keyword + " %r" * rows.shape[1] + newline) * len(rows) % tuple(rows.ravel().tolist())


def _face_lines(
    corners: Sequence[Int[np.ndarray, " n"]], sizes: Int[np.ndarray, " f"], newline: str = "\n", *, skip_uv: bool
) -> str:
    """Faces by the numbers at their corners: of positions, and of texture and normals with a gap where one is missing.

    Args:
        corners: those numbers at the corners of all faces, one face after the other.
        sizes: numbers of corners of the faces.
        newline: ends each line.
        skip_uv: whether there is no texture.
    """
    word = " " + ("//" if skip_uv else "/").join(["%d"] * len(corners))
    of_size = {size: f"f{word * size}{newline}" for size in np.unique(sizes).tolist()}
    return "".join(map(of_size.__getitem__, sizes.tolist())) % tuple(np.stack(corners, axis=1).ravel().tolist())
