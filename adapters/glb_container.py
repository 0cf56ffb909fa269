"""The container of binary glTF: its JSON, its one binary buffer, and the accessors that describe arrays in it.

Only the buffer inside the file is read; a buffer or image that the JSON names by address is never opened.
"""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.adapters.contents import malformed

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENT_CODES = {np.dtype(name): code for code, name in COMPONENTS.items()}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
DEEPEST_JSON = 100  # levels; Python's JSON fails some hundreds deeper, and by how much depends on who calls
LISTS = ("accessors", "buffers", "bufferViews", "meshes", "nodes", "scenes")
# rows of zeros that a file need not hold may be as many times its size, in bytes
ZEROS_PER_BYTE = 16

Json = dict[str, Any]


@dataclass(kw_only=True, eq=False)
class GlbContainer:
    """The JSON of a glTF file and its binary buffer, read from and written to by accessors.

    Attributes:
        tree: the JSON.
        views: the bytes of each buffer view; None where they are not in the file.
        chunks: the chunks after the binary one, whatever they are.
        size: of the file, in bytes; 0 for a new one.
        path: the file's name, for errors.
    """

    tree: Json
    views: list[bytes | None]
    path: Path | None
    chunks: bytes = b""
    size: int = 0

    @classmethod
    def read(cls, data: bytes, path: Path | None) -> GlbContainer:
        """Open a file.

        Raises:
            MeshFileError: not a binary glTF 2 file, shorter than it says, or with JSON that cannot be read.
        """
        tree, binary, chunks = _chunks(data, path)
        views: list[bytes | None] = []
        for name in LISTS:
            items = tree.get(name, [])
            if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
                raise malformed(path, "JSON", f"'{name}' is no list of objects", "check the file")
        buffers = tree.get("buffers", [])
        for number, view in enumerate(tree.get("bufferViews", [])):
            # buffer 0 without an address is the one inside the file
            inside = (
                view["buffer"] == 0
                and "uri" not in buffers[0]
                and "EXT_meshopt_compression" not in view.get("extensions", {})
            )
            start, length = view.get("byteOffset", 0), view["byteLength"]
            if inside and not 0 <= start <= start + length <= len(binary):
                problem = f"ends at byte {start + length} of the binary buffer, which has {len(binary)}"
                raise malformed(path, f"buffer view {number}", problem, "check that the file is complete")
            views.append(binary[start : start + length] if inside else None)
        container = cls(tree=tree, views=views, path=path, chunks=chunks, size=len(data))
        for reference in _references(tree):
            container.item("bufferViews", reference["bufferView"])
        return container

    def item(self, name: str, number: Any) -> Json:
        """An entry of one of the JSON's lists.

        Raises:
            MeshFileError: the list has no entry of that number.
        """
        items: list[Json] = self.tree.get(name, [])
        if type(number) is not int or not 0 <= number < len(items):
            problem = f"names number {number} of its {len(items)} {name}"
            raise malformed(self.path, "JSON", problem, "check the file")
        return items[number]

    def encoded(self) -> bytes:
        """The file, without buffer views that nothing refers to any more."""
        used = sorted({view["bufferView"] for view in _references(self.tree)})
        keeps_all = any(view is None for view in self.views)
        kept = range(len(self.views)) if keeps_all else used
        new_number = {old: new for new, old in enumerate(kept)}
        binary = bytearray()
        views = []
        for old in kept:
            view = self.tree["bufferViews"][old]
            content = self.views[old]
            if content is not None:
                view = {**view, "buffer": 0, "byteOffset": len(binary), "byteLength": len(content)}
                binary += content + b"\0" * (-len(content) % 4)
            views.append(view)
        for reference in _references(self.tree):
            reference["bufferView"] = new_number[reference["bufferView"]]
        self.tree["bufferViews"] = views
        buffers = self.tree.setdefault("buffers", [{}])
        buffers[0] = {**buffers[0], "byteLength": len(binary)}
        text = json.dumps(self.tree, separators=(",", ":")).encode("ascii")
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(binary) + len(self.chunks)
        return (
            struct.pack("<4sIIII", b"glTF", 2, total, len(text), JSON_CHUNK)
            + text
            + struct.pack("<II", len(binary), BIN_CHUNK)
            + bytes(binary)
            + self.chunks
        )

    def values(self, accessor: int) -> np.ndarray:
        """The rows of an accessor, (n, k), in the type that the file stores them in.

        Raises:
            MeshFileError: the data lies outside of the file, is compressed, or is shorter than announced.
        """
        item = self.item("accessors", accessor)
        dtype: np.dtype[Any] = np.dtype(COMPONENTS[item["componentType"]])
        width, count = WIDTHS[item["type"]], item["count"]
        sparse = item.get("sparse")
        rows: np.ndarray
        if "bufferView" in item:
            stride = self.item("bufferViews", item["bufferView"]).get("byteStride", width * dtype.itemsize)
            rows = self._rows(item["bufferView"], item.get("byteOffset", 0), count, dtype, width, stride, accessor)
        elif sparse is not None and 0 <= count * width * dtype.itemsize <= ZEROS_PER_BYTE * self.size:
            rows = np.zeros((count, width), dtype=dtype)
        else:
            raise malformed(
                self.path, f"accessor {accessor}", "its data is not in the file, or compressed", "convert the file"
            )
        if sparse is None:
            return rows
        rows = rows.copy()
        where, what, number = sparse["indices"], sparse["values"], sparse["count"]
        index_type: np.dtype[Any] = np.dtype(COMPONENTS[where["componentType"]])
        places = self._rows(
            where["bufferView"], where.get("byteOffset", 0), number, index_type, 1, index_type.itemsize, accessor
        )
        if index_type.kind != "u":
            raise malformed(self.path, f"accessor {accessor}", "its places are no unsigned integers", "check the file")
        size = width * dtype.itemsize
        rows[places[:, 0]] = self._rows(
            what["bufferView"], what.get("byteOffset", 0), number, dtype, width, size, accessor
        )
        return rows

    def _rows(
        self, view: int, offset: int, count: int, dtype: np.dtype[Any], width: int, stride: int, accessor: int
    ) -> np.ndarray:
        content = self.views[view]
        if content is None:
            raise malformed(
                self.path, f"accessor {accessor}", "its data is not in the file, or compressed", "convert the file"
            )
        row = width * dtype.itemsize
        if count < 0 or offset < 0 or stride < row or (count and offset + (count - 1) * stride + row > len(content)):
            problem = f"announces {count} rows, more than buffer view {view} holds"
            raise malformed(self.path, f"accessor {accessor}", problem, "check that the file is complete")
        return np.asarray(np.ndarray((count, width), dtype, content, offset, (stride, dtype.itemsize)))

    def store(self, rows: np.ndarray, *, instead_of: int | None, target: int, bounds: bool = False) -> int:
        """Put rows (n, k) in the file and describe them by an accessor.

        Args:
            rows: the values, of a type that glTF knows.
            instead_of: an accessor whose type and other properties to take over; it is replaced itself if nothing else
                refers to it.
            target: what the rows are for, `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`.
            bounds: whether to write the least and largest value of each column.

        Returns:
            The accessor's number.
        """
        count, width = rows.shape
        size = width * rows.dtype.itemsize
        stride = size + -size % 4 if target == ARRAY_BUFFER else size
        padded = np.zeros((count, stride), dtype=np.uint8)
        padded[:, :size] = np.ascontiguousarray(rows).view(np.uint8).reshape(count, size)
        view: Json = {"buffer": 0, "byteLength": padded.size, "target": target}
        if stride != size:
            view["byteStride"] = stride
        self.views.append(padded.tobytes())
        self.tree.setdefault("bufferViews", []).append(view)
        accessors = self.tree.setdefault("accessors", [])
        old = dict(accessors[instead_of]) if instead_of is not None else {"type": _type_of(width)}
        item = {key: value for key, value in old.items() if key not in ("byteOffset", "sparse", "min", "max")}
        item |= {
            "bufferView": len(self.views) - 1,
            "componentType": COMPONENT_CODES[rows.dtype.newbyteorder("<")],
            "count": count,
        }
        if bounds:
            item |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        if instead_of is not None and self._uses()[instead_of] == 1:
            accessors[instead_of] = item
            return instead_of
        accessors.append(item)
        return len(accessors) - 1

    def _uses(self) -> Counter[int]:
        """How often each accessor is referred to, well-formed or not: by primitives, animations, skins, extensions."""
        uses: Counter[int] = Counter()
        for item in _objects(self.tree):
            named = [item.get(key) for key in ("indices", "input", "output", "inverseBindMatrices")]
            targets = item.get("targets")
            for group in [item.get("attributes"), *(targets if isinstance(targets, list) else [])]:
                named += group.values() if isinstance(group, dict) else []
            uses.update(number for number in named if type(number) is int)
        return uses


