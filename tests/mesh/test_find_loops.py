"""find_boundary_loops: known meshes, bow-ties, soups, slits, and invariants on random meshes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.bench.holes import lattice
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.loop_frame import first_point
from spinor_geom.mesh.topology import boundary_edges, face_components
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.closed import is_watertight
from tests.strategies import SEEDS, RigidMotion, ragged_meshes, rigid_motions


def mesh_of(faces: np.ndarray) -> TriangleMesh:
    return TriangleMesh(np.random.default_rng(0).uniform(size=(int(np.max(faces)) + 1, 3)), faces)


def loop_edges(loops: list[BoundaryLoop]) -> list[tuple[int, int]]:
    pairs = [np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1) for loop in loops]
    return [(start, end) for start, end in np.concatenate(pairs).tolist()] if pairs else []


def rings_of(loops: list[BoundaryLoop]) -> set[tuple[int, ...]]:
    """The vertices of each loop, from the lowest one on."""
    return {tuple(np.roll(loop.vertex_ids, -loop.vertex_ids.argmin()).tolist()) for loop in loops}


def capped(mesh: TriangleMesh, loops: list[BoundaryLoop]) -> np.ndarray:
    """The mesh's faces and a cone over every loop, oriented as the loop runs."""
    rims = [loop.vertex_ids for loop in loops]
    apexes = [np.full(len(rim), len(mesh.vertices) + k) for k, rim in enumerate(rims)]
    cones = [np.stack([rim, np.roll(rim, -1), apex], axis=1) for rim, apex in zip(rims, apexes, strict=True)]
    return np.vstack([mesh.faces, *cones])


