"""OFF: text, with polygons, colours, normals and texture coordinates."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.contents import (
    BYTE_ORDER_MARK,
    FileContents,
    color_scale_of,
    converted,
    integer,
    malformed,
    nonfinite_rows,
    real,
    text_rows,
)
from spinor_geom.adapters.extending import cast_values
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives
from spinor_geom.errors import MeshFileError
from spinor_geom.mesh.extension import MeshExtension

# Geomview's order: ST, C, N before OFF; 4 (four coordinates) and n (any number) are not surfaces in space
KEYWORD = re.compile(rb"(ST|st)?(C|c)?(N)?(?:OFF|off)$")
COUNTS = re.compile(rb"^((?:" + BYTE_ORDER_MARK + rb")?\s*(?:[A-Za-z]\w*\s+)?)(\d+)(\s+)(\d+)")
SIZE = re.compile(rb"([3-9]|[1-9]\d{1,8})$")  # of a face
LONGEST_COUNT = 18  # digits; no file holds more
Error: TypeAlias = Callable[[int, str], MeshFileError]  # of a line, from 0, and what is wrong with it


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

    def error(line: int, problem: str) -> MeshFileError:
        return malformed(path, f"line {line + 1}", problem, "correct the line, or convert the file")

    lines = data.splitlines(keepends=True)
    rows = [line.removeprefix(BYTE_ORDER_MARK).partition(b"#")[0].split() for line in lines]
    filled = [index for index, row in enumerate(rows) if row]
    keyword, counts_line, counts = _header(rows, filled, error)
    if not all(counts):
        raise error(counts_line, f"has {counts[0]} vertices and {counts[1]} faces")
    following = filled[filled.index(counts_line) :]
    chosen = following[1 : 1 + sum(counts)]
    records = [rows[line] for line in chosen]
    is_one_a_line = len(chosen) == sum(counts)
    if not is_one_a_line and (keyword is None or not any(keyword.groups())):
        words = [(word, line) for line in following for word in rows[line]]
        records, lines_of_records = _records(words[words[0][0].isalpha() + 2 :], counts)
        chosen = lines_of_records or chosen
    if len(chosen) < sum(counts):
        problem = f"announces {counts[0]} vertices and {counts[1]} faces, but only {len(chosen)} lines follow"
        raise error(counts_line, problem)
    vertex_rows, vertex_lines = records[: counts[0]], chosen[: counts[0]]
    table = _table(vertex_rows, vertex_lines, error)
    columns = _columns(keyword, table.shape[1], vertex_lines[0], error)
    points, *values, _ = np.split(table, np.cumsum([3, *columns.values()]), axis=1)
    attributes = dict(zip(columns, values, strict=True))
    colors = slice(3 + columns.get("normal", 0), 3 + columns.get("normal", 0) + columns.get("color", 0))
    integer_colors = "color" in columns and all(word.isdigit() for row in vertex_rows for word in row[colors])
    color_scale = 255.0 if integer_colors else color_scale_of(attributes.get("color", np.zeros((0, 3))))
    polygons = _polygons(records[counts[0] :], chosen[counts[0] :], counts[0], error)
    appearance = [attributes[name] for name in ("uv", "normal") if name in attributes]
    wrong = nonfinite_rows(points)
    stops = vertex_lines[-1] + 1, chosen[-1] + 1
    return FileContents(
        vertices=points,
        polygons=polygons,
        attributes=attributes,
        color_scale=color_scale,
        representatives=seam_representatives(points, polygons, appearance),
        first_nonfinite=f"line {vertex_lines[wrong[0]] + 1}" if len(wrong) else "",
        suffix=".off" if is_one_a_line else "",
        appended=partial(_appended, lines, counts_line, *stops, columns, integer_colors),
    )


def _appended(
    lines: list[bytes],
    counts_line: int,
    vertex_stop: int,
    face_stop: int,
    columns: Mapping[str, int],
    integer_colors: bool,
    extension: MeshExtension,
) -> bytes:
    """The file's lines with others before `vertex_stop` and `face_stop`; all other text but the counts stays."""
    if len(extension.vertices) == 0 and len(extension.faces) == 0:
        return b"".join(lines)
    given = extension.vertex_attributes
    values = [
        cast_values(given[name], np.dtype(np.int64)) if name == "color" and integer_colors else given[name]
        for name in columns
    ]
    newline = b"\r\n" if lines[0].endswith(b"\r\n") else b"\n"
    vertices = [row.encode("ascii") + newline for row in text_rows(extension.vertices, *values)]
    faces = [f"3 {row}".encode("ascii") + newline for row in text_rows(extension.faces)]
    lines = list(lines)
    lines[counts_line] = COUNTS.sub(
        lambda match: b"%s%d%s%d" % (match[1], int(match[2]) + len(vertices), match[3], int(match[4]) + len(faces)),
        lines[counts_line],
        count=1,
    )
    if not lines[face_stop - 1].endswith(b"\n"):
        lines[face_stop - 1] += newline
    lines[face_stop:face_stop] = faces
    lines[vertex_stop:vertex_stop] = vertices
    return b"".join(lines)


