"""Malformed mesh files, generated when needed; run as a program, reads them all under a limit of memory.

Each is read, and where that works extended by a triangle and written. A line of JSON says what came of each.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.adapters import read_mesh
from spinor_geom.errors import SpinorGeomError
from tests.adapters.shapes import extension, glb_file, glb_of_text, glb_with, open_cube

MEMORY = 400 << 20  # bytes beyond what the imports take


# a file, or what makes it, and what should come of it: (vertices, faces) that are read, or words of the error
Files = dict[str, tuple[str | bytes | Callable[[], str | bytes], tuple[int, int] | str]]


def content_of(name):
    content = CASES[name][0]
    made = content() if callable(content) else content
    return made if isinstance(made, bytes) else made.encode()


# --- OBJ --------------------------------------------------------------------------------------------------------------

V = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
OBJ = V + "f 1 2 3\n"
HUGE = "9" * 5000

OBJ_FILES: Files = {
    "byte order mark": (b"\xef\xbb\xbf" + OBJ.encode(), (3, 1)),
    "capitals of all kinds": ("VT 0 0\nVN 0 0 1\n" + V + "F 1/1/1 2/1/1 3/1/1\nL 1 2\nG a\nO b\n", (3, 1)),
    "underscore in a number": ("v 1_0 0 0\n" + OBJ, "line 1: '1_0' is not a number"),
    "megabytes of continued lines": (lambda: OBJ + "\\\n" * 1_200_000 + "\n", (3, 1)),
    "continued beyond the end": (OBJ + "f 1 2 \\", "line 5: a face needs three corners"),
    "index zero": (V + "f 0 1 2\n", "line 4: vertex 0 does not exist"),
    "index beyond": (V + "f 1 2 4\n", "line 4: vertex 4 does not exist"),
    "index of 30 digits": (V + f"f 1 2 {10**30}\n", "line 4: '1000"),
    "word as index": (V + "f one two three\n", "'one' is not a corner"),
    "four indices in a corner": (V + "f 1/1/1/1 2 3\n", "'1/1/1/1' is not a corner"),
    "digits of another script": (V + "f 1 2 ٣\n", "is not a corner"),
    "no position index": (V + "f /1 2 3\n", "line 4: '/1' is not a corner"),
    "index beyond after a continued comment": (V + "# a \\\n b\n\nf 1 2 7\n", "line 7: vertex 7 "),
    "curve index beyond": (V + "l 1 9\n", "line 4: vertex 9 "),
    "two corners": (V + "f 1 2\n", "line 4: a face needs three corners, got 'f 1 2'"),
    "one vertex in a curve": (OBJ + "l 1\n", "a curve needs two vertices"),
    "two coordinates": ("v 0 0\n" + OBJ, "line 1: a vertex needs three coordinates"),
    "word as coordinate": ("v 0 zero 0\n" + OBJ, "'zero' is not a number"),
    "comma as decimal point": ("v 0,5 0 0\n" + OBJ, "'0,5' is not a number"),
    "nan": ("v 0 nan 0\n" + OBJ, "line 1: vertex 0 has a NaN"),
    "number beyond all": (V + "v 1e999 0 0\nf 1 2 4\n", "line 4: vertex 3"),
    "latin letters": (b"# M\xfcller\no K\xf6rper\n" + OBJ.encode(), (3, 1)),
    "wide letters": (OBJ.encode("utf-16"), "has a zero byte, so it is not a text file"),
    "zero byte": (OBJ + "\0", "a zero byte"),
    "empty": ("", "is empty"),
    "spaces": (" \n\t\n", "has no vertices"),
    "points": (V, "has vertices but no faces"),
    "faces before vertices": ("f 1 2 3\n" + V, (3, 1)),
    "a vertex named twice": (V + "f 1 1 2\n", (3, 1)),
    "other files and commands": ("mtllib /dev/zero\ncall /dev/zero\nsh rm\n" + OBJ, (3, 1)),
    "a wrong word of a million letters": (lambda: V + "f 1 2 " + "x" * 1_000_000 + "\n", "is not a corner"),
    "a face of 100000 corners": (lambda: V + "f" + " 1 2 3" * 33_333 + "\n", (3, 99_997)),
    "curves only": (V + "l 1 2 3\n", (3, 0)),
}


# --- PLY --------------------------------------------------------------------------------------------------------------


def ply(*, vertices=3, faces=1, body="0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", index="int"):
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar {index} vertex_indices\nend_header\n{body}"
    )


POINTS = "0 0 0\n1 0 0\n0 1 0\n"
PLY = ply()


SIGNALLING = b"\x01\x00\x80\x7f"  # NaNs of this kind raise a floating-point flag when they are converted


def binary_ply(*, vertices=3, faces=1, count="int", body=None, order="<"):
    header = (
        f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\nelement vertex {vertices}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list {count} int vertex_indices\nend_header\n"
    )
    points = struct.pack(f"{order}9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    return header.encode() + (points + struct.pack(f"{order}4i", 3, 0, 1, 2) if body is None else points + body)


def cut_polygons():
    """A million bytes of faces, of which the header declares twice as many."""
    record = struct.pack("<9i", 3, 0, 1, 2, 4, 0, 1, 2, 0)
    return binary_ply(faces=10**6, body=record * (10**6 // len(record)))


PLY_FILES: Files = {
    "byte order mark": (b"\xef\xbb\xbf" + PLY.encode(), (3, 1)),
    "fraction as index": (ply(body=POINTS + "3 0 1 0.5\n"), "line 13: cannot read face 0"),
    "underscore in a number": (ply(body=POINTS.replace("1", "1_0") + "3 0 1 2\n"), "line 11: cannot read vertex 1"),
    "vertex count of 64 bits": (ply(vertices=2**63), "line 3: cannot understand"),
    "vertex count of 17 digits": (ply(vertices=10**17), "the file ends within record 4"),
    "negative count": (ply(vertices=-3), "line 3: cannot understand"),
    "many records of nothing": (PLY.replace("end_header", f"element x {10**17}\nend_header"), (3, 1)),
    "unknown line in the header": (PLY.replace("float z\n", "float z\nnonsense 1\n"), "line 7: cannot understand"),
    "word as coordinate": (ply(body="0 0 0\n1 0 q\n0 1 0\n3 0 1 2\n"), "line 11: cannot read vertex 1"),
    "no end of the header": (PLY.replace("end_header", "end"), "has no line 'end_header'"),
    "no format": (PLY.replace("format ascii 1.0\n", ""), "the format is None"),
    "another magic word": (PLY.replace("ply", "plz"), "does not begin with 'ply'"),
    "unknown type": (PLY.replace("float x", "quad x"), "is of unknown type"),
    "length of a real type": (PLY.replace("list uchar", "list float"), "is of unknown type"),
    "indices of a real type": (ply(index="double"), "the corners of the element 'face' are not integers"),
    "a signalling NaN": (binary_ply().replace(struct.pack("<f", 1), SIGNALLING), "NaN or infinite"),
    "thousands of properties": (
        lambda: PLY.replace(
            "property float x", "".join(f"property float a{k}\n" for k in range(9000)) + "property float x"
        ),
        "header: declares over 1000 elements and properties",
    ),
    "billions of records in megabytes": (
        lambda: (
            b"ply\nformat binary_little_endian 1.0\nelement other 4000000000\nproperty list uchar uchar a\n"
            b"element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            b"element face 1\nproperty list uchar int vertex_indices\nend_header\n" + bytes(50_000_000)
        ),
        "element 'other': the header declares 4000000000 records, but the file ends within record 50000",
    ),
    "two properties of one name": (PLY.replace("float y", "float x"), "or the second of its name"),
    "two elements of one name": (PLY.replace("element face", "element vertex"), "two elements of one name"),
    "property of no element": (PLY.replace("element vertex 3\n", ""), "line 3: cannot understand"),
    "no coordinates": (PLY.replace("float z", "float w"), "no x, y and z"),
    "no corners": (PLY.replace("vertex_indices", "corners"), "no list 'vertex_indices'"),
    "no faces": (ply(faces=0, body=POINTS), "has no faces"),
    "no vertices": (ply(vertices=0, body="3 0 1 2\n"), "has no vertices"),
    "index beyond": (ply(body=POINTS + "3 0 1 3\n"), "face 0: has vertex index 3"),
    "negative index": (ply(body=POINTS + "3 0 1 -1\n"), "face 0: has vertex index -1"),
    "length of minus one": (ply(body=POINTS + "-1 0 1 2\n"), "cannot read face 0"),
    "two corners": (ply(body=POINTS + "2 0 1\n"), "has 2 corners"),
    "strip with an index beyond": (PLY.replace("face", "tristrips").replace("0 1 2\n", "0 1 8\n"), "vertex index 8"),
    "a short vertex": (ply(body="0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), "line 10: cannot read vertex 0"),
    "byte of 256": (PLY.replace("float z", "uchar z").replace("1 0 0", "1 0 256"), "line 11: cannot read vertex 1"),
    "nan": (ply(body="0 0 0\n\n1 nan 0\n0 1 0\n3 0 1 2\n"), "line 12: vertex 1 has a NaN"),
    "latin letters": (PLY.encode().replace(b"element v", b"comment M\xfcller\nelement v"), (3, 1)),
    "wide letters": (PLY.encode("utf-16"), "does not begin with 'ply'"),
    "empty": ("", "is empty"),
    "megabytes of blank lines": (lambda: ply(body=POINTS + "\n" * 2_000_000 + "3 0 1 2\n"), (3, 1)),
    "binary with bytes after it": (binary_ply() + b"more", (3, 1)),
    "binary with a byte order mark": (b"\xef\xbb\xbf" + binary_ply(), (3, 1)),
    "binary, length of minus one": (
        binary_ply(body=struct.pack("<4i", -1, 0, 1, 2)),
        "record 0 has a list of length -1",
    ),
    "binary, nan": (binary_ply().replace(struct.pack("<f", 1), struct.pack("<f", np.nan), 1), "vertex 1 has a NaN"),
    "binary, many records of nothing": (
        binary_ply().replace(b"end_header", b"element x 99999999999999\nproperty list uchar int y\nend_header"),
        "element 'x'",
    ),
    "binary, polygons cut": (cut_polygons, "the file ends within record 55554"),
    "binary, scalars cut": (
        lambda: binary_ply(vertices=10**7)[: -16 - 36] + b"\0" * 10**7,
        "the file ends within record 833333",
    ),
}


# --- OFF --------------------------------------------------------------------------------------------------------------

OFF = "OFF\n3 1 0\n" + POINTS + "3 0 1 2\n"

OFF_FILES: Files = {
    "one line": (OFF.replace("\n", " "), (3, 1)),
    "a line for each number": (OFF[:10] + OFF[10:].replace(" ", "\n"), "a vertex with 1 numbers"),
    "underscore in a number": (OFF.replace("1 0 0", "1_0 0 0"), "line 4: cannot read vertex 1"),
    "count of 18 digits": (OFF.replace("3 1 0", f"{10**17} 1 0"), "the file ends within record 4"),
    "no counts": ("OFF\n", "the counts"),
    "no faces": (OFF.replace("3 1 0", "3 0 0"), "line 2: the counts of vertices and faces are missing or zero"),
    "index beyond": (OFF.replace("0 1 2", "0 1 3"), "line 6, face 0: has vertex index 3"),
    "a billion corners": (OFF.replace("3 0 1 2", f"{10**9} 0 1 2"), "line 6: cannot read face 0"),
    "two corners": (OFF.replace("3 0 1 2", "2 0 1"), "line 6, face 0: has 2 corners, a face needs three"),
    "normals announced": (OFF.replace("OFF", "NOFF"), "line 3: a vertex with 3 numbers does not fit"),
    "short first vertex": (OFF.replace("0 0 0\n", "0 0\n"), "line 3: a vertex with 2 numbers"),
    "short vertex": (OFF.replace("1 0 0", "1 0"), "line 4: cannot read vertex 1 from '1 0'"),
    "word as coordinate": (OFF.replace("1 0 0", "1 0 o"), "line 4: cannot read vertex 1 from '1 0 o'"),
    "nan": (OFF.replace("1 0 0", "1 0 nan"), "line 4: vertex 1 has a NaN"),
    "old line ends": (OFF.replace("\n", "\r"), (3, 1)),
    "latin letters": (OFF.encode().replace(b"OFF", b"OFF # M\xfcller"), (3, 1)),
    "wide letters": (OFF.encode("utf-16"), "a zero byte"),
    "binary": (b"OFF BINARY\n\0\0\0\3", "a zero byte"),
    "four coordinates": (OFF.replace("OFF", "4OFF"), "is not a supported kind of OFF"),
    "colours announced": (OFF.replace("OFF", "COFF"), "does not fit the keyword"),
    "another magic word": (OFF.replace("OFF", "ON"), "is not a supported kind of OFF"),
    "empty": ("", "is empty"),
    "megabytes of blank lines": (lambda: OFF.replace("\n3 0", "\n" * 400_000 + "3 0"), (3, 1)),
}


# --- STL --------------------------------------------------------------------------------------------------------------

STL = (
    "solid a\n"
    + 2
    * ("facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n").replace(
        "vertex 0 1 0", "vertex 0 1 {}"
    )
    + "endsolid a\n"
)
STL = STL.format(0, 2)


def binary_stl(*, header=b"", count=2, facets=2):
    facet = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    return header.ljust(80, b"\0") + struct.pack("<I", count) + facet * facets


STL_FILES: Files = {
    "a signalling NaN": (binary_stl()[:96] + SIGNALLING + binary_stl()[100:], "NaN or infinite"),
    "text": (STL, (4, 2)),
    "byte order mark": (b"\xef\xbb\xbf" + STL.encode(), (4, 2)),
    "old line ends": (STL.replace("\n", "\r"), (4, 2)),
    "capitals": (STL.upper(), (4, 2)),
    "a name like a vertex": (STL.replace("solid a", "solid vertex 1 2 3", 1), (4, 2)),
    "wide letters": (STL.encode("utf-16"), "bytes; has"),
    "nan": (STL.replace("1 0 0", "nan 0 0", 1), "facet 0: vertex 1 has a NaN"),
    "underscore": (STL.replace("0 1 2", "0 1 1_0"), "facet 1: '1_0' is not a number"),
    "word as coordinate": (STL.replace("0 1 2", "0 1 two"), "facet 1: 'two' is not a number"),
    "no facets": ("solid a\nendsolid a\n", "has no facets"),
    "facets without corners": ("solid a\nfacet\nendfacet\nendsolid a\n", "1 facets begin, 1 end, and 0 vertices"),
    "one line": (STL.replace("\n", " "), "has no facets"),
    "empty": ("", "is empty"),
    "another magic word": (STL.replace("solid", "fluid"), "does not begin with 'solid'"),
    "needles only": (STL.replace("1 0 0", "0 0 0"), "has vertices but no faces"),
    "binary": (binary_stl(), (3, 2)),
    "binary that begins like text": (binary_stl(header=b"solid a"), (3, 2)),
    "binary with two bytes more": (binary_stl() + b"\r\n", (3, 2)),
    "binary with a facet more": (binary_stl(facets=3), "declares 2 facets, 184 bytes; has 234"),
    "binary with a byte less": (binary_stl()[:-1], "declares 2 facets, 184 bytes; has 183"),
    "binary of four billion facets": (binary_stl(count=4 * 10**9), "declares 4000000000 facets"),
    "binary of no facets": (binary_stl(count=0, facets=0), "has no facets"),
    "binary, nan": (
        binary_stl().replace(struct.pack("<3f", 1, 0, 0), struct.pack("<3f", np.nan, 0, 0)),
        "facet 0: vertex 1 has a NaN",
    ),
}


# --- GLB --------------------------------------------------------------------------------------------------------------

CUBE, FACES = open_cube(np.float32)
GLB = glb_file([{"POSITION": CUBE, "indices": FACES.reshape(-1, 1).astype(np.uint16)}])
JSON_SIZE = struct.unpack_from("<I", GLB, 12)[0]


def glb(change, data=GLB):
    return glb_with(change, data)


def with_text(text, rest=GLB[20 + JSON_SIZE :]):
    return glb_of_text(text, rest)


def primitive(tree):
    return tree["meshes"][0]["primitives"][0]


def huge_sparse(tree):
    sparse = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}
    tree["accessors"][0] = {"componentType": 5126, "type": "VEC3", "count": 2**31 - 1, "sparse": sparse}


def instances():
    """A third of a megabyte: a mesh of 20000 vertices, used by 900 nodes."""
    points = np.random.default_rng(1).integers(0, 100, size=(20_000, 3)).astype(np.float32)
    indices = np.arange(48_000).reshape(-1, 1) % 20_000

    def show(tree):
        tree["nodes"] = [{"mesh": 0}] * 900
        tree["scenes"] = [{"nodes": list(range(900))}]

    return glb(show, glb_file([{"POSITION": points, "indices": indices.astype(np.uint16)}]))


def aliases():
    """One array under 20000 names."""
    points = np.zeros((20_000, 3), dtype=np.float32)
    return glb(
        lambda tree: primitive(tree)["attributes"].update({f"_{name}": 0 for name in range(20_000)}),
        glb_file([{"POSITION": points, "indices": np.arange(30).reshape(-1, 1).astype(np.uint16)}]),
    )


def empty_primitives():
    """An empty primitive that is used 36 million times."""

    def show(tree):
        tree["meshes"][0]["primitives"] = [{"attributes": {}}] * 6000
        tree["nodes"] = [{"mesh": 0}] * 6000
        tree["scenes"] = [{"nodes": list(range(6000))}]

    return glb(show)


def nested(levels):
    value: list = []
    for _ in range(levels):
        value = [value]
    return value


GLB_FILES: Files = {
    "valid": (GLB, (8, 10)),
    "gigabytes of zeros": (glb(huge_sparse), "accessor 0: its data is external"),
    "900 instances": (instances, "over 10,000,000 rows of arrays"),
    "20000 names for one array": (aliases, "over 10,000,000 rows of arrays"),
    "36 million empty primitives": (empty_primitives, "over 10,000,000 rows of arrays"),
    "a node millions of times": (
        lambda: glb(lambda tree: tree.update(scenes=[{"nodes": [0] * 3_000_000}])),
        "node 0: has two parents",
    ),
    "thousands of empty nodes": (
        lambda: glb(
            lambda tree: tree.update(nodes=[*tree["nodes"], *[{}] * 200_000], scenes=[{"nodes": [*range(200_001)]}])
        ),
        (8, 10),
    ),
    "node its own child": (glb(lambda tree: tree["nodes"][0].update(children=[0])), "node 0: has two parents"),
    "negative accessor": (glb(lambda tree: primitive(tree).update(indices=-1)), "number -1 of its 2 accessors"),
    "view that does not exist": (glb(lambda tree: tree["accessors"][0].update(bufferView=9)), "of its 2 bufferViews"),
    "image in no view": (glb(lambda tree: tree.update(images=[{"bufferView": "a"}])), (8, 10)),
    "negative offset": (glb(lambda tree: tree["bufferViews"][0].update(byteOffset=-4)), "buffer view 0"),
    "length beyond": (glb(lambda tree: tree["bufferViews"][0].update(byteLength=10**12)), "buffer view 0: ends at"),
    "length of 5000 digits": (
        with_text(GLB[20 : 20 + JSON_SIZE].decode().replace('"byteLength":96', f'"byteLength":{HUGE}')),
        "JSON: ",
    ),
    "accessor beyond": (glb(lambda tree: tree["accessors"][0].update(byteOffset=10**9)), "accessor 0: declares"),
    "count as text": (glb(lambda tree: tree["accessors"][0].update(count="8")), "does not follow glTF"),
    "count beyond": (glb(lambda tree: tree["accessors"][0].update(count=10**15)), "accessor 0: declares"),
    "stride too small": (glb(lambda tree: tree["bufferViews"][0].update(byteStride=4)), "accessor 0: declares"),
    "unknown component type": (glb(lambda tree: tree["accessors"][0].update(componentType=1)), "does not follow glTF"),
    "plane positions": (glb(lambda tree: tree["accessors"][0].update(type="VEC2")), "of the width that glTF requires"),
    "real indices": (
        glb(lambda tree: tree["accessors"][1].update(componentType=5126, count=15)),
        "its indices are not unsigned integers",
    ),
    "index beyond": (glb(lambda tree: tree["accessors"][0].update(count=7)), "do not form triangles of its 7 vertices"),
    "real and normalized": (glb(lambda tree: tree["accessors"][0].update(normalized=True)), (8, 10)),
    "file outside": (glb(lambda tree: tree["buffers"][0].update(uri="/dev/zero")), "its data is external"),
    "draco": (glb(lambda tree: primitive(tree).update(extensions={"KHR_draco_mesh_compression": {}})), "Draco"),
    "meshopt": (
        glb(lambda tree: tree["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}})),
        "or compressed",
    ),
    "scale of zero": (glb(lambda tree: tree["nodes"][0].update(scale=[1, 0, 1])), "transform is singular"),
    "scale of nan": (glb(lambda tree: tree["nodes"][0].update(scale=[1, float("nan"), 1])), "has a NaN"),
    "scale beyond all": (
        glb(lambda tree: tree["nodes"][0].update(scale=[1e300] * 3, translation=[1e308] * 3)),
        (8, 10),
    ),
    "short matrix": (glb(lambda tree: tree["nodes"][0].update(matrix=[1, 2, 3])), "does not follow glTF"),
    "points": (glb(lambda tree: primitive(tree).update(mode=0)), "has no triangles"),
    "a strip": (glb(lambda tree: primitive(tree).update(mode=5)), "mesh 0, primitive 0: is a triangle strip or fan"),
    "morph targets": (glb(lambda tree: primitive(tree).update(targets=[{"POSITION": 0}])), "has morph targets"),
    "sparse": (glb(lambda tree: tree["accessors"][0].update(sparse={"count": 1})), "accessor 0: its data is external"),
    "no buffer": (with_text(GLB[20 : 20 + JSON_SIZE].decode(), b""), "the binary buffer, which has 0"),
    "another chunk in place of the buffer": (
        GLB[: 24 + JSON_SIZE] + b"XXXX" + GLB[28 + JSON_SIZE :],
        "the binary buffer, which has 0",
    ),
    "cut in the buffer, with a length that fits": (
        GLB[:8] + struct.pack("<I", len(GLB) - 8) + GLB[12:-8],
        "bytes of binary data, but the file ends after",
    ),
    "deep JSON": (with_text('{"a":' + "[" * 50_000 + "]" * 50_000 + "}"), "JSON: "),
    "rather deep JSON": (glb(lambda tree: tree.update(extras=nested(300))), "nested more than 100 levels"),
    "JSON that is no object": (with_text("[]"), "JSON: is not an object"),
    "JSON of numbers": (with_text('{"nodes": [1], "meshes": 3}'), "is not a list of objects"),
    "no JSON": (with_text("?"), "JSON: Expecting value"),
    "JSON in latin letters": (with_text('{"a": "')[:-1] + b"\xfc\xfc\xfc\xfc", "JSON: "),
    "nothing in JSON": (with_text("{}"), "has no triangles"),
    "buffer longer than the file": (
        GLB[: 20 + JSON_SIZE] + struct.pack("<I", 2**32 - 1) + GLB[24 + JSON_SIZE :],
        "declares 4294967295 bytes",
    ),
    "JSON longer than the file": (GLB[:12] + struct.pack("<I", 2**32 - 1) + GLB[16:], "byte 8: declares"),
    "first version": (GLB[:4] + struct.pack("<I", 1) + GLB[8:], "is glTF version 1"),
    "another magic word": (b"gltf" + GLB[4:], "does not begin like"),
    "nan": (GLB.replace(struct.pack("<3f", 1, 1, 1), struct.pack("<3f", 1, np.nan, 1)), "vertex 3 has a NaN"),
}

CASES: Files = {
    f"{kind}, {name}.{kind.lower()}": case
    for kind, files in {
        "OBJ": OBJ_FILES,
        "PLY": PLY_FILES,
        "OFF": OFF_FILES,
        "STL": STL_FILES,
        "GLB": GLB_FILES,
    }.items()
    for name, case in files.items()
} | {
    f"{kind} in another format's name.{suffix}": (content, words)
    for suffix, words in (
        ("obj", "has no vertices"),
        ("ply", "does not begin with 'ply'"),
        ("off", "OFF"),
        ("stl", "does not begin with 'solid'"),
        ("glb", "does not begin like"),
        ("xyz", "is not a supported format"),
        ("", "is not a supported format"),
    )
    for kind, content in (("OBJ", OBJ), ("PLY", PLY), ("OFF", OFF), ("STL", STL))
    if kind.lower() != suffix
}


def tried(path):
    """The result of reading a file, and of writing it with one more triangle."""
    start = time.perf_counter()
    outcome: dict[str, Any]
    try:
        file = read_mesh(path)
        outcome = {"read": [len(file.mesh.vertices), len(file.mesh.faces)]}
        written = path.with_name(f"out{path.suffix}")
        with_a_triangle(file).write(written)
        written.unlink()
    except SpinorGeomError as error:
        outcome = {"error": str(error)}
    except Exception as error:  # what must not be
        outcome = {"raw": f"{type(error).__name__}: {error}"}
    return {**outcome, "seconds": time.perf_counter() - start}


def with_a_triangle(file):
    rows = {name: values[:1] for name, values in file.mesh.vertex_attributes.items()}
    return file.extended(extension(file.mesh.vertices[:1] + 1.0, [0, 1, len(file.mesh.vertices)], **rows))


def limit_memory():
    """Limits the additional memory of this process, on Linux only."""
    if not sys.platform.startswith("linux"):
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    limit_memory()
    for name in CASES:
        path = folder / name
        path.write_bytes(content_of(name))
        sys.stdout.write(json.dumps({"name": name, **tried(path)}) + "\n")
        sys.stdout.flush()
        path.unlink()