def grid(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and counter-clockwise triangles of a flat grid; vertex (x, y) has index y (columns + 1) + x."""
    (x, y), faces = lattice(columns, rows)
    return np.column_stack([x, y, 0 * x]), faces


class TestKnownMeshes:
    def test_longest_perimeter_first(self) -> None:
        points, faces = grid(6, 6)
        loops = find_boundary_loops(TriangleMesh(points, faces[[5, 15, 70]]))
        assert [len(loop) for loop in loops] == [3, 3, 3]
        points = points * [1.0, 1.0, 0.0] + np.outer(np.arange(len(points)) == faces[15, 0], [0, 0, 5.0])
        loops = find_boundary_loops(TriangleMesh(points, faces[[5, 15, 70]]))
        assert set(loops[0].vertex_ids.tolist()) == set(faces[15].tolist())

    def test_large_fan_at_a_boundary_vertex(self) -> None:
        count = 500
        faces = np.stack([np.zeros(count, int), np.arange(1, count + 1), np.arange(2, count + 2)], axis=1)
        (loop,) = find_boundary_loops(mesh_of(faces))
        assert rings_of([loop]) == {(0, *range(count + 1, 0, -1))}


class TestBowTies:
    def test_ring_through_one_vertex_three_times(self) -> None:
        # every second triangle cut out of a hexagon around vertex 0; the others hang together through an outer ring
        inner, outer = np.arange(1, 7), np.arange(7, 13)
        next_inner, next_outer = np.roll(inner, -1), np.roll(outer, -1)
        ring = np.concatenate([np.stack([inner, outer, next_outer], 1), np.stack([inner, next_outer, next_inner], 1)])
        kept_petals = np.stack([np.zeros(3, int), inner[::2], next_inner[::2]], axis=1)
        mesh = mesh_of(np.concatenate([ring, kept_petals]))
        loops = find_boundary_loops(mesh)
        assert {ring for ring in rings_of(loops) if len(ring) == 3} == {(0, 2, 3), (0, 4, 5), (0, 6, 1)}
        assert len(loops) == 4
        assert is_watertight(capped(mesh, loops))


class TestCoincidentEdges:
    def test_two_pieces_along_a_seam_report_its_edges(self) -> None:
        points, faces = grid(2, 4)
        left = np.flatnonzero(points[faces][:, :, 0].max(axis=1) <= 1)
        right_faces = np.delete(faces, left, axis=0)
        shifted = right_faces + len(points)
        mesh = TriangleMesh(np.vstack([points, points]), np.vstack([faces[left], shifted]))
        loops = find_boundary_loops(mesh)
        assert [len(loop.seam_edges) for loop in loops] == [4, 4]
        assert all((mesh.vertices[loop.seam_edges][:, :, 0] == 1).all() for loop in loops)
        assert all(loop.slit_fraction == 0 for loop in loops)
        for loop in loops:
            assert {tuple(edge) for edge in loop.seam_edges.tolist()} <= set(loop_edges([loop]))

    def test_zero_width_slit_has_fraction_one(self) -> None:
        points, faces = grid(6, 4)
        # cut along y = 2 from x = 2 to x = 4: the upper faces get a copy of vertex (3, 2)
        middle, copy = 2 * 7 + 3, len(points)
        upper = points[faces].mean(axis=1)[:, 1] > 2
        faces = np.where(upper[:, None] & (faces == middle), copy, faces)
        outer, slit = find_boundary_loops(TriangleMesh(np.vstack([points, points[middle]]), faces))
        assert set(slit.vertex_ids.tolist()) == {16, 17, 18, copy}
        assert slit.slit_fraction == 1.0
        assert outer.slit_fraction == 0.0
        assert len(slit.seam_edges) == 0

    def test_partly_closed_hole_has_the_share_of_its_length(self) -> None:
        points, faces = grid(6, 4)
        middle, copy = 2 * 7 + 3, len(points)
        upper = points[faces].mean(axis=1)[:, 1] > 2
        faces = np.where(upper[:, None] & (faces == middle), copy, faces)
        points = np.vstack([points, points[middle]])
        hole = ~((faces == 18).any(axis=1) & (faces == copy).any(axis=1))
        _, loop = find_boundary_loops(TriangleMesh(points, faces[hole]))
        assert 0 < loop.slit_fraction < 1
        assert loop.slit_fraction == pytest.approx(2 / loop.perimeter)

    def test_edges_run_twice_the_same_way_are_no_slit(self) -> None:
        # a fan that winds twice around its centre: its six rim edges lie on three, in the same direction
        t = 2 * np.pi * np.arange(6) / 3
        points = np.vstack([[0, 0, 1], np.tile(np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)[:3], (2, 1))])
        faces = np.array([[0, k + 1, (k + 1) % 6 + 1] for k in range(6)])
        (loop,) = find_boundary_loops(TriangleMesh(points, faces))
        assert len(loop) == 6
        assert loop.slit_fraction == 0
        assert len(loop.seam_edges) == 0

    def test_edges_of_length_zero_at_one_position_are_no_seam(self) -> None:
        points = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 1, 0]])
        loops = find_boundary_loops(TriangleMesh(points, [[0, 1, 2], [3, 4, 5]]))
        # each triangle's two long edges lie on each other
        assert [loop.slit_fraction for loop in loops] == [1.0, 1.0]
        assert [len(loop.seam_edges) for loop in loops] == [0, 0]


class TestRandomMeshes:
    @given(mesh=ragged_meshes())
    def test_loops_are_simple_and_cover_the_boundary_once_reversed(self, mesh: TriangleMesh) -> None:
        loops = find_boundary_loops(mesh)
        assert sorted(loop_edges(loops)) == sorted((b, a) for a, b in boundary_edges(mesh.faces).tolist())
        for loop in loops:
            assert len(set(loop.vertex_ids.tolist())) == len(loop) >= 3
            assert first_point(loop.points, loop.beside)[0] == 0
            np.testing.assert_array_equal(loop.points, mesh.vertices[loop.vertex_ids])
        perimeters = [loop.perimeter for loop in loops]
        assert perimeters == sorted(perimeters, reverse=True)
        assert is_watertight(capped(mesh, loops))
        labels = face_components(mesh.faces)
        sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).tolist()
        piece = dict(zip(map(tuple, sides), np.tile(labels, 3).tolist(), strict=True))
        assert all(len({piece[b, a] for a, b in loop_edges([loop])}) == 1 for loop in loops)

    @given(mesh=ragged_meshes(), motion=rigid_motions(), exponent=st.integers(-6, 6), seed=SEEDS)
    def test_place_size_and_the_order_of_faces_corners_and_vertices_do_not_matter(
        self, mesh: TriangleMesh, motion: RigidMotion, exponent: int, seed: int
    ) -> None:
        random = np.random.default_rng(seed)
        turned = np.take_along_axis(mesh.faces, (np.arange(3) + random.integers(3, size=(len(mesh.faces), 1))) % 3, 1)
        loops = find_boundary_loops(mesh)
        moved = find_boundary_loops(TriangleMesh(10.0**exponent * motion(mesh.vertices), random.permutation(turned)))
        assert rings_of(moved) == rings_of(loops)
        number = random.permutation(len(mesh.vertices))
        vertices = np.empty_like(mesh.vertices)
        vertices[number] = mesh.vertices
        old = {frozenset((number[a], number[b]) for a, b in loop_edges([loop])) for loop in loops}
        renumbered = find_boundary_loops(TriangleMesh(vertices, number[mesh.faces]))
        assert {frozenset(loop_edges([loop])) for loop in renumbered} == old
        flipped = find_boundary_loops(TriangleMesh(mesh.vertices, mesh.faces[:, ::-1]))
        assert rings_of(flipped) == rings_of([loop.reversed() for loop in loops])


@pytest.mark.parametrize("flat", [True, False])
def test_a_face_of_many_random_corners_is_read_quickly(flat: bool) -> None:
    # all pairs of its edges would take minutes
    points = np.random.default_rng(0).normal(size=(40_000, 3)) * [1, 1, not flat]
    k = np.arange(1, len(points) - 1)
    (loop,) = find_boundary_loops(TriangleMesh(points, np.stack([0 * k, k, k + 1], axis=1)))
    assert len(loop) == len(points)


@pytest.mark.parametrize(
    ("name", "count", "longest"),
    [
        ("trimesh_reference.obj", 2, [56, 24]),
        ("demosthenes_low_res.obj", 1, [67]),
        ("mountain.obj", 1, [636]),
        ("plane_holes.obj", 27, [28, 13, 12, 12, 12]),
        ("spot_cut.obj", 125, [91, 78, 68]),
    ],
)
def test_published_meshes(name: str, count: int, longest: list[int], real_mesh: Callable[[str], TriangleMesh]) -> None:
    mesh = real_mesh(name)
    loops = find_boundary_loops(mesh)
    assert len(loops) == count
    assert sorted((len(loop) for loop in loops), reverse=True)[: len(longest)] == longest
    assert is_watertight(capped(mesh, loops))
