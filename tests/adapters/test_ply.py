from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import MeshFile, read_mesh
from spinor_geom.adapters.ply import read_ply, read_records
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extension, extensions, is_closed, lid, open_cube, reading

parsed, again = reading(read_ply, ".ply")


FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"]


def ply(encoding, vertices, faces, *, extra=None, face_extra="", coordinate="float", before="", newline="\n"):
    """A PLY file: positions, further scalar properties (type, values), faces, and with `face_extra` a colour a face."""
    extra = extra or {}
    kinds = {"float": "f4", "double": "f8", "uchar": "u1", "int": "i4"}
    order = ">" if encoding == "binary_big_endian" else "<"
    columns = [(coordinate, column) for column in vertices.T] + list(extra.values())
    header = ["ply", f"format {encoding} 1.0", "comment element vertex 99", *before.splitlines()]
    header += [f"element vertex {len(vertices)}", *(f"property {coordinate} {name}" for name in "xyz")]
    header += [f"property {kind} {name}" for name, (kind, _) in extra.items()]
    header += [f"element face {len(faces)}"]
    header += ["property uchar red"] if face_extra else []
    header += ["property list uchar int vertex_indices", "end_header", ""]
    text = newline.join(header).encode()
    if encoding == "ascii":
        rows = [" ".join(repr(column[i].item()) for _, column in columns) for i in range(len(vertices))]
        rows += [("7 " if face_extra else "") + " ".join(map(str, [len(face), *face])) for face in faces]
        return text + newline.join([*rows, ""]).encode()
    records = np.zeros(len(vertices), dtype=[(f"{i}", order + kinds[kind]) for i, (kind, _) in enumerate(columns)])
    for i, (_, column) in enumerate(columns):
        records[f"{i}"] = column
    body = b"".join(
        (b"\x07" if face_extra else b"") + bytes([len(face)]) + np.array(face, dtype=order + "i4").tobytes()
        for face in faces
    )
    return text + records.tobytes() + body


QUADS = [quad.tolist() for quad in CUBE_QUADS[:-1]]
MIXED = [QUADS[0][:3], [QUADS[0][0], QUADS[0][2], QUADS[0][3]], *QUADS[1:]]


