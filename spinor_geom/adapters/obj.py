"""Wavefront OBJ: read in blocks, and extended without changing the bytes that were read.

The lines `v`, `vt`, `vn`, `f`, `l`, `o` and `g` are read, in lower or upper case. Other lines, such as `mtllib`, are
kept as text. The names after `mtllib` are read. The files are copied when the mesh is written.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import compress

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import (
    BYTE_ORDER_MARK,
    COMMENT,
    UV,
    FileContents,
    color_scale_of,
    convert_words,
    malformed,
    real_numbers,
)
from spinor_geom.adapters.obj_writing import NEWLINE, OWN_GROUP, USE_LINE, appended_obj, textures_of_new_faces
from spinor_geom.adapters.polygon_faces import Polygons, chained
from spinor_geom.adapters.textures import Appearance
from spinor_geom.errors import MeshFileError
from spinor_geom.mesh.array_checks import nonfinite_rows

BLOCK_SIZE = 1 << 22
LONGEST_LINE = 1 << 25
KEYWORDS = (b"v", b"vt", b"vn", b"f", b"l", b"o")
NUMBERS = (b"v", b"vt", b"vn")  # keywords of lines of numbers
ELEMENTS = {b"f": (3, "a face needs three corners"), b"l": (2, "a curve needs two vertices")}
COLORED = ({6}, {7})  # words after `v` where all lines have colours
MATERIALS, LIBRARY_LINE = b"mtllib", re.compile(rb"^[ \t]*mtllib[ \t]+([^\n]{1,1000})$", re.MULTILINE)
WHOLE_LINE_END = re.compile(rb"(?<!\\)\n")


def read_obj(data: bytes) -> FileContents:
    """The vertices, faces, curves and names of an OBJ file, which can be extended.

    Faces are read by their position indices, so that texture and normal seams are no boundaries. `v` lines may have
    colours (three or four numbers after the coordinates; ignored unless all lines have them) or a weight (ignored).
    Texture coordinates and normals become the attributes "uv" and "normal" if each vertex has only one. Pieces of
    curves are joined where two of them meet in a vertex. A MeshFileError names the line that cannot be read.
    """
    newline = (re.search(rb"\r\n|\n|\r", data) or [NEWLINE])[0]
    text = data.replace(b"\r\n", NEWLINE).replace(b"\r", NEWLINE).removeprefix(BYTE_ORDER_MARK)
    if b"\0" in text:
        line = text.count(NEWLINE, 0, text.index(0)) + 1
        raise malformed(f"line {line}", "has a zero byte, so it is not a text file")
    reader = _Reader()
    start, line = 0, 1
    while start < len(text):  # in blocks, as words take many times the memory of the file
        end = WHOLE_LINE_END.search(text, start + BLOCK_SIZE)
        stop = end.end() if end else len(text)
        if stop - start > BLOCK_SIZE + LONGEST_LINE:
            problem = f"a line of more than {LONGEST_LINE >> 20} MiB"
            raise malformed("", problem, "check that this is an OBJ file, or write it in several pieces")
        reader.add(_Block(text[start:stop], first_line=line))
        start, line = stop, line + text.count(NEWLINE, start, stop)
    # a backslash at the end of the file would continue the last line
    ending = (not text.endswith(NEWLINE)) + text[-2:].rstrip().endswith(b"\\")
    contents = reader.contents(data, newline.decode("ascii"), ending)
    names = _library_names(text)
    if not names:
        return contents
    uses = (match[1].decode("utf-8", "replace") for match in USE_LINE.finditer(text))
    materials = tuple(dict.fromkeys(line.removeprefix("usemtl").strip() for line in uses))
    return replace(contents, appearance=Appearance(names=names, materials=materials))


def _library_names(text: bytes) -> tuple[str, ...]:
    """The names after `mtllib`. A line may have several, separated by their suffix and a space."""
    if MATERIALS not in text:
        return ()
    lines = (match[1].decode("utf-8", "replace") for match in LIBRARY_LINE.finditer(text))
    return tuple(
        dict.fromkeys(name.strip() for line in lines for name in re.split(r'(?<=\.mtl)"?\s', line) if name.strip())
    )


class _Reader:
    """Collects the contents of the blocks of a file."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(NUMBERS, 0)
        self.widths: dict[bytes, set[int]] = {key: set() for key in NUMBERS}  # numbers of words after the keyword
        self.values: dict[bytes, list[Float[np.ndarray, "n k"]]] = {key: [] for key in NUMBERS}
        self.nonfinite_places: dict[int, str] = {}
        self.unreadable: dict[bytes, MeshFileError] = {}  # raised only if the numbers are needed
        # for each block the corners of its elements, and the size, the line and the name of each element
        none = np.zeros(0, dtype=np.int64)
        self.elements = {key: [(none.reshape(0, 3), none, none, none)] for key in ELEMENTS}
        self.names = {"": 0}
        self.of_object = self.of_group = ""

    def add(self, block: _Block) -> None:
        block.require_words(b"v", 3, "a vertex needs three coordinates")
        for key in NUMBERS:
            self.widths[key] |= block.widths(key)
        if len(lines := block.lines[b"v"]):
            widths = block.widths(b"v")
            rows = block.floats(b"v", min(widths) if widths in COLORED else 3)
            self.values[b"v"].append(rows)
            wrong = nonfinite_rows(rows[:, :3])
            numbers = block.line_numbers[lines[wrong]].tolist()
            first = self.counts[b"v"]
            self.nonfinite_places |= {
                first + vertex: f"line {number}" for vertex, number in zip(wrong.tolist(), numbers, strict=True)
            }
        for key in (b"vt", b"vn"):
            if len(self.widths[key]) == 1 and key not in self.unreadable:
                try:
                    self.values[key].append(block.floats(key, min(self.widths[key])))
                except MeshFileError as error:
                    self.unreadable[key] = error
        starts, names = self._names(block)
        for key, (least, what) in ELEMENTS.items():
            block.require_words(key, least, what)
            if len(lines := block.lines[key]):
                own_names = np.array(names, dtype=np.int64)[np.searchsorted(starts, lines) - 1]
                corners = block.corners(key, self.counts)
                self.elements[key].append((corners, block.sizes[lines], block.line_numbers[lines], own_names))
        for key in NUMBERS:
            self.counts[key] += len(block.lines[key])

    def _names(self, block: _Block) -> tuple[list[int], list[int]]:
        """The lines of a block after which the object or group changes, and the number of its name."""
        starts, numbers = [-1], [self._name()]
        for line in block.lines[b"o"].tolist():
            keyword, *words = block.words(line)
            name = b" ".join(words).decode("utf-8", "replace")
            self.of_object, self.of_group = (name, "") if keyword in b"oO" else (self.of_object, name)
            starts.append(line)
            numbers.append(self._name())
        return starts, numbers

    def _name(self) -> int:
        """The number of the current object and group."""
        return self.names.setdefault("/".join(filter(None, (self.of_object, self.of_group))), len(self.names))

    def contents(self, data: bytes, newline: str, ending: int) -> FileContents:
        """The whole file. Raises a MeshFileError if there are no vertices, or an index is out of range.

        When the file is extended, `ending` line breaks are written after `data`, its bytes.
        """
        if not self.values[b"v"]:
            raise malformed("", "has no vertices (`v` lines)")
        vertices = np.concatenate([rows[:, :3] for rows in self.values[b"v"]])
        faces, curves = ([np.concatenate(parts) for parts in zip(*own, strict=True)] for own in self.elements.values())
        wrong: list[tuple[int, int]] = []
        for corners, sizes, lines, _ in (faces, curves):
            outside = np.flatnonzero((corners[:, 0] < 0) | (corners[:, 0] >= len(vertices)))[:1].tolist()
            wrong += [(int(np.repeat(lines, sizes)[corner]), int(corners[corner, 0]) + 1) for corner in outside]
        if wrong:
            number, index = min(wrong)
            problem = f"vertex {index} does not exist, the file has {len(vertices)} (numbered from 1)"
            raise malformed(f"line {number}", problem, "correct the index, or complete the file")
        attributes = {}
        if self.widths[b"v"] in COLORED:
            attributes["color"] = np.concatenate([rows[:, 3:] for rows in self.values[b"v"]])
        corner_indices, several, corner_uv = {}, [], None
        for column, name, key in ((1, "uv", b"vt"), (2, "normal", b"vn")):
            own = _index_of_each_vertex(faces[0][:, 0], faces[0][:, column], len(vertices), self.counts[key])
            widths = self.widths[key]
            if own is None and (faces[0][:, column] >= 0).any():
                several.append({"uv": UV, "normal": "normals"}[name])
                indices = faces[0][:, column]
                if name == "uv" and len(widths) == 1 and 0 <= indices.min() <= indices.max() < self.counts[key]:
                    if key in self.unreadable:
                        raise self.unreadable[key]
                    corner_uv = np.concatenate(self.values[key]), indices
            if own is not None and len(widths) == 1 and (widths == {3} if name == "normal" else 0 not in widths):
                if key in self.unreadable:
                    raise self.unreadable[key]
                corner_indices[name] = own
                attributes[name] = np.where(own[:, None] >= 0, np.concatenate(self.values[key])[own], 0.0)
        pieces = np.split(curves[0][:, 0], np.cumsum(curves[1])[:-1]) if len(curves[1]) else []
        chains, names = chained(pieces), tuple(self.names)
        fills = [int(match[1]) if (match := OWN_GROUP.search(name)) else -1 for name in names]
        count = {"uv": self.counts[b"vt"], "normal": self.counts[b"vn"]}
        own_indices = {name: (own, count[name]) for name, own in corner_indices.items()}
        return FileContents(
            vertices=vertices,
            # a copy, so that the other columns need not stay in memory
            polygons=Polygons.of_sizes(faces[0][:, 0].copy(), faces[1]),
            attributes=attributes,
            color_scale=color_scale_of(attributes.get("color", np.zeros(0))),
            representatives=np.arange(len(vertices)),
            polylines=tuple(curve for _, curve in chains),
            names=names,
            polygon_names=faces[3],
            face_loops=np.array(fills, dtype=np.int64)[faces[3]] if max(fills, default=-1) >= 0 else None,
            polyline_names=tuple(names[curves[3][first]] for first, _ in chains),
            nonfinite_places=self.nonfinite_places,
            several=tuple(several),
            corner_uv=corner_uv,
            suffix=".obj",
            appended=partial(
                appended_obj,
                data,
                newline * ending,
                newline,
                "color" in attributes,
                own_indices,
                None if corner_uv is None else partial(textures_of_new_faces, data, faces, vertices),
            ),
        )


