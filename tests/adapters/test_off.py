from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters.off import read_off
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extensions, is_closed, lid, lid_for, reading

parsed, again = reading(read_off, ".off")


QUADS = "".join(f"4 {' '.join(map(str, quad))}\n" for quad in CUBE_QUADS[:-1].tolist())
POINTS = "".join(f"{x} {y} {z}\n" for x, y, z in CUBE_POINTS.tolist())
CUBE = f"OFF\n8 5 0\n{POINTS}{QUADS}"


@pytest.mark.parametrize(
    "text",
    [
        CUBE,
        CUBE.replace("OFF\n", "OFF "),
        CUBE.replace("OFF\n", ""),
        "# a comment\n\n" + CUBE.replace("8 5 0", "\n8 5 0 # counts\n"),
        CUBE.replace("\n", "\r\n"),
        CUBE.replace("4 0 1 3 2\n", "4 0 1 3 2 255 0 0\n\n"),
        CUBE.rstrip("\n"),
        CUBE.replace("8 5 0", "8 5"),
        CUBE.replace("OFF\n", "OFF"),
        "\ufeff" + CUBE.replace("OFF\n", "OFF"),
        CUBE.replace("OFF\n8 5 0\n", "# one\n\tOFF8\t5 # two\n"),
        CUBE.replace("OFF\n", "off").replace("\n", "\r\n"),
        CUBE.replace("OFF\n8 5 0", "OFF 8 5 0 # counts"),
        CUBE.replace("8 5 0", "8\n5\n0"),
        CUBE.replace("8 5 0", "8 5\n# edges:\n\n 12 # unused").replace("4 0 1 3 2\n", "4 0 1 3 2 255 0 0\n"),
    ],
)
def test_forms_of_a_file_keep_their_quads_and_close(tmp_path, text):
    file = parsed(text)
    assert file.polygons.rows() == CUBE_QUADS[:-1].tolist()
    closed = again(file.extended(lid()), tmp_path)
    assert closed.polygons.sizes.tolist() == [4] * 5 + [3] * 4
    assert np.array_equal(closed.mesh.vertices[8], lid().vertices[0])
    assert is_closed(closed.mesh)
    again(file, tmp_path)
    assert (tmp_path / "again.off").read_bytes() == text.encode()


@given(data=st.data(), seed=st.integers(0, 2**32 - 1), integers=st.booleans())
def test_round_trip_keeps_normals_colors_and_texture(tmp_path_factory, data, seed, integers):
    random = np.random.default_rng(seed)
    points, normals, uv = random.normal(size=(5, 3)), random.normal(size=(5, 3)), random.uniform(size=(5, 2))
    colors = random.integers(0, 256, (5, 4)) if integers else random.uniform(size=(5, 4))
    columns = (values.tolist() for values in (points, normals, colors, uv))
    rows = [[*chain(*parts)] for parts in zip(*columns, strict=True)]
    text = "STCNOFF\n5 2 0\n" + "".join(" ".join(map(repr, row)) + "\n" for row in rows) + "3 0 1 2\n4 2 1 3 4 9 9 9\n"
    file = parsed(text)
    attributes = file.mesh.vertex_attributes
    assert np.array_equal(attributes["normal"], normals)
    assert np.array_equal(attributes["color"], colors)
    assert np.array_equal(attributes["uv"], uv)
    assert file.contents.color_scale == (255.0 if integers else 1.0)
    grown = file.extended(data.draw(extensions(file.mesh)))
    back = again(grown, tmp_path_factory.mktemp("off"))
    assert back.mesh.vertices.tobytes() == grown.mesh.vertices.tobytes()
    assert back.polygons.rows() == grown.polygons.rows()
    for name, values in grown.mesh.vertex_attributes.items():
        assert np.array_equal(back.mesh.vertex_attributes[name], values)


def test_colors_under_the_plain_keyword_and_unknown_columns(tmp_path):
    colored = CUBE.replace(".0\n", ".0 255 0 7\n", 8)
    file = parsed(colored)
    assert file.mesh.vertex_attributes["color"][0].tolist() == [255, 0, 7]
    again(file.extended(lid(color=np.array([[1.6, 2.2, 3.0]]))), tmp_path)
    assert "0.5 0.5 1.3333333333333333 2 2 3\n" in (tmp_path / "again.off").read_text()
    extra = parsed(CUBE.replace(".0\n", ".0 4.5\n", 8))
    assert extra.mesh.vertex_attributes["extra"].shape == (8, 1)
    assert is_closed(again(extra.extended(lid_for(extra.mesh)), tmp_path).mesh)
    two = parsed(CUBE.replace(".0\n", ".0 4.5 6\n", 8)).mesh.vertex_attributes
    assert [two[name][0].tolist() for name in ("extra_0", "extra_1")] == [[4.5], [6]]


@pytest.mark.parametrize("keyword", ["COFF", "NOFF", "STOFF", "CNOFF", "STCNOFF"])
def test_every_keyword_may_be_joined_to_the_counts(keyword):
    rows = POINTS.replace(
        ".0\n", ".0" + " 3" * ("N" in keyword) * 3 + " 9" * ("C" in keyword) * 3 + " 5" * 2 * ("T" in keyword) + "\n"
    )
    rows = rows.replace(" 3" * 3, " 0 0 1")
    one, other = (parsed(f"{keyword}{gap}8 5 0\n{rows}{QUADS}").mesh for gap in ("\n", ""))
    assert len(one.vertex_attributes) == len(keyword.replace("OFF", "").replace("ST", "T"))
    for name, values in one.vertex_attributes.items():
        assert np.array_equal(other.vertex_attributes[name], values)
