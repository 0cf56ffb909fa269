"""Records of vertices, faces and whatever else a PLY or OFF file holds, text and binary, whatever they mean."""

from __future__ import annotations

import io
import struct
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int, Shaped

from spinor_geom.adapters.contents import is_readable, malformed, real, text_rows
from spinor_geom.adapters.extending import cast_values
from spinor_geom.errors import MeshFileError

LARGEST_RECORD = 1 << 30  # bytes; numpy's records are below 2 GiB


class Property(NamedTuple):
    """One property of an element: its name, the type of its value or values, and of a list that of their number."""

    name: str
    dtype: np.dtype[Any]
    count_dtype: np.dtype[Any] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """One kind of record, and the records of a file."""

    name: str  # what they are
    count: int  # how many the header announces
    count_at: tuple[int, int]  # where in the file that number stands, the bytes from and to
    properties: tuple[Property, ...] = ()  # what each is made of
    stop: int = 0  # where they end in the file, in bytes
    lines: Sequence[int] = ()  # on which line of a text each stands, from 1
    # by the properties' names; those of lists one list after the other, with the lists' lengths
    values: Mapping[str, Shaped[np.ndarray, " _"]] = field(default_factory=dict)
    lengths: Mapping[str, Int[np.ndarray, " n"]] = field(default_factory=dict)

    def line(self, record: int) -> str:
        """On which line a record stands, as "line 12"; "" where none is known."""
        return f"line {self.lines[record]}" if self.lines else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """A file of records as it was read."""

    data: bytes  # its bytes
    newline: bytes  # how lines end; b"" where records are binary
    elements: Mapping[str, Element]  # the kinds of records by name, in the file's order

    def appended(self, columns: Mapping[str, Mapping[str, np.ndarray]], counts: Mapping[str, int]) -> bytes:
        """The file with records after those of some elements; all other bytes but their counts stay.

        For each of these elements come its new values by the properties' names, (n,) or (n, k) for lists (those that
        are not named are empty), and how many records they are.
        """
        edits = []
        for element in self.elements.values():
            added = counts.get(element.name, 0)
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
    """Binary records whose lists are equally long; arguments as of `Records.appended`, for one element."""
    tables = _tables(properties, columns, count, as_text=False)
    records = np.empty(count, [(str(index), table.dtype, table.shape[1:]) for index, table in enumerate(tables)])
    for index, table in enumerate(tables):
        records[str(index)] = table
    return records.tobytes()


def _tables(
    properties: tuple[Property, ...], columns: Mapping[str, np.ndarray], count: int, *, as_text: bool
) -> list[Shaped[np.ndarray, "{count} _"]]:
    """What records hold, side by side, in the declared types; text holds all digits, whatever the header declares."""
    tables = []
    for item in properties:
        values = columns.get(item.name, np.zeros((count, 0))).reshape(count, -1)
        if item.count_dtype is not None:
            tables.append(np.full((count, 1), values.shape[1]).astype(item.count_dtype))
        tables.append(cast_values(values, np.dtype(np.float64) if as_text and item.dtype.kind == "f" else item.dtype))
    return tables


def read_binary(data: bytes, position: int, element: Element, path: Path | None) -> Element:
    """An element with the records that begin at byte `position`; a MeshFileError if the file ends before they do."""
    run, stop = _equal_records(data, position, element), position
    lists = [item.name for item in element.properties if item.count_dtype is not None]
    values = {item.name: run[item.name].reshape(-1) for item in element.properties}
    lengths = {name: np.full(len(run), run.dtype[name].shape[0]) for name in lists}
    stop += run.nbytes
    if len(run) < element.count:
        others, other_lengths, stop = _walk(data, stop, element, len(run), path)
        values = {name: np.append(own, others[name]) for name, own in values.items()}
        lengths = {name: np.append(own, other_lengths[name]) for name, own in lengths.items()}
    return replace(element, stop=stop, values=values, lengths=lengths)


