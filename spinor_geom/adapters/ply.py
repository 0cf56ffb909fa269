"""PLY, text and binary: polygons and all properties of vertices. Other elements are kept when a file is extended."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import BYTE_ORDER_MARK, UV, FileContents, color_scale_of, malformed, nearest_rows
from spinor_geom.adapters.polygon_faces import Polygons, seam_representatives
from spinor_geom.adapters.records import Element, Property, Records, binary_records, parse_rows, read_binary, split_rows
from spinor_geom.adapters.textures import Appearance
from spinor_geom.adapters.vertex_data import as_float64, cast_values, most_frequent_row
from spinor_geom.errors import PolygonError
from spinor_geom.mesh.array_checks import nonfinite_rows
from spinor_geom.mesh.find_loops import repeats_a_vertex
from spinor_geom.mesh.triangle_mesh import MeshExtension

NUMPY_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
OLD_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
TYPES = {np.dtype(kind).name: kind for kind in NUMPY_TYPES} | dict(zip(OLD_NAMES, NUMPY_TYPES, strict=True))
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_COUNT = 18  # digits. No file holds more
MOST_DECLARED = 1000  # elements and properties. The time to read a header grows with the square of their number
LINE = re.compile(rb"[^\r\n]*(?:\r\n|\n|\r)")
# attributes of several properties, with the names that programs use for these
GROUPS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "color": (("red", "green", "blue", "alpha"), ("red", "green", "blue"), ("r", "g", "b")),
    "normal": (("nx", "ny", "nz"),),
    "uv": (("s", "t"), ("u", "v"), ("texture_u", "texture_v")),
}
CORNER_UV, IMAGE_OF_FACE = "texcoord", "texnumber"  # properties of faces: two numbers a corner, an index of an image
FACE_LISTS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"  # the element of triangle strips. −1 begins another strip
TEXTURE = re.compile(rb"^comment TextureFile ([^\r\n]{1,1000})", re.MULTILINE)  # as MeshLab writes it


def read_ply(data: bytes) -> FileContents:
    """The vertices, per-vertex properties and faces of a PLY file, and the names of its textures."""
    contents = contents_of_records(read_records(data), suffix=".ply")
    names = tuple(match[1].decode("utf-8", "replace") for match in TEXTURE.finditer(data, 0, _read_header(data)[0]))
    return replace(contents, appearance=Appearance(names=names)) if names else contents


def read_records(data: bytes) -> Records:
    """The header and all records of a PLY file."""
    position, records = _read_header(data)
    text, elements = data.replace(b"\r", b"\n") if records.newline == b"\r" else data, {}
    for element in records.elements.values():
        if not element.properties:
            element = replace(element, stop=position)
        elif records.newline:
            rows, element = split_rows(text, position, element)
            element = parse_rows(rows, element)
        else:
            element = read_binary(data, position, element)
        elements[element.name] = element
        position = element.stop
    return replace(records, elements=elements)


def _read_header(data: bytes) -> tuple[int, Records]:
    """The size of a PLY file's header, and its elements without their records."""
    start = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    if not re.match(rb"ply\s", data[start : start + 4]):
        raise malformed("line 1", "does not begin with 'ply'")
    end = re.search(rb"(?:^|[\r\n])end_header[ \t]*(\r\n|\n|\r)", data)
    if end is None:
        raise malformed("header", "has no line 'end_header'")
    # "\r" before binary data that begins with "\n" is ambiguous. The first line of the file decides
    newline = b"\r\n" if data[start + 3 : start + 5] == b"\r\n" else data[start + 3 : start + 4]
    size = end.start(1) + len(newline) if end[1].startswith(newline) else end.end()
    lines = [(line.start(), line[0].decode("latin-1").rstrip()) for line in LINE.finditer(data, start, size)]
    formats = (line.split() for _, line in lines)
    encoding = next((words[1] for words in formats if words[:1] == ["format"] and words[1:]), None)
    if encoding not in BYTE_ORDERS:
        raise malformed("header", f"the format is {encoding}", f"use one of {', '.join(BYTE_ORDERS)}")
    if sum(line.startswith(("element", "property")) for _, line in lines) > MOST_DECLARED:
        raise malformed("header", f"declares over {MOST_DECLARED} elements and properties", "correct the header")
    elements: list[Element] = []
    for number, (begin, line) in enumerate(lines, start=1):
        match line.split():
            case [] | ["ply" | "end_header" | "comment" | "obj_info" | "format", *_]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) <= LONGEST_COUNT:
                stop = begin + len(line)
                elements.append(Element(name=name, count=int(count), count_at=(stop - len(count), stop)))
            case ["property", *description] if elements:
                added = _property(description, BYTE_ORDERS[encoding])
                if added is None or added.name in {item.name for item in elements[-1].properties}:
                    problem = f"'{line.strip()}' is of unknown type, or the second of its name"
                    raise malformed(f"line {number}", problem, "correct the header")
                elements[-1] = replace(elements[-1], properties=(*elements[-1].properties, added))
            case _:
                raise malformed(f"line {number}", f"cannot understand '{line.strip()}'", "correct the header")
    by_name = {element.name: element for element in elements}
    if len(by_name) != len(elements):
        raise malformed("header", "has two elements of one name", "rename one")
    return size, Records(data=data, newline=newline if encoding == "ascii" else b"", elements=by_name)


