"""PLY: text and binary, with every per-vertex property, polygons, and whatever else a file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from spinor_geom.adapters.contents import FileContents, color_scale_of, malformed, nonfinite_rows
from spinor_geom.adapters.extending import cast_values, most_frequent_row
from spinor_geom.adapters.ply_body import line_of_record, read_ascii, read_binary
from spinor_geom.adapters.ply_header import PlyElement, PlyHeader, read_header
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


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyBody:
    """The records of one element.

    Attributes:
        element: its description in the header.
        start: where its records begin in the file, in bytes.
        stop: where they end.
        scalars: (n,) values by the names of the properties that are no lists.
        lists: for each list property all its values in one row, and (n,) how many each record has.
    """

    element: PlyElement
    start: int
    stop: int
    scalars: Mapping[str, np.ndarray]
    lists: Mapping[str, tuple[np.ndarray, Int[np.ndarray, " n"]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlySource:
    """A PLY file as it was read.

    Attributes:
        data: the file's bytes.
        header: its header.
        vertices: its vertex records.
        faces: its face records.
        groups: the properties that make up each attribute.
    """

    data: bytes
    header: PlyHeader
    vertices: PlyBody
    faces: PlyBody
    groups: Mapping[str, tuple[str, ...]]
    suffix: str = ".ply"

    def appended(self, extension: MeshExtension) -> bytes:
        """The file with records added after its own vertices and faces; all other bytes but the two counts stay.

        New positions and attributes are rounded to the types that the file declares. Properties of new faces get the
        value that occurs most often, lists beside the corners get zeros.
        """
        counts = {"vertex": len(extension.vertices), "face": len(extension.faces)}
        if not any(counts.values()):
            return self.data
        new = {
            self.vertices.stop: self._encoded(self.vertices, self._vertex_columns(extension), counts["vertex"]),
            self.faces.stop: self._encoded(self.faces, self._face_columns(extension), counts["face"]),
        }
        pieces = [self.header.with_more(counts)]
        position = self.header.size
        for stop in sorted(new):
            pieces += [self.data[position:stop], new[stop]]
            position = stop
        return b"".join([*pieces, self.data[position:]])

    def _vertex_columns(self, extension: MeshExtension) -> dict[str, np.ndarray]:
        columns = dict(zip("xyz", extension.vertices.T, strict=True))
        for attribute, names in self.groups.items():
            columns |= dict(zip(names, extension.vertex_attributes[attribute].T, strict=True))
        return columns

    def _face_columns(self, extension: MeshExtension) -> dict[str, np.ndarray]:
        columns: dict[str, np.ndarray] = {
            name: np.repeat(most_frequent_row(values), len(extension.faces))
            for name, values in self.faces.scalars.items()
        }
        for name, (_, lengths) in self.faces.lists.items():
            usual = int(most_frequent_row(lengths)[0])
            columns[name] = np.zeros((len(extension.faces), usual))
        return columns | {self.corner_list: extension.faces}

    @property
    def corner_list(self) -> str:
        """The name of the list property that holds the corners of faces."""
        return next(name for name in FACE_LISTS if name in self.faces.lists)

    def _encoded(self, body: PlyBody, columns: Mapping[str, np.ndarray], count: int) -> bytes:
        """`count` records in the file's own encoding; list properties without a column are empty."""
        if count == 0:
            return b""
        as_text = self.header.encoding == "ascii"
        fields = []
        for item in body.element.properties:
            values = columns.get(item.name, np.zeros((count, 0)))
            if item.count_dtype is not None:
                fields.append(np.full((count, 1), values.shape[1]).astype(item.count_dtype))
            # text holds all digits, whatever type the header declares
            dtype = np.dtype(np.float64) if as_text and item.dtype.kind == "f" else item.dtype
            fields.append(cast_values(values.reshape(count, -1), dtype))
        if as_text:
            columns_as_text = [list(map(repr, column.tolist())) for part in fields for column in part.T]
            lines = [" ".join(record).encode("ascii") for record in zip(*columns_as_text, strict=True)]
            newline = self.header.newline
            begin = b"" if self.data[: body.stop].endswith((b"\n", newline)) else newline
            return begin + b"".join(line + newline for line in lines)
        dtype = np.dtype([(str(index), part.dtype, part.shape[1:]) for index, part in enumerate(fields)])
        records = np.empty(count, dtype=dtype)
        for index, part in enumerate(fields):
            records[str(index)] = part
        return records.tobytes()


