"""The loops that a call fills, and the errors for loops that cannot be chosen."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.errors import ForeignLoopError, LoopIndexError
from spinor_geom.fill.fill_options import Choice
from spinor_geom.fill.loop_choice import boundary_loops, chosen_indices, free_rim, reasons_to_leave_open
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.fill.shapes import tube


@pytest.fixture
def loops() -> list[BoundaryLoop]:
    return boundary_loops(tube())


def test_boundary_loops_of_a_pair_of_arrays_are_longest_first(loops: list[BoundaryLoop]) -> None:
    assert [len(loop) for loop in loops] == [16, 16]
    assert loops[0].perimeter > loops[1].perimeter
    assert set(loops[0].vertex_ids) == set(range(16))


def test_places_may_be_one_or_several_in_any_order(loops: list[BoundaryLoop]) -> None:
    assert chosen_indices(1, loops) == [1]
    assert chosen_indices(np.int64(1), loops) == [1]
    assert chosen_indices([1, 0, 1], loops) == [0, 1]
    assert chosen_indices(np.array([1]), loops) == [1]


@pytest.mark.parametrize("place", [2, -1, [0, 7]])
def test_an_index_of_no_loop_is_named(loops: list[BoundaryLoop], place: int | list[int]) -> None:
    with pytest.raises(LoopIndexError, match="there are 2"):
        chosen_indices(place, loops)


def test_a_loop_is_found_from_any_start(loops: list[BoundaryLoop]) -> None:
    second = loops[1]
    arrays = {name: np.roll(getattr(second, name), 5, axis=0) for name in ("points", "vertex_ids", "corners")}
    turned = BoundaryLoop(**arrays)
    assert chosen_indices(turned, loops) == [1]


def test_a_loop_of_another_mesh_or_direction_is_refused(loops: list[BoundaryLoop]) -> None:
    moved = BoundaryLoop.from_points(loops[0].points + 1.0)
    for foreign in (moved, loops[0].reversed()):
        with pytest.raises(ForeignLoopError, match="not a boundary loop of this mesh"):
            chosen_indices(foreign, loops)


def test_loops_left_open_have_their_reason(loops: list[BoundaryLoop]) -> None:
    between = (loops[0].perimeter + loops[1].perimeter) / 2
    assert reasons_to_leave_open(loops, [0, 1], Choice()) == {}
    keep = reasons_to_leave_open(loops, [0, 1], Choice(keep_largest=True))
    assert list(keep) == [0]
    assert "keep_largest" in keep[0]
    short = reasons_to_leave_open(loops, [0, 1], Choice(max_perimeter=between))
    assert list(short) == [0]
    assert "max_perimeter" in short[0]
    assert reasons_to_leave_open(loops, [1], Choice()) == {0: "not requested"}


def frame(kink: float = 0.0, edges: int = 12) -> BoundaryLoop:
    """A bent square with straight sides and a curved one, one point in the middle of a side moved by a share of it."""
    t, zero = np.arange(edges) / edges, np.zeros(edges)
    sides = [(t, zero, t), (1 + 0.2 * np.sin(np.pi * t), t, 1 - t), (1 - t, 1 + zero, t), (zero, 1 - t, 1 - t)]
    points = np.concatenate([np.column_stack(side) for side in sides])
    points[edges // 2, 1] += kink
    return BoundaryLoop.from_points(points)


@pytest.mark.parametrize("edges", [6, 12])
def test_corners_between_smooth_sides_stay(edges: int) -> None:
    loop = frame(edges=edges)
    assert loop.corners.sum() == 4
    assert free_rim(loop, tolerance=1e-3) is loop


def test_corners_of_triangles_are_not_kept_on_a_free_rim() -> None:
    loop = frame(kink=0.05)
    assert loop.corners.sum() == 4
    free = free_rim(loop, tolerance=1e-3)
    assert not free.corners.any()
    np.testing.assert_array_equal(free.points, loop.points)
    # what somebody named stays
    named = BoundaryLoop.from_points(loop.points, corners=np.flatnonzero(loop.corners)[:-1])
    assert free_rim(named, tolerance=1e-3) is named