def _property(description: list[str], order: str) -> Property | None:
    """The property that the words after "property" in a header line describe, or None if they are not valid."""
    match description:
        case [kind, name] if kind in TYPES:
            return Property(name, np.dtype(order + TYPES[kind]))
        case ["list", count, kind, name] if count in TYPES and kind in TYPES and TYPES[count][0] != "f":
            return Property(name, np.dtype(order + TYPES[kind]), np.dtype(order + TYPES[count]))
    return None


def contents_of_records(records: Records, *, suffix: str) -> FileContents:
    """The contents of a file from its records of vertices and faces. `suffix` as in `FileContents`.

    Colours, normals and texture coordinates become "color", "normal" and "uv". Every other scalar property of the
    vertices becomes an attribute under its own name. Edges along which texture coordinates or normals differ are seams.
    """
    vertices, faces, strips = (records.elements.get(name) for name in ("vertex", "face", STRIPS))
    has_strips = strips is not None and strips.count > 0
    if vertices is None or vertices.count == 0:
        raise malformed("header", "has no vertices", "give a file with a surface in it")
    if not has_strips and (faces is None or faces.count == 0):
        raise malformed("header", "has no faces", "give a file with a surface in it")
    if not set("xyz") <= vertices.values.keys() - vertices.lengths.keys():
        raise malformed("header", "the vertices have no x, y and z")
    polygons = Polygons.of_triangles(np.zeros((0, 3), dtype=np.int64))
    if faces is not None and faces.count > 0:
        corner_list = _corner_list(faces)
        polygons = Polygons.of_sizes(faces.values[corner_list], faces.lengths[corner_list])
    if strips is not None and has_strips:
        polygons = polygons.followed_by(_triangles_of_strips(strips, vertices.count))
    points, groups = _table(vertices, tuple("xyz")), _attribute_groups(vertices)
    attributes = {attribute: _table(vertices, names) for attribute, names in groups.items()}
    try:
        polygons.require_valid(len(points))
    except PolygonError as error:
        face, problem = error.fields["face"], error.fields["problem"]
        line = faces.line(face) if faces is not None and face < faces.count else ""
        place = ", ".join(filter(None, (line, f"face {face}")))
        raise malformed(place, problem, "correct or remove the face") from None
    appearance = [attributes[name] for name in ("uv", "normal") if name in groups]
    patches = None
    if faces is not None and not has_strips and "patch" not in faces.lengths:
        patches = faces.values.get("patch")
    corner_uv, of_new_faces = None, None
    if faces is not None and not has_strips and CORNER_UV in faces.lengths and "uv" not in groups:
        sizes = faces.lengths[corner_list]
        if np.array_equal(faces.lengths[CORNER_UV], 2 * sizes):
            table, rows = np.unique(faces.values[CORNER_UV].reshape(-1, 2), axis=0, return_inverse=True)
            corner_uv = as_float64(table), rows.ravel()
            of_new_faces = partial(_of_new_faces, faces, corner_uv, polygons.corners, points)
    wrong, color_scale = nonfinite_rows(points).tolist() if vertices.lines else [], 1.0
    if "color" in groups:
        stored = vertices.values[groups["color"][0]].dtype
        color_scale = color_scale_of(attributes["color"]) if stored.kind == "f" else float(np.iinfo(stored).max)
    return FileContents(
        vertices=points,
        polygons=polygons,
        attributes=attributes,
        labels=frozenset(
            attribute
            for attribute, names in groups.items()
            if attribute != "color" and all(vertices.values[name].dtype.kind in "iu" for name in names)
        ),
        color_scale=color_scale,
        face_loops=patches.astype(np.int64) if patches is not None and patches.dtype.kind == "i" else None,
        representatives=seam_representatives(points, polygons, appearance),
        stored=None if records.newline else partial(_stored, tuple(vertices.values[name].dtype for name in "xyz")),
        nonfinite_places={vertex: vertices.line(vertex) for vertex in wrong},
        several=() if corner_uv is None else (UV,),
        corner_uv=corner_uv,
        # strips cannot be extended. Many programs read them only where there are no faces
        suffix="" if has_strips else suffix,
        notes=("triangle strips were changed into faces",) if has_strips else (),
        appended=None if has_strips else partial(_appended, records, groups, corner_list, of_new_faces),
    )