def _chunks(data: bytes, path: Path | None) -> tuple[Json, bytes, bytes]:
    """The JSON, the binary chunk, and all chunks after these."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise malformed(path, "byte 0", "does not begin like a binary glTF file", "check the file's format")
    version, length, json_length, json_type = struct.unpack_from("<IIII", data, 4)
    if version != 2 or json_type != JSON_CHUNK:
        raise malformed(path, "byte 4", f"is glTF version {version}, only 2 is read", "convert the file")
    if length > len(data) or 20 + json_length > length:
        problem = f"announces {max(length, 20 + json_length)} bytes, but the file has {len(data)}"
        raise malformed(path, "byte 8", problem, "check that the file is complete")
    try:
        tree = json.loads(data[20 : 20 + json_length])
    except (ValueError, RecursionError) as error:
        raise malformed(path, "JSON", str(error), "check that the file is complete") from None
    if not isinstance(tree, dict):
        raise malformed(path, "JSON", "is no object", "check the file")
    if _depth(tree) > DEEPEST_JSON:
        raise malformed(path, "JSON", f"is nested more than {DEEPEST_JSON} levels deep", "check the file")
    position = 20 + json_length
    if position + 8 > length:
        return tree, b"", b""
    binary_length, binary_type = struct.unpack_from("<II", data, position)
    if binary_type != BIN_CHUNK:
        return tree, b"", data[position:length]
    if position + 8 + binary_length > length:
        problem = f"announces {binary_length} bytes of binary data, but the file ends after {length - position - 8}"
        raise malformed(path, f"byte {position}", problem, "check that the file is complete")
    end = position + 8 + binary_length
    return tree, data[position + 8 : end], data[end + -end % 4 : length]


def _depth(tree: Json) -> int:
    """How deep objects and lists in the JSON are nested."""
    depth = 0
    level: list[Any] = [tree]
    while level:
        depth += 1
        parts = chain.from_iterable(node.values() if isinstance(node, dict) else node for node in level)
        level = [part for part in parts if isinstance(part, (dict, list))]
    return depth


def _objects(tree: Json) -> Iterator[Json]:
    """All objects in the JSON but what users store under "extras", which is theirs."""
    stack: list[Any] = [tree]
    while stack:
        item = stack.pop()
        if isinstance(item, list):
            stack += item
        elif isinstance(item, dict):
            yield item
            stack += [value for key, value in item.items() if key != "extras"]


def _references(tree: Json) -> Iterator[Json]:
    """All objects in the JSON that refer to a buffer view."""
    return (item for item in _objects(tree) if "bufferView" in item)


def _type_of(width: int) -> str:
    return "SCALAR" if width == 1 else f"VEC{width}"
