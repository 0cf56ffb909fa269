"""Changes valid small mesh files in every way; run as a program for one format, under the limit of `malformed`."""

from __future__ import annotations

import os
import struct
import sys
import tempfile
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.adapters.malformed import CUBE, FACES, GLB, OBJ, OFF, PLY, STL, binary_ply, binary_stl, limit_memory, tried
from tests.adapters.malformed import glb as glb_with
from tests.adapters.shapes import glb_file

EXAMPLES = 30

RICH_OBJ = (
    "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 1 1 0 1 1 1\nvt 0 0\nvn 0 0 1\n"
    "o a\ng b\nf 1/1/1 2/1/1 -1/-1/-1 3/1/1\nl 1 2\n"
)
RICH_PLY = (
    "ply\nformat ascii 1.0\ncomment a\nelement vertex 3\nproperty float x\nproperty double y\nproperty short z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float quality\n"
    "element face 2\nproperty list uchar int vertex_indices\nproperty list int float texcoord\nproperty uchar flag\n"
    "element edge 1\nproperty int a\nproperty list uchar int b\nend_header\n"
    "0 0 0 1 2 3 0.5\n1 0 0 1 2 3 0.5\n0 1 0 9 9 9 1e-3\n3 0 1 2 0 1\n3 0 2 1 2 0.5 0.5 1\n7 2 0 1\n"
)
MIXED_PLY = binary_ply(faces=3, body=struct.pack("<13i", 3, 0, 1, 2, 4, 0, 1, 2, 0, 3, 2, 1, 0))
RICH_OFF = (
    "STCNOFF\n3 1 0\n0 0 0 0 0 1 9 9 9 255 0 0\n1 0 0 0 0 1 9 9 9 255 1 0\n0 1 0 0 0 1 9 9 9 255 0 1\n3 0 1 2 1 0 0\n"
)
RICH_GLB = glb_file(
    [
        {
            "POSITION": CUBE,
            "NORMAL": CUBE,
            "TEXCOORD_0": CUBE[:, :2].copy(),
            "COLOR_0": np.arange(32, dtype=np.uint8).reshape(8, 4),
            "indices": FACES.reshape(-1, 1).astype(np.uint8),
        },
        {"POSITION": CUBE[:6] + 2},
    ],
    nodes=[{"mesh": 0, "scale": [2, 1, 1], "children": [1]}, {"mesh": 0, "rotation": [0, 0, 0, 1]}],
    materials=[{"name": "a"}],
)

VALID: dict[str, tuple[str, list[str | bytes]]] = {
    "obj": ("a.obj", [OBJ, RICH_OBJ, OBJ.replace("\n", "\r\n"), OBJ.replace(" ", " \\\n")]),
    "text-ply": ("a.ply", [PLY, RICH_PLY, PLY.replace("\n", "\r")]),
    "binary-ply": ("a.ply", [binary_ply(), binary_ply(order=">"), MIXED_PLY]),
    "off": ("a.off", [OFF, RICH_OFF, OFF.replace("\n", " ")]),
    "text-stl": ("a.stl", [STL, STL.replace("\n", "\r")]),
    "binary-stl": ("a.stl", [binary_stl(), binary_stl(header=b"solid")]),
    "glb": ("a.glb", [GLB, RICH_GLB]),
}
PIECES = [
    *(b"-1", b"0", b"3", b"1_0", b"0.5", b"nan", b"-inf", b"1e999", b"9" * 30, b"9" * 5000, b"4294967295", b"1e-320"),
    *(b"\n", b"\r", b"\\\n", b" ", b"/", b"//", b"#", b"\0", b"\xff", b"\xef\xbb\xbf", b"\xff\xff\xff\xff", b"\x80"),
    *(b"v", b"f", b"l 1 2 1\n", b"vt", b"end_header\n", b"element face 2\n", b"list", b"OFF", b"vertex", b"endfacet"),
]
VALUES: list[Any] = [
    *(None, True, -1, 0, 1, 2, 3, 5, 7, 10**9, 2**63, 10**30, 0.5, float("nan"), float("inf"), 1e300, "", "a"),
    *([], {}, [0], [[]], [1, 2, 3], {"a": 1}, 5120, 5122, 5123, 5125, 5126, "SCALAR", "VEC2", "MAT4"),
]


@st.composite
def changed_bytes(draw, valid):
    """A valid file with a few of its bytes taken out, repeated, put in or replaced."""
    base = draw(st.sampled_from(valid))
    data = base if isinstance(base, bytes) else base.encode()
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        stop = draw(st.integers(start, min(start + 16, len(data))))
        middle = draw(st.sampled_from([b"", data[start:stop] * 2, *PIECES]) | st.binary(max_size=4))
        data = data[:start] + middle + data[stop if draw(st.booleans()) else start :]
        if draw(st.integers(0, 9)) == 0:
            data = data[:stop]
    return data


@st.composite
def changed_json(draw):
    """A GLB file with a few values of its JSON replaced, added or taken out."""

    def change(tree):
        for _ in range(draw(st.integers(1, 3))):
            node: Any = tree
            while True:
                keys = list(node) if isinstance(node, dict) else list(range(len(node)))
                key = draw(st.sampled_from(keys))
                if isinstance(node[key], (dict, list)) and node[key] and draw(st.integers(0, 4)):
                    node = node[key]
                    continue
                break
            if draw(st.integers(0, 4)) == 0:
                del node[key]
            else:
                node[key] = deepcopy(draw(st.sampled_from(VALUES)))
            if not tree:
                return

    return glb_with(change, draw(st.sampled_from([GLB, RICH_GLB])))


def fuzz(kind):
    """Fails at the first file that gives anything but a mesh or a typed error."""
    name, valid = VALID[kind]
    strategy = changed_bytes(valid) if kind != "glb" else changed_bytes(valid) | changed_json()

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name

        @settings(max_examples=EXAMPLES, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
        @given(strategy)
        def read(data):
            path.write_bytes(data)
            outcome = tried(path)
            assert "raw" not in outcome, outcome
            assert outcome["seconds"] < 10.0, outcome

        read()


if __name__ == "__main__":
    os.fsync = lambda descriptor: None  # the disk is not what is tested, and most of the time
    limit_memory()
    for each in VALID:
        print(f"changed {each} files", file=sys.stderr, flush=True)
        fuzz(each)