def _stored(
    dtypes: Sequence[np.dtype[Any]], points: Float[np.ndarray, "n 3"], _: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "n 3"]:
    """Positions as binary properties of some types hold them."""
    columns = [cast_values(column, dtype) for column, dtype in zip(points.T[..., None], dtypes, strict=True)]
    return np.concatenate(columns, axis=1, dtype=np.float64)


def _corner_list(element: Element) -> str:
    """The name of the list of the corners of faces or strips."""
    name = next((name for name in FACE_LISTS if name in element.lengths), None)
    if name is None:
        raise malformed("header", f"the element '{element.name}' has no list 'vertex_indices'")
    if element.values[name].dtype.kind not in "iu":
        raise malformed("header", f"the corners of the element '{element.name}' are not integers")
    return name


def _triangles_of_strips(strips: Element, vertices: int) -> Int[np.ndarray, "t 3"]:
    """The triangles of all strips. Each three corners in a row are one, of which every second is reversed.

    Strips turn by repeating a corner. Such triangles are left out.
    """
    name = _corner_list(strips)
    stored, lengths = strips.values[name], strips.lengths[name]
    corners = stored.astype(np.int64)
    # −1 in an unsigned type, where it is no vertex
    largest = np.iinfo(stored.dtype).max
    ends = (corners == -1) | (stored.dtype.kind == "u" and largest >= vertices) * (corners == largest)
    record, place = np.repeat(np.arange(len(lengths)), lengths), np.arange(len(corners))
    begins = np.append(True, ends[:-1] | (np.diff(record) > 0))[: len(corners)]
    parity = (place - np.maximum.accumulate(np.where(begins, place, 0)))[:-2] % 2
    rows = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    rows[parity == 1] = rows[parity == 1][:, ::-1]
    is_triangle = (record[:-2] == record[2:]) & ~(ends[:-2] | ends[1:-1] | ends[2:]) & ~repeats_a_vertex(rows)
    return np.asarray(rows[is_triangle])


def _appended(
    records: Records,
    groups: Mapping[str, tuple[str, ...]],
    corner_list: str,
    of_new_faces: Callable[[MeshExtension], dict[str, np.ndarray]] | None,
    extension: MeshExtension,
) -> bytes:
    """The file with records added.

    New faces get the most frequent values, a colour as a whole, and lists of zeros, but the texture of the nearest old
    vertex.
    """
    vertices = dict(zip("xyz", extension.vertices.T, strict=True))
    for attribute, names in groups.items() if len(extension.vertices) else ():
        vertices |= dict(zip(names, extension.vertex_attributes[attribute].T, strict=True))
    count = len(extension.faces)
    own = records.elements["face"]
    faces: dict[str, np.ndarray] = {}
    # a colour as a whole, because the most frequent red and the most frequent green may be of different colours
    for names in (*_attribute_groups(own).values(), *((name,) for name in "xyz" if name in own.values)):
        row = most_frequent_row(_table(own, names))
        faces |= dict(zip(names, np.repeat(row, count, axis=0).T, strict=True))
    for name, lengths in own.lengths.items():
        faces[name] = np.zeros((count, int(most_frequent_row(lengths)[0])))
    faces |= {} if of_new_faces is None else of_new_faces(extension)
    return records.appended({"vertex": vertices, "face": faces | {corner_list: extension.faces}})


