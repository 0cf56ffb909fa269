"""The records of a PLY file, binary and text."""

from __future__ import annotations

import io
import struct
from array import array
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from spinor_geom.adapters.contents import malformed, real
from spinor_geom.adapters.ply_header import PlyElement, PlyProperty
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
    layout = [
        (index, item.dtype.itemsize, None if item.count_dtype is None else _number_reader(item.count_dtype))
        for index, item in enumerate(element.properties)
    ]
    for record in range(len(equal), element.count):
        for index, width, count in layout:
            length = 1
            if count is not None:
                if position + count.size > len(data):
                    raise _too_short(element, record, path)
                (number,) = count.unpack_from(data, position)
                if not 0 <= number == number // 1:
                    raise _too_short(element, record, path)
                length = int(number)
                position += count.size
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


def read_ascii(data: bytes, position: int, element: PlyElement, path: Path | None) -> tuple[Scalars, Lists, int]:
    """The records of an element in a text file, one a line; arguments and results as of `read_binary`.

    Raises:
        MeshFileError: the file has fewer lines than its header says, or a line has too few or unreadable numbers.
    """
    if element.count == 0 or not element.properties:
        return *_empty(element), position
    rows, stop = _lines(data, position, element, path)
    try:
        return *_of_words(rows, element), stop
    except (ValueError, OverflowError) as error:
        number = next(number for number, row in enumerate(rows) if not _is_readable(row, element))
        line = line_of_record(data, position, number)
        problem = f"cannot read {element.name} {number} from '{b' '.join(rows[number][:12]).decode('latin-1')}'"
        raise malformed(path, f"line {line}", problem, "correct the line") from error


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


def _of_words(rows: list[list[bytes]], element: PlyElement) -> tuple[Scalars, Lists]:
    """The properties of lines of text, read like binary records in which every number has 64 bits.

    Raises:
        ValueError: a line has too many or too few words, or one that is not the number it should be.
        OverflowError: as ValueError.
    """
    words, wide = np.array(list(map(real, chain.from_iterable(rows)))), np.dtype(np.float64)
    items = [(item.name, wide, None if item.count_dtype is None else wide) for item in element.properties]
    as_binary = replace(
        element,
        count=len(rows),
        properties=tuple(PlyProperty(name=name, dtype=dtype, count_dtype=count) for name, dtype, count in items),
    )
    scalars, lists, _ = read_binary(words.tobytes(), 0, as_binary, None)
    width = len(scalars) + sum(1 + lengths for _, lengths in lists.values())
    if not np.array_equal(np.broadcast_to(width, len(rows)), list(map(len, rows))):
        raise ValueError("too many or too few words")
    dtypes = {item.name: item.dtype for item in element.properties}
    return (
        {name: _typed(values, dtypes[name]) for name, values in scalars.items()},
        {name: (_typed(values, dtypes[name]), lengths) for name, (values, lengths) in lists.items()},
    )


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


def _is_readable(row: list[bytes], element: PlyElement) -> bool:
    try:
        _of_words([row], element)
    except (ValueError, OverflowError):
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