class _Block:
    """Part of an OBJ file, split into lines.

    A line that ends with a backslash, but not with a comment or a name, is joined to the next one.

    Attributes:
        line_numbers: of each line in the file, from 1.
        sizes: how many words follow the first one on each line, −1 on blank lines.
        lines: which lines begin with each of `KEYWORDS`. Those of groups are among those of objects.
    """

    def __init__(self, data: bytes, *, first_line: int) -> None:
        data += 2 * NEWLINE  # so that two letters follow the first letter of every word
        ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord(NEWLINE))
        # comments first: one that ends with a backslash ends there, too, and so does a name, which may be a path
        joined = rb"(?m)^(?![ \t]*(?:[go]|usemtl|mtllib)[ \t])(.*)\\\n"
        for mark, pattern in ((b"#", rb"()" + COMMENT), (b"\\", joined)):
            if mark in data:
                data = re.sub(pattern, lambda match: match[1].ljust(len(match[0])), data)
        letters = np.array(np.frombuffer(data, np.uint8))
        is_end = letters[ends] == ord(NEWLINE)
        self.line_numbers = first_line + np.append(0, np.flatnonzero(is_end) + 1)[:-1]
        is_space = (letters == ord(" ")) | (letters - ord("\t") <= ord("\r") - ord("\t"))
        starts = np.flatnonzero(~is_space & np.append(True, is_space[:-1]))
        bounds = np.append(0, np.searchsorted(starts, ends[is_end]))
        self.sizes = np.diff(bounds) - 1
        filled = np.flatnonzero(self.sizes >= 0)
        first, second = starts[bounds[filled]], starts[bounds[filled]] + 1
        one, two = (letters[at].astype(np.int64) | 0x20 for at in (first, second))  # small letters
        two[is_space[second]] = 0
        keywords = np.where(is_space[second] | is_space[second + 1], one + (two << 8), 0)
        keywords[keywords == ord("g")] = ord("o")
        self.lines = {key: filled[keywords == int.from_bytes(key, "little")] for key in KEYWORDS}
        letters[first] = letters[second[two > 0]] = ord(" ")
        self._data, self._after_keywords, self._line_ends = data, letters.tobytes(), np.append(0, ends[is_end] + 1)

    def words(self, line: int) -> list[bytes]:
        return self._data[self._line_ends[line] : self._line_ends[line + 1]].split()

    def widths(self, key: bytes) -> set[int]:
        return set(np.unique(self.sizes[self.lines[key]]).tolist())

    def _text(self, key: bytes) -> bytes:
        """The text after the keyword on all of its lines."""
        lines = self.lines[key]
        after_gap = np.flatnonzero(np.diff(lines, prepend=-2) > 1)
        last = np.append(lines[after_gap[1:] - 1], lines[-1:])
        runs = zip(self._line_ends[lines[after_gap]].tolist(), self._line_ends[last + 1].tolist(), strict=True)
        return b"".join([self._after_keywords[start:stop] for start, stop in runs])

    def _error(self, line: int, problem: str, advice: str) -> MeshFileError:
        return malformed(f"line {self.line_numbers[line]}", problem, advice)

    def require_words(self, key: bytes, least: int, what: str) -> None:
        """Raises a MeshFileError if fewer than `least` words follow the keyword on a line."""
        lines = self.lines[key]
        for line in lines[self.sizes[lines] < least][:1].tolist():
            text = b" ".join(self.words(line)).decode("utf-8", "replace")
            raise self._error(line, f"{what}, got '{text}'", "complete or remove the line")

    def floats(self, key: bytes, count: int) -> Float[np.ndarray, "n {count}"]:
        """The first words after the keyword on all of its lines, as numbers."""

        def error(number: int, word: str) -> MeshFileError:
            line = self.lines[key][number // count]
            return self._error(line, f"'{word}' is not a number", "correct the line")

        text, sizes = self._text(key), self.sizes[self.lines[key]]
        words = text.split()
        if not (sizes == count).all():
            place = np.arange(len(words)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
            words = list(compress(words, (place < count).tobytes()))
        return np.array(convert_words(words, real_numbers, error), dtype=np.float64).reshape(len(sizes), count)

    def corners(self, key: bytes, counts: dict[bytes, int]) -> Int[np.ndarray, "n 3"]:
        """The indices (position, texture, normal) from 0 of all corners on the lines, or −1 where one is not given.

        `counts` has the numbers of lines in the blocks before this one. A position before the first vertex is returned
        as in the file, less 1, for the error message.
        """
        text = self._text(key)
        line_of = np.repeat(self.lines[key], self.sizes[self.lines[key]])

        def error(number: int, word: str) -> MeshFileError:
            return self._error(line_of[number], f"'{word}' is not a corner", "write v, v/vt, v//vn or v/vt/vn")

        corners = _uniform_corners(text, len(line_of))
        if corners is None:
            corners = np.array(convert_words(text.split(), _any_corners, error), dtype=np.int64)
        if (corners < 0).any():
            before = [counts[name] + np.searchsorted(self.lines[name], line_of) for name in NUMBERS]
            resolved = corners + np.stack(before, axis=1) + 1
            corners = np.where((corners < 0) & (resolved > 0), resolved, corners)
            # an index before the file's first element is not the same as "not given"
            corners[:, 1:] = np.where(corners[:, 1:] < 0, np.iinfo(np.int64).max, corners[:, 1:])
        return corners - 1


def _uniform_corners(text: bytes, count: int) -> Int[np.ndarray, "{count} 3"] | None:
    """Corners as in the file, 0 where an index is not given, or None unless all are valid and have the same form."""
    # the form of a corner is the number of its slashes, if nothing else is left without its digits
    marks = text.translate(None, b"-0123456789").split()
    slashes = len(marks[0]) if marks else 0
    if slashes > 2 or marks != [b"/" * slashes] * (count if slashes else 0):
        return None
    text, is_signed = text.replace(b"//", b"/0/").replace(b"/", b" "), b"-" in text
    corners = np.zeros((count, 3), dtype=np.int64)
    try:
        # `fromstring` takes a quarter of the time, but reads no signs. Numbers of 64 bits become negative
        flat = np.array(list(map(int, text.split()))) if is_signed else np.fromstring(text, np.uint64, sep=" ")
        corners[:, : slashes + 1] = flat.reshape(count, slashes + 1)
    except (ValueError, OverflowError):
        return None
    return corners if is_signed or corners.min() >= 0 else None


def _any_corners(words: Sequence[bytes]) -> list[list[int]]:
    """Corners in any of the four forms as in the file, 0 where an index is not given."""
    corners = []
    for word in words:
        position, *others = word.split(b"/")
        indices = [int(position), *(int(other or b"0") for other in others)]
        if len(indices) > 3 or b"_" in word or not -(2**63) <= min(indices) <= max(indices) < 2**63:
            raise ValueError(word)
        corners.append(indices + [0] * (3 - len(indices)))
    return corners


def _index_of_each_vertex(
    positions: Int[np.ndarray, " n"], others: Int[np.ndarray, " n"], vertices: int, count: int
) -> Int[np.ndarray, " {vertices}"] | None:
    """The texture or normal index of each vertex, −1 in no face, or None if a vertex has several, or a corner none."""
    if len(others) == 0 or (others < 0).any() or (others >= count).any():
        return None
    own = np.full(vertices, -1, dtype=np.int64)
    own[positions] = others
    return own if (own[positions] == others).all() else None