def read_ply(data: bytes, path: Path | None) -> FileContents:
    """The vertices, per-vertex properties and faces of a PLY file.

    Colours, normals and texture coordinates become "color", "normal" and "uv"; every other scalar property of the
    vertices becomes an attribute under its own name. Positions whose vertices differ in texture coordinates or normals
    are seams.

    Raises:
        MeshFileError: a malformed header, a file shorter than its header says, no vertices or faces, or a face that
            names a vertex that does not exist; names the place.
    """
    header = read_header(data, path)
    is_text = header.encoding == "ascii"
    # as many bytes, so places stay
    text = data.replace(b"\r", b"\n") if is_text and header.newline == b"\r" else data
    bodies = _read_bodies(text, header, path)
    for name, what in (("vertex", "vertices"), ("face", "faces")):
        if name not in bodies or bodies[name].element.count == 0:
            raise malformed(path, "header", f"has no {what}", "give a file with a surface in it")
    vertices, faces = bodies["vertex"], bodies["face"]
    if not set("xyz") <= set(vertices.scalars):
        raise malformed(path, "header", "the vertices have no x, y and z", "check the file")
    if not set(FACE_LISTS) & set(faces.lists):
        raise malformed(path, "header", "the faces have no list 'vertex_indices'", "check the file")
    points = np.stack([vertices.scalars[name] for name in "xyz"], axis=1).astype(np.float64)
    groups = _attribute_groups(vertices)
    attributes = {
        attribute: np.stack([vertices.scalars[name] for name in names], axis=1).astype(np.float64)
        for attribute, names in groups.items()
    }
    source = PlySource(data=data, header=header, vertices=vertices, faces=faces, groups=groups)
    corners, sizes = faces.lists[source.corner_list]
    if corners.dtype.kind not in "iu":
        raise malformed(path, "header", "the corners of faces are not integers", "check the file")
    polygons = Polygons.of_sizes(corners, sizes).checked(
        len(points), lambda face, problem: malformed(path, f"face {face}", problem, "correct or remove the face")
    )
    appearance = [attributes[name] for name in ("uv", "normal") if name in groups]
    wrong = nonfinite_rows(points)
    return FileContents(
        vertices=points,
        polygons=polygons,
        attributes=attributes,
        labels=frozenset(
            attribute
            for attribute, names in groups.items()
            if attribute != "color" and all(vertices.scalars[name].dtype.kind in "iu" for name in names)
        ),
        color_scale=_color_scale(vertices, groups),
        representatives=seam_representatives(points, polygons, appearance),
        first_nonfinite=f"line {line_of_record(text, vertices.start, wrong[0])}" if is_text and len(wrong) else "",
        source=source,
    )


def encode_ply(contents: FileContents) -> bytes:
    """A new binary PLY file: positions and attributes as float64, colours as bytes."""
    columns: list[tuple[str, str, np.ndarray]] = [
        (name, "double", column) for name, column in zip("xyz", contents.vertices.T, strict=True)
    ]
    for attribute, values in contents.attributes.items():
        names = next((names for names in GROUPS.get(attribute, ()) if len(names) == values.shape[1]), None)
        if attribute == "color" and names:
            scaled = cast_values(values * (255.0 / contents.color_scale), np.dtype(np.uint8))
            columns += [(name, "uchar", column) for name, column in zip(names, scaled.T, strict=True)]
        else:
            names = names or _column_names(attribute, values.shape[1])
            columns += [(name, "double", column) for name, column in zip(names, values.T, strict=True)]
    types = {"double": np.dtype("<f8"), "uchar": np.dtype("u1")}
    records = np.empty(len(contents.vertices), dtype=[(f"{i}", types[kind]) for i, (_, kind, _) in enumerate(columns)])
    for index, (_, _, column) in enumerate(columns):
        records[f"{index}"] = column
    largest = int(contents.polygons.sizes.max(initial=3))
    count_name, count_dtype = ("uchar", "u1") if largest < 256 else ("uint", "<u4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(contents.vertices)}",
        *(f"property {kind} {name}" for name, kind, _ in columns),
        f"element face {len(contents.polygons)}",
        f"property list {count_name} int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode("ascii") + records.tobytes() + _encoded_polygons(contents.polygons, count_dtype)


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


def _attribute_groups(vertices: PlyBody) -> dict[str, tuple[str, ...]]:
    """Which scalar properties make up each attribute; those in no group are attributes of their own."""
    groups: dict[str, tuple[str, ...]] = {}
    free = [name for name in vertices.scalars if name not in {"x", "y", "z"}]
    for attribute, choices in GROUPS.items():
        names = next((names for names in choices if set(names) <= set(free)), None)
        if names is not None:
            groups[attribute] = names
            free = [name for name in free if name not in names]
    return groups | {(f"property {name}" if name in GROUPS else name): (name,) for name in free}


def _color_scale(vertices: PlyBody, groups: Mapping[str, tuple[str, ...]]) -> float:
    if "color" not in groups:
        return 1.0
    values = vertices.scalars[groups["color"][0]]
    return color_scale_of(values) if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)


def _read_bodies(data: bytes, header: PlyHeader, path: Path | None) -> dict[str, PlyBody]:
    """The records of all elements, by name."""
    read = read_ascii if header.encoding == "ascii" else read_binary
    bodies: dict[str, PlyBody] = {}
    position = header.size
    for element in header.elements:
        scalars, lists, stop = read(data, position, element, path)
        bodies[element.name] = PlyBody(element=element, start=position, stop=stop, scalars=scalars, lists=lists)
        position = stop
    return bodies
