"""Wavefront OBJ read block by block, and appended to without a change of its own bytes.

`v`, `vt`, `vn`, `f` and `l` are read, capitals too, and of `o` and `g` the names. Nothing that a file names is opened
or run: `mtllib`, `call` and the like are lines of text, which stay in the file.
"""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress, pairwise
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, Int

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
from spinor_geom.mesh.triangle_mesh import MeshExtension

BLOCK_SIZE = 1 << 22
LONGEST_LINE = 1 << 25
LARGEST_INDEX = 2**62  # so that sums of two indices fit 64 bits
GROUP = "spinor_geom_fill"
NEWLINE = b"\n"
KEYS = (b"v", b"vt", b"vn", b"f", b"l", b"o")  # first words of lines
COUNTED = (b"v", b"vt", b"vn")
COLORED = ({6}, {7})  # words behind `v` where all lines have so many


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjText:
    """An OBJ file's elements, and what is needed to go on writing it."""

    contents: FileContents  # vertices, polygons, attributes and curves, without a source
    names: tuple[str, ...]  # of objects and groups, as "object/group"; the first is ""
    face_names: Int[np.ndarray, " p"]  # of each polygon, as a number among them
    curve_names: tuple[str, ...]  # of each of the contents' curves: that of its first piece
    # for "uv" and "normal", where the file gives each vertex only one, its number there; −1 for a vertex in no face
    corner_indices: dict[str, Int[np.ndarray, " v"]]
    counts: dict[str, int]  # of `vt` and `vn` lines, by the same names
    newline: bytes  # what ends its lines
    ending: bytes  # what has to follow its last byte before a new line can begin


def read_obj_stream(stream: BinaryIO) -> ObjText:
    """The vertices, faces, curves and names of an OBJ file, read once from where the stream stands.

    Faces are read by their position indices, so texture and normal seams leave no trace. `v` lines may carry colours
    (three or four numbers after the coordinates; they count if all lines have them) or a weight (ignored). Texture
    coordinates and normals become the attributes "uv" and "normal" where each vertex has only one. Pieces of curves are
    joined where two of them meet in a vertex. A MeshFileError names the line that cannot be understood.
    """
    reader = _Reader()
    # one byte a letter, with all line ends alike
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("latin-1")(), translate=True)
    last, line = b"", 1
    for block in _blocks(stream, decoder):
        if b"\0" in block:
            at = f"line {line + block.count(NEWLINE, 0, block.index(0))}"
            raise malformed(at, "a zero byte, so this is no OBJ text", "check the file's format")
        reader.add(_Block(block.removeprefix(BYTE_ORDER_MARK) if line == 1 else block, first_line=line))
        line, last = line + block.count(NEWLINE), block[-2:]
    ends = decoder.newlines or "\n"
    newline = (ends if isinstance(ends, str) else ends[0]).encode("ascii")
    # a backslash at the very end would continue the last line into what follows
    ending = b"" if last.endswith(NEWLINE) else newline
    return reader.text(newline, ending + (newline if last.rstrip().endswith(b"\\") else b""))


def _blocks(stream: BinaryIO, decoder: io.IncrementalNewlineDecoder) -> Iterator[bytes]:
    """The file in blocks that end with a line that no backslash continues."""
    rest, searched = "", 0
    while read := stream.read(BLOCK_SIZE):
        rest += decoder.decode(read)
        end = len(rest)
        while (end := rest.rfind("\n", searched, end)) > 0 and rest[end - 1] == "\\":
            pass
        if end >= 0:
            yield rest[: end + 1].encode("latin-1")
            rest = rest[end + 1 :]
        elif len(rest) > LONGEST_LINE:
            problem = f"a line of more than {LONGEST_LINE >> 20} MiB"
            raise malformed("", problem, "check that this is an OBJ file, or write it in several pieces")
        searched = len(rest)
    if rest := rest + decoder.decode(b"", final=True):
        yield rest.encode("latin-1")