def _equal_records(data: bytes, position: int, element: Element) -> np.ndarray:
    """As a structured array the records up to the first whose lists are not as long as those of record 0."""
    fields: list[tuple[Any, ...]] = []
    offset = position
    lengths = {}
    fitting = element.count
    for item in element.properties:
        if item.count_dtype is not None:
            width = item.count_dtype.itemsize
            length = int(np.frombuffer(data[offset : offset + width].ljust(width, b"\0"), item.count_dtype)[0])
            offset += width
            if not 0 <= length * item.dtype.itemsize <= min(len(data) - offset, LARGEST_RECORD):
                length = fitting = 0
            lengths[item.name] = length
            fields += [(f"length of {item.name}", item.count_dtype), (item.name, item.dtype, (length,))]
            offset += length * item.dtype.itemsize
        else:
            fields.append((item.name, item.dtype))
            offset += item.dtype.itemsize
    fitting = min(fitting, max(len(data) - position, 0) // (offset - position))
    records: np.ndarray = np.ndarray(fitting, np.dtype(fields), data, min(position, len(data)))
    differs = np.zeros(fitting, dtype=bool)
    for name, length in lengths.items():
        differs |= records[f"length of {name}"] != length
    return records[: int(differs.argmax())] if differs.any() else records


def _walk(
    data: bytes, position: int, element: Element, first: int, path: Path | None
) -> tuple[dict[str, np.ndarray], dict[str, Int[np.ndarray, " n"]], int]:
    """Values and lengths of lists of the records from number `first` on, and where these end.

    Of lists of differing lengths: where a record begins is known only after the one before, so this is a loop.
    """
    columns = []
    for item in element.properties:
        order = None if item.count_dtype is None else item.count_dtype.str[0].replace("|", "<") + item.count_dtype.char
        columns.append((array("q"), array("q"), item.dtype.itemsize, order and struct.Struct(order)))
    for record in range(first, element.count):
        for place, size, width, count in columns:
            length = 1
            if count:
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
    values, lengths = {}, {}
    for item, (place, size, _, count) in zip(element.properties, columns, strict=True):
        own = np.array(size)
        within = np.arange(int(own.sum())) - np.repeat(np.cumsum(own) - own, own)
        begins = np.repeat(np.array(place), own) + within * item.dtype.itemsize
        values[item.name] = buffer[begins[:, None] + np.arange(item.dtype.itemsize)].reshape(-1).view(item.dtype)
        if count:
            lengths[item.name] = own
    return values, lengths, position


def _too_short(element: Element, record: int, path: Path | None) -> MeshFileError:
    problem = f"the header announces {element.count}, but the file ends within number {record}"
    return malformed(path, f"element '{element.name}'", problem, "check that the file is complete")


def rows_of(
    text: bytes, position: int, element: Element, path: Path | None, words: Callable[[bytes], list[bytes]] = bytes.split
) -> tuple[list[list[bytes]], Element]:
    """The words of an element's records, one on each next line that holds any, and the element with its lines."""
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
        raise _too_short(element, len(rows), path)
    return rows, replace(element, stop=stream.tell(), lines=lines)


def of_rows(rows: list[list[bytes]], element: Element, path: Path | None) -> Element:
    """An element with the records that some rows of words hold; a MeshFileError names the line that cannot be read."""
    try:
        return _of_words(rows, element)
    except (ValueError, OverflowError) as error:
        convert = partial(_of_words, element=element)
        number = next(number for number, row in enumerate(rows) if not is_readable([row], convert))
        problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
        raise malformed(path, element.line(number), problem, "correct the line") from error


def _of_words(rows: list[list[bytes]], element: Element) -> Element:
    """An element with records in lines of text, read like binary ones in which every number has 64 bits."""
    words, wide = list(chain.from_iterable(rows)), np.dtype(np.float64)
    # `float` takes underscores, at a fraction of the time of `real`
    numbers = np.array(list(map(real if b"_" in b"".join(words) else float, words)))
    items = tuple(Property(item.name, wide, item.count_dtype and wide) for item in element.properties)
    read = read_binary(numbers.tobytes(), 0, replace(element, count=len(rows), properties=items), None)
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
