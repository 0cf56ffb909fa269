"""The header of a PLY file: which elements it holds, and what each record is made of."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.adapters.contents import BYTE_ORDER_MARK, malformed

TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
LONGEST_COUNT = 18  # digits; no file holds more
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyProperty:
    """One property of an element.

    Attributes:
        name: its name.
        dtype: the type of its value, or of the values of a list.
        count_dtype: for a list the type of the number of values before them, else None.
    """

    name: str
    dtype: np.dtype[Any]
    count_dtype: np.dtype[Any] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyElement:
    """One kind of record: its name, how many there are, and its properties."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyHeader:
    """A PLY header.

    Attributes:
        text: its bytes, up to and with the line end after "end_header".
        encoding: how the records are written, one of `BYTE_ORDERS`.
        elements: the kinds of records, in the file's order.
        newline: how its lines end.
    """

    text: bytes
    encoding: str
    elements: tuple[PlyElement, ...]
    newline: bytes

    @property
    def size(self) -> int:
        """Its length in bytes, where the records begin."""
        return len(self.text)

    def with_more(self, counts: Mapping[str, int]) -> bytes:
        """The header's text with higher counts of some elements, otherwise unchanged."""
        text = self.text
        for element in self.elements:
            if counts.get(element.name):
                name = re.escape(element.name.encode("latin-1"))
                pattern = rb"((?:^|[\r\n])[ \t]*element[ \t]+" + name + rb"[ \t]+)\d+"
                total = str(element.count + counts[element.name]).encode("ascii")
                text = re.sub(pattern, rb"\g<1>" + total, text, count=1)
        return text


def read_header(data: bytes, path: Path | None) -> PlyHeader:
    """The header of a PLY file.

    Raises:
        MeshFileError: not a PLY file, or a header line that cannot be understood; names the line.
    """
    start = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    if not re.match(rb"ply\s", data[start : start + 4]):
        raise malformed(path, "line 1", "does not begin with 'ply'", "check the file's format")
    end = re.search(rb"(?:^|[\r\n])end_header[ \t]*(\r\n|\n|\r)", data)
    if end is None:
        raise malformed(path, "header", "has no line 'end_header'", "check that the file is complete")
    # an end like "\r" before binary data that begins with "\n" is ambiguous; the first line of the file tells
    newline = b"\r\n" if data[start + 3 : start + 5] == b"\r\n" else data[start + 3 : start + 4]
    size = end.start(1) + len(newline) if end[1].startswith(newline) else end.end()
    lines = [line.split() for line in re.split(r"\r\n|\n|\r", data[start:size].decode("latin-1"))]
    encoding = next((line[1] for line in lines if line[:1] == ["format"] and line[1:]), None)
    if encoding not in BYTE_ORDERS:
        raise malformed(path, "header", f"the format is {encoding}", f"use one of {', '.join(BYTE_ORDERS)}")
    elements: list[PlyElement] = []
    for number, words in enumerate(lines, start=1):
        match words:
            case [] | ["ply" | "end_header" | "comment" | "obj_info" | "format", *_]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) <= LONGEST_COUNT:
                elements.append(PlyElement(name=name, count=int(count), properties=()))
            case ["property", *description] if elements:
                added = _property(description, BYTE_ORDERS[encoding])
                if added is None or added.name in {item.name for item in elements[-1].properties}:
                    problem = f"'{' '.join(words)}' is of unknown type, or the second of its name"
                    raise malformed(path, f"line {number}", problem, "correct the header")
                elements[-1] = replace(elements[-1], properties=(*elements[-1].properties, added))
            case _:
                raise malformed(path, f"line {number}", f"cannot understand '{' '.join(words)}'", "correct the header")
    names = [element.name for element in elements]
    if len(set(names)) != len(names):
        raise malformed(path, "header", "has two elements of one name", "rename one")
    return PlyHeader(text=data[:size], encoding=encoding, elements=tuple(elements), newline=newline)


def _property(description: list[str], order: str) -> PlyProperty | None:
    """A property as its header line describes it after the word "property", or None if it cannot be understood."""
    match description:
        case [kind, name] if kind in TYPES:
            return PlyProperty(name=name, dtype=np.dtype(order + TYPES[kind]), count_dtype=None)
        case ["list", count, kind, name] if count in TYPES and kind in TYPES and TYPES[count][0] != "f":
            dtype, count_dtype = np.dtype(order + TYPES[kind]), np.dtype(order + TYPES[count])
            return PlyProperty(name=name, dtype=dtype, count_dtype=count_dtype)
    return None
