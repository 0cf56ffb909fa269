"""Wavefront OBJ read block by block: only the numbers stay in memory, not the text.

`v`, `vt`, `vn`, `f` and `l` are read, capitals too, and of `o` and `g` the names. Nothing that a file names is opened
or run: `mtllib`, `call` and the like are lines of text.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.adapters.contents import (
    BYTE_ORDER_MARK,
    FileContents,
    color_scale_of,
    converted,
    integer,
    malformed,
    nonfinite_rows,
    real,
)
from spinor_geom.adapters.polygons import Polygons, chained
from spinor_geom.errors import MeshFileError

BLOCK_SIZE = 1 << 22
LONGEST_LINE = 1 << 25
LARGEST_INDEX = 2**62  # so that sums of two indices fit 64 bits
KEYS = (b"v", b"vt", b"vn", b"f", b"l", b"o", b"g")
COUNTED = (b"v", b"vt", b"vn")

Row = list[bytes]


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjText:
    """An OBJ file's elements, and what is needed to go on writing it.

    Attributes:
        contents: vertices, polygons, attributes and curves, without a source.
        names: of objects and groups, as "object/group" where both are given; the first is "".
        face_names: (P,) int64, the name of each polygon as a number among them.
        curve_names: the name of each of the contents' curves: that of its first piece.
        color_width: how many colour values follow the coordinates in its `v` lines: 0, 3 or 4.
        corner_indices: for "uv" and "normal", where the file gives each vertex only one, its (V,) number among the `vt`
            and `vn` lines, −1 where a vertex is in no face.
        counts: how many `vt` and `vn` lines the file has, by the same names.
        newline: what ends its lines.
        ending: what has to follow its last byte before a new line can begin.
    """

    contents: FileContents
    names: tuple[str, ...]
    face_names: Int[np.ndarray, " p"]
    curve_names: tuple[str, ...]
    color_width: int
    corner_indices: dict[str, Int[np.ndarray, " v"]]
    counts: dict[str, int]
    newline: bytes
    ending: bytes


def read_obj_stream(stream: BinaryIO, path: Path | None) -> ObjText:
    """The vertices, faces, curves and names of an OBJ file.

    Faces are read by their position indices, so texture and normal seams leave no trace. `v` lines may carry colours
    (three or four numbers after the coordinates; they count if all lines have them) or a weight (ignored). Texture
    coordinates and normals become the attributes "uv" and "normal" where each vertex has only one. Pieces of curves are
    joined where two of them meet in a vertex.

    Args:
        stream: the file, read once from where it stands to its end.
        path: for messages.

    Raises:
        MeshFileError: not text, no vertices, or a line that cannot be understood; names the line.
    """
    collected = _Collected(path=path)
    newline, last, place, line = b"\n", b"", 0, 1
    for number, (block, lines_end) in enumerate(_blocks(stream, path)):
        if number == 0:
            newline = lines_end
        if b"\0" in block:
            at = f"byte {place + block.index(0)}"
            raise malformed(path, at, "a zero byte, so this is no OBJ text", "check the file's format")
        text = block.removeprefix(BYTE_ORDER_MARK) if number == 0 else block
        collected.add(_Block(text, path, split_at=newline[-1:], first_line=line))
        place, line, last = place + len(block), line + block.count(newline[-1:]), block[-2:]
    # a backslash at the very end would continue the last line into what follows
    ending = b"" if last.endswith(newline) else newline
    return collected.text(newline, ending + (newline if last.rstrip(b"\r\n").endswith(b"\\") else b""))


def _blocks(stream: BinaryIO, path: Path | None) -> Iterator[tuple[bytes, bytes]]:
    """The file in blocks that end where a line does, and what ends lines in each."""
    rest = bytearray()
    split_at = b""
    searched = 0
    while read := stream.read(BLOCK_SIZE):
        rest += read
        if not split_at and (b"\n" in rest or rest.find(b"\r", 0, -1) >= 0):
            split_at = b"\n" if b"\n" in rest else b"\r"
        cut = _end_of_last_line(rest, split_at, searched)
        if cut:
            yield bytes(rest[:cut]), _newline(rest)
            del rest[:cut]
        elif len(rest) > LONGEST_LINE:
            problem = f"a line of more than {LONGEST_LINE >> 20} MiB"
            raise malformed(path, "", problem, "check that this is an OBJ file, or write it in several pieces")
        searched = len(rest) if split_at else 0
    if rest:
        yield bytes(rest), _newline(rest)


def _end_of_last_line(text: bytearray, split_at: bytes, start: int) -> int:
    """Where the last line ends that ends beyond `start` and that no backslash continues; 0 where none does."""
    stop = len(text)
    while split_at and (end := text.rfind(split_at, start, stop)) >= 0:
        if not text[max(end - 2, 0) : end].rstrip(b"\r").endswith(b"\\"):
            return end + 1
        stop = end
    return 0


def _newline(data: bytearray) -> bytes:
    if b"\r\n" in data:
        return b"\r\n"
    return b"\n" if b"\n" in data or b"\r" not in data else b"\r"


@dataclass(kw_only=True, eq=False)
class _Collected:
    """What the blocks read so far have given."""

    path: Path | None
    counts: dict[bytes, int] = field(default_factory=lambda: dict.fromkeys(COUNTED, 0))
    vertices: list[Float[np.ndarray, "n 3"]] = field(default_factory=list)
    colors: list[Float[np.ndarray, "n k"]] = field(default_factory=list)
    widths: set[int] = field(default_factory=set)
    first_nonfinite: str = ""
    values: dict[bytes, list[Float[np.ndarray, "n k"]]] = field(default_factory=lambda: {b"vt": [], b"vn": []})
    lengths: dict[bytes, set[int]] = field(default_factory=lambda: {b"vt": set(), b"vn": set()})
    unreadable: dict[bytes, MeshFileError] = field(default_factory=dict)
    corners: dict[bytes, list[Int[np.ndarray, "n 3"]]] = field(default_factory=lambda: {b"f": [], b"l": []})
    sizes: dict[bytes, list[Int[np.ndarray, " n"]]] = field(default_factory=lambda: {b"f": [], b"l": []})
    lines: dict[bytes, list[Int[np.ndarray, " n"]]] = field(default_factory=lambda: {b"f": [], b"l": []})
    labels: dict[bytes, list[Int[np.ndarray, " n"]]] = field(default_factory=lambda: {b"f": [], b"l": []})
    wrong: list[tuple[int, str]] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=lambda: {"": 0})
    of_object: str = ""
    of_group: str = ""

    def add(self, block: _Block) -> None:
        """Takes the elements of the next block."""
        block.check_lengths(b"v", least=3, what="a vertex needs three coordinates")
        self._add_vertices(block)
        block.check_lengths(b"f", least=3, what="a face needs three corners")
        block.check_lengths(b"l", least=2, what="a curve needs two vertices")
        for key in (b"f", b"l"):
            if block.of(key):
                corners, wrong = block.corners(key, self.counts)
                self.corners[key].append(corners)
                self.wrong += wrong
                self.sizes[key].append(np.array([len(row) - 1 for row in block.of(key)], dtype=np.int64))
                self.lines[key].append(block.line_numbers(key))
        self._add_names(block)
        for key in (b"vt", b"vn"):
            self._add_values(block, key)
        for key in COUNTED:
            self.counts[key] += len(block.of(key))

    def _add_vertices(self, block: _Block) -> None:
        lengths = set(map(len, block.of(b"v")))
        if not lengths:
            return
        self.vertices.append(block.floats(b"v", 1, 4))
        if not self.first_nonfinite and len(wrong := nonfinite_rows(self.vertices[-1])):
            self.first_nonfinite = f"line {block.line_numbers(b'v')[wrong[0]]}"
        self.widths |= lengths
        if self.widths in ({7}, {8}):
            self.colors.append(block.floats(b"v", 4, min(lengths)))
        else:
            self.colors.clear()

    def _add_values(self, block: _Block, key: bytes) -> None:
        """Texture coordinates or normals, as long as they may all be used; an unreadable one matters only then."""
        self.lengths[key] |= set(map(len, block.of(key)))
        if len(self.lengths[key]) != 1 or key in self.unreadable or min(self.lengths[key]) < 2:
            self.values[key].clear()
            return
        try:
            self.values[key].append(block.floats(key, 1, min(self.lengths[key])))
        except MeshFileError as error:
            self.unreadable[key] = error

    def _add_names(self, block: _Block) -> None:
        """The names that hold at each face and curve of a block."""
        starts, numbers = [-1], [self._number()]
        for row, key, words in block.name_rows():
            name = b" ".join(words).decode("utf-8", "replace")
            if key == b"o":
                self.of_object, self.of_group = name, ""
            else:
                self.of_group = name
            starts.append(row)
            numbers.append(self._number())
        for key in (b"f", b"l"):
            at = np.searchsorted(starts, block.rows_of(key)) - 1
            self.labels[key].append(np.array(numbers, dtype=np.int64)[at])

    def _number(self) -> int:
        name = "/".join(filter(None, (self.of_object, self.of_group)))
        return self.names.setdefault(name, len(self.names))

    def text(self, newline: bytes, ending: bytes) -> ObjText:
        """All of it; checks what only the whole file tells.

        Raises:
            MeshFileError: no vertices, or an index of none.
        """
        if not self.vertices:
            advice = "check that the file is complete and is an OBJ file"
            raise malformed(self.path, "", "has no vertices (`v` lines)", advice)
        vertices = np.concatenate(self.vertices)
        corners = {key: _joined(parts, (0, 3)) for key, parts in self.corners.items()}
        self._check_corners(corners, len(vertices))
        attributes = {}
        width = {frozenset({7}): 3, frozenset({8}): 4}.get(frozenset(self.widths), 0)
        if width:
            attributes["color"] = np.concatenate(self.colors)
        corner_indices = {}
        for column, name, key in ((1, "uv", b"vt"), (2, "normal", b"vn")):
            own = _index_of_each_vertex(corners[b"f"][:, 0], corners[b"f"][:, column], len(vertices), self.counts[key])
            lengths = self.lengths[key]
            if own is None or len(lengths) != 1 or (name == "normal" and lengths != {4}):
                continue
            if key in self.unreadable:
                raise self.unreadable[key]
            corner_indices[name] = own
            attributes[name] = np.where(own[:, None] >= 0, np.concatenate(self.values[key])[own], 0.0)
        pieces = np.split(corners[b"l"][:, 0], np.cumsum(_joined(self.sizes[b"l"], (0,)))[:-1])
        chains = chained(pieces) if len(corners[b"l"]) else ()
        labels, names = _joined(self.labels[b"l"], (0,)), tuple(self.names)
        contents = FileContents(
            vertices=vertices,
            polygons=Polygons.of_sizes(corners[b"f"][:, 0], _joined(self.sizes[b"f"], (0,))),
            attributes=attributes,
            color_scale=color_scale_of(attributes["color"]) if width else 1.0,
            representatives=np.arange(len(vertices)),
            polylines=tuple(curve for _, curve in chains),
            first_nonfinite=self.first_nonfinite,
        )
        return ObjText(
            contents=contents,
            names=names,
            face_names=_joined(self.labels[b"f"], (0,)),
            curve_names=tuple(names[labels[first]] for first, _ in chains),
            color_width=width,
            corner_indices=corner_indices,
            counts={"uv": self.counts[b"vt"], "normal": self.counts[b"vn"]},
            newline=newline,
            ending=ending,
        )

    def _check_corners(self, corners: dict[bytes, Int[np.ndarray, "n 3"]], vertices: int) -> None:
        wrong = list(self.wrong)
        for key in (b"f", b"l"):
            beyond = np.flatnonzero(corners[key][:, 0] >= vertices)
            if len(beyond):
                line = np.searchsorted(np.cumsum(np.concatenate(self.sizes[key])), beyond[0], side="right")
                wrong.append((int(np.concatenate(self.lines[key])[line]), str(corners[key][beyond[0], 0] + 1)))
        if wrong:
            number, word = min(wrong)
            problem = f"'{word}' names a vertex that does not exist, the file has {vertices} (numbered from 1)"
            raise malformed(self.path, f"line {number}", problem, "correct the index, or complete the file")


class _Block:
    """The lines of a part of an OBJ file as words, by their first word."""

    def __init__(self, data: bytes, path: Path | None, *, split_at: bytes, first_line: int) -> None:
        self.path = path
        lines, numbers = _logical_lines(data, split_at)
        self._first_line, self._line_numbers = first_line, numbers
        commented = b"#" in data
        codes = {key: code for code, key in enumerate(KEYS, start=1)}
        self._by_key: dict[bytes, list[Row]] = {key: [] for key in KEYS}
        found = bytearray(len(lines))
        for number, line in enumerate(lines):
            row = (line.partition(b"#")[0] if commented else line).split()
            code = (codes.get(row[0]) or codes.get(row[0].lower())) if row else None
            if code:
                self._by_key[KEYS[code - 1]].append(row)
                found[number] = code
        self._codes = np.frombuffer(found, dtype=np.uint8)

    def of(self, key: bytes) -> list[Row]:
        """The lines that begin with one of the known words."""
        return self._by_key[key]

    def rows_of(self, key: bytes) -> Int[np.ndarray, " n"]:
        """Where those lines stand among the block's lines."""
        return np.flatnonzero(self._is(key))

    def _is(self, key: bytes) -> Bool[np.ndarray, " n"]:
        return np.asarray(self._codes == KEYS.index(key) + 1)

    def line_numbers(self, key: bytes) -> Int[np.ndarray, " n"]:
        """Their numbers in the file, from 1."""
        numbers: Int[np.ndarray, " n"] = np.fromiter(self._line_numbers, dtype=np.int64)[self.rows_of(key)]
        return self._first_line + numbers

    def name_rows(self) -> Iterator[tuple[int, bytes, Row]]:
        """The lines that name objects and groups: their place, their first word, and the name's words."""
        rows = (
            (int(row), words)
            for key in (b"o", b"g")
            for row, words in zip(self.rows_of(key), self.of(key), strict=True)
        )
        for row, words in sorted(rows):
            yield row, words[0].lower(), words[1:]

    def error(self, key: bytes, number: int, problem: str, advice: str) -> MeshFileError:
        """The error at line `number` of those that begin with a word."""
        return malformed(self.path, f"line {self.line_numbers(key)[number]}", problem, advice)

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
        words = [row[start:stop] for row in rows]
        flat = converted(words, real, partial(self._unreadable, key, "number", "correct the line"))
        return np.array(flat, dtype=np.float64).reshape(len(rows), stop - start)

    def _unreadable(self, key: bytes, what: str, advice: str, number: int, word: str) -> MeshFileError:
        return self.error(key, number, f"'{word}' is no {what}", advice)

    def corners(self, key: bytes, counts: dict[bytes, int]) -> tuple[Int[np.ndarray, "n 3"], list[tuple[int, str]]]:
        """The indices (position, texture, normal) from 0 of all corners on the lines; −1 where one is not given.

        Args:
            key: the lines' first word.
            counts: how many elements the blocks before this one have.

        Returns:
            The indices, and the first line with a position that cannot exist and the word there, if there is one.
        """
        rows = self.of(key)
        words = list(chain.from_iterable(row[1:] for row in rows))
        corners = _uniform_corners(words)
        if corners is None:
            error = partial(self._unreadable, key, "corner", "write v, v/vt, v//vn or v/vt/vn")
            corners = np.array(converted([row[1:] for row in rows], _corner, error), dtype=np.int64).reshape(-1, 3)
        line_of = np.repeat(np.arange(len(rows)), [len(row) - 1 for row in rows])
        if (corners < 0).any():
            standing = self.rows_of(key)
            before = np.stack([counts[name] + np.cumsum(self._is(name))[standing] for name in COUNTED], axis=1)
            corners = np.where(corners < 0, corners + before[line_of] + 1, corners)
            # an index before the file's first element must not pass for "not given"
            corners[:, 1:] = np.where(corners[:, 1:] < 0, np.iinfo(np.int64).max, corners[:, 1:])
        wrong = np.flatnonzero(corners[:, 0] < 1)[:1].tolist()
        at = [(int(self.line_numbers(key)[line_of[i]]), words[i].decode("utf-8", "replace")) for i in wrong]
        return corners - 1, at


