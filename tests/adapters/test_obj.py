import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.obj import read_obj
from spinor_geom.errors import MeshFileError
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import (
    CUBE_POINTS,
    CUBE_QUADS,
    DATA,
    extension,
    extensions,
    is_closed,
    lid,
    lid_for,
    quad_lines,
    reading,
)

parsed, again = reading(read_obj, ".obj")


POINTS = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE_POINTS.tolist())
CUBE = POINTS + quad_lines()
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3",
        "f 1/1 2/2 3/3",
        "f 1//1 2//2 3//3",
        "f 1/4/4 2/5/5 3/6/6",
        "f -3 -2 -1",
        "f -3/-1/-1 -2/-1/-1 -1/-1/-1",
        "f 1/ 2/ 3/",
        "f 1// 2// 3//",
        "f 1 2/2 3/3/3",
        "f 1 \\\n 2 \\\n3",
        "  f\t1  2 3  # a face",
        "F 1 2 3",
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_forms_of_a_face(face, newline):
    extra = "".join(f"vt {i}.5 0\nvn 0 0 1\n" for i in range(6))
    file = parsed((TRIANGLE + extra + face + "\nv 5 5 5\n").replace("\n", newline))
    assert file.mesh.faces.tolist() == [[0, 1, 2]]
    assert file.mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_comments_and_names_end_at_the_end_of_their_line(newline):
    path = "C:\\scans\\"
    text = f"# {path}\nv 0 0 0 # {path}\nv 1 0 0\nv 0 \\\n1 0\n#\\\nf 1 2 \\\n3 # \\\\\nv 5 5 5\n"
    file = parsed(text.replace("\n", newline))
    assert file.mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]
    assert file.mesh.faces.tolist() == [[0, 1, 2]]
    named = f"mtllib {path}\no {path}\nv 0 0 0\n  g {path}\nv 1 0 0\nv 0 \\\n1 0\nusemtl {path}\nf 1 \\\n2 \\\n3\n"
    file = parsed(named.replace("\n", newline))
    assert (file.mesh.vertices.tolist(), file.mesh.faces.tolist()) == ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(MeshFileError, match=r"line 4: 'x' is not a number"):
        parsed(f"# {path}\nv 0 0 0\n# {path}\nv x 0 0\n")


@given(
    data=st.data(),
    seed=st.integers(0, 2**32 - 1),
    colored=st.booleans(),
    newline=st.sampled_from(["\n", "\r\n"]),
    open_end=st.booleans(),
)
def test_round_trip_is_bit_exact(tmp_path_factory, data, seed, colored, newline, open_end):
    random = np.random.default_rng(seed)
    rows = random.normal(size=(7, 6 if colored else 3)) * 10.0 ** random.integers(-20, 20)
    vertices = ("v " + " ".join(map(repr, row)) for row in rows.tolist())
    lines = ["# head", "mtllib none.mtl", *vertices, "usemtl a b", "f 1 2 3", "f 4 5 6 7"]
    text = newline.join(lines) + ("" if open_end else newline)
    file = parsed(text)
    assert np.array_equal(file.mesh.vertices, rows[:, :3])
    grown = file.extended(data.draw(extensions(file.mesh)))
    folder = tmp_path_factory.mktemp("obj")
    back = again(grown, folder)
    assert (folder / "again.obj").read_bytes().startswith(text.encode())
    assert back.mesh.vertices.tobytes() == grown.mesh.vertices.tobytes()
    assert np.array_equal(back.mesh.faces, grown.mesh.faces)
    assert back.polygons.rows() == grown.polygons.rows()
    if colored:
        assert np.array_equal(back.mesh.vertex_attributes["color"], grown.mesh.vertex_attributes["color"])


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("end", ["", "\\", "\n", "\\\n"])
def test_a_last_line_of_any_end_is_not_continued_by_what_is_added(tmp_path, newline, end):
    text = (TRIANGLE + "f 1 2 3" + end).replace("\n", newline)
    one = extension([5, 5, 5], [1, 0, 3])
    closed = again(parsed(text).extended(one), tmp_path)
    assert (tmp_path / "again.obj").read_bytes().startswith(text.encode())
    assert closed.mesh.faces.tolist() == [[0, 1, 2], [1, 0, 3]]


