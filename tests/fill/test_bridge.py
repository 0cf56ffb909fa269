"""Bridges between two rims of a mesh, and islands in holes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from spinor_geom.bench.holes import lattice
from spinor_geom.fill.bridges import find_islands, lies_in
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.closed import is_watertight
from tests.fill.shapes import circle, collar, together
from tests.plateau.rims import TETRAHEDRON
from tests.systems import every_second

SIDES = 24


def ring(inner: float, outer: float, *, height: float = 0.0, down: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A plane ring of 24 × 2 vertices, normal up or down."""
    vertices, faces = collar(circle(SIDES, inner, height), circle(SIDES, outer - inner))
    return vertices, faces[:, ::-1] if down else faces


def island() -> tuple[np.ndarray, np.ndarray]:
    """A plate with a round hole of radius 1 and a plate of radius 0.4 (with a hole of its own) raised in it."""
    return together(ring(1.0, 1.5), ring(0.2, 0.4, height=0.2))


def places(mesh: tuple[np.ndarray, np.ndarray], *radii: float) -> tuple[int, ...]:
    """Indices of the loops of given radii."""
    loops = find_boundary_loops(TriangleMesh(*mesh))
    found = [np.linalg.norm(loop.points[:, :2], axis=1).mean() for loop in loops]
    return tuple(int(np.argmin(np.abs(np.array(found) - radius))) for radius in radii)


def inner_rims(mesh: tuple[np.ndarray, np.ndarray]) -> tuple[int, ...]:
    """The places of the loops of radius 1."""
    loops = find_boundary_loops(TriangleMesh(*mesh))
    return tuple(k for k, loop in enumerate(loops) if abs(np.linalg.norm(loop.points[0, :2]) - 1.0) < 0.01)


def test_two_ends_of_a_gap_are_bridged() -> None:
    # flanges of radius 1 at heights ±0.4, facing outwards
    mesh = together(ring(1.0, 1.4, height=0.4), ring(1.0, 1.4, height=-0.4, down=True))
    first, second = inner_rims(mesh)
    filled, report = fill_hole(mesh, bridge=(first, second), return_report=True)
    here, there = report.loops[first], report.loops[second]
    assert here.converged
    assert there.converged
    assert (here.joined_to, there.joined_to) == (second, first)
    assert here.faces_added > 0
    assert there.faces_added == 0
    np.testing.assert_array_equal(filled[0][: len(mesh[0])], mesh[0])
    # the other two rims close it: disks on the flanges, which have to be asked for
    closed, after = fill_hole(filled, (0, 1), return_report=True)
    assert after.watertight
    assert is_watertight(closed[1])
    # the same in one call
    both = fill_hole(mesh, [0, 1], bridge=[(first, second)], return_report=True)[1]
    assert both.watertight
    assert both.loops[first].area == here.area
    assert len(both.extension.faces) == len(report.extension.faces) + len(after.extension.faces)
    several = fill_hole(mesh, bridge=[(first, second), (0, 1)], keep_largest=True, return_report=True)[1].loops
    assert [outcome.joined_to for outcome in several] == [1, 0, second, first]
    assert here.solution.is_area_minimum
    assert not here.solution.annulus.reversed
    entry = here.to_dict()
    assert entry["area_minimum"]
    assert entry["annulus"]["spin"] == "periodic"
    assert abs(entry["annulus"]["disk_area"] / (2 * np.pi) - 1) < 1e-5
    # the figures of the bridge are reported once
    other = there.to_dict()
    assert (other["kind"], other["converged"]) == ("minimal", True)
    assert entry["area"] > 0
    assert all(other[name] is None for name in ("area", "residual_rms_per_edge", "stability", "annulus"))