def _joined(parts: Sequence[Int[np.ndarray, " *n"]], empty: tuple[int, ...]) -> Int[np.ndarray, " *n"]:
    joined: Int[np.ndarray, " *n"] = np.concatenate(parts) if parts else np.zeros(empty, dtype=np.int64)
    return joined


def _logical_lines(data: bytes, split_at: bytes) -> tuple[list[bytes], Iterable[int]]:
    """The lines, those that end with a backslash joined to the next, and on which of the block's lines each begins."""
    lines = data.split(split_at)
    if b"\\" not in data:
        return lines, range(len(lines))
    joined: list[bytes] = []
    line_numbers = []
    pieces: list[bytes] = []
    for number, line in enumerate(lines):
        text = line.rstrip(b"\r")
        if not pieces:
            line_numbers.append(number)
        pieces.append(text.removesuffix(b"\\"))
        if not text.endswith(b"\\") or number == len(lines) - 1:
            joined.append(b" ".join(pieces))
            pieces = []
    return joined, line_numbers


def _uniform_corners(words: list[bytes]) -> Int[np.ndarray, "n 3"] | None:
    """Corners as they stand in the file, 0 where not given; None unless they all have one form, and are well-formed."""
    text = b" ".join(words)
    slashes = words[0].count(b"/") if words else 0
    # what is left without the numbers tells whether all corners have one form, much faster than looking at each
    if slashes > 2 or text.translate(None, b"-0123456789") != b" ".join([b"/" * slashes] * len(words)):
        return None
    corners = np.zeros((len(words), 3), dtype=np.int64)
    try:
        flat = list(map(int, text.replace(b"//", b"/0/").replace(b"/", b" ").split()))
        corners[:, : slashes + 1] = np.array(flat, dtype=np.int64).reshape(len(words), slashes + 1)
    except (ValueError, OverflowError):
        return None
    return corners


def _corner(word: bytes) -> tuple[int, int, int]:
    """One corner, in any of the four forms."""
    parts = [*word.split(b"/"), b"", b""]
    if len(parts) > 5:
        raise ValueError(word)
    position, texture, normal = integer(parts[0]), integer(parts[1] or b"0"), integer(parts[2] or b"0")
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
