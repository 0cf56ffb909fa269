"""STL, text and binary: each triangle has three vertices of its own."""

import re
import struct
from itertools import chain

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.contents import (
    BYTE_ORDER_MARK,
    FileContents,
    convert_words,
    is_held_in_single_precision,
    malformed,
    real_numbers,
    single_precision,
    text_rows,
)
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.vertex_data import as_float64, unit_vectors
from spinor_geom.errors import MeshFileError, PrecisionError
from spinor_geom.mesh.array_checks import nonfinite_rows
from spinor_geom.mesh.triangle_mesh import Stored, stored_as

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 80
SOLID = "spinor_geom"


def read_stl(data: bytes) -> FileContents:
    """The triangles of an STL file: vertices 3i, 3i + 1, 3i + 2 are the corners of facet i.

    Positions are float64 in text and float32 in binary files. Normals and attribute bytes are not kept.
    """
    is_text = data.removeprefix(BYTE_ORDER_MARK).lstrip()[:5].lower() == b"solid" and b"\0" not in data
    count = int(np.frombuffer(data, "<u4", 1, HEADER)[0]) if len(data) >= HEADER + 4 else 0
    size = HEADER + 4 + count * FACET.itemsize
    # the header of a binary file may begin like text. Less than a facet of padding may follow
    if size <= len(data) < size + (1 if is_text else FACET.itemsize):
        corners, is_text = np.frombuffer(data, FACET, count, HEADER + 4)["corners"], False
    elif is_text:
        corners = _text_corners(data)
    else:
        problem = f"declares {count} facets, {size} bytes; has {len(data)} and does not begin with 'solid'"
        raise malformed(f"byte {HEADER}", problem)
    if len(corners) == 0:
        raise malformed("", "has no facets")
    vertices = as_float64(corners.reshape(-1, 3))
    return FileContents(
        vertices=vertices,
        polygons=Polygons.of_triangles(np.arange(len(vertices)).reshape(-1, 3)),
        representatives=np.arange(len(vertices)),
        nonfinite_places={vertex: f"facet {vertex // 3}" for vertex in nonfinite_rows(vertices).tolist()},
        stored=None if is_text else stored_as(FACET["corners"].base),
        is_text_stl=is_text,
    )


def encode_stl(contents: FileContents) -> bytes:
    """An STL file of the triangles of all faces: text if `is_text_stl`, else binary and rounded to float32."""
    faces, _ = contents.polygons.triangulated(contents.vertices)
    corners = contents.vertices[faces]
    # scaled to size 1, because products of very large or small edges overflow or underflow
    size = np.abs(corners).max(axis=(1, 2), keepdims=True, initial=0.0)
    a, b, c = np.moveaxis(np.divide(corners, size, out=np.zeros_like(corners), where=size > 0), 1, 0)
    normals = unit_vectors(np.cross(b - a, c - a))
    if stored_in_stl(contents) is None:
        rows = text_rows(corners.reshape(-1, 3))
        blocks = [
            f"facet normal {normal}\n outer loop\n  vertex {a}\n  vertex {b}\n  vertex {c}\n endloop\nendfacet\n"
            for normal, a, b, c in zip(text_rows(normals), rows[::3], rows[1::3], rows[2::3], strict=True)
        ]
        return f"solid {SOLID}\n{''.join(blocks)}endsolid {SOLID}\n".encode("ascii")
    facets = np.zeros(len(faces), dtype=FACET)
    facets["normal"] = normals
    facets["corners"] = single_precision(corners)
    return SOLID.encode("ascii").ljust(HEADER, b"\0") + struct.pack("<I", len(faces)) + facets.tobytes()


def stored_in_stl(contents: FileContents) -> Stored | None:
    """The positions in a new STL file, None for text. Raises a PrecisionError if float32 does not hold the mesh."""
    if contents.is_text_stl:
        return None
    if not is_held_in_single_precision(contents, contents.vertices):
        raise PrecisionError(suffix=".stl")
    return stored_as(FACET["corners"].base)


def _text_corners(data: bytes) -> Float[np.ndarray, "f 3 3"]:
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    # the first line is the solid's name, which may be anything
    start = data.find(b"\n", data.lower().find(b"solid")) + 1
    words = re.findall(rb"(?im)^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t\r]*$", data[start:])
    ends = len(re.findall(rb"(?im)^[ \t]*endfacet\b", data[start:]))
    begins = len(re.findall(rb"(?im)^[ \t]*facet\b", data[start:]))
    if begins != ends or len(words) != 3 * ends:
        problem = f"{begins} facets begin, {ends} end, and {len(words)} vertices can be read; each facet needs three"
        raise malformed(f"about facet {min(ends, len(words) // 3)}", problem)

    def error(number: int, word: str) -> MeshFileError:
        return malformed(f"facet {number // 9}", f"'{word}' is not a number", "correct it")

    return np.array(convert_words(list(chain.from_iterable(words)), real_numbers, error)).reshape(-1, 3, 3)
