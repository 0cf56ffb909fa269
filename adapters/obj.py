"""Wavefront OBJ: reading to position indices, and appending to a file without touching what it says.

Only `v`, `vt`, `vn`, `f` and `l` are read. Nothing that a file names is opened or run: `mtllib`, `call` and the like
are lines of text that stay in the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import Addition, FileContents, color_scale_of, first_unreadable, malformed, numbers
from spinor_geom.adapters.polygons import Polygons, chained
from spinor_geom.errors import MeshFileError

GROUP = "spinor_geom_fill"
LARGEST_INDEX = 2**62  # so that sums of two indices fit 64 bits

Row = list[bytes]


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjSource:
    """The text of an OBJ file and what is needed to go on writing it.

    Attributes:
        data: the file's bytes.
        color_width: how many colour values follow the coordinates in its `v` lines: 0, 3 or 4.
        corner_indices: for "uv" and "normal", where the file gives each vertex only one, its (V,) number among the `vt`
            and `vn` lines, −1 where a vertex is in no face.
        counts: how many `vt` and `vn` lines the file has, by the same names.
    """

    data: bytes
    color_width: int
    corner_indices: dict[str, Int[np.ndarray, " v"]]
    counts: dict[str, int]
    suffix: str = ".obj"

    def appended(self, addition: Addition) -> bytes:
        """The file's own bytes, then `v` lines (with colours, if the file's have them) and a group of faces."""
        if len(addition.vertices) == 0 and len(addition.faces) == 0:
            return self.data
        columns = [addition.vertices]
        if self.color_width:
            columns.append(addition.attributes["color"])
        lines = [f"v {numbers(row)}" for row in np.hstack(columns)]
        corners = [addition.faces + 1]
        for name, keyword in (("uv", "vt"), ("normal", "vn")):
            if name in self.corner_indices:
                lines += [f"{keyword} {numbers(row)}" for row in addition.attributes[name]]
                first = self.counts[name]
                all_indices = np.concatenate(
                    [self.corner_indices[name], np.arange(first, first + len(addition.vertices))]
                )
                # a vertex in no face has none: any valid number will do
                corners.append(np.maximum(all_indices[addition.faces], 0) + 1)
        lines.append(f"g {GROUP}")
        lines += _face_lines(np.stack(corners, axis=2), skip_uv="uv" not in self.corner_indices)
        newline = _newline(self.data)
        text = newline.join(line.encode("ascii") for line in lines) + newline
        # a backslash at the very end would continue the last line into ours
        open_end = b"" if self.data.endswith(newline) else newline
        return self.data + open_end + (newline if self.data.rstrip(b"\r\n").endswith(b"\\") else b"") + text


def read_obj(data: bytes, path: Path | None) -> FileContents:
    """The vertices, faces and curves of an OBJ file.

    Faces are read by their position indices, so texture and normal seams leave no trace. `v` lines may carry colours
    (three or four numbers after the coordinates; they count if all lines have them) or a weight (ignored). Texture
    coordinates and normals become the attributes "uv" and "normal" where each vertex has only one.

    Raises:
        MeshFileError: not text, no vertices, or a line that cannot be understood; names the line.
    """
    if b"\0" in data:
        raise malformed(path, f"byte {data.index(0)}", "a zero byte, so this is no OBJ text", "check the file's format")
    rows = _Rows(data, path)
    vertex_rows = rows.of(b"v")
    if not vertex_rows:
        raise malformed(path, "", "has no vertices (`v` lines)", "check that the file is complete and is an OBJ file")
    rows.check_lengths(b"v", least=3, what="a vertex needs three coordinates")
    lengths = set(map(len, vertex_rows))
    width = {frozenset({7}): 3, frozenset({8}): 4}.get(frozenset(lengths), 0)
    vertices = rows.floats(b"v", 1, 4)
    attributes = {"color": rows.floats(b"v", 4, 4 + width)} if width else {}
    rows.check_lengths(b"f", least=3, what="a face needs three corners")
    corners = rows.corners(b"f", vertices=len(vertices))
    sizes = np.array([len(row) - 1 for row in rows.of(b"f")], dtype=np.int64)
    corner_indices = {}
    for column, name, keyword in ((1, "uv", b"vt"), (2, "normal", b"vn")):
        own = _index_of_each_vertex(corners[:, 0], corners[:, column], len(vertices), len(rows.of(keyword)))
        lengths = set(map(len, rows.of(keyword)))
        if own is None or len(lengths) != 1 or (name == "normal" and lengths != {4}):
            continue
        values = rows.floats(keyword, 1, min(lengths))
        corner_indices[name] = own
        attributes[name] = np.where(own[:, None] >= 0, values[own], 0.0)
    source = ObjSource(
        data=data,
        color_width=width,
        corner_indices=corner_indices,
        counts={"uv": len(rows.of(b"vt")), "normal": len(rows.of(b"vn"))},
    )
    return FileContents(
        vertices=vertices,
        polygons=Polygons.of_sizes(corners[:, 0], sizes),
        attributes=attributes,
        color_scale=color_scale_of(attributes["color"]) if width else 1.0,
        representatives=np.arange(len(vertices)),
        polylines=_polylines(rows, len(vertices)),
        source=source,
    )


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    columns = [contents.vertices]
    if "color" in contents.attributes:
        columns.append(contents.attributes["color"] / contents.color_scale)
    lines = [f"v {numbers(row)}" for row in np.hstack(columns)]
    corners = [contents.representatives[contents.polygons.corners] + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in contents.attributes:
            lines += [f"{keyword} {numbers(row)}" for row in contents.attributes[name]]
            corners.append(contents.polygons.corners + 1)
    tokens = _corner_tokens(np.stack(corners, axis=1), skip_uv="uv" not in contents.attributes)
    starts = contents.polygons.starts.tolist()
    lines += ["f " + " ".join(tokens[a:b]) for a, b in pairwise(starts)]
    lines += ["l " + " ".join(map(str, (curve + 1).tolist())) for curve in contents.polylines]
    return ("\n".join(lines) + "\n").encode("ascii")


class _Rows:
    """The lines of an OBJ file as words, by their first word."""

    def __init__(self, data: bytes, path: Path | None) -> None:
        self.path = path
        lines, self._line_numbers = _logical_lines(data)
        commented = b"#" in data
        self._keys: list[bytes] = []
        self._by_key: dict[bytes, list[Row]] = {key: [] for key in (b"v", b"vt", b"vn", b"f", b"l")}
        for row in ((line.partition(b"#")[0] if commented else line).split() for line in lines):
            key = row[0] if row else b""
            self._keys.append(key)
            if key in self._by_key:
                self._by_key[key].append(row)

    def of(self, key: bytes) -> list[Row]:
        """The lines that begin with a word, which is one of v, vt, vn, f, l."""
        return self._by_key[key]

    def error(self, key: bytes, number: int, problem: str, advice: str) -> MeshFileError:
        """The error at line `number` of those that begin with a word."""
        rows = (index for index, own in enumerate(self._keys) if own == key)
        line = next(index for count, index in enumerate(rows) if count == number)
        return malformed(self.path, f"line {self._line_numbers[line]}", problem, advice)

    def check_lengths(self, key: bytes, *, least: int, what: str) -> None:
        """Whether all lines that begin with a word have enough other words."""
        rows = self.of(key)
        if rows and min(map(len, rows)) <= least:
            number = next(index for index, row in enumerate(rows) if len(row) <= least)
            text = b" ".join(rows[number]).decode("utf-8", "replace")
            raise self.error(key, number, f"{what}, got '{text}'", "complete or remove the line")

    def floats(self, key: bytes, start: int, stop: int) -> Float[np.ndarray, "n k"]:
        """Words `start` to `stop` of all lines that begin with a word, as numbers."""
        rows = self.of(key)
        try:
            flat = list(map(float, chain.from_iterable(row[start:stop] for row in rows)))
        except ValueError:
            number, word = first_unreadable((row[start:stop] for row in rows), float)
            raise self.error(key, number, f"'{word}' is no number", "correct the line") from None
        return np.array(flat, dtype=np.float64).reshape(len(rows), stop - start)

    def corners(self, key: bytes, *, vertices: int) -> Int[np.ndarray, "n 3"]:
        """The indices (position, texture, normal) from 0 of all corners on the lines; −1 where one is not given."""
        rows = self.of(key)
        words = list(chain.from_iterable(row[1:] for row in rows))
        corners = _split_corners(words)
        if corners is None:
            number, word = first_unreadable((row[1:] for row in rows), _corner)
            raise self.error(key, number, f"'{word}' is no corner", "write v, v/vt, v//vn or v/vt/vn")
        line_of = np.repeat(np.arange(len(rows)), [len(row) - 1 for row in rows])
        if (corners < 0).any():
            before = np.stack([self._count_before(key, name) for name in (b"v", b"vt", b"vn")], axis=1)
            corners = np.where(corners < 0, corners + before[line_of] + 1, corners)
            # an index before the file's first element must not pass for "not given"
            corners[:, 1:] = np.where(corners[:, 1:] < 0, np.iinfo(np.int64).max, corners[:, 1:])
        wrong = np.flatnonzero((corners[:, 0] < 1) | (corners[:, 0] > vertices))
        if len(wrong):
            line = int(line_of[wrong[0]])
            word = words[wrong[0]].decode("utf-8", "replace")
            problem = f"'{word}' names a vertex that does not exist, the file has {vertices} (numbered from 1)"
            raise self.error(key, line, problem, "correct the index, or complete the file")
        return corners - 1

    def _count_before(self, key: bytes, counted: bytes) -> Int[np.ndarray, " n"]:
        """How many lines that begin with `counted` stand before each line that begins with `key`."""
        is_counted = np.array([own == counted for own in self._keys], dtype=bool)
        is_key = np.array([own == key for own in self._keys], dtype=bool)
        return np.asarray(np.cumsum(is_counted)[is_key])


def _logical_lines(data: bytes) -> tuple[list[bytes], Sequence[int]]:
    """The lines, those that end with a backslash joined to the next, and the number each begins at."""
    lines = data.split(b"\n" if b"\n" in data else b"\r")
    if b"\\" not in data:
        return lines, range(1, len(lines) + 1)
    joined: list[bytes] = []
    line_numbers = []
    continued = False
    for number, line in enumerate(lines, start=1):
        text = line.rstrip(b"\r")
        if continued:
            joined[-1] += b" " + text
        else:
            joined.append(text)
            line_numbers.append(number)
        continued = text.endswith(b"\\")
        if continued:
            joined[-1] = joined[-1][:-1]
    return joined, line_numbers


def _newline(data: bytes) -> bytes:
    if b"\r\n" in data:
        return b"\r\n"
    return b"\n" if b"\n" in data or b"\r" not in data else b"\r"


def _split_corners(words: list[bytes]) -> Int[np.ndarray, "n 3"] | None:
    """Corners "v", "v/vt", "v//vn" or "v/vt/vn" as they stand in the file, 0 where not given; None if malformed."""
    text = b" ".join(words)
    slashes = words[0].count(b"/") if words else 0
    # what is left without the numbers tells whether all corners have one form, much faster than looking at each
    is_uniform = text.translate(None, b"-0123456789") == b" ".join([b"/" * slashes] * len(words))
    corners = np.zeros((len(words), 3), dtype=np.int64)
    try:
        if is_uniform and slashes <= 2:
            flat = list(map(int, text.replace(b"//", b"/0/").replace(b"/", b" ").split()))
            if len(flat) == (slashes + 1) * len(words):
                corners[:, : slashes + 1] = np.array(flat, dtype=np.int64).reshape(-1, slashes + 1)
                return corners
        return np.array(list(map(_corner, words)), dtype=np.int64).reshape(-1, 3)
    except (ValueError, OverflowError):
        return None


def _corner(word: bytes) -> tuple[int, int, int]:
    """One corner, in any of the four forms."""
    parts = [*word.split(b"/"), b"", b""]
    if len(parts) > 5:
        raise ValueError(word)
    position, texture, normal = int(parts[0]), int(parts[1] or 0), int(parts[2] or 0)
    if max(abs(position), abs(texture), abs(normal)) > LARGEST_INDEX:
        raise ValueError(word)
    return position, texture, normal


def _index_of_each_vertex(
    positions: Int[np.ndarray, " n"], others: Int[np.ndarray, " n"], vertices: int, count: int
) -> Int[np.ndarray, " {vertices}"] | None:
    """The texture or normal index of each vertex, −1 in no face; None unless it is one and the same at all corners."""
    if len(others) == 0 or (others < 0).any() or (others >= count).any():
        return None
    own = np.full(vertices, -1, dtype=np.int64)
    own[positions] = others
    return own if (own[positions] == others).all() else None


def _polylines(rows: _Rows, vertices: int) -> tuple[Int[np.ndarray, " _"], ...]:
    if not rows.of(b"l"):
        return ()
    rows.check_lengths(b"l", least=2, what="a curve needs two vertices")
    corners = rows.corners(b"l", vertices=vertices)[:, 0]
    return chained(np.split(corners, np.cumsum([len(row) - 1 for row in rows.of(b"l")])[:-1]))


def _corner_tokens(corners: Int[np.ndarray, "n c"], *, skip_uv: bool) -> list[str]:
    """Corners as words: one index, or indices of position, texture and normal with a gap where there is no texture."""
    columns = [list(map(str, column)) for column in corners.T.tolist()]
    if len(columns) == 1:
        return columns[0]
    return list(map(("//" if skip_uv else "/").join, zip(*columns, strict=True)))


def _face_lines(corners: Int[np.ndarray, "t 3 c"], *, skip_uv: bool) -> list[str]:
    tokens = _corner_tokens(corners.reshape(-1, corners.shape[2]), skip_uv=skip_uv)
    return [f"f {a} {b} {c}" for a, b, c in zip(tokens[::3], tokens[1::3], tokens[2::3], strict=True)]