def encode_off(contents: FileContents) -> bytes:
    """A new OFF file of positions, colours (COFF, as integers) and faces, closed along seams."""
    colors = contents.attributes.get("color")
    scaled = [] if colors is None else [cast_values(colors * (255.0 / contents.color_scale), np.dtype(np.uint8))]
    lines = ["COFF" if scaled else "OFF", f"{len(contents.vertices)} {len(contents.polygons)} 0"]
    lines += text_rows(contents.vertices, *scaled)
    closed = contents.polygons.renumbered(contents.representatives)
    lines += [f"{len(corners)} {' '.join(map(str, corners))}" for corners in closed.rows()]
    return ("\n".join(lines) + "\n").encode("ascii")


def _header(
    rows: list[list[bytes]], filled: list[int], error: Error
) -> tuple[re.Match[bytes] | None, int, tuple[int, int]]:
    """The keyword, the line of the counts, and the two counts."""
    keyword = None
    head = [(word, line) for line in filled[:2] for word in rows[line]]
    if head and not head[0][0].isdigit():
        keyword = KEYWORD.match(head[0][0])
        if keyword is None or rows[filled[0]][1:2] == [b"BINARY"]:
            text = b" ".join(rows[filled[0]][:2]).decode("latin-1")
            raise error(filled[0], f"'{text}' is no kind of OFF that is read")
        head = head[1:]
    counts_line = head[0][1] if head else max(filled, default=0)
    counts = [word for word, line in head if line == counts_line][:2]
    if len(counts) < 2 or not all(word.isdigit() and len(word) <= LONGEST_COUNT for word in counts):
        raise error(counts_line, "the counts of vertices and faces are missing or no numbers")
    return keyword, counts_line, (int(counts[0]), int(counts[1]))


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


def _table(rows: list[list[bytes]], lines: list[int], error: Error) -> Float[np.ndarray, "v c"]:
    """The numbers of the vertex lines."""
    width = len(rows[0])
    for row, line in zip(rows, lines, strict=True):
        if len(row) != width or width < 3:
            raise error(line, f"a vertex with {len(row)} numbers, the first has {width}, at least three are needed")
    words = list(chain.from_iterable(rows))
    flat = converted(words, real, lambda number, word: error(lines[number // width], f"'{word}' is no number"))
    return np.array(flat).reshape(len(rows), width)


def _columns(keyword: re.Match[bytes] | None, width: int, line: int, error: Error) -> dict[str, int]:
    """The attributes after the coordinates: normals, colours, texture coordinates, then what no keyword announces."""
    has_uv, has_color, has_normal = (bool(keyword and keyword[group]) for group in (1, 2, 3))
    rest = width - 3 - 3 * has_normal - 2 * has_uv
    # many programs write colours under the plain keyword
    has_color = has_color or (rest in (3, 4) and not has_uv)
    if rest < 0 or (has_color and rest not in (3, 4)):
        raise error(line, f"a vertex with {width} numbers does not fit the keyword")
    columns = {"normal": 3 * has_normal, "color": rest * has_color, "uv": 2 * has_uv, "extra": rest * (not has_color)}
    return {name: count for name, count in columns.items() if count}


def _polygons(rows: list[list[bytes]], lines: list[int], vertices: int, error: Error) -> Polygons:
    """The faces; what follows the corners in a line is a colour."""

    def no_index(line: int, word: str) -> MeshFileError:
        return error(line, f"'{word}' is no index")

    sizes = converted([row[0] for row in rows], integer, lambda number, word: no_index(lines[number], word))
    for row, size, line in zip(rows, sizes, lines, strict=True):
        if size < 3 or len(row) <= size:
            text = b" ".join(row[:8]).decode("latin-1")
            raise error(line, f"a face needs at least three corners and as many as it announces, got '{text}'")
    named = [word for row, size in zip(rows, sizes, strict=True) for word in row[1 : 1 + size]]
    line_of = np.repeat(lines, sizes)
    corners = converted(named, integer, lambda number, word: no_index(line_of[number], word))
    polygons = Polygons.of_sizes(np.array(corners), np.array(sizes))
    return polygons.checked(vertices, lambda face, problem: error(lines[face], problem))
