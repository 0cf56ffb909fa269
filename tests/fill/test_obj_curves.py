"""The loops of a file, their names, and the reasons why some curves are not loops."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.adapters.obj import read_obj
from spinor_geom.batching.inputs import Source
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.task import FileTask
from spinor_geom.errors import LoopTooShortError, NonFiniteVertexError, OpenCurveError, SelfCrossingLoopError
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.obj_curves import NamedLoop, curve_loops
from tests.batching.files import circle, curve_text, holed_text, vertex_lines


def loops(text: str, *, closing: float = 1e-3) -> list[NamedLoop]:
    return curve_loops(read_obj(text.encode()), closing=closing)


def opened(text: str) -> FileTask:
    options = FillOptions(target_edge_length="auto", model="auto", tolerance=1e-3)
    return FileTask(text.encode(), Source(key="a.obj", path="a.obj"), BatchOptions(), options)


def test_several_curves_of_one_file_keep_their_names() -> None:
    text = "o rings\ng upper one\n" + curve_text(circle(9)) + "g lower\n" + vertex_lines(circle(7, 1) - [0, 0, 3])
    text += "l " + " ".join(map(str, [*range(-7, 0), -7])) + "\no other\n" + vertex_lines(circle(5) + 9)
    text += "l -5 -4\nl -3 -4\nl -3 -2 -1 -5\n"
    found = loops(text)
    expected = [("rings/upper one", 9, None), ("rings/lower", 7, None), ("other", 5, None)]
    assert [(loop.name, len(loop.points), loop.error) for loop in found] == expected
    np.testing.assert_array_equal(found[0].points, circle(9))
    assert found[1].loop.vertex_ids.tolist() == list(range(9, 16))


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_pieces_with_vertices_of_their_own_are_joined(gap: float) -> None:
    points = circle(12)
    halves = [points[:7], np.vstack([points[6:], points[:1]]) + np.array([0, 0, gap])]
    text = "".join(map(vertex_lines, halves)) + "l 1 2 3 4 5 6 7\nl 8 9 10 11 12 13 14\n"
    (found,) = loops(text)
    assert found.error is None
    assert len(found.points) == 12
    assert found.notes == (() if not gap else (f"closed over a gap of {gap:g}",))


def test_a_curve_is_closed_within_the_tolerance_and_no_further() -> None:
    points = np.vstack([circle(12), circle(12)[:1] + np.array([0, 0, 0.01])])
    (found,) = loops(curve_text(points, closed=False), closing=0.1)
    assert found.error is None
    assert len(found.points) == 12
    assert found.notes == ("closed over a gap of 0.01",)
    (left,) = loops(curve_text(points, closed=False), closing=1e-3)
    assert isinstance(left.error, OpenCurveError)
    assert left.error.fields["gap"] == pytest.approx(0.01)
    assert "its ends are 0.01 apart" in str(left.error)


def test_repeated_points_are_dropped_and_reported() -> None:
    points = np.repeat(circle(10), [1, 3, 1, 1, 1, 1, 1, 1, 1, 2], axis=0)
    (found,) = loops(curve_text(points))
    np.testing.assert_array_equal(found.points, circle(10))
    assert found.notes == ("3 repeated points were dropped",)


def test_what_bounds_no_disk_is_refused_by_name_with_the_reason() -> None:
    bow_tie = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0.0]])
    cases = {
        "open": (curve_text(circle(9), closed=False), OpenCurveError),
        "short": (curve_text(circle(9)[:2]), LoopTooShortError),
        "crossing": (curve_text(bow_tie), SelfCrossingLoopError),
        "touching": (curve_text(np.vstack([circle(9), circle(9)[3:5]])), SelfCrossingLoopError),
        "nan": (curve_text(np.vstack([circle(9), [[0, np.nan, 0]]])), NonFiniteVertexError),
    }
    for name, (text, error) in cases.items():
        (found,) = opened(f"g {name}\n{text}").curves
        assert found.name == name
        assert isinstance(found.error, error), (name, found.error)


def test_holes_have_the_name_of_most_faces_beside_them() -> None:
    file = opened(holed_text().replace("g north\r\nf -3 -2 -1\r\n", "f -3 -2 -1\r\ng north\r\n"))
    assert (file.hole_names, [len(loop) for loop in file.rims]) == (["roof/south"], [4])


def test_curves_of_a_file_whose_mesh_is_broken_are_kept() -> None:
    text = curve_text(circle(9)) + "f 1 2 3\nv nan 0 0\nf 1 2 10\n"
    file = opened(text)
    assert "NaN" in file.problem
    assert file.filling is None
    assert [curve.error for curve in file.curves] == [None]
