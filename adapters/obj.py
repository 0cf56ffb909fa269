"""Wavefront OBJ: reading to position indices, and appending to a file without touching what it says.

What is read and what is not: see `obj_stream`. Lines that are not read stay in the file.
"""

from __future__ import annotations

import io
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Int

from spinor_geom.adapters.contents import FileContents, Source, text_rows
from spinor_geom.adapters.obj_stream import ObjText, read_obj_stream
from spinor_geom.mesh.extension import MeshExtension

GROUP = "spinor_geom_fill"


def added_lines(text: ObjText, extension: MeshExtension) -> bytes:
    """What to write after the last byte of a file: `v` lines (with colours, if the file's have them), a group of faces.

    Texture coordinates and normals are added where the file gives each vertex one.
    """
    if len(extension.vertices) == 0 and len(extension.faces) == 0:
        return b""
    colors = [extension.vertex_attributes["color"]] if "color" in text.contents.attributes else []
    lines = [f"v {row}" for row in text_rows(extension.vertices, *colors)]
    corners = [extension.faces + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in text.corner_indices:
            lines += [f"{keyword} {row}" for row in text_rows(extension.vertex_attributes[name])]
            first = text.counts[name]
            all_indices = np.concatenate([text.corner_indices[name], np.arange(first, first + len(extension.vertices))])
            # a vertex in no face has none: any valid number will do
            corners.append(np.maximum(all_indices[extension.faces], 0) + 1)
    lines.append(f"g {GROUP}")
    lines += _face_lines(np.stack(corners, axis=2), skip_uv="uv" not in text.corner_indices)
    return text.ending + text.newline.join(line.encode("ascii") for line in lines) + text.newline


def read_obj(data: bytes, path: Path | None) -> FileContents:
    """The vertices, faces and curves of an OBJ file, as `read_obj_stream` reads them, with its text as their source.

    Raises:
        MeshFileError: not text, no vertices, or a line that cannot be understood; names the line.
    """
    text = read_obj_stream(io.BytesIO(data), path)
    return replace(text.contents, source=Source(".obj", partial(_appended, data, text)))


def _appended(data: bytes, text: ObjText, extension: MeshExtension) -> bytes:
    return data + added_lines(text, extension)


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    colors = [contents.attributes["color"] / contents.color_scale] if "color" in contents.attributes else []
    lines = [f"v {row}" for row in text_rows(contents.vertices, *colors)]
    corners = [contents.representatives[contents.polygons.corners] + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in contents.attributes:
            lines += [f"{keyword} {row}" for row in text_rows(contents.attributes[name])]
            corners.append(contents.polygons.corners + 1)
    tokens = _corner_tokens(np.stack(corners, axis=1), skip_uv="uv" not in contents.attributes)
    starts = contents.polygons.starts.tolist()
    lines += ["f " + " ".join(tokens[a:b]) for a, b in pairwise(starts)]
    lines += ["l " + " ".join(map(str, (curve + 1).tolist())) for curve in contents.polylines]
    return ("\n".join(lines) + "\n").encode("ascii")


def _corner_tokens(corners: Int[np.ndarray, "n c"], *, skip_uv: bool) -> list[str]:
    """Corners as words: one index, or indices of position, texture and normal with a gap where there is no texture."""
    columns = [list(map(str, column)) for column in corners.T.tolist()]
    if len(columns) == 1:
        return columns[0]
    return list(map(("//" if skip_uv else "/").join, zip(*columns, strict=True)))


def _face_lines(corners: Int[np.ndarray, "t 3 c"], *, skip_uv: bool) -> list[str]:
    tokens = _corner_tokens(corners.reshape(-1, corners.shape[2]), skip_uv=skip_uv)
    return [f"f {a} {b} {c}" for a, b, c in zip(tokens[::3], tokens[1::3], tokens[2::3], strict=True)]
