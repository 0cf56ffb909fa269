"""OFF: text, with polygons, colours, normals and texture coordinates."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import (
    BYTE_ORDER_MARK,
    Addition,
    FileContents,
    color_scale_of,
    first_unreadable,
    integer,
    malformed,
    nonfinite_rows,
    real,
)
from spinor_geom.adapters.extending import cast_values
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives

# Geomview's order: ST, C, N before OFF; 4 (four coordinates) and n (any number) are not surfaces in space
KEYWORD = re.compile(rb"(ST|st)?(C|c)?(N)?(?:OFF|off)$")
COUNTS = re.compile(rb"^((?:" + BYTE_ORDER_MARK + rb")?\s*(?:[A-Za-z]\w*\s+)?)(\d+)(\s+)(\d+)")
SIZE = re.compile(rb"([3-9]|[1-9]\d{1,8})$")  # of a face
LONGEST_COUNT = 18  # digits; no file holds more


@dataclass(frozen=True, kw_only=True, eq=False)
class OffSource:
    """An OFF file as it was read.

    Attributes:
        lines: its lines, line ends included.
        counts_line: which of them holds the counts.
        vertex_stop: the line after the last vertex.
        face_stop: the line after the last face.
        columns: the attributes that follow the coordinates in a vertex line, in order, and how many numbers each has.
        integer_colors: whether colours are written as integers.
    """

    lines: tuple[bytes, ...]
    counts_line: int
    vertex_stop: int
    face_stop: int
    columns: Mapping[str, int]
    integer_colors: bool
    suffix: str = ".off"

    def appended(self, addition: Addition) -> bytes:
        """The file with lines added after its own vertices and faces; all other text but the counts stays."""
        if len(addition.vertices) == 0 and len(addition.faces) == 0:
            return b"".join(self.lines)
        newline = b"\r\n" if self.lines[0].endswith(b"\r\n") else b"\n"
        columns = [list(map(repr, column.tolist())) for column in addition.vertices.T]
        for name in self.columns:
            values = addition.attributes[name]
            if name == "color" and self.integer_colors:
                values = cast_values(values, np.dtype(np.int64))
            columns += [list(map(repr, column.tolist())) for column in values.T]
        vertices = [" ".join(words).encode("ascii") + newline for words in zip(*columns, strict=True)]
        faces = [f"3 {a} {b} {c}".encode("ascii") + newline for a, b, c in addition.faces.tolist()]
        lines = list(self.lines)
        lines[self.counts_line] = self._counts(len(vertices), len(faces))
        if not lines[self.face_stop - 1].endswith(b"\n"):
            lines[self.face_stop - 1] += newline
        return b"".join(
            chain(
                lines[: self.vertex_stop],
                vertices,
                lines[self.vertex_stop : self.face_stop],
                faces,
                lines[self.face_stop :],
            )
        )

    def _counts(self, vertices: int, faces: int) -> bytes:
        """The line of counts with more vertices and faces."""

        def more(match: re.Match[bytes]) -> bytes:
            total_vertices, total_faces = int(match[2]) + vertices, int(match[4]) + faces
            return match[1] + str(total_vertices).encode() + match[3] + str(total_faces).encode()

        return COUNTS.sub(more, self.lines[self.counts_line], count=1)


def read_off(data: bytes, path: Path | None) -> FileContents:
    """The vertices, with colours, normals and texture coordinates, and the faces of an OFF file.

    One vertex and one face a line; colours of faces are kept in the file but not read. Plain files whose lines
    are broken elsewhere are read too, and written anew.

    Raises:
        MeshFileError: another kind of OFF (binary, four or n coordinates), fewer lines than announced, no vertices or
            faces, or a line that cannot be understood; names the line.
    """
    if b"\0" in data:
        raise malformed(path, f"byte {data.index(0)}", "a zero byte, so this is no OFF text", "binary OFF is not read")
    lines = data.splitlines(keepends=True)
    rows = [line.removeprefix(BYTE_ORDER_MARK).partition(b"#")[0].split() for line in lines]
    filled = [index for index, row in enumerate(rows) if row]
    keyword, counts_line, first, counts = _header(rows, filled, path)
    vertex_count, face_count = counts
    if not vertex_count or not face_count:
        problem = f"has {vertex_count} vertices and {face_count} faces"
        raise malformed(path, f"line {counts_line + 1}", problem, "give a file with a surface in it")
    chosen = filled[first : first + vertex_count + face_count]
    records = [rows[line] for line in chosen]
    is_one_a_line = len(chosen) == vertex_count + face_count
    if not is_one_a_line and (keyword is None or not any(keyword.groups())):
        words = [(word, line) for line in filled[first - 1 :] for word in rows[line]]
        records, lines_of_records = _records(words[words[0][0].isalpha() + 2 :], counts)
        chosen = lines_of_records or chosen
    if len(chosen) < vertex_count + face_count:
        problem = f"announces {vertex_count} vertices and {face_count} faces, but only {len(chosen)} lines follow"
        raise malformed(path, f"line {counts_line + 1}", problem, "check that the file is complete")
    vertex_lines, face_lines = chosen[:vertex_count], chosen[vertex_count:]
    table = _table(records[:vertex_count], vertex_lines, path)
    columns = _columns(keyword, table.shape[1], vertex_lines[0], path)
    points, *values, _ = np.split(table, np.cumsum([3, *columns.values()]), axis=1)
    attributes = dict(zip(columns, values, strict=True))
    source = OffSource(
        lines=tuple(lines),
        counts_line=counts_line,
        vertex_stop=vertex_lines[-1] + 1,
        face_stop=face_lines[-1] + 1,
        columns=columns,
        integer_colors="color" in columns and _all_integers(records[:vertex_count], columns),
    )
    color_scale = 1.0
    if "color" in attributes:
        color_scale = 255.0 if source.integer_colors else color_scale_of(attributes["color"])
    polygons = _polygons(records[vertex_count:], face_lines, vertex_count, path)
    appearance = [attributes[name] for name in ("uv", "normal") if name in attributes]
    wrong = nonfinite_rows(points)
    return FileContents(
        vertices=points,
        polygons=polygons,
        attributes=attributes,
        color_scale=color_scale,
        representatives=seam_representatives(points, polygons, appearance),
        first_nonfinite=f"line {vertex_lines[wrong[0]] + 1}" if len(wrong) else "",
        source=source if is_one_a_line else None,
    )


def encode_off(contents: FileContents) -> bytes:
    """A new OFF file of positions, colours (COFF, as integers) and faces, closed along seams."""
    columns = [list(map(repr, column.tolist())) for column in contents.vertices.T]
    colors = contents.attributes.get("color")
    if colors is not None:
        scaled = cast_values(colors * (255.0 / contents.color_scale), np.dtype(np.uint8))
        columns += [list(map(str, column.tolist())) for column in scaled.T]
    lines = ["OFF" if colors is None else "COFF", f"{len(contents.vertices)} {len(contents.polygons)} 0"]
    lines += map(" ".join, zip(*columns, strict=True))
    closed = contents.polygons.renumbered(contents.representatives)
    lines += [f"{len(corners)} {' '.join(map(str, corners))}" for corners in closed.rows()]
    return ("\n".join(lines) + "\n").encode("ascii")


def _header(
    rows: list[list[bytes]], filled: list[int], path: Path | None
) -> tuple[re.Match[bytes] | None, int, int, tuple[int, int]]:
    """The keyword, the line of the counts, which of the filled lines is the first vertex, and the two counts."""
    keyword = None
    number = 0
    words = rows[filled[0]] if filled else []
    if words and not words[0].isdigit():
        keyword = KEYWORD.match(words[0])
        if keyword is None or words[1:2] == [b"BINARY"]:
            text = b" ".join(words[:2]).decode("latin-1")
            raise malformed(
                path, f"line {filled[0] + 1}", f"'{text}' is no kind of OFF that is read", "convert the file"
            )
        words = words[1:]
        if not words:
            number = 1
            words = rows[filled[1]] if len(filled) > 1 else []
    if len(words) < 2 or not all(word.isdigit() and len(word) <= LONGEST_COUNT for word in words[:2]):
        line = filled[min(number, len(filled) - 1)] + 1 if filled else 1
        problem = "the counts of vertices and faces are missing or no numbers"
        raise malformed(path, f"line {line}", problem, "check the file's format")
    return keyword, filled[number], number + 1, (int(words[0]), int(words[1]))


def _records(words: list[tuple[bytes, int]], counts: tuple[int, int]) -> tuple[list[list[bytes]], list[int]]:
    """Vertices of three numbers, then faces without colours, however they stand in lines, and each one's first line.

    Nothing unless the words after the count of edges, which some files lack, are just these.
    """
    for lacking in (1, 0):
        rest = words[lacking:]
        starts = list(range(0, 3 * counts[0], 3)) if 3 * counts[0] <= len(rest) else []
        stop = 3 * len(starts)
        while stop < len(rest) and len(starts) < sum(counts) and SIZE.match(rest[stop][0]):
            starts.append(stop)
            stop += 1 + int(rest[stop][0])
        if stop == len(rest) and len(starts) == sum(counts):
            bounds = pairwise([*starts, stop])
            return [[word for word, _ in rest[a:b]] for a, b in bounds], [rest[start][1] for start in starts]
    return [], []


def _table(rows: list[list[bytes]], line_numbers: list[int], path: Path | None) -> Float[np.ndarray, "v c"]:
    """The numbers of the vertex lines."""
    width = len(rows[0])
    for row, line in zip(rows, line_numbers, strict=True):
        if len(row) != width or width < 3:
            problem = f"a vertex with {len(row)} numbers, the first has {width}, at least three are needed"
            raise malformed(path, f"line {line + 1}", problem, "correct the line")
    try:
        return np.array(list(map(real, chain.from_iterable(rows)))).reshape(len(rows), width)
    except ValueError:
        number, word = first_unreadable(rows, real)
        raise malformed(path, f"line {line_numbers[number] + 1}", f"'{word}' is no number", "correct it") from None


def _columns(keyword: re.Match[bytes] | None, width: int, line: int, path: Path | None) -> dict[str, int]:
    """The attributes after the coordinates: normals, colours, texture coordinates, then what no keyword announces."""
    has_uv, has_color, has_normal = (bool(keyword and keyword[group]) for group in (1, 2, 3))
    rest = width - 3 - 3 * has_normal - 2 * has_uv
    # many programs write colours under the plain keyword
    has_color = has_color or (rest in (3, 4) and not has_uv)
    if rest < 0 or (has_color and rest not in (3, 4)):
        raise malformed(
            path, f"line {line + 1}", f"a vertex with {width} numbers does not fit the keyword", "correct it"
        )
    columns = {"normal": 3 * has_normal, "color": rest * has_color, "uv": 2 * has_uv, "extra": rest * (not has_color)}
    return {name: count for name, count in columns.items() if count}


def _all_integers(rows: list[list[bytes]], columns: Mapping[str, int]) -> bool:
    start = 3 + columns.get("normal", 0)
    return all(word.isdigit() for row in rows for word in row[start : start + columns["color"]])


def _polygons(rows: list[list[bytes]], line_numbers: list[int], vertices: int, path: Path | None) -> Polygons:
    """The faces; what follows the corners in a line is a colour."""
    sizes = _integers([row[:1] for row in rows], line_numbers, path)
    for row, size, line in zip(rows, sizes.tolist(), line_numbers, strict=True):
        if size < 3 or len(row) <= size:
            text = b" ".join(row[:8]).decode("latin-1")
            problem = f"a face needs at least three corners and as many as it announces, got '{text}'"
            raise malformed(path, f"line {line + 1}", problem, "correct the line")
    named = [row[1 : 1 + size] for row, size in zip(rows, sizes.tolist(), strict=True)]
    corners = _integers(named, line_numbers, path)
    wrong = np.flatnonzero((corners < 0) | (corners >= vertices))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(sizes), wrong[0], side="right"))
        problem = f"names vertex {corners[wrong[0]]}, but the file has vertices 0 to {vertices - 1}"
        raise malformed(path, f"line {line_numbers[face] + 1}", problem, "correct the index")
    return Polygons.of_sizes(corners, sizes)


def _integers(rows: list[list[bytes]], line_numbers: list[int], path: Path | None) -> Int[np.ndarray, " n"]:
    try:
        return np.array(list(map(integer, chain.from_iterable(rows))), dtype=np.int64)
    except ValueError:
        number, word = first_unreadable(rows, integer)
        raise malformed(path, f"line {line_numbers[number] + 1}", f"'{word}' is no index", "correct it") from None