def test_a_bridge_with_more_area_than_two_disks_is_reported_as_a_local_minimum() -> None:
    # two disks have less area from height 0.5277 on
    mesh = together(ring(1.0, 1.4, height=0.6), ring(1.0, 1.4, height=-0.6, down=True))
    _, report = fill_hole(mesh, bridge=(2, 3), return_report=True)
    here, there = report.loops[2], report.loops[3]
    assert here.converged
    # nothing was solved that is not shown
    assert not {"disks", "stability", "certificates"} & here.solution.timings.keys()
    assert "local minimum of the area only" in here.notes[-1]
    assert here.solution.timings["disks"] > 0
    assert not there.notes
    assert not here.to_dict()["area_minimum"]


@pytest.mark.parametrize(
    ("height", "down", "reasons"),
    [(0.8, True, ("no annulus", "fill the two loops one by one")), (0.4, False, ("flip the faces of one piece", ""))],
    ids=["too far apart", "inside out to each other"],
)
def test_rims_without_a_surface_between_them_stay_open(height: float, down: bool, reasons: tuple[str, str]) -> None:
    mesh = together(ring(1.0, 1.4, height=height), ring(1.0, 1.4, height=-height, down=down))
    pair = inner_rims(mesh)
    _, report = fill_hole(mesh, bridge=pair, return_report=True)
    for place, reason in zip(pair, reasons, strict=True):
        assert not report.loops[place].filled
        assert reason in report.loops[place].reason
    assert len(report.extension.faces) == 0


def test_island_is_recognised_and_joined() -> None:
    mesh = island()
    hole, piece = places(mesh, 1.0, 0.4)
    loops = find_boundary_loops(TriangleMesh(*mesh))
    assert find_islands(TriangleMesh(*mesh), loops) == {hole: (piece,)}
    _, report = fill_hole(mesh, [hole, piece], islands="join", return_report=True)
    assert report.loops[hole].joined_to == piece
    assert report.loops[piece].joined_to == hole
    assert f"loop indices: {piece}): joined" in report.loops[hole].notes[-1]
    assert report.complete
    _, ignored = fill_hole(mesh, [hole, piece], return_report=True)
    assert ignored.loops[hole].joined_to is None
    assert f"loop indices: {piece}): ignored" in ignored.loops[hole].notes[-1]


@pytest.mark.parametrize(("height", "is_in"), [(0.3, True), (0.5, True), (0.65, False), (1.0, False)])
def test_a_piece_is_in_a_round_hole_up_to_a_fifth_of_the_diagonal(height: float, is_in: bool) -> None:
    # of the hole's box, which is 2.8
    hole, piece = (BoundaryLoop.from_points(circle(SIDES, *place)) for place in ((1.0, 0.0), (0.4, height)))
    assert lies_in(piece, hole) == is_in


