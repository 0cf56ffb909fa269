"""OFF, text: polygons, colours, normals and texture coordinates, as records like those of PLY."""

import re
from dataclasses import replace
from itertools import chain, islice, pairwise

import numpy as np

from spinor_geom.adapters.contents import BYTE_ORDER_MARK, COMMENT, FileContents, malformed, text_rows
from spinor_geom.adapters.ply import LONGEST_COUNT, contents_of_records
from spinor_geom.adapters.records import Element, Property, Records, parse_rows, split_rows
from spinor_geom.adapters.vertex_data import cast_values
from spinor_geom.errors import MeshFileError

# in Geomview's order. The prefixes 4 and n (four or n coordinates) are not supported
KEYWORD = re.compile(rb"(ST|st)?(C|c)?(N)?(?:OFF|off)$")
REST_OF_COUNTS = re.compile(rb"[^\n]*\n?(?:(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t]*\d+[ \t\r]*(?:#[^\n]*)?\n)?")
# ModelNet's files have the keyword and the first count in one word
WORD = re.compile(rb"(?:ST|st)?[Cc]?N?(?:OFF|off)(?=\d)|[^\s#]+|#[^\n]*")
SIZE = re.compile(rb"([3-9]|[1-9]\d{1,8})$")  # of a face
COLORS = ("red", "green", "blue", "alpha")
CORNERS = Property("vertex_indices", np.dtype("i4"), np.dtype("u4"))


def read_off(data: bytes) -> FileContents:
    """The vertices, with colours, normals and texture coordinates, and the faces of an OFF file.

    Each vertex and each face has a line. Colours of faces are kept in the file but not read. Files without colours,
    normals and texture coordinates may have other line breaks. Such files are rewritten with standard line breaks.
    """
    if b"\0" in data:
        raise malformed(f"byte {data.index(0)}", "has a zero byte, so it is not a text file", "binary OFF is not read")
    newline = (re.search(rb"\r\n|\n|\r", data) or [b"\n"])[0]
    text = data.replace(b"\r", b"\n") if newline == b"\r" else data
    keyword, vertex, face = _header(text)
    # the number of edges, which is not needed, may have a line of its own
    start = next(REST_OF_COUNTS.finditer(text, face.count_at[1])).end()
    words = (lambda line: re.sub(COMMENT, b"", line).split()) if b"#" in text else bytes.split
    suffix = ".off"
    try:
        rows, vertex = split_rows(text, start, vertex, words)
        face_rows, face = split_rows(text, vertex.stop, face, words)
    except MeshFileError:
        lines = [] if any(keyword) else text[face.count_at[1] :].splitlines()
        reflowed = _reflowed(list(chain.from_iterable(map(words, lines))), vertex.count, face.count)
        if reflowed is None:
            raise
        (rows, face_rows), suffix = reflowed, ""
        vertex = replace(vertex, lines=())
    names = _names(keyword, len(rows[0]))
    if not names:
        problem = f"a vertex with {len(rows[0])} numbers does not fit the keyword"
        raise malformed(vertex.line(0), problem, "correct the line, or convert the file")
    colors = [place for place, name in enumerate(names) if name in COLORS]
    is_integer = all(row[place].isdigit() for row in rows for place in colors if place < len(row))
    color, number = np.dtype("u1" if is_integer else "f8"), np.dtype("f8")
    columns = tuple(Property(name, color if name in COLORS else number) for name in names)
    # a colour may follow a face's size and corners
    face_rows = [row[: 1 + int(row[0])] if len(row) > 4 and SIZE.match(row[0]) else row for row in face_rows]
    elements = {"vertex": parse_rows(rows, replace(vertex, properties=columns)), "face": parse_rows(face_rows, face)}
    return contents_of_records(Records(data=data, newline=newline, elements=elements), suffix=suffix)


def encode_off(contents: FileContents) -> bytes:
    """A new OFF file of positions, colours (COFF, as integers) and faces, closed along seams."""
    colors = contents.attributes.get("color")
    scaled = [] if colors is None else [cast_values(colors * (255.0 / contents.color_scale), np.dtype(np.uint8))]
    lines = ["COFF" if scaled else "OFF", f"{len(contents.vertices)} {len(contents.polygons)} 0"]
    lines += text_rows(contents.vertices, *scaled)
    closed = contents.polygons.renumbered(contents.representatives)
    lines += [f"{len(corners)} {' '.join(map(str, corners))}" for corners in closed.rows()]
    return ("\n".join(lines) + "\n").encode("ascii")


def _header(text: bytes) -> tuple[tuple[bytes | None, ...], Element, Element]:
    """The prefixes of the keyword, and the elements "vertex" and "face" without their records."""
    found = WORD.finditer(text, text.startswith(BYTE_ORDER_MARK) and len(BYTE_ORDER_MARK))
    words = list(islice((word for word in found if not word[0].startswith(b"#")), 3))
    keyword: tuple[bytes | None, ...] = ()
    if words and not words[0][0].isdigit():
        is_binary = [word[0] for word in words[1:2]] == [b"BINARY"]
        match = KEYWORD.match(words[0][0])
        if match is None or is_binary:
            name = words[0][0].decode("latin-1") + " BINARY" * is_binary
            line = text.count(b"\n", 0, words[0].start()) + 1
            raise malformed(f"line {line}", f"'{name}' is not a supported kind of OFF", "convert the file")
        keyword, words = match.groups(), words[1:]
    counts = [word for word in words[:2] if word[0].isdigit() and len(word[0]) <= LONGEST_COUNT and int(word[0])]
    if len(counts) < 2:
        line = text.count(b"\n", 0, words[0].start() if words else len(text.rstrip())) + 1
        raise malformed(f"line {line}", "the counts of vertices and faces are missing or zero", "correct the file")
    vertex, face = (
        Element(name=name, count=int(count[0]), count_at=count.span(), properties=(CORNERS,))
        for name, count in zip(("vertex", "face"), counts, strict=True)
    )
    return keyword, vertex, face


def _reflowed(words: list[bytes], vertices: int, faces: int) -> tuple[list[list[bytes]], list[list[bytes]]] | None:
    """The words of vertices of three numbers and of faces without colours, whatever the line breaks, else None."""
    for rest in (words[1:], words):
        starts = list(range(0, 3 * vertices, 3)) if 3 * vertices <= len(rest) else []
        stop = 3 * len(starts)
        while stop < len(rest) and len(starts) < vertices + faces and SIZE.match(rest[stop]):
            starts.append(stop)
            stop += 1 + int(rest[stop])
        if stop == len(rest) and len(starts) == vertices + faces:
            rows = [rest[a:b] for a, b in pairwise([*starts, stop])]
            return rows[:vertices], rows[vertices:]
    return None


def _names(keyword: tuple[bytes | None, ...], width: int) -> tuple[str, ...]:
    """The names of the numbers of a vertex, by the keyword and by how many they are, or () if these do not fit."""
    has_uv, has_color, has_normal = map(bool, keyword or (None,) * 3)
    rest = width - 3 - 3 * has_normal - 2 * has_uv
    has_color = has_color or (rest in (3, 4) and not has_uv)  # many programs write colours under the plain keyword
    if rest < 0 or (has_color and rest not in (3, 4)):
        return ()
    colors = COLORS[: rest * has_color]
    extra = [f"extra_{number}" if rest > 1 else "extra" for number in range(rest - len(colors))]
    return ("x", "y", "z", *("nx", "ny", "nz") * has_normal, *colors, *("s", "t") * has_uv, *extra)
