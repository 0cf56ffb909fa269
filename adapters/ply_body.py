"""The records of a PLY file, binary and text."""

from __future__ import annotations

import io
from array import array
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from spinor_geom.adapters.contents import integer, malformed, real
from spinor_geom.adapters.ply_header import PlyElement
from spinor_geom.errors import MeshFileError

LARGEST_RECORD = 1 << 30  # numpy's records are below 2 GiB
Scalars = dict[str, np.ndarray]
Lists = dict[str, tuple[np.ndarray, Int[np.ndarray, " _"]]]


def read_binary(data: bytes, position: int, element: PlyElement, path: Path | None) -> tuple[Scalars, Lists, int]:
    """The records of an element in a binary file.

    Args:
        data: the file.
        position: where the records begin.
        element: what they are made of.
        path: the file's name, for errors.

    Returns:
        The scalar properties, the list properties (values, lengths), and where the records end.

    Raises:
        MeshFileError: the file is shorter than its header says.
    """
    if element.count == 0 or not element.properties:
        return *_empty(element), position
    records = _equal_records(data, position, element)
    if len(records) == element.count:
        scalars, lists = {}, {}
        for item in element.properties:
            values = records[item.name]
            if item.count_dtype is None:
                scalars[item.name] = values
            else:
                lists[item.name] = (values.reshape(-1), np.full(len(values), values.shape[1]))
        return scalars, lists, position + records.nbytes
    return _walk(data, position, element, records, path)


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


def _walk(
    data: bytes, position: int, element: PlyElement, equal: np.ndarray, path: Path | None
) -> tuple[Scalars, Lists, int]:
    """Records of differing lengths: where one begins is known only after the one before, so this is a loop.

    The loop begins after the records that are equal in length, as those of a file that is merely cut off are.
    """
    places = [array("q") for _ in element.properties]
    sizes = [array("q") for _ in element.properties]
    first = position
    for index, item in enumerate(element.properties if len(equal) else ()):
        kind = equal.dtype[item.name]
        first += item.count_dtype.itemsize if item.count_dtype is not None else 0
        places[index].extend(range(first, first + equal.nbytes, equal.itemsize))
        sizes[index].extend([kind.shape[0] if kind.shape else 1] * len(equal))
        first += kind.itemsize
    position += equal.nbytes
    little = all(item.dtype.byteorder != ">" for item in element.properties)
    layout = [
        (index, item.dtype.itemsize, item.count_dtype.itemsize if item.count_dtype is not None else 0)
        for index, item in enumerate(element.properties)
    ]
    order: Any = "little" if little else "big"
    for record in range(len(equal), element.count):
        for index, width, count_width in layout:
            length = 1
            if count_width:
                length = int.from_bytes(data[position : position + count_width], order)
                position += count_width
            places[index].append(position)
            sizes[index].append(length)
            position += length * width
        if position > len(data):
            raise _too_short(element, record, path)
    buffer = np.frombuffer(data, np.uint8)
    scalars: Scalars = {}
    lists: Lists = {}
    for item, starts, lengths in zip(element.properties, places, sizes, strict=True):
        values = _gathered(buffer, np.array(starts), np.array(lengths), item.dtype)
        if item.count_dtype is None:
            scalars[item.name] = values
        else:
            lists[item.name] = (values, np.array(lengths))
    return scalars, lists, position


def _gathered(
    buffer: np.ndarray, starts: Int[np.ndarray, " n"], lengths: Int[np.ndarray, " n"], dtype: np.dtype[Any]
) -> np.ndarray:
    """Runs of `lengths` values that begin at the bytes `starts`, one after the other."""
    before = np.cumsum(lengths) - lengths
    within = np.arange(int(lengths.sum())) - np.repeat(before, lengths)
    first = np.repeat(starts, lengths) + within * dtype.itemsize
    return np.asarray(buffer[first[:, None] + np.arange(dtype.itemsize)].reshape(-1).view(dtype))


def read_ascii(data: bytes, position: int, element: PlyElement, path: Path | None) -> tuple[Scalars, Lists, int]:
    """The records of an element in a text file, one a line; arguments and results as of `read_binary`.

    Raises:
        MeshFileError: the file has fewer lines than its header says, or a line has too few or unreadable numbers.
    """
    if element.count == 0 or not element.properties:
        return *_empty(element), position
    rows, stop = _lines(data, position, element, path)
    try:
        table = _equal_rows(rows, element)
        columns = _columns(rows, element) if table is None else table
    except (ValueError, IndexError, OverflowError) as error:
        raise _unreadable(data, position, rows, element, path) from error
    scalars = {item.name: columns[item.name][0] for item in element.properties if item.count_dtype is None}
    lists = {item.name: columns[item.name] for item in element.properties if item.count_dtype is not None}
    return scalars, lists, stop


