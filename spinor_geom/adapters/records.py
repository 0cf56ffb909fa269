"""Records of vertices, faces and whatever else a PLY or OFF file holds, text and binary, whatever they mean."""

import io
import struct
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int, Shaped

from spinor_geom.adapters.contents import is_readable, malformed, real, text_rows
from spinor_geom.adapters.vertex_data import cast_values
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

    def appended(self, columns: Mapping[str, Mapping[str, np.ndarray]]) -> bytes:
        """The file with records after those of some elements; all other bytes but their counts stay.

        For each of these elements come its new values by the properties' names, (n,) or (n, k) for lists, else empty.
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
    """So many binary records whose lists are equally long; columns as of `Records.appended`, for one element."""
    tables = _tables(properties, columns, count, as_text=False)
    return np.hstack([np.ascontiguousarray(table).view(np.uint8) for table in tables]).tobytes()


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


def read_binary(data: bytes, position: int, element: Element) -> Element:
    """An element with the records that begin at byte `position`; a MeshFileError if the file ends before they do."""
    run = _equal_records(data, position, element)
    stop = position + run.nbytes
    lists = [item.name for item in element.properties if item.count_dtype is not None]
    values = {item.name: run[item.name].reshape(-1) for item in element.properties}
    lengths = {name: np.full(len(run), run.dtype[name].shape[0]) for name in lists}
    if len(run) < element.count:
        others, other_lengths, stop = _walk(data, stop, element, len(run))
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
    data: bytes, position: int, element: Element, first: int
) -> tuple[dict[str, np.ndarray], dict[str, Int[np.ndarray, " n"]], int]:
    """Values and lengths of lists, which may differ, of the records from number `first` on, and where these end."""
    columns = []
    for item in element.properties:
        order = None if item.count_dtype is None else item.count_dtype.str[0].replace("|", "<") + item.count_dtype.char
        columns.append((list[bytes](), array("q"), item.dtype.itemsize, order and struct.Struct(order)))
    for record in range(first, element.count):  # each begins where the one before it ends
        for pieces, sizes, width, count in columns:
            size = width
            if count:
                if position + count.size > len(data):
                    raise _too_short(element, record)
                (number,) = count.unpack_from(data, position)
                if not 0 <= number == number // 1:
                    raise _too_short(element, record)
                sizes.append(int(number))
                size *= int(number)
                position += count.size
            pieces.append(data[position : position + size])
            position += size
        if position > len(data):
            raise _too_short(element, record)
    values, lengths = {}, {}
    for item, (pieces, sizes, _, count) in zip(element.properties, columns, strict=True):
        values[item.name] = np.frombuffer(b"".join(pieces), item.dtype)
        if count:
            lengths[item.name] = np.array(sizes)
    return values, lengths, position


def _too_short(element: Element, record: int) -> MeshFileError:
    problem = f"the header announces {element.count}, but the file ends within number {record}"
    return malformed(f"element '{element.name}'", problem, "check that the file is complete")


def rows_of(
    text: bytes, position: int, element: Element, words: Callable[[bytes], list[bytes]] = bytes.split
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
        raise _too_short(element, len(rows))
    return rows, replace(element, stop=stream.tell(), lines=lines)


def of_rows(rows: list[list[bytes]], element: Element) -> Element:
    """An element with the records that some rows of words hold; a MeshFileError names the line that cannot be read."""
    try:
        return _of_words(rows, element)
    except (ValueError, OverflowError) as error:
        convert = partial(_of_words, element=element)
        number = next(number for number, row in enumerate(rows) if not is_readable([row], convert))
        problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
        raise malformed(element.line(number), problem, "correct the line") from error


def _of_words(rows: list[list[bytes]], element: Element) -> Element:
    """An element with records in lines of text, read like binary ones in which every number has 64 bits."""
    words, wide = list(chain.from_iterable(rows)), np.dtype(np.float64)
    # `float` takes underscores, at a fraction of the time of `real`
    numbers = np.array(list(map(real if b"_" in b"".join(words) else float, words)))
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
                raise ValueError("a number is no integer, or out of range")
            values[item.name] = own.astype(item.dtype)
    return replace(element, values=values, lengths=read.lengths)