def test_second_extension_follows_the_first(tmp_path):
    twice = parsed(CUBE).extended(extension(lid().vertices, lid().faces[:2])).extended(extension([], lid().faces[2:]))
    assert is_closed(twice.mesh)
    assert is_closed(again(twice, tmp_path).mesh)


@pytest.mark.parametrize(
    ("name", "vertices", "polygons", "boundary"),
    [
        ("trimesh_reference.obj", 845, 1610, 80),
        ("demosthenes_low_res.obj", 8394, 16719, 67),
        ("ict_face_neutral.obj", 26719, 26384, None),
        ("spot_cut.obj", 11533, 22242, None),
    ],
)
def test_real_files_have_the_sizes_that_their_sources_state(tmp_path, name, vertices, polygons, boundary):
    file = read_mesh(DATA / name)
    assert len(file.mesh.vertices) == vertices
    assert len(file.polygons) == polygons
    assert len(file.mesh.faces) == polygons + (file.polygons.sizes == 4).sum()
    file.write(tmp_path / name)
    assert (tmp_path / name).read_bytes() == (DATA / name).read_bytes()
    if boundary is not None:
        assert len(boundary_edges(file.mesh.faces)) == boundary


def test_texture_and_normals_of_single_vertices_are_carried(tmp_path):
    text = POINTS + "".join(f"vt {i / 8} 0.5\n" for i in range(8)) + "".join(f"vn {7 - i} 1 0\n" for i in range(8))
    text += "".join("f " + " ".join(f"{i}/{i}/{9 - i}" for i in quad) + "\n" for quad in (CUBE_QUADS[:-1] + 1).tolist())
    file = parsed(text)
    assert file.mesh.vertex_attributes["uv"][:, 0].tolist() == [i / 8 for i in range(8)]
    assert file.mesh.vertex_attributes["normal"][:, 0].tolist() == list(range(8))
    closed = again(file.extended(lid_for(file.mesh)), tmp_path)
    assert (tmp_path / "again.obj").read_text().splitlines()[-1] == "f 4/4/5 2/2/7 9/9/9"
    assert closed.mesh.vertex_attributes["uv"][8].tolist() == [3.5 / 8, 0.5]
    assert closed.mesh.vertex_attributes["normal"][8].tolist() == [3.5, 1.0, 0.0]
    assert is_closed(closed.mesh)


def test_normals_alone_leave_the_texture_index_empty(tmp_path):
    file = parsed(POINTS + "".join(f"vn 0 0 {i}\n" for i in range(8)) + quad_lines("{0}//{0}"))
    closed = again(file.extended(lid_for(file.mesh)), tmp_path)
    assert (tmp_path / "again.obj").read_text().endswith("f 4//4 2//2 9//9\n")
    assert set(closed.mesh.vertex_attributes) == {"normal"}


def test_unreadable_normals_matter_only_where_each_vertex_has_one():
    text = TRIANGLE + "vn 0 0 1\nvn up 0 1\n"
    assert dict(parsed(text + "f 1//1 2//2 3//1\nf 1//2 3//1 2//1\n").mesh.vertex_attributes) == {}
    with pytest.raises(MeshFileError, match="line 5"):
        parsed(text + "f 1//1 2//2 3//1\n")


def test_weights_are_no_colors():
    assert dict(parsed("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n").mesh.vertex_attributes) == {}
    assert dict(parsed("v 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").mesh.vertex_attributes) == {}
    assert parsed("v 0 0 0 9 8 7 6\nv 1 0 0 9 8 7 6\nv 0 1 0 9 8 7 6\nf 1 2 3\n").contents.color_scale == 255.0