def head_with_eyes(size: float) -> tuple[np.ndarray, np.ndarray]:
    """A ball with two mirrored holes, and an open eyeball behind each, whose rim has a size relative to theirs."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    eye = np.array([0.5, np.sqrt(0.75), 0.0])
    is_open = (np.maximum(ball.vertices @ eye, ball.vertices @ (eye * [-1, 1, 1])) > 0.97)[ball.faces].any(axis=1)
    head = ball.vertices, ball.faces[~is_open]
    rim = 0.3 * size
    cup = ball.faces[(ball.vertices @ eye < 0.05)[ball.faces].all(axis=1)]
    right = rim * ball.vertices + 0.93 * eye, cup
    left = right[0] * [-1, 1, 1], cup[:, ::-1]
    return together(head, right, left)


@pytest.mark.parametrize("size", [0.5, 0.97, 1.0, 1.03, 1.3, 2.0])
def test_the_larger_component_is_the_mesh_and_mirrored_pieces_are_treated_alike(size: float) -> None:
    mesh = TriangleMesh(*head_with_eyes(size))
    loops = find_boundary_loops(mesh)
    assert len(loops) == 4
    is_head = [loop.vertex_ids[0] < 642 for loop in loops]
    found = find_islands(mesh, loops)
    assert all(is_head[hole] for hole in found)
    pieces = [piece for own in found.values() for piece in own]
    assert not any(is_head[piece] for piece in pieces)
    assert len(pieces) == (2 if size < 0.9 else 0 if size > 1.1 else len(found))
    assert len(found) in (0, 2)


def test_several_islands_in_one_hole_are_joined() -> None:
    # raised, so that the gap is no plane region
    vertices, faces = ring(0.1, 0.2, height=0.1)
    pieces = [(vertices + np.array([x, y, 0.0]), faces) for x, y in ((0.5, 0.0), (-0.4, 0.3), (-0.1, -0.5))]
    mesh = together(ring(1.0, 1.5), *pieces)
    (hole,) = places(mesh, 1.0)
    loops = find_boundary_loops(TriangleMesh(*mesh))
    islands = find_islands(TriangleMesh(*mesh), loops)[hole]
    assert len(islands) == 3
    filled, report = fill_hole(mesh, [hole, *islands], islands="join", return_report=True)
    outcomes = [report.loops[place] for place in (hole, *islands)]
    assert all(outcome.converged for outcome in outcomes)
    assert [outcome.joined_to for outcome in outcomes] == [*islands, hole]
    assert f"loop indices: {', '.join(map(str, islands))}): joined" in outcomes[0].notes[-1]
    solution = outcomes[0].solution
    assert np.pi * (1 - 3 * 0.2**2) * 0.98 < solution.area < np.pi
    # the rims of the plate and of the pieces' own holes are left
    assert len(find_boundary_loops(TriangleMesh(*filled))) == 1 + 3
    np.testing.assert_array_equal(filled[0][: len(mesh[0])], mesh[0])


@pytest.mark.parametrize("count", [2, 3, 4])
def test_chunks_cut_along_triangles_are_joined_through_their_points(count: int) -> None:
    ball, at = (
        trimesh.creation.icosphere(subdivisions=3),
        TETRAHEDRON[:count] @ [[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]],
    )
    label = (ball.triangles_center @ at.T).argmax(axis=1)
    mesh = together(*((ball.vertices + 0.12 * at[k], ball.faces[label == k]) for k in range(count)))
    filled, report = fill_hole(mesh, bridge=range(count), time_limit=60, return_report=True)
    assert report.loops[0].solution.route == "vertices"
    assert report.complete
    np.testing.assert_array_equal(filled[0][: len(mesh[0])], mesh[0])


def terrain(start: float, rows: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A piece of one terrain, 9 × 14 wide, from x = start on, with so many rows of squares along y."""
    (y, x), faces = lattice(rows, 9)
    x, y = start + x, 14 * y / rows
    random = np.random.default_rng(seed)
    k, phase = random.uniform(0.2, 0.6, size=4), random.uniform(0, 6, size=3)
    z = 0.5 * np.sin(k[0] * x + phase[0]) * np.sin(k[1] * y + phase[1]) + 0.4 * np.sin(k[2] * x + k[3] * y + phase[2])
    return np.column_stack([x, y, z]), faces[:, ::-1]


@pytest.mark.parametrize("seed", every_second(range(4)))
@pytest.mark.parametrize(("gap", "rows"), [(1.0, 14), (5.0, 10)])
def test_what_is_advised_for_open_sheets_joins_them(seed: int, gap: float, rows: int) -> None:
    left, right = terrain(0.0, 14, seed), terrain(9.0 + gap, rows, seed)
    vertices, faces = together(left, right)
    _, report = fill_hole((vertices, faces), bridge=(0, 1), return_report=True)
    assert not report.loops[0].filled
    assert "join the sheets by two triangles at each end of the gap" in report.loops[0].reason
    near, far = 9 * 15 + np.arange(15), len(left[0]) + np.arange(rows + 1)
    ends = [[near[k], far[k], far[k + 1], near[k + 1]] for k in (0, -2)]
    joins = [corners for a, b, c, d in ends for corners in ([a, b, c], [a, c, d])]
    _, report = fill_hole((vertices, np.concatenate([faces, joins])), return_report=True)
    border, gap_between = report.loops
    assert border.is_border
    assert gap_between.converged
    assert report.intersection_free