def _lines(data: bytes, position: int, element: PlyElement, path: Path | None) -> tuple[list[list[bytes]], int]:
    """The words of the next lines that are not blank, one for each record, and where they end."""
    stream = io.BytesIO(data)
    stream.seek(position)
    rows: list[list[bytes]] = []
    for line in stream:
        if words := line.split():
            rows.append(words)
            if len(rows) == element.count:
                return rows, stream.tell()
    raise _too_short(element, len(rows), path)


def _equal_rows(rows: list[list[bytes]], element: PlyElement) -> dict[str, tuple[np.ndarray, np.ndarray]] | None:
    """The properties by column, if all lines have as many words and all lists as many values as those of the first."""
    width = len(rows[0])
    if any(len(row) != width for row in rows):
        return None
    table = np.array(list(map(real, chain.from_iterable(rows)))).reshape(len(rows), width)
    columns = {}
    at = 0
    for item in element.properties:
        length = 1
        if item.count_dtype is not None:
            length = integer(rows[0][at])
            if (table[:, at] != length).any():
                return None
            at += 1
        if length < 0 or at + length > width:
            raise ValueError("too few words")
        values = _typed(table[:, at : at + length], item.dtype)
        columns[item.name] = (values.reshape(-1), np.full(len(rows), length))
        at += length
    if at != width:
        raise ValueError("too many words")
    return columns


def _columns(rows: list[list[bytes]], element: PlyElement) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The properties of lines of differing lengths."""
    values: list[list[float]] = [[] for _ in element.properties]
    lengths: list[list[int]] = [[] for _ in element.properties]
    for row in rows:
        _split_row(row, element, values, lengths)
    return {
        item.name: (_typed(np.array(own, dtype=np.float64), item.dtype), np.array(counts, dtype=np.int64))
        for item, own, counts in zip(element.properties, values, lengths, strict=True)
    }


def _split_row(row: list[bytes], element: PlyElement, values: list[list[float]], lengths: list[list[int]]) -> None:
    """Append one line's numbers to the lists of its properties."""
    at = 0
    for index, item in enumerate(element.properties):
        length = 1
        if item.count_dtype is not None:
            length = integer(row[at])
            at += 1
        if length < 0 or at + length > len(row):
            raise ValueError("too few words")
        values[index] += map(real, row[at : at + length])
        lengths[index].append(length)
        at += length
    if at != len(row):
        raise ValueError("too many words")


def _typed(values: np.ndarray, dtype: np.dtype[Any]) -> np.ndarray:
    """Numbers read as float64 in the type that the header declares; text positions keep all their digits."""
    if dtype.kind == "f":
        return values
    limits = np.iinfo(dtype)
    if not ((values >= limits.min) & (values <= limits.max) & (values == np.rint(values))).all():
        raise ValueError("a number is no integer, or out of range")
    return values.astype(dtype)


def _unreadable(
    data: bytes, position: int, rows: list[list[bytes]], element: PlyElement, path: Path | None
) -> MeshFileError:
    """The error at the first line that cannot be read."""
    number = next(number for number, row in enumerate(rows) if not _is_readable(row, element))
    line = line_of_record(data, position, number)
    problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
    return malformed(path, f"line {line}", problem, "correct the line")


def line_of_record(data: bytes, position: int, record: int) -> int:
    """The line of a text file, from 1, of a record of the element whose records begin at byte `position`."""
    filled = (index for index, line in enumerate(data[position:].split(b"\n"), start=1) if line.split())
    return data.count(b"\n", 0, position) + next(islice(filled, record, None))


def _is_readable(row: list[bytes], element: PlyElement) -> bool:
    try:
        _columns([row], element)
    except (ValueError, IndexError, OverflowError):
        return False
    return True


def _too_short(element: PlyElement, record: int, path: Path | None) -> MeshFileError:
    problem = f"the header announces {element.count}, but the file ends within number {record}"
    return malformed(path, f"element '{element.name}'", problem, "check that the file is complete")


def _empty(element: PlyElement) -> tuple[Scalars, Lists]:
    nothing = np.zeros(0, dtype=np.int64)
    scalars = {item.name: nothing.astype(item.dtype) for item in element.properties if item.count_dtype is None}
    lists = {
        item.name: (nothing.astype(item.dtype), nothing) for item in element.properties if item.count_dtype is not None
    }
    return scalars, lists
