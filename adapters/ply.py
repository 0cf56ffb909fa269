"""PLY: text and binary, with every per-vertex property, polygons, and whatever else a file holds."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.contents import FileContents, color_scale_of, malformed, nonfinite_rows
from spinor_geom.adapters.extending import most_frequent_row
from spinor_geom.adapters.ply_records import (
    TYPES,
    PlyElement,
    PlyProperty,
    PlyRecords,
    binary_records,
    line_of_record,
    read_records,
)
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives
from spinor_geom.mesh.extension import MeshExtension

# attributes that several properties make up, by the names that programs give these
GROUPS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "color": (("red", "green", "blue", "alpha"), ("red", "green", "blue"), ("r", "g", "b")),
    "normal": (("nx", "ny", "nz"),),
    "uv": (("s", "t"), ("u", "v"), ("texture_u", "texture_v")),
}
FACE_LISTS = ("vertex_indices", "vertex_index")


def read_ply(data: bytes, path: Path | None) -> FileContents:
    """The vertices, per-vertex properties and faces of a PLY file.

    Colours, normals and texture coordinates become "color", "normal" and "uv"; every other scalar property of the
    vertices becomes an attribute under its own name. Positions whose vertices differ in texture coordinates or normals
    are seams.

    Raises:
        MeshFileError: a malformed header, a file shorter than its header says, no vertices or faces, or a face that
            names a vertex that does not exist; names the place.
    """
    records = read_records(data, path)
    for name, what in (("vertex", "vertices"), ("face", "faces")):
        if name not in records.elements or records.elements[name].count == 0:
            raise malformed(path, "header", f"has no {what}", "give a file with a surface in it")
    vertices, faces = records.elements["vertex"], records.elements["face"]
    corner_list = next((name for name in FACE_LISTS if name in faces.lengths), None)
    if not set("xyz") <= vertices.values.keys() - vertices.lengths.keys():
        raise malformed(path, "header", "the vertices have no x, y and z", "check the file")
    if corner_list is None:
        raise malformed(path, "header", "the faces have no list 'vertex_indices'", "check the file")
    corners = faces.values[corner_list]
    if corners.dtype.kind not in "iu":
        raise malformed(path, "header", "the corners of faces are not integers", "check the file")
    points, groups = _table(vertices, tuple("xyz")), _attribute_groups(vertices)
    attributes = {attribute: _table(vertices, names) for attribute, names in groups.items()}
    polygons = Polygons.of_sizes(corners, faces.lengths[corner_list]).checked(
        len(points), lambda face, problem: malformed(path, f"face {face}", problem, "correct or remove the face")
    )
    appearance = [attributes[name] for name in ("uv", "normal") if name in groups]
    wrong = nonfinite_rows(points)
    is_text = records.encoding == "ascii" and len(wrong) > 0
    return FileContents(
        vertices=points,
        polygons=polygons,
        attributes=attributes,
        labels=frozenset(
            attribute
            for attribute, names in groups.items()
            if attribute != "color" and all(vertices.values[name].dtype.kind in "iu" for name in names)
        ),
        color_scale=_color_scale(vertices.values[groups["color"][0]]) if "color" in groups else 1.0,
        representatives=seam_representatives(points, polygons, appearance),
        first_nonfinite=f"line {line_of_record(records.text, vertices.start, wrong[0])}" if is_text else "",
        suffix=".ply",
        appended=partial(_appended, records, groups, corner_list),
    )


def _appended(
    records: PlyRecords, groups: Mapping[str, tuple[str, ...]], corner_list: str, extension: MeshExtension
) -> bytes:
    """The file with records added after its own vertices and faces.

    Properties of new faces get the value that occurs most often, lists beside the corners get zeros.
    """
    vertices = dict(zip("xyz", extension.vertices.T, strict=True))
    for attribute, names in groups.items() if len(extension.vertices) else ():
        vertices |= dict(zip(names, extension.vertex_attributes[attribute].T, strict=True))
    count = len(extension.faces)
    own = records.elements["face"]
    faces = {name: np.repeat(most_frequent_row(values), count) for name, values in own.values.items()}
    for name, lengths in own.lengths.items():
        faces[name] = np.zeros((count, int(most_frequent_row(lengths)[0])))
    return records.appended(
        {"vertex": vertices, "face": faces | {corner_list: extension.faces}},
        {"vertex": len(extension.vertices), "face": count},
    )


def encode_ply(contents: FileContents) -> bytes:
    """A new binary PLY file: positions and attributes as float64, colours as bytes."""
    columns = dict(zip("xyz", contents.vertices.T, strict=True))
    types = dict.fromkeys("xyz", "double")
    for attribute, values in contents.attributes.items():
        names = next((names for names in GROUPS.get(attribute, ()) if len(names) == values.shape[1]), None)
        is_color = attribute == "color" and names is not None
        names = names or _column_names(attribute, values.shape[1])
        names = tuple(f"property_{name}" if name in columns else name for name in names)
        types |= dict.fromkeys(names, "uchar" if is_color else "double")
        columns |= dict(zip(names, (values * (255.0 / contents.color_scale) if is_color else values).T, strict=True))
    properties = tuple(PlyProperty(name, np.dtype(f"<{TYPES[kind]}")) for name, kind in types.items())
    largest = int(contents.polygons.sizes.max(initial=3))
    count_name, count_dtype = ("uchar", "u1") if largest < 256 else ("uint", "<u4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(contents.vertices)}",
        *(f"property {kind} {name}" for name, kind in types.items()),
        f"element face {len(contents.polygons)}",
        f"property list {count_name} int vertex_indices",
        "end_header\n",
    ]
    records = binary_records(properties, columns, len(contents.vertices))
    return "\n".join(header).encode("ascii") + records + _encoded_polygons(contents.polygons, count_dtype)


def _encoded_polygons(polygons: Polygons, count_dtype: str) -> bytes:
    """Face records, each a count and that many 32-bit indices, without a loop over the faces."""
    width = np.dtype(count_dtype).itemsize
    starts = polygons.starts[:-1] * 4 + np.arange(len(polygons)) * width
    buffer = np.zeros(len(polygons.corners) * 4 + len(polygons) * width, dtype=np.uint8)
    is_count = np.zeros(len(buffer), dtype=bool)
    is_count[(starts[:, None] + np.arange(width)).reshape(-1)] = True
    buffer[is_count] = polygons.sizes.astype(count_dtype).view(np.uint8)
    buffer[~is_count] = polygons.corners.astype("<i4").view(np.uint8)
    return buffer.tobytes()


def _column_names(attribute: str, width: int) -> tuple[str, ...]:
    name = "_".join(attribute.split()) or "attribute"
    return (name,) if width == 1 else tuple(f"{name}_{index}" for index in range(width))


def _table(element: PlyElement, names: tuple[str, ...]) -> Float[np.ndarray, "n _"]:
    """Properties side by side as float64."""
    return np.stack([element.values[name] for name in names], axis=1).astype(np.float64)


def _attribute_groups(vertices: PlyElement) -> dict[str, tuple[str, ...]]:
    """Which scalar properties make up each attribute; those in no group are attributes of their own."""
    groups: dict[str, tuple[str, ...]] = {}
    free = [name for name in vertices.values if name not in {"x", "y", "z", *vertices.lengths}]
    for attribute, choices in GROUPS.items():
        names = next((names for names in choices if set(names) <= set(free)), None)
        if names is not None:
            groups[attribute] = names
            free = [name for name in free if name not in names]
    return groups | {(f"property {name}" if name in GROUPS else name): (name,) for name in free}


def _color_scale(values: np.ndarray) -> float:
    return color_scale_of(values) if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
