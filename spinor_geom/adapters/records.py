"""The records of PLY and OFF files, text and binary: arrays of numbers by the names of their properties."""

import io
import math
import struct
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int, Shaped

from spinor_geom.adapters.contents import first_unreadable, malformed, real_numbers, text_rows
from spinor_geom.adapters.vertex_data import cast_values
from spinor_geom.errors import MeshFileError

LARGEST_RECORD = 1 << 30  # bytes, as records of NumPy are below 2 GiB


class Property(NamedTuple):
    """One property of an element: a number, or a list of numbers."""

    name: str
    dtype: np.dtype[Any]
    count_dtype: np.dtype[Any] | None = None  # of a list's length, or None for a number


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """One kind of record, such as "vertex", and the records of a file."""

    name: str
    count: int  # the number of records that the header declares
    count_at: tuple[int, int]  # first and last byte of that number in the file
    properties: tuple[Property, ...] = ()
    stop: int = 0  # the byte after the last record
    lines: Sequence[int] = ()  # the line of each record in a text file, from 1
    values: Mapping[str, Shaped[np.ndarray, " _"]] = field(default_factory=dict)  # of lists one after the other
    lengths: Mapping[str, Int[np.ndarray, " _"]] = field(default_factory=dict)  # of lists

    def line(self, record: int) -> str:
        """The line of a record, as "line 12", or "" where it is not known."""
        return f"line {self.lines[record]}" if self.lines else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """A file of records as it was read."""

    data: bytes
    newline: bytes  # b"" for binary records
    elements: Mapping[str, Element]  # by name, in the file's order

    def appended(self, columns: Mapping[str, Mapping[str, np.ndarray]]) -> bytes:
        """The file with records added to some elements. Of its own bytes only their counts change.

        `columns` has for each of these elements the new values of its properties, (n,) or (n, k) for lists. Lists that
        are not given are empty.
        """
        edits = []
        for element in self.elements.values():
            added = max(map(len, columns.get(element.name, {}).values()), default=0)
            if added:
                edits.append((*element.count_at, b"%d" % (element.count + added)))
                edits.append((element.stop, element.stop, self._encoded(element, columns[element.name], added)))
        parts, position = [], 0
        for start, stop, new in sorted(edits):
            parts += [self.data[position:start], new]
            position = stop
        return b"".join([*parts, self.data[position:]])

    def _encoded(self, element: Element, columns: Mapping[str, np.ndarray], count: int) -> bytes:
        """Records in the file's own encoding."""
        if not self.newline:
            return binary_records(element.properties, columns, count)
        rows = text_rows(*_tables(element.properties, columns, count, as_text=True))
        ends = self.data[: element.stop].endswith((b"\n", self.newline))
        return b"".join([b"" if ends else self.newline, *(row.encode("ascii") + self.newline for row in rows)])


def binary_records(properties: tuple[Property, ...], columns: Mapping[str, np.ndarray], count: int) -> bytes:
    """`count` binary records whose lists are equally long, with columns as in `Records.appended`, for one element."""
    tables = _tables(properties, columns, count, as_text=False)
    return np.hstack([np.ascontiguousarray(table).view(np.uint8) for table in tables]).tobytes()


def _tables(
    properties: tuple[Property, ...], columns: Mapping[str, np.ndarray], count: int, *, as_text: bool
) -> list[Shaped[np.ndarray, "{count} _"]]:
    """The columns of records, side by side, in the declared types. In text real numbers keep all their digits."""
    tables = []
    for item in properties:
        values = columns.get(item.name, np.zeros((count, 0))).reshape(count, -1)
        if item.count_dtype is not None:
            tables.append(np.full((count, 1), values.shape[1]).astype(item.count_dtype))
        tables.append(cast_values(values, np.dtype(np.float64) if as_text and item.dtype.kind == "f" else item.dtype))
    return tables


def read_binary(data: bytes, position: int, element: Element) -> Element:
    """An element with the records that begin at byte `position`. Raises a MeshFileError if the file ends too early."""
    records = _equal_records(data, position, element)
    if records is None:
        return _ragged_records(data, position, element)
    values = {item.name: records[item.name].reshape(-1) for item in element.properties}
    lists = [item.name for item in element.properties if item.count_dtype is not None]
    lengths = {name: np.full(element.count, records.dtype[name].shape[0]) for name in lists}
    return replace(element, stop=position + records.nbytes, values=values, lengths=lengths)


