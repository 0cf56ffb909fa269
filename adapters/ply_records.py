"""The elements of a PLY file and their records, text and binary, whatever they mean."""

from __future__ import annotations

import io
import re
import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int, Shaped

from spinor_geom.adapters.contents import BYTE_ORDER_MARK, is_readable, malformed, real, text_rows
from spinor_geom.adapters.extending import cast_values
from spinor_geom.errors import MeshFileError

NUMPY_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
OLD_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
TYPES = {np.dtype(kind).name: kind for kind in NUMPY_TYPES} | dict(zip(OLD_NAMES, NUMPY_TYPES, strict=True))
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_COUNT = 18  # digits; no file holds more
LARGEST_RECORD = 1 << 30  # bytes; numpy's records are below 2 GiB


class PlyProperty(NamedTuple):
    """One property of an element: its name, the type of its value or values, and of a list that of their number."""

    name: str
    dtype: np.dtype[Any]
    count_dtype: np.dtype[Any] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyElement:
    """One kind of record, and the records of a file.

    Attributes:
        name: what they are.
        count: how many the header announces.
        properties: what each is made of.
        start: where they begin in the file, in bytes.
        stop: where they end.
        values: the values of each property by its name, those of lists one list after the other.
        lengths: how many values each record has, of those properties that are lists.
    """

    name: str
    count: int
    properties: tuple[PlyProperty, ...]
    start: int = 0
    stop: int = 0
    values: Mapping[str, Shaped[np.ndarray, " _"]] = field(default_factory=dict)
    lengths: Mapping[str, Int[np.ndarray, " n"]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyRecords:
    """A PLY file as it was read.

    Attributes:
        data: its bytes.
        size: of the header, up to and with the line end after "end_header".
        encoding: how the records are written, one of `BYTE_ORDERS`.
        newline: how lines end.
        elements: the kinds of records by name, in the file's order.
    """

    data: bytes
    size: int
    encoding: str
    newline: bytes
    elements: Mapping[str, PlyElement]

    @property
    def text(self) -> bytes:
        """The bytes with line ends that can be split at, as many as there are in the file."""
        is_old = self.encoding == "ascii" and self.newline == b"\r"
        return self.data.replace(b"\r", b"\n") if is_old else self.data

    def appended(self, columns: Mapping[str, Mapping[str, np.ndarray]], counts: Mapping[str, int]) -> bytes:
        """The file with records after those of some elements; all other bytes but their counts stay.

        Args:
            columns: for each of these elements its new values, (n,) or (n, k) for lists, by the properties' names;
                lists that are not named are empty.
            counts: how many new records it gets.
        """
        header, body, position = self.data[: self.size], [], self.size
        for element in self.elements.values():
            body.append(self.data[position : element.stop])
            position = element.stop
            if not counts.get(element.name):
                continue
            count = counts[element.name]
            body += self._encoded(element, columns[element.name], count)
            pattern = rb"((?:^|[\r\n])[ \t]*element[ \t]+" + re.escape(element.name.encode("latin-1")) + rb"[ \t]+)\d+"
            header = re.sub(pattern, rb"\g<1>%d" % (element.count + count), header, count=1)
        return b"".join([header, *body, self.data[position:]])

    def _encoded(self, element: PlyElement, columns: Mapping[str, np.ndarray], count: int) -> list[bytes]:
        """Records in the file's own encoding."""
        if self.encoding != "ascii":
            return [binary_records(element.properties, columns, count)]
        rows = text_rows(*_tables(element.properties, columns, count, as_text=True))
        ends = self.data[: element.stop].endswith((b"\n", self.newline))
        return [b"" if ends else self.newline, *(row.encode("ascii") + self.newline for row in rows)]


def binary_records(properties: tuple[PlyProperty, ...], columns: Mapping[str, np.ndarray], count: int) -> bytes:
    """Binary records whose lists are equally long; arguments as of `PlyRecords.appended`, for one element."""
    tables = _tables(properties, columns, count, as_text=False)
    records = np.empty(count, [(str(index), table.dtype, table.shape[1:]) for index, table in enumerate(tables)])
    for index, table in enumerate(tables):
        records[str(index)] = table
    return records.tobytes()


def _tables(
    properties: tuple[PlyProperty, ...], columns: Mapping[str, np.ndarray], count: int, *, as_text: bool
) -> list[Shaped[np.ndarray, "{count} _"]]:
    """What records hold, side by side, in the declared types; text holds all digits, whatever the header declares."""
    tables = []
    for item in properties:
        values = columns.get(item.name, np.zeros((count, 0))).reshape(count, -1)
        if item.count_dtype is not None:
            tables.append(np.full((count, 1), values.shape[1]).astype(item.count_dtype))
        tables.append(cast_values(values, np.dtype(np.float64) if as_text and item.dtype.kind == "f" else item.dtype))
    return tables


def read_records(data: bytes, path: Path | None) -> PlyRecords:
    """The header and all records of a PLY file.

    Raises:
        MeshFileError: not a PLY file, a line that cannot be understood, or shorter than its header says; names the
            place.
    """
    read = _read_header(data, path)
    text, position = read.text, read.size
    elements = {}
    for element in read.elements.values():
        if element.properties:
            element = (_read_text if read.encoding == "ascii" else _read_binary)(text, position, element, path)
        else:
            element = replace(element, start=position, stop=position)
        elements[element.name] = element
        position = element.stop
    return replace(read, elements=elements)


def _read_header(data: bytes, path: Path | None) -> PlyRecords:
    """The header of a PLY file; its elements have no records yet."""
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
    by_name = {element.name: element for element in elements}
    if len(by_name) != len(elements):
        raise malformed(path, "header", "has two elements of one name", "rename one")
    return PlyRecords(data=data, size=size, encoding=encoding, newline=newline, elements=by_name)


def _property(description: list[str], order: str) -> PlyProperty | None:
    """A property as its header line describes it after the word "property", or None if it cannot be understood."""
    match description:
        case [kind, name] if kind in TYPES:
            return PlyProperty(name, np.dtype(order + TYPES[kind]))
        case ["list", count, kind, name] if count in TYPES and kind in TYPES and TYPES[count][0] != "f":
            return PlyProperty(name, np.dtype(order + TYPES[kind]), np.dtype(order + TYPES[count]))
    return None


def _read_binary(data: bytes, position: int, element: PlyElement, path: Path | None) -> PlyElement:
    """An element with the records that begin at byte `position`."""
    records = _equal_records(data, position, element)
    if len(records) < element.count or not element.count:
        return _walk(data, position, element, records, path)
    lists = [item.name for item in element.properties if item.count_dtype is not None]
    return replace(
        element,
        start=position,
        stop=position + records.nbytes,
        values={item.name: records[item.name].reshape(-1) for item in element.properties},
        lengths={name: np.full(len(records), records.dtype[name].shape[0]) for name in lists},
    )


def _equal_records(data: bytes, position: int, element: PlyElement) -> np.ndarray:
    """As a structured array the records up to the first whose lists are not as long as those of record 0."""
    fields: list[tuple[Any, ...]] = []
    offset = position
    lengths = {}
    for item in element.properties:
        if item.count_dtype is not None:
            if offset + item.count_dtype.itemsize > len(data):
                return np.zeros(0)
            lengths[item.name] = int(np.frombuffer(data, item.count_dtype, 1, offset)[0])
            if not 0 <= lengths[item.name] * item.dtype.itemsize <= min(len(data) - offset, LARGEST_RECORD):
                return np.zeros(0)
            fields += [(f"length of {item.name}", item.count_dtype), (item.name, item.dtype, (lengths[item.name],))]
            offset += item.count_dtype.itemsize + lengths[item.name] * item.dtype.itemsize
        else:
            fields.append((item.name, item.dtype))
            offset += item.dtype.itemsize
    fitting = min(element.count, max(len(data) - position, 0) // (offset - position))
    records = np.frombuffer(data, np.dtype(fields), fitting, position)
    differs = np.zeros(fitting, dtype=bool)
    for name, length in lengths.items():
        differs |= records[f"length of {name}"] != length
    return records[: int(differs.argmax())] if differs.any() else records


def _walk(data: bytes, position: int, element: PlyElement, equal: np.ndarray, path: Path | None) -> PlyElement:
    """Records of differing lengths: where one begins is known only after the one before, so this is a loop.

    It begins after the records that are equal in length, as those of a file that is merely cut off are.
    """
    start = first = position
    places = [array("q") for _ in element.properties]
    sizes = [array("q") for _ in element.properties]
    for place, size, item in zip(places, sizes, element.properties, strict=True) if len(equal) else ():
        kind = equal.dtype[item.name]
        first += item.count_dtype.itemsize if item.count_dtype is not None else 0
        place.extend(range(first, first + equal.nbytes, equal.itemsize))
        size.extend([kind.shape[0] if kind.shape else 1] * len(equal))
        first += kind.itemsize
    position += equal.nbytes
    layout = [
        (place, size, item.dtype.itemsize, None if item.count_dtype is None else _number_reader(item.count_dtype))
        for place, size, item in zip(places, sizes, element.properties, strict=True)
    ]
    for record in range(len(equal), element.count):
        for place, size, width, count in layout:
            length = 1
            if count is not None:
                if position + count.size > len(data):
                    raise _too_short(element, record, path)
                (number,) = count.unpack_from(data, position)
                if not 0 <= number == number // 1:
                    raise _too_short(element, record, path)
                length = int(number)
                position += count.size
            place.append(position)
            size.append(length)
            position += length * width
        if position > len(data):
            raise _too_short(element, record, path)
    buffer = np.frombuffer(data, np.uint8)
    values = {
        item.name: _gathered(buffer, np.array(place), np.array(size), item.dtype)
        for item, place, size in zip(element.properties, places, sizes, strict=True)
    }
    both = zip(element.properties, sizes, strict=True)
    lengths = {item.name: np.array(size) for item, size in both if item.count_dtype is not None}
    return replace(element, start=start, stop=position, values=values, lengths=lengths)


def _number_reader(dtype: np.dtype[Any]) -> struct.Struct:
    return struct.Struct(dtype.str[0].replace("|", "<") + dtype.char)


def _gathered(
    buffer: np.ndarray, starts: Int[np.ndarray, " n"], lengths: Int[np.ndarray, " n"], dtype: np.dtype[Any]
) -> np.ndarray:
    """Runs of `lengths` values that begin at the bytes `starts`, one after the other."""
    before = np.cumsum(lengths) - lengths
    within = np.arange(int(lengths.sum())) - np.repeat(before, lengths)
    first = np.repeat(starts, lengths) + within * dtype.itemsize
    return np.asarray(buffer[first[:, None] + np.arange(dtype.itemsize)].reshape(-1).view(dtype))


def _read_text(data: bytes, position: int, element: PlyElement, path: Path | None) -> PlyElement:
    """An element with its records, one on each of the next lines that are not blank."""
    stream = io.BytesIO(data)
    stream.seek(position)
    rows = list(islice(filter(None, (line.split() for line in stream)), element.count))
    if len(rows) < element.count:
        raise _too_short(element, len(rows), path)
    try:
        return replace(_of_words(rows, element), start=position, stop=stream.tell())
    except (ValueError, OverflowError) as error:
        convert = partial(_of_words, element=element)
        number = next(number for number, row in enumerate(rows) if not is_readable([row], convert))
        problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
        line = line_of_record(data, position, number)
        raise malformed(path, f"line {line}", problem, "correct the line") from error


def _of_words(rows: list[list[bytes]], element: PlyElement) -> PlyElement:
    """An element with records in lines of text, read like binary ones in which every number has 64 bits."""
    words, wide = np.array(list(map(real, chain.from_iterable(rows)))), np.dtype(np.float64)
    items = [PlyProperty(item.name, wide, item.count_dtype and wide) for item in element.properties]
    as_binary = replace(element, count=len(rows), properties=tuple(items))
    read = _read_binary(words.tobytes(), 0, as_binary, None)
    width = len(items) + sum(read.lengths.values())
    if not np.array_equal(np.broadcast_to(width, len(rows)), list(map(len, rows))):
        raise ValueError("too many or too few words")
    values = {item.name: _typed(read.values[item.name], item.dtype) for item in element.properties}
    return replace(element, values=values, lengths=read.lengths)


def _typed(values: np.ndarray, dtype: np.dtype[Any]) -> np.ndarray:
    """Numbers read as float64 in the type that the header declares; text positions keep all their digits."""
    if dtype.kind == "f":
        return values
    limits = np.iinfo(dtype)
    if not ((values >= limits.min) & (values <= limits.max) & (values == np.rint(values))).all():
        raise ValueError("a number is no integer, or out of range")
    return values.astype(dtype)


def line_of_record(data: bytes, position: int, record: int) -> int:
    """The line of a text file, from 1, of a record of the element whose records begin at byte `position`."""
    filled = (index for index, line in enumerate(data[position:].split(b"\n"), start=1) if line.split())
    return data.count(b"\n", 0, position) + next(islice(filled, record, None))


def _too_short(element: PlyElement, record: int, path: Path | None) -> MeshFileError:
    problem = f"the header announces {element.count}, but the file ends within number {record}"
    return malformed(path, f"element '{element.name}'", problem, "check that the file is complete")
