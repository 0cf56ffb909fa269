"""VTK's XML files of polygonal data (.vtp): text, base64 and raw bytes, compressed or not.

VTK's own reader ends the process for some malformed files, or takes all memory.
"""

from __future__ import annotations

import binascii
import lzma
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from itertools import accumulate, pairwise
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Shaped

from spinor_geom.adapters.contents import malformed
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.vtk_arrays import KINDS, ROLES, Arrays, Data, VtkMesh, checked_cells, numbers_of, texts_of
from spinor_geom.files import MOST_RATIO, is_bomb

TYPES = {f"{kind}{8 * size}": f"{kind[0].lower()}{size}" for kind in ("Int", "UInt") for size in (1, 2, 4, 8)}
TYPES |= {"Float32": "f4", "Float64": "f8"}
APPENDED = re.compile(rb"<AppendedData\s+encoding\s*=\s*[\"'](raw|base64)[\"']\s*>\s*_")
LZMA_MEMORY = 1 << 27  # bytes, which the highest level of compression needs


def read_xml(data: bytes) -> VtkMesh:
    """The mesh in a .vtp file, its pieces one after the other. A MeshFileError names the array that cannot be read."""
    appended = APPENDED.search(data)
    root = _tree(data if appended is None else data[: appended.start()] + b"</VTKFile>")
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        problem = f"holds '{root.tag} {root.get('type', '')}', not polygonal data"
        raise malformed("", problem, "extract the surface and write it as polygonal data")
    arrays = _Arrays.of_root(root, data, appended)
    pieces = [_piece(piece, arrays) for piece in root.iterfind("PolyData/Piece")]
    if not pieces:
        raise malformed("", "has no pieces")
    fields = [arrays.named(element) for element in root.iterfind("PolyData/FieldData")]
    first = root.find("PolyData/Piece")
    try:
        return _joined(pieces, {name: values for own in fields for name, values in own.items()}, _roles(first))
    except ValueError as error:  # of numpy: pieces with other numbers of columns
        raise malformed("", f"its pieces do not fit together ({error})", "write them to files of their own") from error


class _Tree(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> None:
        raise ElementTree.ParseError("it declares a document type, which may define entities of any size")


def _tree(text: bytes) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=_Tree())
    try:
        parser.feed(text)
        return parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise malformed("", f"its XML cannot be read ({error})") from error


def _piece(piece: ElementTree.Element, arrays: _Arrays) -> tuple[np.ndarray, dict[str, Polygons], Arrays, list[Arrays]]:
    """The points, the cells by kind, the point data, and the cell data of each kind."""
    count = arrays.count(piece, "NumberOfPoints", "0")
    element = piece.find("Points/DataArray")
    points = np.zeros((0, 3)) if element is None else arrays.values(element)
    if points.shape != (count, 3):
        raise malformed("Points", f"has an array of shape {points.shape} for {count} points of three coordinates")
    cells: dict[str, Polygons] = {}
    for kind in KINDS:
        stored = {"connectivity": np.zeros(0, dtype=np.int64), "offsets": np.zeros(0, dtype=np.int64)}
        for element in piece.iterfind(f"{kind}/DataArray"):
            stored[element.get("Name", "")] = arrays.values(element)
        corners, ends = stored["connectivity"], stored["offsets"]
        if corners.dtype.kind not in "iu" or ends.dtype.kind not in "iu" or corners.ndim + ends.ndim > 2:
            raise malformed(kind, "its connectivity and offsets are not integers", "make the cells anew")
        if len(ends) != arrays.count(piece, f"NumberOf{kind}", "0"):
            raise malformed(kind, f"has {len(ends)} offsets for {piece.get(f'NumberOf{kind}', 0)} cells")
        starts = np.concatenate([[0], ends.astype(np.int64)])
        cells[kind] = checked_cells(starts, corners.astype(np.int64), points=count, place=kind)
    data: list[Arrays] = []
    for name, rows in (("PointData", count), ("CellData", sum(map(len, cells.values())))):
        found = [arrays.named(element) for element in piece.iterfind(name)]
        data.append({key: values for own in found for key, values in own.items()})
        for key, values in data[-1].items():
            if len(values) != rows:
                raise malformed(name, f"the array '{key}' has {len(values)} rows for {rows} of the mesh")
    bounds = list(accumulate(map(len, cells.values()), initial=0))
    by_kind = [{name: values[a:b] for name, values in data[1].items()} for a, b in pairwise(bounds)]
    return points, cells, data[0], by_kind