def _of_new_faces(
    faces: Element,
    corner_uv: tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, " c"]],
    corners: Int[np.ndarray, " c"],
    points: Float[np.ndarray, "v 3"],
    extension: MeshExtension,
) -> dict[str, np.ndarray]:
    """The texture coordinates of new faces, and the image if there are several: those of the nearest old corner."""
    table, own = corner_uv
    face_of_corner = np.repeat(np.arange(faces.count), faces.lengths[CORNER_UV] // 2)
    every = np.concatenate([points, extension.vertices])
    row, face = nearest_rows(np.stack([own, face_of_corner], axis=1), corners, every, extension.faces).T
    images = {IMAGE_OF_FACE: faces.values[IMAGE_OF_FACE][face]} if IMAGE_OF_FACE in faces.values else {}
    return {CORNER_UV: np.tile(table[row], 3), **images}


def names_in_ply(contents: FileContents) -> dict[str, tuple[str, ...]]:
    """The properties of each attribute in a new PLY file, without attributes whose names are not ASCII or clash."""
    found: dict[str, tuple[str, ...]] = {}
    taken = set("xyz")
    for attribute, values in contents.attributes.items():
        names = next((names for names in GROUPS.get(attribute, ()) if len(names) == values.shape[1]), None)
        if names is None:
            name, width = "_".join(attribute.split()) or "attribute", values.shape[1]
            names = (name,) if width == 1 else tuple(f"{name}_{index}" for index in range(width))
        names = tuple(f"property_{name}" if name in taken else name for name in names)
        if "".join(names).isascii() and taken.isdisjoint(names):
            found[attribute] = names
            taken |= {*names}
    return found


def encode_ply(contents: FileContents) -> bytes:
    """A new binary PLY file: positions and attributes as float64, colours as bytes.

    Where faces were added, each face has the property "patch": the index of its loop, −1 for faces that were read.
    """
    columns = dict(zip("xyz", contents.vertices.T, strict=True))
    types = dict.fromkeys("xyz", "double")
    for attribute, names in names_in_ply(contents).items():
        values = contents.attributes[attribute]
        is_color = attribute == "color" and names in GROUPS["color"]
        types |= dict.fromkeys(names, "uchar" if is_color else "double")
        columns |= dict(zip(names, (values * (255.0 / contents.color_scale) if is_color else values).T, strict=True))
    properties = tuple(Property(name, np.dtype(f"<{TYPES[kind]}")) for name, kind in types.items())
    largest = int(contents.polygons.sizes.max(initial=3))
    count_name, count_dtype = ("uchar", np.dtype("u1")) if largest < 256 else ("uint", np.dtype("<u4"))
    texture = contents.appearance and contents.appearance.texture
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *([f"comment TextureFile {texture.name}"] if texture else []),
        f"element vertex {len(contents.vertices)}",
        *(f"property {kind} {name}" for name, kind in types.items()),
        f"element face {len(contents.polygons)}",
        f"property list {count_name} int vertex_indices",
        *(["property int patch"] if contents.face_loops is not None else []),
        "end_header\n",
    ]
    vertices = binary_records(properties, columns, len(contents.vertices))
    # the bytes of the corners, with the size of each face before its corners and its patch after them
    corners, sizes = contents.polygons.corners.astype("<i4"), contents.polygons.sizes.astype(count_dtype)
    patches = (np.zeros(0) if contents.face_loops is None else contents.face_loops).astype("<i4")
    starts = np.repeat(contents.polygons.starts[:-1] * corners.itemsize, count_dtype.itemsize)
    ends = np.repeat(contents.polygons.starts[1:][: len(patches)] * corners.itemsize, patches.itemsize)
    # between two faces the patch of the first comes before the size of the second
    places, added = np.concatenate([ends, starts]), np.concatenate([patches.view(np.uint8), sizes.view(np.uint8)])
    faces = np.insert(corners.view(np.uint8), places, added)
    return "\n".join(header).encode() + vertices + faces.tobytes()


def _table(element: Element, names: tuple[str, ...]) -> Float[np.ndarray, "n _"]:
    """Properties side by side as float64."""
    return as_float64(np.stack([element.values[name] for name in names], axis=1))


def _attribute_groups(vertices: Element) -> dict[str, tuple[str, ...]]:
    """The scalar properties of each attribute. Those in no group are attributes of their own."""
    groups: dict[str, tuple[str, ...]] = {}
    free = [name for name in vertices.values if name not in {"x", "y", "z", *vertices.lengths}]
    for attribute, choices in GROUPS.items():
        names = next((names for names in choices if set(names) <= set(free)), None)
        if names is not None:
            groups[attribute] = names
            free = [name for name in free if name not in names]
    return groups | {(f"property {name}" if name in GROUPS else name): (name,) for name in free}