class _Reader:
    """What the blocks read so far have given."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(COUNTED, 0)
        self.widths: dict[bytes, set[int]] = {key: set() for key in COUNTED}  # words of their lines
        self.values: dict[bytes, list[Float[np.ndarray, "n k"]]] = {key: [] for key in COUNTED}
        self.first_nonfinite = ""
        self.unreadable: dict[bytes, MeshFileError] = {}
        # of faces and curves in each block: their corners, and of each how many these are, its line and its name
        none = np.zeros(0, dtype=np.int64)
        self.elements = {key: [(none.reshape(0, 3), none, none, none)] for key in (b"f", b"l")}
        self.names = {"": 0}
        self.of_object = self.of_group = ""

    def add(self, block: _Block) -> None:
        block.check_sizes(b"v", least=3, what="a vertex needs three coordinates")
        if len(block.standing[b"v"]):
            widths = block.widths(b"v")
            self.widths[b"v"] |= widths
            rows = block.floats(b"v", min(widths) if widths in COLORED else 3)
            self.values[b"v"].append(rows)
            if not self.first_nonfinite and len(wrong := nonfinite_rows(rows[:, :3])):
                self.first_nonfinite = f"line {block.line_numbers[block.standing[b'v'][wrong[0]]]}"
        block.check_sizes(b"f", least=3, what="a face needs three corners")
        block.check_sizes(b"l", least=2, what="a curve needs two vertices")
        starts, names = self._names(block)
        for key in (b"f", b"l"):
            lines = block.standing[key]
            if len(lines):
                corners = block.corners(key, self.counts)
                own_names = np.array(names, dtype=np.int64)[np.searchsorted(starts, lines) - 1]
                self.elements[key].append((corners, block.sizes[lines], block.line_numbers[lines], own_names))
        for key in (b"vt", b"vn"):
            # as long as they may all be used; an unreadable one matters only then
            self.widths[key] |= block.widths(key)
            if len(self.widths[key]) != 1 or key in self.unreadable or min(self.widths[key]) < 1:
                self.values[key].clear()
                continue
            try:
                self.values[key].append(block.floats(key, min(self.widths[key])))
            except MeshFileError as error:
                self.unreadable[key] = error
        for key in COUNTED:
            self.counts[key] += len(block.standing[key])

    def _names(self, block: _Block) -> tuple[list[int], list[int]]:
        """Behind which lines of a block which name holds, as a number."""
        starts, numbers = [-1], [self._number()]
        for line in block.standing[b"o"].tolist():
            keyword, *words = block.row(line)
            name = b" ".join(words).decode("utf-8", "replace")
            self.of_object, self.of_group = (name, "") if keyword in b"oO" else (self.of_object, name)
            starts.append(line)
            numbers.append(self._number())
        return starts, numbers

    def _number(self) -> int:
        return self.names.setdefault("/".join(filter(None, (self.of_object, self.of_group))), len(self.names))

    def text(self, newline: bytes, ending: bytes) -> ObjText:
        """All of it; a MeshFileError if there are no vertices, or an index is of none."""
        if not self.values[b"v"]:
            raise malformed("", "has no vertices (`v` lines)", "check that the file is complete and is an OBJ file")
        vertices = np.concatenate([rows[:, :3] for rows in self.values[b"v"]])
        faces, curves = ([np.concatenate(parts) for parts in zip(*own, strict=True)] for own in self.elements.values())
        wrong: list[tuple[int, int]] = []
        for corners, sizes, lines, _ in (faces, curves):
            outside = np.flatnonzero((corners[:, 0] < 0) | (corners[:, 0] >= len(vertices)))[:1].tolist()
            wrong += [(int(np.repeat(lines, sizes)[corner]), int(corners[corner, 0]) + 1) for corner in outside]
        if wrong:
            number, index = min(wrong)
            problem = f"'{index}' names a vertex that does not exist, the file has {len(vertices)} (numbered from 1)"
            raise malformed(f"line {number}", problem, "correct the index, or complete the file")
        attributes = {}
        if self.widths[b"v"] in COLORED:
            attributes["color"] = np.concatenate([rows[:, 3:] for rows in self.values[b"v"]])
        corner_indices = {}
        for column, name, key in ((1, "uv", b"vt"), (2, "normal", b"vn")):
            own = _index_of_each_vertex(faces[0][:, 0], faces[0][:, column], len(vertices), self.counts[key])
            widths = self.widths[key]
            if own is None or len(widths) != 1 or 0 in widths or (name == "normal" and widths != {3}):
                continue
            if key in self.unreadable:
                raise self.unreadable[key]
            corner_indices[name] = own
            attributes[name] = np.where(own[:, None] >= 0, np.concatenate(self.values[key])[own], 0.0)
        pieces = np.split(curves[0][:, 0], np.cumsum(curves[1])[:-1]) if len(curves[1]) else []
        chains, names = chained(pieces), tuple(self.names)
        contents = FileContents(
            vertices=vertices,
            polygons=Polygons.of_sizes(faces[0][:, 0], faces[1]),
            attributes=attributes,
            color_scale=color_scale_of(attributes.get("color", np.zeros(0))),
            representatives=np.arange(len(vertices)),
            polylines=tuple(curve for _, curve in chains),
            first_nonfinite=self.first_nonfinite,
        )
        return ObjText(
            contents=contents,
            names=names,
            face_names=faces[3],
            curve_names=tuple(names[curves[3][first]] for first, _ in chains),
            corner_indices=corner_indices,
            counts={"uv": self.counts[b"vt"], "normal": self.counts[b"vn"]},
            newline=newline,
            ending=ending,
        )


class _Block:
    """The lines of a part of an OBJ file, those that end with a backslash joined to the next.

    Known are the number of each line in the file, how many words follow the first on it (−1 on blank lines), and which
    lines begin with each of `KEYS`; those of groups stand among those of objects.
    """

    def __init__(self, data: bytes, *, first_line: int) -> None:
        data += 2 * NEWLINE  # so that three letters stand wherever a word begins
        ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord(NEWLINE))
        for mark, pattern in ((b"\\", rb"\\\n"), (b"#", rb"#[^\n]*")):
            if mark in data:
                data = re.sub(pattern, lambda match: b" " * len(match[0]), data)
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
        self.standing = {key: filled[keywords == int.from_bytes(key, "little")] for key in KEYS}
        letters[first] = letters[second[two > 0]] = ord(" ")
        self._data, self._behind_keys, self._line_ends = data, letters.tobytes(), np.append(0, ends[is_end] + 1)

    def row(self, line: int) -> list[bytes]:
        return self._data[self._line_ends[line] : self._line_ends[line + 1]].split()

    def widths(self, key: bytes) -> set[int]:
        return set(np.unique(self.sizes[self.standing[key]]).tolist())

    def _text(self, key: bytes) -> bytes:
        """What follows the key on all of its lines."""
        lines = self.standing[key]
        after_gap = np.flatnonzero(np.diff(lines, prepend=-2) > 1)
        last = np.append(lines[after_gap[1:] - 1], lines[-1:])
        runs = zip(self._line_ends[lines[after_gap]].tolist(), self._line_ends[last + 1].tolist(), strict=True)
        return b"".join([self._behind_keys[start:stop] for start, stop in runs])

    def _error(self, line: int, problem: str, advice: str) -> MeshFileError:
        return malformed(f"line {self.line_numbers[line]}", problem, advice)

    def check_sizes(self, key: bytes, *, least: int, what: str) -> None:
        """Whether enough words follow the key on all of its lines."""
        lines = self.standing[key]
        for line in lines[self.sizes[lines] < least][:1].tolist():
            text = b" ".join(self.row(line)).decode("utf-8", "replace")
            raise self._error(line, f"{what}, got '{text}'", "complete or remove the line")

    def floats(self, key: bytes, count: int) -> Float[np.ndarray, "n {count}"]:
        """The first words behind the key on all of its lines, as numbers."""

        def error(number: int, word: str) -> MeshFileError:
            line = self.standing[key][number // count]
            return self._error(line, f"'{word}' is no number", "correct the line")

        text, sizes = self._text(key), self.sizes[self.standing[key]]
        words = text.split()
        if not (sizes == count).all():
            place = np.arange(len(words)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
            words = list(compress(words, (place < count).tobytes()))
        convert = real if b"_" in text else float  # `float` takes underscores, at a fraction of the time of `real`
        return np.array(converted(words, convert, error), dtype=np.float64).reshape(-1, count)

    def corners(self, key: bytes, counts: dict[bytes, int]) -> Int[np.ndarray, "n 3"]:
        """The indices (position, texture, normal) from 0 of all corners on the lines; −1 where one is not given.

        `counts` elements stand in the blocks before this one. A position before the first of all is as it is written.
        """
        text = self._text(key)
        line_of = np.repeat(self.standing[key], self.sizes[self.standing[key]])

        def error(number: int, word: str) -> MeshFileError:
            return self._error(line_of[number], f"'{word}' is no corner", "write v, v/vt, v//vn or v/vt/vn")

        corners = _uniform_corners(text, len(line_of))
        if corners is None:
            corners = np.array(converted(text.split(), _corner, error), dtype=np.int64)
        if (corners < 0).any():
            before = [counts[name] + np.searchsorted(self.standing[name], line_of) for name in COUNTED]
            resolved = corners + np.stack(before, axis=1) + 1
            corners = np.where((corners < 0) & (resolved > 0), resolved, corners)
            # an index before the file's first element must not pass for "not given"
            corners[:, 1:] = np.where(corners[:, 1:] < 0, np.iinfo(np.int64).max, corners[:, 1:])
        return corners - 1


def _uniform_corners(text: bytes, count: int) -> Int[np.ndarray, "{count} 3"] | None:
    """Corners as they stand in the file, 0 where not given; None unless they all have one form, and are well-formed."""
    # what is left without the numbers tells whether all corners have one form, much faster than looking at each
    marks = text.translate(None, b"-0123456789").split()
    slashes = len(marks[0]) if marks else 0
    if slashes > 2 or marks != [b"/" * slashes] * (count if slashes else 0):
        return None
    text, is_signed = text.replace(b"//", b"/0/").replace(b"/", b" "), b"-" in text
    corners = np.zeros((count, 3), dtype=np.int64)
    try:
        # of digits alone numpy reads numbers at a quarter of the time, those of 64 bits as negative ones
        flat = np.array(list(map(int, text.split()))) if is_signed else np.fromstring(text, np.uint64, sep=" ")
        corners[:, : slashes + 1] = flat.reshape(count, slashes + 1)
    except (ValueError, OverflowError):
        return None
    return corners if is_signed or corners.min() >= 0 else None


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


def added_lines(text: ObjText, extension: MeshExtension) -> bytes:
    """What to write after a file's last byte: vertices with all that the file gives each of its own, and faces."""
    if len(extension.vertices) == 0 and len(extension.faces) == 0:
        return b""
    colors = [extension.vertex_attributes["color"]] if "color" in text.contents.attributes else []
    newline = text.newline.decode("ascii")
    lines = [_number_lines("v", np.hstack([extension.vertices, *colors]), newline)]
    corners = [extension.faces.ravel() + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in text.corner_indices:
            lines.append(_number_lines(keyword, extension.vertex_attributes[name], newline))
            first = text.counts[name]
            all_indices = np.concatenate([text.corner_indices[name], np.arange(first, first + len(extension.vertices))])
            # a vertex in no face has none: any valid number will do
            corners.append(np.maximum(all_indices[extension.faces.ravel()], 0) + 1)
    for start, stop in runs_of(extension.face_loops):
        lines.append(f"g {GROUP}_{extension.face_loops[start]}{newline}")
        own = [numbers[3 * start : 3 * stop] for numbers in corners]
        sizes = np.full(stop - start, 3)
        lines.append(_face_lines(own, sizes, newline, skip_uv="uv" not in text.corner_indices))
    return text.ending + "".join(lines).encode("ascii")


def runs_of(values: Int[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """Where runs of equal values start and stop."""
    starts = np.flatnonzero(np.diff(values)) + 1
    return list(pairwise([0, *starts.tolist(), len(values)])) if len(values) else []


def read_obj(data: bytes) -> FileContents:
    """What `read_obj_stream` reads of an OBJ file, with its text as the source to append to."""
    text = read_obj_stream(io.BytesIO(data))
    return replace(text.contents, suffix=".obj", appended=lambda extension: data + added_lines(text, extension))


def encode_obj(contents: FileContents) -> bytes:
    """A new OBJ file of vertices (with colours), texture coordinates, normals, faces and curves."""
    colors = [contents.attributes["color"] / contents.color_scale] if "color" in contents.attributes else []
    lines = [_number_lines("v", np.hstack([contents.vertices, *colors]))]
    corners = [contents.representatives[contents.polygons.corners] + 1]
    for name, keyword in (("uv", "vt"), ("normal", "vn")):
        if name in contents.attributes:
            lines.append(_number_lines(keyword, contents.attributes[name]))
            corners.append(contents.polygons.corners + 1)
    starts, loops = contents.polygons.starts, contents.loop_of_faces
    for first, last in runs_of(loops):
        lines += [f"g {GROUP}_{loops[first]}\n"] if loops[first] >= 0 else []
        own = [numbers[starts[first] : starts[last]] for numbers in corners]
        lines.append(_face_lines(own, contents.polygons.sizes[first:last], skip_uv="uv" not in contents.attributes))
    lines += ["l " + " ".join(map(str, (curve + 1).tolist())) + "\n" for curve in contents.polylines]
    return "".join(lines).encode("ascii")


def _number_lines(keyword: str, rows: Float[np.ndarray, "n k"], newline: str = "\n") -> str:
    """A line for each row, of numbers from which the very same float64 values are read."""
    line = f"{keyword}{' %r' * rows.shape[1]}{newline}"
    return line * len(rows) % tuple(rows.ravel().tolist())


def _face_lines(
    corners: Sequence[Int[np.ndarray, " n"]], sizes: Int[np.ndarray, " f"], newline: str = "\n", *, skip_uv: bool
) -> str:
    """Faces by the numbers at all their corners: of positions, texture (or a gap) and normals."""
    word = " " + ("//" if skip_uv else "/").join(["%d"] * len(corners))
    of_size = {size: f"f{word * size}{newline}" for size in np.unique(sizes).tolist()}
    return "".join(map(of_size.__getitem__, sizes.tolist())) % tuple(np.stack(corners, axis=1).ravel().tolist())