def _joined(pieces: list[Any], fields: Arrays, roles: list[dict[str, str]]) -> VtkMesh:
    points, cells, point_data, cell_data = zip(*pieces, strict=True)
    first = np.cumsum([0, *map(len, points)])
    joined: dict[str, Polygons] = {}
    for kind in KINDS:
        parts = [own[kind] for own in cells]
        corners = [part.corners + start for part, start in zip(parts, first, strict=False)]
        joined[kind] = Polygons.of_sizes(np.concatenate(corners), np.concatenate([part.sizes for part in parts]))
    in_order = [own[number] for number in range(len(KINDS)) for own in cell_data]  # kind by kind
    return VtkMesh(
        points=np.concatenate(points),
        cells=joined,
        types=None,
        point_data=Data(arrays=_concatenated(point_data), active=roles[0]),
        cell_data=Data(arrays=_concatenated(in_order), active=roles[1]),
        field_data=Data(arrays=fields),
    )


def _concatenated(parts: Any) -> Arrays:
    """The arrays that all parts have, each one after the other."""
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _roles(piece: ElementTree.Element | None) -> list[dict[str, str]]:
    """The names of the active arrays at points and in cells."""
    found = [None if piece is None else piece.find(name) for name in ("PointData", "CellData")]
    return [
        {role: element.attrib[role] for role in ROLES if element is not None and role in element.attrib}
        for element in found
    ]


