"""Seams: vertices equal up to rounding, and T-junctions, around closed bodies of many kinds; real holes beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.bench.holes import lattice
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.topology import near_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.closed import is_watertight
from tests.fill.shapes import circle, collar, icosphere, obj_text, spokes, together, tube
from tests.fill.sheets import moebius

Mesh = tuple[np.ndarray, np.ndarray]


def grid_patch(corner: np.ndarray, right: np.ndarray, up: np.ndarray, columns: int, rows: int) -> Mesh:
    """A parallelogram of columns × rows squares, normal right × up."""
    (x, y), faces = lattice(columns, rows)
    return corner + x[:, None] * right / columns + y[:, None] * up / rows, faces


def box(lid: int, sides: int, *, size: float = 1.0) -> Mesh:
    """A closed box, its top divided into lid × lid squares and each other side into sides × sides: two pieces."""
    x, y, z = size * np.eye(3)
    none = 0 * x
    walls = [(none, x, z), (x, y, z), (x + y, -x, z), (y, -y, z), (none, y, x)]
    body = TriangleMesh(*together(*(grid_patch(*wall, sides, sides) for wall in walls))).merged(1e-9 * size)[0]
    return together((body.vertices, body.faces), grid_patch(z, x, y, lid, lid))


def can(lid: int, wall: int) -> Mesh:
    """A closed cylinder with 12 sides: each side of its lower ring in `wall` parts, of its lid in `lid`."""

    def ring(parts: int, height: float) -> np.ndarray:
        corners, along = circle(12, height=height), np.arange(parts)[:, None] / parts
        return np.concatenate([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])

    low = ring(wall, 0.0)
    body = TriangleMesh(*together(collar(low, [0, 0, 1]), spokes(low))).merged(1e-9)[0]
    return together((body.vertices, body.faces[:, ::-1]), spokes(ring(lid, 1.0)))


def text_stl(mesh: Mesh, error: float, seed: int) -> str:
    """A text STL in all digits whose equal corners differ by an error, as a share of the size."""
    corners = mesh[0][mesh[1]]
    size = np.linalg.norm(np.ptp(mesh[0], axis=0))
    shift = np.random.default_rng(seed).uniform(-1, 1, size=corners.shape) * error * size / np.sqrt(12)
    facets = (
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in facet)
        + "endloop\nendfacet\n"
        for facet in (corners + shift).tolist()
    )
    return f"solid a\n{''.join(facets)}endsolid a\n"


BODIES = {"box": box(3, 3), "can": can(1, 1), "ball": icosphere(2), "moved": (box(2, 2)[0] + [9, -5, 3], box(2, 2)[1])}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("error", [1e-16, 1e-8])
def test_text_stl_is_merged_within_rounding(tmp_path: Path, body: str, error: float) -> None:
    path = tmp_path / "a.stl"
    path.write_text(text_stl(BODIES[body], error, 7))
    file = read_mesh(path)
    assert boundary_loops(file) == []
    assert is_watertight(file.mesh.faces)
    assert "were merged" in file.notes[0]
    # nothing collapsed
    assert len(file.mesh.faces) == len(BODIES[body][1])


@pytest.mark.parametrize("body", BODIES)
def test_binary_stl_is_merged_within_units_in_the_last_place(tmp_path: Path, body: str) -> None:
    vertices, faces = BODIES[body]
    corners = vertices[faces].astype(np.float32)
    away = np.random.default_rng(3).choice([-1.0, 1.0], size=corners.shape).astype(np.float32)
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")])
    moved = np.random.default_rng(4).random(corners.shape) < 0.3
    records["corners"] = np.where(moved & (corners != 0), np.nextafter(corners, away * np.inf), corners)
    path = tmp_path / "a.stl"
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + records.tobytes())
    file = read_mesh(path)
    assert boundary_loops(file) == []
    assert len(file.mesh.faces) == len(faces)


@pytest.mark.parametrize("error", [1e-16, 1e-12, 1e-9])
def test_near_seams_are_left_open_with_the_distance_and_merging_closes_them(error: float) -> None:
    vertices, faces = box(3, 3, size=2.0)
    shift = np.random.default_rng(1).uniform(-1, 1, size=(16, 3)) * error
    near = np.concatenate([vertices[:-16], vertices[-16:] + shift])
    _, report = fill_hole((near, faces), return_report=True)
    assert len(report.extension.faces) == 0
    for outcome in report.loops:
        distance = outcome.loop.seam_distance
        # a coordinate is rounded by as much again
        assert 0 < distance <= 4 * error
        assert f"{distance:.2g} apart" in outcome.reason
        assert "--merge" in outcome.reason
        assert not outcome.converged
    assert any("would leave 0 of the 2 loops" in note for note in report.notes)
    for merge in (True, 1.1 * max(outcome.loop.seam_distance for outcome in report.loops)):
        merged, after = fill_hole((near, faces), merge=merge, return_report=True)
        assert after.watertight
        assert isinstance(merged, tuple)


@pytest.mark.parametrize("width", [0.0, 1e-15, 1e-11, 1e-8])
def test_nothing_is_laid_into_a_slit_narrower_than_rounding(width: float) -> None:
    vertices, faces = grid_patch(np.zeros(3), np.array([6.0, 0, 0]), np.array([0, 4.0, 0]), 6, 4)
    # cut along y = 2 from x = 2 to x = 4: the upper faces get a copy of vertex (3, 2)
    upper = vertices[faces].mean(axis=1)[:, 1] > 2
    faces = np.where(upper[:, None] & (faces == 17), len(vertices), faces)
    vertices = np.concatenate([vertices, vertices[[17]] + np.array([0, width, 0])])
    _, report = fill_hole((vertices, faces), return_report=True)
    slit = next(outcome for outcome in report.loops if len(outcome.loop) == 4)
    assert not slit.filled
    assert "zero-width slit" in slit.reason
    assert "--merge" in slit.reason
    assert slit.loop.seam_distance <= 1.1 * width + 1e-15


@pytest.mark.parametrize(("share", "is_seam"), [(0.7e-6, True), (1.5e-6, False)])
def test_sides_of_a_gap_coincide_up_to_a_millionth_of_the_diagonal(share: float, is_seam: bool) -> None:
    vertices, faces = box(3, 3)
    # the lid is lifted. Its edges are 1/3, so that the diagonal is the limit
    lid = vertices[-16:] + np.array([0, 0, share * np.linalg.norm(np.ptp(vertices, axis=0))])
    _, report = fill_hole((np.concatenate([vertices[:-16], lid]), faces), return_report=True)
    assert {"apart" in outcome.reason for outcome in report.loops} == {is_seam}


@pytest.mark.parametrize(("share", "is_seam"), [(0.7e-2, True), (1.5e-2, False)])
def test_sides_of_a_gap_between_fine_faces_coincide_up_to_a_hundredth_of_an_edge(share: float, is_seam: bool) -> None:
    # edges of 1e-5 beside a face of size 1: a millionth of the diagonal is a tenth of them
    vertices, faces = box(3, 3, size=3e-5)
    far = np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5]])
    vertices[-16:, 2] += share * 1e-5
    mesh = together((vertices, faces), (far, np.array([[0, 1, 2]])))
    assert {loop.seam_distance > 0 for loop in boundary_loops(mesh) if len(loop) > 3} == {is_seam}


def test_a_hole_at_the_end_of_a_slit_is_filled() -> None:
    vertices, faces = grid_patch(np.zeros(3), np.array([8.0, 0, 0]), np.array([0, 4.0, 0]), 8, 4)
    # cut along y = 2 from x = 1 to x = 7, and open beyond: seven of ten edges or so lie on one another
    middle = vertices[faces].mean(axis=1)
    upper = middle[:, 1] > 2
    cut = np.flatnonzero((vertices[:, 1] == 2) & (vertices[:, 0] > 1) & (vertices[:, 0] < 7))
    copy = np.arange(len(vertices))
    copy[cut] = len(vertices) + np.arange(len(cut))
    faces = np.where(upper[:, None], copy[faces], faces)
    opened = (np.abs(middle - [6.5, 2.5, 0]).max(axis=1) < 0.5) & (middle[:, 1] > 2)
    mesh = np.concatenate([vertices, vertices[cut]]), faces[~opened]
    _, report = fill_hole(mesh, return_report=True)
    (keyhole,) = (outcome for outcome in report.loops if outcome.loop.slit_fraction)
    assert 0.5 < keyhole.loop.slit_fraction < 0.9
    assert "zero-width slit" not in keyhole.reason


def test_no_two_corners_of_a_face_are_merged() -> None:
    random = np.random.default_rng(0)
    for scale in (0.02, 0.1, 0.5, 3.0):
        points = random.uniform(size=(60, 3))
        faces = np.stack([random.permutation(60)[:3] for _ in range(80)])
        place = near_vertices(points, np.full(60, scale), faces)
        corners = np.sort(place[faces], axis=1)
        assert (np.diff(corners, axis=1) > 0).all()


SEAMS = {"one vertex": box(1, 2), "many vertices": box(1, 5), "lid finer": box(4, 1), "both sides": box(2, 3)}
SEAMS |= {"can": can(1, 3), "can, both": can(3, 2)}


@pytest.mark.parametrize("seam", SEAMS)
@pytest.mark.parametrize("off", [0.0, 5e-7])
def test_t_junctions_are_left_open(seam: str, off: float) -> None:
    vertices, faces = SEAMS[seam]
    vertices = vertices + np.random.default_rng(2).uniform(-1, 1, size=vertices.shape) * off / np.sqrt(12)
    _, report = fill_hole((vertices, faces), return_report=True)
    assert len(report.loops) == 2
    assert len(report.extension.faces) == 0
    for outcome in report.loops:
        assert "T-junction" in outcome.reason
        # the vertex lies on the edge that is named
        for vertex, start, end in vertices[outcome.loop.junctions]:
            side = end - start
            assert np.linalg.norm(np.cross(vertex - start, side)) / np.linalg.norm(side) <= 3 * off + 1e-15


def test_a_t_junction_is_filled_by_name() -> None:
    _, report = fill_hole(box(1, 2), loop=0, return_report=True)
    assert report.loops[0].filled


def test_vertices_on_edges_without_a_common_edge_are_no_seam() -> None:
    # a triangle that stands with its tip on the border of a plate
    plate = grid_patch(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 1, 1)
    tip = (np.array([[0.5, 1, 0], [0.8, 2, 0], [0.2, 2, 0]]), np.array([[0, 1, 2]]))
    assert [len(loop.junctions) for loop in boundary_loops(together(plate, tip))] == [0, 0]


def test_closed_and_one_sided_meshes_are_named() -> None:
    _, report = fill_hole(icosphere(1), return_report=True)
    assert report.notes == ("the mesh is closed, genus 0: it has no hole",)
    assert (report.loops, report.watertight, report.complete) == ((), True, True)
    # a torus of 8 x 6
    (i, j), faces = lattice(8, 6, wrap_x=True, wrap_y=True)
    u, v = i * np.pi / 4, j * np.pi / 3
    torus = np.column_stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)])
    _, report = fill_hole((torus, faces), return_report=True)
    assert report.notes == ("the mesh is closed, genus 1: it has no boundary loops; a tunnel is not a hole",)
    _, report = fill_hole(moebius(0.5), loop=0, return_report=True)
    assert any("not orientable" in note for note in report.notes)


def test_each_patch_has_its_group(tmp_path: Path) -> None:
    source = tmp_path / "a.obj"
    source.write_text(obj_text(*tube()))
    fill_hole(source).write(tmp_path / "b.obj")
    groups = [line for line in (tmp_path / "b.obj").read_text().splitlines() if line.startswith("g ")]
    assert groups == [f"g spinor_geom_fill_{index}" for index in range(2)]
