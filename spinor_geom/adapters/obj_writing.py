"""Wavefront OBJ: lines of new elements, for new files and at the end of files that were read."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePosixPath
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import FileContents, nearest_rows
from spinor_geom.adapters.textures import Texture
from spinor_geom.mesh.triangle_mesh import MeshExtension

NEWLINE = b"\n"
GROUP, MATERIAL = "spinor_geom_fill", "textured"
OWN_GROUP = re.compile(rf"(?:^|/){GROUP}_([0-9]{{1,9}})$")
USE_LINE = re.compile(rb"^[ \t]*(usemtl[ \t][^\n]*)$", re.MULTILINE)


def appended_obj(
    data: bytes,
    ending: str,
    newline: str,
    has_colors: bool,
    corner_indices: Mapping[str, tuple[Int[np.ndarray, " v"], int]],
    of_new_faces: Callable[[MeshExtension], tuple[Int[np.ndarray, " n"], dict[int, str]]] | None,
    extension: MeshExtension,
) -> bytes:
    """The file with new vertices, with the attributes that it has, and new faces after its last byte.

    `corner_indices` has "uv" and "normal" where the file has one for each vertex: its index, −1 for a vertex in no
    face, and the number of all. `of_new_faces` is `textures_of_new_faces` where a vertex has several
    texture coordinates.
    """
    if len(extension.vertices) == 0 and len(extension.faces) == 0:
        return data
    colors = [extension.vertex_attributes["color"]] if has_colors else []
    lines = [_number_lines("v", np.hstack([extension.vertices, *colors]), newline)]
    corners = [extension.faces.ravel() + 1]
    heads: dict[int, str] = {}
    if of_new_faces is not None:
        own_uv, heads = of_new_faces(extension)
        corners.append(np.repeat(own_uv, 3) + 1)
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in corner_indices:
            own, first = corner_indices[name]
            lines.append(_number_lines(keyword, extension.vertex_attributes[name], newline))
            indices = np.concatenate([own, np.arange(first, first + len(extension.vertices))])
            # a vertex in no face has no index. Any valid number can be written
            corners.append(np.maximum(indices[extension.faces.ravel()], 0) + 1)
    sizes, has_uv = np.full(len(extension.faces), 3), "uv" in corner_indices or of_new_faces is not None
    lines.append(_face_lines(corners, sizes, extension.face_loops, newline, has_uv=has_uv, heads=heads))
    return data + (ending + "".join(lines)).encode("utf-8", "surrogateescape")


def textures_of_new_faces(
    data: bytes, faces: Sequence[np.ndarray], vertices: Float[np.ndarray, "v 3"], extension: MeshExtension
) -> tuple[Int[np.ndarray, " n"], dict[int, str]]:
    """The texture index of each new face, and `usemtl` lines, by the new faces that they come before.

    Both are those of the nearest old corner. `faces` has the corners, sizes and lines of the old faces.
    """
    corners, sizes, lines, _ = faces
    parts = USE_LINE.split(data.replace(b"\r\n", NEWLINE).replace(b"\r", NEWLINE))
    uses = ["", *(line.decode("utf-8", "surrogateescape") for line in parts[1::2])]
    used_from = np.cumsum([part.count(NEWLINE) for part in parts[:-1:2]], dtype=np.int64) + 1
    used = np.repeat(np.searchsorted(used_from, lines), sizes)
    rows = np.stack([corners[:, 1], used], axis=1)
    own = nearest_rows(rows, corners[:, 0], np.concatenate([vertices, extension.vertices]), extension.faces)
    changes = np.flatnonzero(np.diff(own[:, 1], prepend=len(uses) - 1))
    return own[:, 0], {first: uses[own[first, 1]] for first in changes.tolist() if own[first, 1]}


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    colors = [contents.attributes["color"] / contents.color_scale] if "color" in contents.attributes else []
    texture = contents.appearance and contents.appearance.texture
    head = f"mtllib {PurePosixPath(texture.name).with_suffix('.mtl')}\nusemtl {MATERIAL}\n" if texture else ""
    lines = [head, _number_lines("v", np.hstack([contents.vertices, *colors]))]
    corners = [contents.representatives[contents.polygons.corners] + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in contents.attributes:
            lines.append(_number_lines(keyword, contents.attributes[name]))
            corners.append(contents.polygons.corners + 1)
    sizes, has_uv = contents.polygons.sizes, "uv" in contents.attributes
    lines.append(_face_lines(corners, sizes, contents.loop_of_faces, has_uv=has_uv))
    lines += ["l " + " ".join(map(str, (curve + 1).tolist())) + "\n" for curve in contents.polylines]
    return "".join(lines).encode()


def material_library(texture: Texture) -> bytes:
    """A material library with one material that has a texture."""
    return f"newmtl {MATERIAL}\nKd 1 1 1\nmap_Kd {texture.name}\n".encode()


def _number_lines(keyword: str, rows: Float[np.ndarray, "n k"], newline: str = "\n") -> str:
    """A line for each row, with all digits of its float64 values."""
    line = f"{keyword}{' %r' * rows.shape[1]}{newline}"
    return line * len(rows) % tuple(rows.ravel().tolist())


def _face_lines(
    corners: Sequence[Int[np.ndarray, " n"]],
    sizes: Int[np.ndarray, " f"],
    loops: Int[np.ndarray, " f"],
    newline: str = "\n",
    *,
    has_uv: bool,
    heads: Mapping[int, str] = MappingProxyType({}),
) -> str:
    """Faces by the indices at all their corners (position, texture, normal). Each patch is a group.

    `heads` has lines that come before some of the faces.
    """
    word = " " + ("/" if has_uv else "//").join(["%d"] * len(corners))
    of_size = {size: f"f{word * size}{newline}" for size in np.unique(sizes).tolist()}
    lines = [of_size[size] for size in sizes.tolist()]
    for face, head in heads.items():
        lines[face] = f"{head.replace('%', '%%')}{newline}{lines[face]}"
    for first in np.flatnonzero(np.diff(loops, prepend=-1)):
        lines[first] = f"g {GROUP}_{loops[first]}{newline}{lines[first]}"
    return "".join(lines) % tuple(np.stack(corners, axis=1).ravel().tolist())
