"""The container of binary glTF: its JSON, its one binary buffer, and the accessors that describe arrays in it.

Only the buffer inside the file is read. A buffer or image that the JSON refers to by a URI is never opened.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from spinor_geom.adapters.contents import malformed

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENT_CODES = {np.dtype(name): code for code, name in COMPONENTS.items()}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
DEEPEST_JSON = 100  # levels. Python's JSON has a limit of its own, which depends on the depth of the call
STRING = re.compile(rb'"(?:[^"\\]|\\.)*"')
LISTS = ("accessors", "buffers", "bufferViews", "meshes", "nodes", "scenes")

Json = dict[str, Any]


@dataclass(kw_only=True, eq=False)
class GlbContainer:
    """The JSON of a glTF file and its binary buffer, read from and written to by accessors."""

    tree: Json  # the JSON
    views: list[bytes | None]  # of each buffer view, or None where they are not in the file, or compressed
    chunks: bytes = b""  # the chunks after the binary one, as they are

    @classmethod
    def read(cls, data: bytes) -> GlbContainer:
        """Opens a file. Raises a MeshFileError if it is not binary glTF 2, incomplete, or has malformed JSON."""
        tree, binary, chunks = _chunks(data)
        container = cls(tree=tree, views=[], chunks=chunks)
        for name in LISTS:
            items = tree.get(name, [])
            if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
                raise malformed("JSON", f"'{name}' is not a list of objects")
        for number, view in enumerate(tree.get("bufferViews", [])):
            # buffer 0 without a URI is the one inside the file
            outside = view["buffer"] != 0 or "uri" in tree["buffers"][0]
            start, stop = view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"]
            if not outside and not 0 <= start <= stop <= len(binary):
                problem = f"ends at byte {stop} of the binary buffer, which has {len(binary)}"
                raise malformed(f"buffer view {number}", problem)
            compressed = "EXT_meshopt_compression" in view.get("extensions", {})
            container.views.append(None if outside or compressed else binary[start:stop])
        return container

    def item(self, name: str, number: Any) -> Json:
        """An entry of one of the JSON's lists. Raises a MeshFileError if there is none of that number."""
        items: list[Json] = self.tree.get(name, [])
        if type(number) is not int or not 0 <= number < len(items):
            raise malformed("JSON", f"refers to number {number} of its {len(items)} {name}")
        return items[number]

    def encoded(self) -> bytes:
        """The bytes of the file."""
        binary, views = bytearray(), []
        for view, content in zip(self.tree.get("bufferViews", []), self.views, strict=True):
            if content is not None:
                view = {**view, "buffer": 0, "byteOffset": len(binary), "byteLength": len(content)}
                binary += content + b"\0" * (-len(content) % 4)
            views.append(view)
        self.tree["bufferViews"] = views
        buffers = self.tree.setdefault("buffers", [{}])
        buffers[0] = {**buffers[0], "byteLength": len(binary)}
        text = json.dumps(self.tree, separators=(",", ":")).encode("ascii")
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), BIN_CHUNK) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body) + len(self.chunks)) + body + self.chunks

    def values(self, accessor: int) -> np.ndarray:
        """The rows of an accessor, (n, k), in the file's dtype. Raises a MeshFileError if they are not in the file."""
        item = self.item("accessors", accessor)
        dtype: np.dtype[Any] = np.dtype(COMPONENTS[item["componentType"]])
        count, width, offset = item["count"], WIDTHS[item["type"]], item.get("byteOffset", 0)
        view = item.get("bufferView")
        described = {} if view is None else self.item("bufferViews", view)
        content = None if view is None or "sparse" in item else self.views[view]
        if content is None:
            raise malformed(f"accessor {accessor}", "its data is external, sparse or compressed", "convert the file")
        row = width * dtype.itemsize
        stride = described.get("byteStride", row)
        if count < 0 or offset < 0 or stride < row or (count and offset + (count - 1) * stride + row > len(content)):
            raise malformed(f"accessor {accessor}", f"declares {count} rows, more than buffer view {view} holds")
        return np.asarray(np.ndarray((count, width), dtype, content, offset, (stride, dtype.itemsize)))

    def store_bytes(self, data: bytes) -> int:
        """Appends bytes, such as an image, and returns the number of their buffer view."""
        self.views.append(data)
        self.tree.setdefault("bufferViews", []).append({"buffer": 0, "byteLength": len(data)})
        return len(self.views) - 1

    def store(self, rows: np.ndarray, *, target: int, like: int | None = None) -> int:
        """Appends rows (n, k) for `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`, and returns the number of their accessor.

        Its other properties are those of accessor `like`.
        """
        count, width = rows.shape
        size = width * rows.dtype.itemsize
        stride = size + -size % 4 if target == ARRAY_BUFFER else size
        padded = np.pad(np.ascontiguousarray(rows).view(np.uint8), ((0, 0), (0, stride - size)))
        view: Json = {"buffer": 0, "byteLength": padded.size, "target": target}
        if stride != size:
            view["byteStride"] = stride
        self.views.append(padded.tobytes())
        self.tree.setdefault("bufferViews", []).append(view)
        accessors = self.tree.setdefault("accessors", [])
        old = {"type": "SCALAR" if width == 1 else f"VEC{width}"} if like is None else accessors[like]
        code = COMPONENT_CODES[rows.dtype.newbyteorder("<")]
        item = old | {"bufferView": len(self.views) - 1, "byteOffset": 0, "componentType": code, "count": count}
        if count:
            item |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        accessors.append(item)
        return len(accessors) - 1


def _chunks(data: bytes) -> tuple[Json, bytes, bytes]:
    """The JSON, the binary chunk, and all chunks after these."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise malformed("byte 0", "does not begin like a binary glTF file")
    version, length, json_length, json_type = struct.unpack_from("<IIII", data, 4)
    if version != 2 or json_type != JSON_CHUNK:
        raise malformed("byte 4", f"is glTF version {version}, only 2 is read", "convert the file")
    position = 20 + json_length
    if max(length, position) > len(data) or position > length:
        raise malformed("byte 8", f"declares {max(length, position)} bytes, but the file has {len(data)}")
    tree = _json(data[20:position])
    if position + 8 > length:
        return tree, b"", b""
    binary_length, binary_type = struct.unpack_from("<II", data, position)
    if binary_type != BIN_CHUNK:
        return tree, b"", data[position:length]
    end = position + 8 + binary_length
    if end > length:
        problem = f"declares {binary_length} bytes of binary data, but the file ends after {length - position - 8}"
        raise malformed(f"byte {position}", problem)
    return tree, data[position + 8 : end], data[end + -end % 4 : length]


def _json(text: bytes) -> Json:
    letters = np.frombuffer(STRING.sub(b"", text), np.uint8)
    steps = np.isin(letters, list(b"[{")).astype(np.int64) - np.isin(letters, list(b"]}"))
    if np.cumsum(steps).max(initial=0) > DEEPEST_JSON:
        raise malformed("JSON", f"is nested more than {DEEPEST_JSON} levels deep")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise malformed("JSON", str(error)) from None
    if not isinstance(tree, dict):
        raise malformed("JSON", "is not an object")
    return tree
