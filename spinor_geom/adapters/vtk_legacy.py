"""VTK's legacy files (.vtk) of polygonal data and unstructured grids, text and binary, versions 1 to 5.

VTK's own reader ends the process for some malformed files.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Shaped

from spinor_geom.adapters.contents import malformed
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.vtk_arrays import Data, VtkMesh, checked_cells, counted_cells, numbers_of, texts_of
from spinor_geom.errors import MeshFileError

TYPES = {
    "bit": "u1",
    "char": "i1",
    "signed_char": "i1",
    "unsigned_char": "u1",
    "short": "i2",
    "unsigned_short": "u2",
    "int": "i4",
    "unsigned_int": "u4",
    "vtkidtype": "i4",
    "long": "i8",
    "long_long": "i8",
    "vtktypeint64": "i8",
    "unsigned_long": "u8",
    "unsigned_long_long": "u8",
    "vtktypeuint64": "u8",
    "float": "f4",
    "double": "f8",
}
STRINGS = ("string", "utf8_string")
CELLS = {"VERTICES": "Verts", "LINES": "Lines", "POLYGONS": "Polys", "TRIANGLE_STRIPS": "Strips", "CELLS": "Cells"}
# arrays with a fixed number of columns, and their roles
WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1, "EDGE_FLAGS": 1}
ROLES = {"SCALARS": "Scalars", "COLOR_SCALARS": "Scalars", "NORMALS": "Normals", "TEXTURE_COORDINATES": "TCoords"}
MOST_WORDS = 1 << 18  # words converted at a time, which take many times the memory of their text
WORD = re.compile(rb"\S+")


def read_legacy(data: bytes) -> VtkMesh:
    """The mesh in a legacy file. A MeshFileError names the section that cannot be read."""
    text = _Text(data)
    header, _, encoding = text.line(), text.line(), text.word()
    version = re.match(rb"# vtk DataFile Version (\d+)", header, re.IGNORECASE)
    if version is None or encoding not in ("ASCII", "BINARY"):
        raise malformed("line 1", "does not begin like a legacy VTK file", "check that this is a .vtk file")
    text.is_binary = encoding == "BINARY"
    kind = text.word() and text.word()
    if kind not in ("POLYDATA", "UNSTRUCTURED_GRID"):
        problem = f"holds '{kind}', not POLYDATA or UNSTRUCTURED_GRID"
        raise malformed("line 4", problem, "extract the surface and write it as polygonal data")
    points, types = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    cells: dict[str, Polygons] = {}
    data_of = {"": Data(), "POINT_DATA": Data(), "CELL_DATA": Data()}
    target, rows = data_of[""], 0
    while section := text.word():
        text.section = section
        if section == "POINTS":
            count, name = text.count(), text.word()
            points = text.values(count, 3, name).reshape(-1, 3)
        elif section in CELLS:
            cells[CELLS[section]] = text.cells(len(points), offsets=int(version[1]) >= 5)
        elif section == "CELL_TYPES":
            types = text.values(text.count(), 1, "int")
        elif section in ("POINT_DATA", "CELL_DATA"):
            target, rows = data_of[section], text.count()
        elif section == "METADATA":
            text.skip_metadata()
        elif section == "FIELD":
            text.word()
            for _ in range(text.count()):
                name, width = text.name(), text.count()
                target.arrays[name] = text.values(text.count(), width, text.word())
                text.skip_metadata(optional=True)
        elif section == "LOOKUP_TABLE":  # colours for scalars
            text.word()
            text.values(text.count(), 4, "unsigned_char" if text.is_binary else "float")
        elif section in WIDTHS or section in ROLES:
            _attribute(text, section, rows, target)
        else:
            raise malformed(f"byte {text.position}", f"'{section[:40]}' is not a section of a legacy VTK file")
    return VtkMesh(
        points=points,
        cells={name: cells[name] for name in CELLS.values() if name in cells},
        types=types if kind == "UNSTRUCTURED_GRID" else None,
        point_data=data_of["POINT_DATA"],
        cell_data=data_of["CELL_DATA"],
        field_data=data_of[""],
    )


def _attribute(text: _Text, section: str, rows: int, target: Data) -> None:
    name = text.name()
    if section == "COLOR_SCALARS":
        values = text.values(rows, text.count(), "unsigned_char" if text.is_binary else "float")
        if not text.is_binary:
            values = np.clip(np.rint(values * 255.0), 0.0, 255.0).astype(np.uint8)
    elif section == "SCALARS":
        kind, *width = text.rest_of_line() or [""]
        if text.next_is("LOOKUP_TABLE"):
            text.word()
        values = text.values(rows, text.as_count(width[0]) if width else 1, kind)
    else:
        width_of_row = WIDTHS[section] if section in WIDTHS else text.count()
        values = text.values(rows, width_of_row, text.word())
    target.arrays[name] = values
    if section in ROLES:
        target.active.setdefault(ROLES[section], name)


@dataclass(eq=False)
class _Text:
    """A file and the position up to which it has been read."""

    data: bytes
    position: int = 0
    is_binary: bool = False
    section: str = ""

    def line(self) -> bytes:
        stop = self.data.find(b"\n", self.position) + 1 or len(self.data)
        line, self.position = self.data[self.position : stop], stop
        return line.strip()

    def rest_of_line(self) -> list[str]:
        return self.line().decode("latin-1").split()

    def _next(self) -> bytes:
        match = WORD.search(self.data, self.position)
        self.position = match.end() if match else len(self.data)
        return match[0] if match else b""

    def word(self) -> str:
        """The next word in capitals, or "" at the end."""
        return self._next()[:200].decode("latin-1").upper()

    def name(self) -> str:
        """The next word as the name of an array, in which other characters than letters are %XX."""
        return unquote(self._next().decode("utf-8", "replace"))

    def next_is(self, word: str) -> bool:
        """Whether a word follows. If so, it is read."""
        before = self.position
        if self.word() == word:
            return True
        self.position = before
        return False

    def count(self) -> int:
        """The next word as the number of rows or columns."""
        return self.as_count(self.word())

    def as_count(self, word: str) -> int:
        # a number takes at least a bit of the file
        if not (word.isascii() and word.isdigit() and len(word) < 20 and int(word) <= 8 * len(self.data)):
            raise malformed(self.section, f"declares '{word[:40]}' items in a file of {len(self.data)} bytes")
        return int(word)

    def skip_metadata(self, *, optional: bool = False) -> None:
        """Skips the lines up to a blank one, if optional only after the word METADATA."""
        if not optional or self.next_is("METADATA"):
            self.line()
            while self.line():
                pass

    def cells(self, points: int, *, offsets: bool) -> Polygons:
        """The cells of a section."""
        count, size = self.count(), self.count()
        if not offsets:
            numbers = self.values(size, 1, "int")
            return counted_cells(numbers, count, points=points, place=self.section)
        parts = [np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64)]
        for part, (name, length) in enumerate((("OFFSETS", count), ("CONNECTIVITY", size))):
            if length and not self.next_is(name):
                raise malformed(self.section, f"its {name} are missing")
            if length:
                parts[part] = self.values(length, 1, self.word())
        return checked_cells(*parts, points=points, place=self.section)

    def values(self, rows: int, width: int, kind: str) -> Shaped[np.ndarray, "{rows} *k"]:
        """The next rows of numbers, or of text: (rows,), or (rows, width) for several columns."""
        count, kind = rows * width, kind.lower()
        if kind in STRINGS:
            found = self._strings(count)
        elif kind not in TYPES:
            raise malformed(self.section, f"'{kind[:40]}' is not a supported type of numbers")
        elif self.is_binary:
            found = self._binary(count, kind)
        else:
            found = self._numbers(count, np.dtype(TYPES["long" if kind == "vtkidtype" else kind]))
        return found if width == 1 else found.reshape(rows, width)

    def _binary(self, count: int, kind: str) -> Shaped[np.ndarray, "{count}"]:
        self.line()
        dtype = np.dtype(TYPES[kind]).newbyteorder(">")
        size = -(-count // 8) if kind == "bit" else count * dtype.itemsize
        if size > len(self.data) - self.position:
            raise self._too_short(count)
        stored = np.frombuffer(self.data, np.uint8, size, self.position)
        self.position += size
        if kind == "bit":
            return np.unpackbits(stored, count=count)
        numbers: np.ndarray = stored.view(dtype).astype(TYPES[kind])
        return numbers

    def _numbers(self, count: int, dtype: np.dtype[Any]) -> Shaped[np.ndarray, "{count}"]:
        """The next words as numbers."""
        if count > len(self.data) - self.position:
            raise self._too_short(count)
        blocks = [np.zeros(0, dtype=dtype)]
        while count:
            start, words = self.position, min(count, MOST_WORDS)
            last = deque(islice(WORD.finditer(self.data, start), words), maxlen=1)
            self.position = last[0].end() if last else len(self.data)
            found = self.data[start : self.position].split()
            if len(found) < words:
                raise self._too_short(count)
            blocks.append(numbers_of(found, dtype, self.section))
            count -= words
        return np.concatenate(blocks)

    def _strings(self, count: int) -> Shaped[np.ndarray, "{count}"]:
        self.line()
        found = []
        for _ in range(count):
            if self.position >= len(self.data):
                raise self._too_short(count)
            if self.is_binary:  # the first two bits tell how many bytes the length has
                size = 1 << (3 - (self.data[self.position] >> 6))
                start = self.position + size
                length = int.from_bytes(self.data[self.position : start], "big") % (1 << (8 * size - 2))
                self.position = min(start + length, len(self.data))
                found.append(self.data[start : self.position].decode("utf-8", "replace"))
            else:
                found.append(unquote(self.line().decode("utf-8", "replace")))
        return texts_of(found, len(self.data), self.section)

    def _too_short(self, count: int) -> MeshFileError:
        return malformed(self.section, f"declares {count} values, but the file ends before the last one")