@pytest.mark.parametrize("encoding", FORMATS)
@pytest.mark.parametrize("faces", [QUADS, MIXED], ids=["quads", "mixed"])
@pytest.mark.parametrize("face_extra", ["", "red"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_polygons_stay_and_the_lid_closes_the_cube(tmp_path, encoding, faces, face_extra, newline):
    data = ply(encoding, CUBE_POINTS, faces, face_extra=face_extra, newline=newline)
    file = parsed(data)
    assert file.polygons.rows() == faces
    assert np.array_equal(file.mesh.vertices, CUBE_POINTS)
    closed = again(file.extended(lid()), tmp_path)
    assert closed.polygons.rows() == faces + lid().faces.tolist()
    assert is_closed(closed.mesh)
    again(file, tmp_path)
    assert (tmp_path / "again.ply").read_bytes() == data


@given(
    data=st.data(),
    encoding=st.sampled_from(FORMATS),
    coordinate=st.sampled_from(["float", "double"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_round_trip_keeps_every_property(tmp_path_factory, data, encoding, coordinate, seed):
    random = np.random.default_rng(seed)
    vertices = random.normal(size=(6, 3)).astype("f4" if coordinate == "float" else "f8")
    extra = {name: ("uchar", random.integers(0, 256, 6).astype("u1")) for name in ("red", "green", "blue")}
    extra |= {name: ("float", random.normal(size=6).astype("f4")) for name in ("nx", "ny", "nz", "quality")}
    extra |= {"label": ("int", random.integers(-9, 9, 6))}
    file = parsed(ply(encoding, vertices, [[0, 1, 2], [2, 1, 3, 4]], extra=extra, coordinate=coordinate))
    attributes = file.mesh.vertex_attributes
    assert set(attributes) == {"color", "normal", "quality", "label"}
    assert np.array_equal(attributes["color"][:, 1], extra["green"][1])
    grown = file.extended(data.draw(extensions(file.mesh)))
    back = again(grown, tmp_path_factory.mktemp("ply"))
    assert back.mesh.labels == {"label"}
    assert back.mesh.vertices[:6].tobytes() == vertices.astype(float).tobytes()
    rounded = grown.mesh.vertices[6:] if encoding == "ascii" else grown.mesh.vertices[6:].astype(vertices.dtype)
    assert np.array_equal(back.mesh.vertices[6:], rounded)
    assert back.polygons.rows() == grown.polygons.rows()
    for name, values in grown.mesh.vertex_attributes.items():
        assert np.array_equal(back.mesh.vertex_attributes[name], values), name


def test_real_colors_of_255_are_recognised_by_any_channel():
    extra = {name: ("float", np.full(8, value)) for name, value in (("red", 0), ("green", 0), ("blue", 255))}
    assert parsed(ply("ascii", CUBE_POINTS, QUADS, extra=extra)).contents.color_scale == 255.0


def test_other_elements_and_comments_stay(tmp_path):
    before = "obj_info hello\nelement camera 1\nproperty float view\nproperty int depth"
    data = ply("binary_little_endian", CUBE_POINTS, QUADS, before=before)
    head = data.index(b"end_header\n") + len(b"end_header\n")
    data = data[:head] + b"\0\0\x80?\x05\0\0\0" + data[head:]
    closed = again(parsed(data).extended(lid()), tmp_path)
    written = (tmp_path / "again.ply").read_bytes()
    assert b"comment element vertex 99\nobj_info hello\nelement camera 1\n" in written
    assert b"element vertex 9\n" in written
    assert b"end_header\n\0\0\x80?\x05\0\0\0" in written
    assert is_closed(closed.mesh)


def test_text_lines_of_one_length_with_lists_of_another_are_read():
    header = HEAD.replace("vertex 3", "vertex 5") + "element face 2\nproperty list uchar int vertex_indices\n"
    header += "property list uchar int edges\nend_header\n"
    body = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 2 0\n" + "3 0 1 2 2 7 7\n4 0 2 4 3 1 7\n"
    assert parsed((header + body).encode()).polygons.rows() == [[0, 1, 2], [0, 2, 4, 3]]


def test_empty_elements_are_skipped():
    before = "element edge 0\nproperty int a\nproperty list uchar int b\nelement nothing 5"
    for encoding in FORMATS:
        assert parsed(ply(encoding, CUBE_POINTS, QUADS, before=before)).polygons.rows() == QUADS


def test_lists_beside_the_corners_are_kept(tmp_path):
    vertices, faces = open_cube()
    header = (
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "property list uchar int owners\nelement face 10\nproperty list uchar int vertex_indices\n"
        "property list uchar float weights\nproperty int part\nend_header\n"
    )
    body = "".join(f"{x} {y} {z} 2 5 6\n" for x, y, z in vertices)
    body += "".join(f"3 {a} {b} {c} 6 0 0 1 0 1 1 4\n" for a, b, c in faces)
    file = parsed((header + body).encode())
    closed = again(file.extended(lid()), tmp_path)
    lines = (tmp_path / "again.ply").read_text().splitlines()
    assert lines[-1] == "3 3 1 8 6 0.0 0.0 0.0 0.0 0.0 0.0 4"
    assert "0.5 0.5 1.3333333333333333 0" in lines
    assert is_closed(closed.mesh)


HEAD = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"


def test_an_attribute_called_like_a_coordinate_is_written_beside_it(tmp_path):
    contents = replace(parsed(ply("ascii", CUBE_POINTS, QUADS)).contents, attributes={"x": np.ones((8, 1))}, suffix="")
    back = again(MeshFile.of_contents(contents, path=None), tmp_path)
    assert np.array_equal(back.mesh.vertices, CUBE_POINTS)
    assert np.array_equal(back.mesh.vertex_attributes["property_x"], np.ones((8, 1)))


def test_new_faces_have_the_colour_of_most_faces(tmp_path):
    colours = [[255, 0, 0], [255, 0, 0], [0, 255, 0], [0, 255, 255], [0, 0, 255]]  # red, though most have no red
    header = HEAD + "element face 5\nproperty list uchar int vertex_indices\n"
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
    body = "0 0 0\n1 0 0\n0 1 0\n" + "".join(f"3 0 1 2 {r} {g} {b}\n" for r, g, b in colours)
    one = extension([0, 0, 1], [0, 1, 3])
    again(parsed((header + body).encode()).extended(one), tmp_path)
    held = read_records((tmp_path / "again.ply").read_bytes()).elements["face"].values
    assert [int(held[name][-1]) for name in ("red", "green", "blue")] == [255, 0, 0]


STRIPS = {
    "int": ([[0, 1, 2, 3, -1, 4, 5, 6]], [[0, 1, 2], [3, 2, 1], [4, 5, 6]]),
    "char": ([[-1, 0, 1, 2, 3], [], [4, 5, 6, 7]], [[0, 1, 2], [3, 2, 1], [4, 5, 6], [7, 6, 5]]),
    # a repeated corner turns a strip; the orientation goes on as without it
    "short": ([[0, 1, 2, 2, 3, 4, -1, -1, 5, 6]], [[0, 1, 2], [4, 3, 2]]),
    "uchar": ([[0, 1, 2, 255, 3, 4, 5], [6, 7]], [[0, 1, 2], [3, 4, 5]]),
    "ushort": ([[0, 1, 2, 3]], [[0, 1, 2], [3, 2, 1]]),
    "uint": ([[7, 6, 5, 4294967295, 2, 1, 0, 3]], [[7, 6, 5], [2, 1, 0], [3, 0, 1]]),
}
NUMPY = {"int": "i4", "char": "i1", "short": "i2", "uchar": "u1", "ushort": "u2", "uint": "u4"}


def strips_ply(encoding, kind, strips, faces, newline="\n"):
    head, data = ply(encoding, CUBE_POINTS, faces, newline=newline).split(b"end_header" + newline.encode())
    declared = [f"element tristrips {len(strips)}", f"property list int {kind} vertex_indices", "end_header", ""]
    order = ">" if encoding == "binary_big_endian" else "<"
    if encoding == "ascii":
        rows = newline.join([*(" ".join(map(str, [len(strip), *strip])) for strip in strips), ""]).encode()
    else:
        count, item = order + "i4", order + NUMPY[kind]
        rows = b"".join(np.array([len(strip)], count).tobytes() + np.array(strip, item).tobytes() for strip in strips)
    return head + newline.join(declared).encode() + data + rows


@pytest.mark.parametrize("encoding", FORMATS)
@pytest.mark.parametrize("kind", list(STRIPS))
@pytest.mark.parametrize("faces", [[], [[0, 4, 1]]], ids=["alone", "with faces"])
def test_triangle_strips_are_faces(tmp_path, encoding, kind, faces):
    strips, triangles = STRIPS[kind]
    file = parsed(strips_ply(encoding, kind, strips, faces, "\r\n" if kind == "short" else "\n"))
    assert file.polygons.rows() == faces + triangles
    assert file.notes == ("triangle strips were changed into faces",)
    file.write(tmp_path / "faces.ply")
    assert read_mesh(tmp_path / "faces.ply").polygons.rows() == faces + triangles
