"""Meshes, extensions and files that the adapter tests share."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer
from spinor_geom.adapters.mesh_files import path_in_errors
from spinor_geom.mesh.triangle_mesh import MeshExtension
from tests.closed import is_watertight

DATA = Path(__file__).parents[2] / "data"

# a cube from (0, 0, 0) to (1, 1, 1) as quads, counter-clockwise seen from outside
CUBE_POINTS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def open_cube(dtype=np.float64):
    """The cube's triangles without its top z = 1. The hole is 1, 3, 7, 5 seen from above."""
    quads = CUBE_QUADS[:-1]
    return CUBE_POINTS.astype(dtype), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def quad_lines(corner="{0}"):
    """The open cube's quads as lines of an OBJ file. `corner` is the pattern of a corner with the index i."""
    return "".join("f " + " ".join(corner.format(i) for i in quad) + "\n" for quad in (CUBE_QUADS[:-1] + 1).tolist())


def extension(vertices, faces, **attributes):
    """New vertices, any number of them, and new faces of one loop."""
    return MeshExtension(
        vertices=np.reshape(vertices, (-1, 3)),
        faces=np.reshape(faces, (-1, 3)),
        face_loops=np.zeros(np.size(faces) // 3, dtype=np.int64),
        vertex_attributes=attributes,
    )


def lid(**attributes):
    """Four triangles around a new vertex that close the open cube."""
    return extension([[0.5, 0.5, 1.0 + 1 / 3]], [[1, 5, 8], [5, 7, 8], [7, 3, 8], [3, 1, 8]], **attributes)


def lid_for(mesh):
    """The lid with the mean of every attribute of a mesh."""
    return lid(**{name: values.mean(axis=0, keepdims=True) for name, values in mesh.vertex_attributes.items()})


def nothing():
    return extension([], np.zeros((0, 3), dtype=np.int64))


def reading(read, suffix):
    """Reads the content of a file of a format; writes a file to a folder and reads it again."""

    def parsed(content):
        with path_in_errors(Path(f"a{suffix}")):
            return MeshFile.of_contents(read(content.encode() if isinstance(content, str) else content), path=None)

    def again(file, folder):
        file.write(folder / f"again{suffix}")
        return read_mesh(folder / f"again{suffix}")

    return parsed, again


def is_closed(mesh):
    return is_watertight(mesh.faces)


@st.composite
def meshes(draw, max_vertices=12):
    """Vertices with any finite coordinates of moderate size and triangles over some of them, not all manifold."""
    count = draw(st.integers(3, max_vertices))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    vertices = random.normal(size=(count, 3)) * 10.0 ** draw(st.integers(-3, 3))
    faces = np.stack([random.permutation(count)[:3] for _ in range(draw(st.integers(1, 2 * max_vertices)))])
    return vertices, faces


@st.composite
def extensions(draw, mesh):
    """No or several new vertices, each in a face with two old ones, and no or several faces over old vertices only."""
    # a stream of its own: a new vertex drawn like an old one would lie on it, and close up with it as a seam
    random = np.random.default_rng([draw(st.integers(0, 2**32 - 1)), 1])
    old = len(mesh.vertices)
    new = draw(st.integers(0, 4))
    faces = [np.array([old + k, *random.permutation(old)[:2]]) for k in range(new)]
    faces += [random.permutation(old)[:3] for _ in range(draw(st.integers(0, 3)))]
    vertices, rows = random.normal(size=(new, 3)), mesh.vertex_attributes.items()
    attributes = {name: values[random.integers(0, old, size=new)] for name, values in rows}
    return extension(vertices, np.array(faces, dtype=np.int64), **attributes)


def glb_tree(data):
    """The JSON of a GLB file."""
    tree: dict[str, Any] = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    return tree


def glb_with(change, data):
    """A GLB file with its JSON changed in place."""
    tree = glb_tree(data)
    change(tree)
    return glb_of_text(json.dumps(tree), data[20 + struct.unpack_from("<I", data, 12)[0] :])


def glb_of_text(text, rest):
    """A GLB file of a text in place of its JSON, and of the chunks that follow it."""
    text += " " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text.encode() + rest


def glb_file(primitives, **tree):
    """A GLB file with one mesh of the given primitives: accessors by name, "indices" among them, used by one node."""
    container = GlbContainer(tree={"asset": {"version": "2.0"}}, views=[])
    entries = []
    for primitive in primitives:
        accessors = {
            name: container.store(rows, target=ELEMENT_ARRAY_BUFFER if name == "indices" else ARRAY_BUFFER)
            for name, rows in primitive.items()
        }
        entry: dict[str, object] = {"attributes": {k: v for k, v in accessors.items() if k != "indices"}}
        if "indices" in accessors:
            entry["indices"] = accessors["indices"]
        entries.append(entry)
    container.tree |= {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    container.tree["meshes"] = [{"primitives": entries}]
    container.tree |= tree
    return container.encoded()
