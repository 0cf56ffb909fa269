"""Wavefront OBJ: reading to position indices, and appending to a file without touching what it says.

What is read and what is not: see `obj_stream`. Lines that are not read stay in the file.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import FileContents
from spinor_geom.adapters.obj_stream import ObjText, read_obj_stream
from spinor_geom.mesh.triangle_mesh import MeshExtension

GROUP = "spinor_geom_fill"


def added_lines(text: ObjText, extension: MeshExtension) -> bytes:
    """What to write after the last byte of a file: `v` lines (with colours, if the file's have them), a group of faces.

    Texture coordinates and normals are added where the file gives each vertex one.
    """
    if len(extension.vertices) == 0 and len(extension.faces) == 0:
        return b""
    colors = [extension.vertex_attributes["color"]] if "color" in text.contents.attributes else []
    newline = text.newline.decode("ascii")
    lines = [_number_lines("v", np.hstack([extension.vertices, *colors]), newline)]
    corners = [extension.faces.ravel() + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in text.corner_indices:
            lines.append(_number_lines(keyword, extension.vertex_attributes[name], newline))
            first = text.counts[name]
            all_indices = np.concatenate([text.corner_indices[name], np.arange(first, first + len(extension.vertices))])
            # a vertex in no face has none: any valid number will do
            corners.append(np.maximum(all_indices[extension.faces.ravel()], 0) + 1)
    lines.append(f"g {GROUP}{newline}")
    sizes = np.full(len(extension.faces), 3)
    lines.append(_face_lines(corners, sizes, newline, skip_uv="uv" not in text.corner_indices))
    return text.ending + "".join(lines).encode("ascii")


def read_obj(data: bytes, path: Path | None) -> FileContents:
    """What `read_obj_stream` reads of an OBJ file, with its text as the source to append to."""
    text = read_obj_stream(io.BytesIO(data), path)
    return replace(text.contents, suffix=".obj", appended=partial(_appended, data, text))


def _appended(data: bytes, text: ObjText, extension: MeshExtension) -> bytes:
    return data + added_lines(text, extension)


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    colors = [contents.attributes["color"] / contents.color_scale] if "color" in contents.attributes else []
    lines = [_number_lines("v", np.hstack([contents.vertices, *colors]))]
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
    line = f"{keyword}{' %r' * rows.shape[1]}{newline}"
    return line * len(rows) % tuple(rows.ravel().tolist())


def _face_lines(
    corners: Sequence[Int[np.ndarray, " n"]], sizes: Int[np.ndarray, " f"], newline: str = "\n", *, skip_uv: bool
) -> str:
    """Faces by the numbers at all their corners: of positions, texture (or a gap) and normals."""
    word = " " + ("//" if skip_uv else "/").join(["%d"] * len(corners))
    of_size = {size: f"f{word * size}{newline}" for size in np.unique(sizes).tolist()}
    return "".join(map(of_size.__getitem__, sizes.tolist())) % tuple(np.stack(corners, axis=1).ravel().tolist())