@dataclass(eq=False)
class _Arrays:
    """Reads the arrays of a file."""

    size: int  # of the file, in bytes
    appended: bytes
    is_raw: bool
    order: Literal["<", ">"]
    head: np.dtype[Any]  # of the numbers before the bytes of an array
    compressor: str
    unpacked: int = 0  # bytes so far

    @classmethod
    def of_root(cls, root: ElementTree.Element, data: bytes, appended: re.Match[bytes] | None) -> _Arrays:
        order: Literal["<", ">"] = ">" if root.get("byte_order") == "BigEndian" else "<"
        is_raw = appended is not None and appended[1] == b"raw"
        text = b"" if appended is None else data[appended.end() :]
        return cls(
            size=len(data),
            appended=text if is_raw else b"".join(text.partition(b"<")[0].split()),
            is_raw=is_raw,
            order=order,
            head=np.dtype(f"{order}u{8 if root.get('header_type') == 'UInt64' else 4}"),
            compressor=root.get("compressor", ""),
        )

    def count(self, element: ElementTree.Element, name: str, default: str) -> int:
        text = element.get(name, default).strip()
        if not (text.isascii() and text.isdigit() and len(text) < 20):
            raise malformed(element.tag, f"'{name}' is '{text[:40]}', not a count")
        return int(text)

    def named(self, parent: ElementTree.Element) -> Arrays:
        """The arrays in an element, by name."""
        elements = [element for element in parent if element.tag in ("DataArray", "Array")]
        return {element.get("Name", f"array {number}"): self.values(element) for number, element in enumerate(elements)}

    def values(self, element: ElementTree.Element) -> Shaped[np.ndarray, "n *k"]:
        """The rows of an array: (n,), or (n, k) for several columns."""
        place = f"array '{element.get('Name', '')}'"
        kind, width = element.get("type", ""), self.count(element, "NumberOfComponents", "1")
        if kind not in TYPES and kind != "String":
            raise malformed(place, f"'{kind[:40]}' is not a supported type of numbers")
        dtype = np.dtype(TYPES.get(kind, "i1"))
        if element.get("format", "ascii") == "ascii":
            found = numbers_of((element.text or "").encode().split(), dtype, place)
        else:
            stored = self._bytes(element, place)
            if len(stored) % dtype.itemsize:
                raise malformed(place, f"has {len(stored)} bytes, no multiple of {dtype.itemsize}")
            found = np.frombuffer(stored, dtype.newbyteorder(self.order)).astype(dtype)
        if kind == "String":
            texts = found.tobytes().decode("utf-8", "replace").split("\0")[:-1]
            return texts_of(texts, self.size, place)
        if width == 0 or len(found) % width:
            raise malformed(place, f"has {len(found)} numbers, no multiple of its {width} components")
        return found if width == 1 else found.reshape(-1, width)

    def _bytes(self, element: ElementTree.Element, place: str) -> bytes:
        """The bytes of an array, unpacked."""
        is_appended = element.get("format") == "appended"
        text = self.appended if is_appended else b"".join((element.text or "").encode().split())
        encoded = _Encoded(text, is_raw=is_appended and self.is_raw)
        position = self.count(element, "offset", "0") if is_appended else 0
        if position >= len(text):
            if is_appended:
                raise malformed(place, f"begins at byte {position} of {len(text)} appended ones")
            return b""
        try:
            if self.compressor:
                return b"".join(self._blocks(encoded, position))
            (size,) = self._head(encoded, position, 1)
            return encoded.part(position, self.head.itemsize + size)[self.head.itemsize :]
        except (ValueError, EOFError, zlib.error, lzma.LZMAError) as error:
            raise malformed(place, f"its bytes cannot be read ({error})") from error

    def _head(self, encoded: _Encoded, position: int, count: int) -> list[int]:
        head: list[int] = np.frombuffer(encoded.part(position, count * self.head.itemsize), self.head).tolist()
        return head

    def _blocks(self, encoded: _Encoded, position: int) -> Iterator[bytes]:
        """The unpacked blocks of a compressed array."""
        (count,) = self._head(encoded, position, 1)
        if count == 0:
            return
        count, size, last = self._head(encoded, position, 3)
        sizes = self._head(encoded, position, 3 + count)[3:]
        packed = encoded.part(encoded.after(position, (3 + count) * self.head.itemsize), sum(sizes))
        wanted = [size] * (count - (last > 0)) + [last] * (last > 0)
        self.unpacked += sum(wanted)
        if is_bomb(self.unpacked, self.size):
            raise ValueError(f"with it the file unpacks to over {MOST_RATIO} times its size")
        for (start, stop), length in zip(pairwise(accumulate(sizes, initial=0)), wanted, strict=True):
            yield self._unpacked(packed[start:stop], length)

    def _unpacked(self, block: bytes, length: int) -> bytes:
        if self.compressor == "vtkZLibDataCompressor":
            found = zlib.decompressobj().decompress(block, length + 1)
        elif self.compressor == "vtkLZMADataCompressor":
            found = lzma.LZMADecompressor(memlimit=LZMA_MEMORY).decompress(block, length + 1)
        elif self.compressor == "vtkLZ4DataCompressor":
            found = _unpacked_lz4(block, length)
        else:
            raise ValueError(f"'{self.compressor[:40]}' is not a supported compressor")
        if len(found) != length:
            raise ValueError(f"a block does not have its {length} bytes")
        return found


def _unpacked_lz4(block: bytes, length: int) -> bytes:
    import pyvista

    build = "vtkmodules" if pyvista.vtk_backend() == "vtk" else pyvista.vtk_backend()
    with pyvista.vtk_verbosity("off"):
        found = import_module(f"{build}.vtkIOCore").vtkLZ4DataCompressor().Uncompress(block, len(block), length)
    return b"" if found is None else bytes(pyvista.convert_array(found))


@dataclass(frozen=True)
class _Encoded:
    """Bytes in base64, or as they are."""

    text: bytes
    is_raw: bool

    def after(self, position: int, size: int) -> int:
        """The position after `size` bytes that begin at a position."""
        return position + (size if self.is_raw else 4 * -(-size // 3))

    def part(self, position: int, size: int) -> bytes:
        """The `size` bytes that begin at a position. Raises a ValueError if the text ends too early."""
        text = self.text[position : self.after(position, size)]
        found = text if self.is_raw else binascii.a2b_base64(text)[:size]
        if len(found) < size:
            raise ValueError(f"declares {size} bytes, but only {len(found)} follow")
        return found
