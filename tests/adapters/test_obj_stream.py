"""OBJ files parsed block by block: the result is that of parsing in one piece, with names, in little memory."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.adapters import obj
from spinor_geom.adapters.contents import FileContents
from spinor_geom.adapters.mesh_files import path_in_errors
from spinor_geom.adapters.obj import read_obj
from spinor_geom.errors import MeshFileError
from tests.adapters.shapes import extension

LINES = (
    "v 0 0 0 1 0 0\nv 1 0 0.5 0 1 0\nv 1 1 -2e-3 0 0 1\nvt 0.5 1\nvn 0 0 1\nf 1 2 3\nf -3 -2 -1\n"
    "f 1/1/1 2/1/1 3/1/1 2\n"
    "f 1 2 \\\nl 1 2\nl -1 \\\n2 3\no body # not this\ng left  lower\ng\nusemtl steel\n# v 9 9 9 \\\n\n"
).splitlines()


def read(text):
    try:
        with path_in_errors(Path("a.obj")):
            return read_obj(text.encode())
    except MeshFileError as error:
        return str(error)


def with_a_face(contents):
    assert contents.appended is not None
    none = {name: values[:0] for name, values in contents.attributes.items()}
    return contents.appended(extension([], [0, 0, 0], **none))


PLAIN = ("names", "polyline_names", "suffix")


def same(one, other):
    arrays = [
        (
            text.vertices,
            text.polygons.corners,
            text.polygons.starts,
            text.polygon_names,
            *text.polylines,
            *(text.attributes[name] for name in sorted(text.attributes)),
        )
        for text in (one, other)
    ]
    if len(arrays[0]) != len(arrays[1]) or not all(map(np.array_equal, *arrays)):
        return False
    return all(getattr(one, name) == getattr(other, name) for name in PLAIN)


@given(
    lines=st.lists(st.sampled_from(LINES), max_size=25),
    size=st.integers(1, 60),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
    ended=st.booleans(),
)
@settings(max_examples=40)
def test_blocks_of_any_size_give_the_same(lines, size, newline, ended):
    text = newline.join(["v 0 0 0 1 1 1", *lines]) + (newline if ended else "")
    whole = read(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(obj, "BLOCK_SIZE", size)
        blocks = read(text)
    if isinstance(whole, str):
        # which of several mistakes is reported may differ, its line number may not
        assert isinstance(blocks, str)
    else:
        assert isinstance(blocks, FileContents)
        assert same(whole, blocks)
        assert with_a_face(blocks) == with_a_face(whole)


def test_a_mistake_has_its_line_in_every_block(monkeypatch):
    text = "v 0 0 0\n" * 3 + "f 1 2 3\n" * 50 + "# a \\\n b\n\nf 1 2 4\n"
    monkeypatch.setattr(obj, "BLOCK_SIZE", 16)
    assert "a.obj, line 57: vertex 4 does not exist, the file has 3" in str(read(text))
    assert "a.obj, line 57: 'x' is not a corner" in str(read(text.replace("4", "x")))
    assert "line 38: has a zero byte" in str(read(text[:300] + "\0"))


def test_objects_and_groups_name_what_follows():
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    faces = "f 1 2 3\ng a b\nf 1 2 3\no c\nf 1 2 3\ng d\nf 1 2 3\n"
    text = read(f"{vertices}{faces}l 1 2\ng e\nl 3 2\no f\nl 1 3\n")
    assert isinstance(text, FileContents)
    assert [text.names[number] for number in text.polygon_names] == ["", "a b", "c", "c/d"]
    assert text.polyline_names == ("c/d",)


def test_a_line_without_end_is_refused(monkeypatch):
    monkeypatch.setattr(obj, "BLOCK_SIZE", 1 << 10)
    monkeypatch.setattr(obj, "LONGEST_LINE", 1 << 14)
    assert "a line of more than" in str(read("v 0 0 0\n" + "l" + " 1" * (1 << 14)))