def _equal_records(data: bytes, position: int, element: Element) -> np.ndarray | None:
    """The records as a structured array, or None unless all are there, with lists as long as those of the first one."""
    fields: list[tuple[Any, ...]] = []
    lengths: dict[str, Any] = {}
    offset = position
    for item in element.properties:
        shape: tuple[int, ...] = ()
        if item.count_dtype is not None:
            prefix = data[offset : offset + item.count_dtype.itemsize]
            offset += item.count_dtype.itemsize
            if offset > len(data):
                return None
            length = np.frombuffer(prefix, item.count_dtype)[0]
            if not 0 <= float(length) * item.dtype.itemsize <= min(len(data) - offset, LARGEST_RECORD):
                return None
            lengths[f"length of {item.name}"], shape = length, (int(length),)
            fields.append((f"length of {item.name}", item.count_dtype))
        fields.append((item.name, item.dtype, shape))
        offset += item.dtype.itemsize * math.prod(shape)
    fitting = (len(data) - position) // (offset - position)
    if fitting < element.count and not lengths:
        raise _too_short(element, fitting)
    records: np.ndarray = np.ndarray(min(element.count, fitting), np.dtype(fields), data, position)
    if not all((records[name] == length).all() for name, length in lengths.items()):
        return None
    least = sum((item.count_dtype or item.dtype).itemsize for item in element.properties)
    if position + records.nbytes + least * (element.count - len(records)) > len(data):
        raise _too_short(element, fitting)  # known without a loop over records
    return records if len(records) == element.count else None


def _ragged_records(data: bytes, position: int, element: Element) -> Element:
    """The records, each of which begins where the one before it ends."""
    columns = []
    for item in element.properties:
        order = None if item.count_dtype is None else item.count_dtype.str[0].replace("|", "<") + item.count_dtype.char
        columns.append((list[bytes](), array("q"), item.dtype.itemsize, order and struct.Struct(order)))
    for record in range(element.count):
        for pieces, lengths, size, count in columns:
            if count:
                if position + count.size > len(data):
                    raise _too_short(element, record)
                (length,) = count.unpack_from(data, position)
                if not 0 <= length == length // 1:
                    problem = f"record {record} has a list of length {length:g}, which is no count"
                    raise malformed(f"element '{element.name}'", problem, "correct the length")
                lengths.append(int(length))
                size *= int(length)
                position += count.size
            pieces.append(data[position : position + size])
            position += size
        if position > len(data):
            raise _too_short(element, record)
    named = list(zip(element.properties, columns, strict=True))
    return replace(
        element,
        stop=position,
        values={item.name: np.frombuffer(b"".join(pieces), item.dtype) for item, (pieces, *_) in named},
        lengths={item.name: np.array(lengths) for item, (_, lengths, _, count) in named if count},
    )


def _too_short(element: Element, record: int) -> MeshFileError:
    problem = f"the header declares {element.count} records, but the file ends within record {record}"
    return malformed(f"element '{element.name}'", problem)


def split_rows(
    text: bytes, position: int, element: Element, words: Callable[[bytes], list[bytes]] = bytes.split
) -> tuple[list[list[bytes]], Element]:
    """The words of an element's records, one record on each line that is not blank, and the element with its lines."""
    stream = io.BytesIO(text)
    stream.seek(position)
    rows, lines = [], []
    for number, line in enumerate(stream if element.count else (), start=text.count(b"\n", 0, position) + 1):
        if row := words(line):
            rows.append(row)
            lines.append(number)
            if len(rows) == element.count:
                break
    if len(rows) < element.count:
        raise _too_short(element, len(rows))
    return rows, replace(element, stop=stream.tell(), lines=lines)


def parse_rows(rows: list[list[bytes]], element: Element) -> Element:
    """An element with the records in rows of words. Raises a MeshFileError with the first line that cannot be read."""
    try:
        return _of_words(rows, element)
    except (ValueError, OverflowError) as error:
        number = first_unreadable(rows, partial(_of_words, element=element))
        problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
        raise malformed(element.line(number), problem, "correct the line") from error


def _of_words(rows: list[list[bytes]], element: Element) -> Element:
    """An element with records in rows of words, read like binary records of float64 numbers."""
    words, wide = list(chain.from_iterable(rows)), np.dtype(np.float64)
    numbers = np.array(real_numbers(words))
    items = tuple(Property(item.name, wide, item.count_dtype and wide) for item in element.properties)
    read = read_binary(numbers.tobytes(), 0, replace(element, count=len(rows), properties=items))
    width = len(items) + sum(read.lengths.values())
    if not np.array_equal(np.broadcast_to(width, len(rows)), list(map(len, rows))):
        raise ValueError("too many or too few words")
    values = {}
    for item in element.properties:
        own = values[item.name] = read.values[item.name]
        if item.dtype.kind != "f":  # real numbers keep all their digits, whatever the header declares
            limits = np.iinfo(item.dtype)
            if not ((own >= limits.min) & (own <= limits.max) & (own == np.rint(own))).all():
                raise ValueError("a number is not an integer, or out of range")
            values[item.name] = own.astype(item.dtype)
    return replace(element, values=values, lengths=read.lengths)
