"""Smooth continuations: known surfaces are recovered, the mesh is unchanged, and failures are reported."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU

from spinor_geom.bench.holes import plane_square
from spinor_geom.bench.ragged import reported_bowl
from spinor_geom.deadline import time_limit
from spinor_geom.domain.sizes import GRADED
from spinor_geom.errors import OutOfTimeError, SingularMatrixError, SpinorGeomError, TooManyPointsError
from spinor_geom.fill import continuation, fairing
from spinor_geom.fill.collar import Collar, bend_across, collar_of
from spinor_geom.fill.continuation import continue_patch
from spinor_geom.fill.fairing import Faired, minimised_curvature
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import nearest_on_mesh
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from tests.fill.shapes import bowl_below, cone, cylinder, hull, icosphere, rounds_and_rows, together, tube, without
from tests.fill.test_seams import box
from tests.systems import every_second

Mesh = tuple[np.ndarray, np.ndarray]


def centres(mesh: Mesh) -> np.ndarray:
    return np.asarray(mesh[0][mesh[1]].mean(axis=1))


def jittered_ball() -> Mesh:
    points = icosphere(3)[0]
    points = points + np.random.default_rng(0).normal(scale=0.02, size=points.shape)
    return hull(points / np.linalg.norm(points, axis=1, keepdims=True))


def continued(mesh: Mesh, **options: Any) -> tuple[np.ndarray, LoopOutcome]:
    """The new vertices of a mesh, one of whose holes is filled, and its outcome. The mesh must not change."""
    (vertices, faces), report = fill_hole(mesh, return_report=True, **{"continuity": "C1", **options})
    np.testing.assert_array_equal(vertices[: len(mesh[0])], mesh[0])
    np.testing.assert_array_equal(faces[: len(mesh[1])], mesh[1])
    filled = [outcome for outcome in report.loops if outcome.patch is not None]
    assert len(filled) == 1
    return vertices[len(mesh[0]) :], filled[0]


def with_film(mesh: Mesh) -> tuple[BoundaryLoop, Patch, Collar]:
    """The longest loop of a mesh, the film over it, and the mesh around."""
    loop = boundary_loops(mesh)[0]
    film = fill_hole(mesh, 0, return_report=True)[1].loops[0].patch
    return loop, film, collar_of(PatchedMesh(TriangleMesh(*mesh)), loop.vertex_ids, film)


def with_face(mesh: Mesh, *corners: list[float]) -> Mesh:
    """A mesh and a face apart from it."""
    return together(mesh, (np.array(corners), np.array([[0, 1, 2]])))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def heights(points: np.ndarray) -> np.ndarray:
    """Distances from the unit sphere."""
    return np.asarray(np.linalg.norm(points, axis=1) - 1)


@pytest.mark.parametrize("height", [0.85, 0.7, 0.3, 0.0])
@pytest.mark.parametrize("sphere", [icosphere(3), jittered_ball()], ids=["icosphere", "jittered"])
def test_caps_of_spheres_come_back(sphere: Mesh, height: float) -> None:
    mesh = without(sphere, centres(sphere)[:, 2] > height)
    new, outcome = continued(mesh)
    assert (outcome.kind, outcome.converged, outcome.reason) == ("smooth", True, "")
    # vertices on a sphere have one mean curvature, whatever the triangles: only the steps' tolerance is left
    # and where a lid becomes a hemisphere, twice as large, what its triangles, meshed anew or not, leave
    assert rms(heights(new)) < (1e-3 if height > 0 else 5e-3)
    continuation = outcome.continuation
    # as the sphere's own edges bend: 5.5°
    assert continuation.after.rms < 8 < continuation.before.rms
    assert continuation.after.largest < 30


@pytest.mark.parametrize(("height", "width", "most"), [(0.2, 0.3, 0.012), (0.3, 0.3, 0.015), (0.4, 0.4, 0.006)])
def test_ridges_go_on_across_a_hole(height: float, width: float, most: float) -> None:
    def profile(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(height * np.exp(-((0.3 * x + 0.95 * y) ** 2) / (2 * width**2)))

    points, faces = plane_square(30)
    x, y, _ = (0.1 * (points - 15 + np.random.default_rng(0).uniform(-0.2, 0.2, points.shape))).T
    ridge = np.stack([x, y, profile(x, y)], axis=1), faces
    new, _ = continued(without(ridge, np.hypot(*centres(ridge).T[:2]) < 0.8), loop=1)
    assert rms(new[:, 2] - profile(new[:, 0], new[:, 1])) < most


def test_windows_in_cylinders_and_tori_are_closed_round() -> None:
    tube_mesh = cylinder()
    x, y, z = centres(tube_mesh).T
    window = np.hypot(np.arctan2(y, x), z) < 0.9
    rim = min(boundary_loops(without(tube_mesh, window)), key=lambda loop: abs(loop.points[:, 2]).max())
    new, _ = continued(without(tube_mesh, window), loop=rim)
    film = fill_hole(without(tube_mesh, window), rim)[0][len(without(tube_mesh, window)[0]) :]
    assert rms(np.hypot(new[:, 0], new[:, 1]) - 1) < 1e-3 < 0.05 < rms(np.hypot(film[:, 0], film[:, 1]) - 1)
    torus = rounds_and_rows(
        lambda a, b: ((1 + 0.4 * np.cos(a)) * np.cos(b), (1 + 0.4 * np.cos(a)) * np.sin(b), 0.4 * np.sin(a)),
        36,
        2 * np.pi * np.arange(72) / 72,
        closed=True,
    )
    for place in ([1.4, 0, 0], [1.0, 0, 0.4], [0.6, 0, 0]):
        new, _ = continued(without(torus, np.linalg.norm(centres(torus) - place, axis=1) < 0.35))
        off = np.hypot(np.hypot(new[:, 0], new[:, 1]) - 1, new[:, 2]) - 0.4
        assert rms(off) < 2e-3


@pytest.mark.parametrize(
    ("sides", "rows", "width"), [(16, 1, 1.0), (32, 1, 1.0), (32, 4, 1.0), (64, 2, 1.0), (24, 2, 0.5), (40, 3, 0.8)]
)
def test_prisms_are_continued_without_a_kink(sides: int, rows: int, width: float) -> None:
    # quads as long as CAD writes them: up to twenty rim edges
    vertices, faces = cylinder(sides, rows + 1, half=1.0)
    _, outcome = continued((vertices * [1, width, 1], faces), loop=0)
    assert outcome.continuation.after.rms < outcome.continuation.around.rms + 5
    assert not any("meets the mesh" in remark for remark in outcome.remarks)


def test_a_kink_is_remarked() -> None:
    # the six edges of a coarse prism bend by 60°, more than a crease, but all are alike
    _, outcome = continued(cylinder(6, 2, half=1.0), loop=0)
    assert outcome.continuation.creased == 0
    assert outcome.continuation.after.rms > outcome.continuation.around.rms + 5
    assert any("the patch meets the mesh at" in remark for remark in outcome.remarks)


def test_folds_are_remarked() -> None:
    _, outcome = continued(cylinder(32, 4, half=1.0), loop=0)
    assert outcome.continuation.folds == 0
    patch = outcome.patch
    assert not any("fold" in remark for remark in outcome.remarks)
    # an inner vertex that was moved beyond all others folds the faces around it
    vertices = patch.vertices.copy()
    vertices[patch.boundary_size] += 5 * (vertices[0] - vertices[patch.boundary_size // 2])
    folded = outcome.continuation.with_angles_of(replace(patch, vertices=vertices))
    assert folded.folds > 0
    assert f"fold the patch at {folded.folds} of its edges" in " ".join(folded.remarks)


def test_a_large_kink_is_not_called_smooth() -> None:
    # over a steep cone a thin plate is nearly the film
    cone = rounds_and_rows(lambda a, r: (r * np.cos(a), r * np.sin(a), r / 2), 8, np.linspace(1, 1 / 13, 13))
    _, outcome = continued(cone, loop=0)
    assert (outcome.kind, outcome.continuation) == ("minimal", None)
    assert any("not continued smoothly: it meets the mesh at" in remark for remark in outcome.remarks)


def test_plane_surroundings_give_the_plane() -> None:
    rng = np.random.default_rng(3)
    flat = rounds_and_rows(lambda a, r: (r * np.cos(a), r * np.sin(a), 0.0), 40, np.linspace(1, 2, 8))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    mesh = flat[0] @ turn.T + 5, flat[1]
    rim = min(boundary_loops(mesh), key=lambda loop: loop.perimeter)
    new, outcome = continued(mesh, loop=rim)
    assert outcome.kind == "smooth"
    assert np.abs((new - 5) @ turn[:, 2]).max() < 1e-13
    assert outcome.continuation.after.largest < 1e-5


@pytest.mark.parametrize(("half", "start", "error"), [(0.45, "minimal", 1e-3), (1.4, "strip", 1e-3)])
def test_a_tube_goes_on_as_a_tube(half: float, start: str, error: float) -> None:
    # farther apart than 1.33 no catenoid joins the rims
    whole = cylinder(32, 41, half=4.0)
    mesh = without(whole, abs(centres(whole)[:, 2]) < half)
    places = [k for k, loop in enumerate(boundary_loops(mesh)) if abs(loop.points[:, 2]).max() < 3]
    (vertices, faces), report = fill_hole(mesh, bridge=places, continuity="C1", return_report=True)
    for place in places:
        continuation = report.loops[place].continuation
        assert report.loops[place].kind == "smooth"
        assert continuation.started_from == start
    new = vertices[len(mesh[0]) :]
    assert len(new)
    assert rms(np.hypot(new[:, 0], new[:, 1]) - 1) < error
    assert {abs(loop.points[:, 2]).max() > 3 for loop in boundary_loops((vertices, faces))} == {True}
    if start == "strip":
        assert not fill_hole(mesh, bridge=places, return_report=True)[1].closed


def test_a_border_near_the_rim_does_not_hold_the_patch_back() -> None:
    sphere = icosphere(4)
    x, y, z = centres(sphere).T
    # two rows of triangles are left between hole and border
    mesh = without(sphere, (np.hypot(x, y) < 0.35) & (z > 0) | (y > 0.45))
    rim = min(boundary_loops(mesh), key=lambda loop: loop.perimeter)
    new, outcome = continued(mesh, loop=rim)
    assert outcome.kind == "smooth"
    assert rms(heights(new)) < 1e-3


def cube_without(middle: list[float]) -> Mesh:
    """The surface of a cube of edge length 2, without the faces near a point of it."""
    sides = TriangleMesh(*box(12, 12)).merged(1e-9)[0]
    whole = 2 * sides.vertices - 1, sides.faces
    return without(whole, np.linalg.norm(centres(whole) - middle, axis=1) < 0.5)


def test_an_edge_of_a_cube_goes_on() -> None:
    new, outcome = continued(cube_without([1, 1, 0]))
    assert outcome.continuation.creased == 2
    assert outcome.continuation.crease == pytest.approx(90)
    assert not outcome.continuation.remarks  # the edge of the cube is no fold
    np.testing.assert_allclose(np.abs(new).max(axis=1), 1, atol=1e-9)
    assert (np.sort(np.abs(new), axis=1)[:, 1] > 1 - 1e-9).sum() > 2  # vertices on the edge itself


def test_nothing_goes_on_across_the_creases_of_a_corner() -> None:
    # what went on with the three sides would have ridges outside
    new, outcome = continued(cube_without([1, 1, 1]))
    assert outcome.continuation.creased == 3
    assert outcome.continuation.crease == 0
    assert np.abs(new).max() <= 1 + 1e-9


def test_vertices_that_rounding_sends_far_away_are_no_patch() -> None:
    whole = trimesh.creation.box((0.5, 0.5, 0.6)).subdivide().subdivide().subdivide()
    is_near = np.linalg.norm(whole.triangles_center - [0.25, 0.25, 0.0], axis=1) < 0.3
    vertices, faces = without((whole.vertices, whole.faces), is_near)
    # a coarse grid, so that many triangles have no area
    new, outcome = continued((np.round(vertices, 1), faces))
    assert np.abs(new).max(initial=0.0) < 1
    assert outcome.kind != "smooth"


def tube_with_disks(sides: int, across: float) -> Mesh:
    """A tube of radius 1 and the disks at its ends, with holes in their middles, stretched along x."""
    radii = np.concatenate([np.linspace(0.2, 1, 7)[:-1], np.ones(13), np.linspace(1, 0.2, 7)[1:]])
    heights = np.concatenate([-np.ones(6), np.linspace(-1, 1, 13), np.ones(6)])
    rows = np.arange(len(radii))
    return rounds_and_rows(lambda a, k: (across * radii[k] * np.cos(a), radii[k] * np.sin(a), heights[k]), sides, rows)


def off_the_mesh(new: np.ndarray, whole: Mesh) -> float:
    return rms(nearest_on_mesh(new, *whole)[0])


# Of 24 sides the corners of the edge lie 0.009 beyond its middle. Without the crease the distance is 0.02 to 0.04
@pytest.mark.parametrize(("sides", "across"), [(40, 1.0), (24, 1.0), (48, 1.5)])
@pytest.mark.parametrize("radius", [0.3, 0.6, 0.7])
def test_the_round_edge_of_a_disk_goes_on(sides: int, across: float, radius: float) -> None:
    whole = tube_with_disks(sides, across)
    mesh = without(whole, np.linalg.norm(centres(whole) - [across, 0, 1], axis=1) < radius)
    new, outcome = continued(mesh, loop=max(boundary_loops(mesh), key=lambda loop: loop.centroid[0]))
    assert outcome.continuation.crease == pytest.approx(90)
    assert off_the_mesh(new, whole) < 0.006


def solid(shape: trimesh.Trimesh) -> Mesh:
    for _ in range(4):
        shape = shape.subdivide()
    shape.merge_vertices()
    return np.asarray(shape.vertices), np.asarray(shape.faces)


def corner_of_boxes() -> trimesh.Trimesh:
    """An L of three unit cubes, with a concave edge at x = y = 0."""
    middles = [(-0.5, 0.5, 0), (-0.5, -0.5, 0), (0.5, -0.5, 0)]
    sides = trimesh.util.concatenate([trimesh.creation.box().apply_translation(middle) for middle in middles])
    x, y, _ = sides.triangles_center.T
    sides.update_faces(~((abs(x) < 1e-9) & (y < 0) | (abs(y) < 1e-9) & (x < 0)))
    sides.merge_vertices()
    return sides


# solids, and the middle of a crease
CREASED = {
    "box": lambda: (solid(trimesh.creation.box()), [0.5, 0.5, 0]),
    "prism": lambda: (solid(trimesh.creation.cylinder(0.5, 1, sections=6)), [0.25, 3**0.5 / 4, 0]),
    "concave": lambda: (solid(corner_of_boxes()), [0, 0, 0]),
}


@pytest.mark.parametrize("seed", every_second(range(12)))
@pytest.mark.parametrize("kind", CREASED)
def test_creases_along_edges_of_the_rim_go_on(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole, middle = CREASED[kind]()
    away = np.linalg.norm(centres(whole) - middle - rng.normal(0, 0.03, 3), axis=1)
    new, outcome = continued(without(whole, away < rng.uniform(0.1, 0.25)))
    assert outcome.continuation.creased == 2
    assert outcome.continuation.crease > 50
    assert not outcome.continuation.has_kink  # nor along edges of the rim on the crease
    np.testing.assert_allclose(off_the_mesh(new, whole), 0, atol=1e-9)


@pytest.mark.parametrize("sides", [4, 6, 12])
def test_the_equal_edges_of_a_prism_are_no_creases(sides: int) -> None:
    mesh = cylinder(sides, 9)
    loop = boundary_loops(mesh)[0]
    assert collar_of(PatchedMesh(TriangleMesh(*mesh)), loop.vertex_ids, cone(loop)).creased == 0


def test_a_patch_depends_on_three_rings_of_faces_and_no_more() -> None:
    mesh = cylinder(24, 12)
    loop = boundary_loops(mesh)[0]
    from_rim = np.abs(mesh[0][:, 2] - loop.centroid[2])
    rows = np.unique(np.round(from_rim, 9))

    def roughness(changed: float) -> float:
        vertices = mesh[0].copy()
        row = np.isclose(from_rim, changed)
        vertices[row, :2] *= 1 + 0.05 * np.sin(5 * np.arange(row.sum()))[:, None]
        return collar_of(PatchedMesh(TriangleMesh(vertices, mesh[1])), loop.vertex_ids, cone(loop)).roughness

    # row k ends the k-th ring. Of a round tube H is the same everywhere
    assert [roughness(rows[k]) > 0 for k in range(1, 8)] == [True, True, True, False, False, False, False]


def test_noise_is_not_amplified_and_is_reported() -> None:
    edge, noise = 0.069, 0.1
    rng = np.random.default_rng(1)
    mesh = bowl_below(0.7, 4)
    _, smooth = continued(mesh)
    rough = mesh[0] * (1 + noise * edge * rng.normal(size=len(mesh[0])))[:, None], mesh[1]
    new, outcome = continued(rough)
    assert smooth.continuation.roughness < 0.1 < 1 < outcome.continuation.roughness
    assert outcome.continuation.correlation_length == 0
    # 0.03 is what noise of 0.069 · 0.1 leaves in the sum over all normals of the rim. The film is off by 0.15
    assert rms(heights(new)) < 0.03


def test_what_would_cross_where_the_film_does_not_is_left_a_film() -> None:
    # a plate over the lid, which the dome would have to pass
    mesh = with_face(bowl_below(0.3), [-3.0, -2.0, 0.8], [3.0, -2.0, 0.8], [0.0, 4.0, 0.9])
    rim = max(boundary_loops(mesh), key=len)
    new, outcome = continued(mesh, loop=rim)
    assert (outcome.kind, outcome.continuation, outcome.intersections) == ("minimal", None, 0)
    assert outcome.converged
    assert "not continued smoothly" in outcome.remarks[0]
    assert outcome.remarks[0] in outcome.shortcomings[0]
    assert new[:, 2].max() < 0.5


@pytest.mark.parametrize(("low", "kind"), [(0.2, "discrete"), (0.5, "minimal")])
def test_what_crosses_the_mesh_is_not_called_smooth(low: float, kind: str) -> None:
    # a pole through the dome, and through the film or not
    mesh = with_face(bowl_below(0.3), [0.0, 0.0, low], [0.2, 0.0, 3.0], [0.0, 0.2, 3.0])
    new, outcome = continued(mesh, loop=max(boundary_loops(mesh), key=len))
    assert (outcome.kind, outcome.continuation) == (kind, None)
    if kind == "discrete":
        assert "not good here: it has" in outcome.reason
        assert outcome.reason in outcome.shortcomings[0]
        assert rms(heights(new)) < 1e-3
    else:
        assert not outcome.intersections


def test_if_no_continuation_is_found_the_minimal_surface_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = bowl_below(0.7, 2)

    def stuck(patch: Patch, *_: object, **__: object) -> Faired:
        return Faired(patch=patch, steps=7, next_step=0.5, stretch=1.0)

    def broken(*_: object, **__: object) -> Faired:
        raise SingularMatrixError(size=5)

    for instead, message in ((stuck, "after 7 steps the next"), (broken, "singular")):
        monkeypatch.setattr("spinor_geom.fill.smooth_patch.continue_patch", instead)
        _, outcome = continued(mesh)
        assert (outcome.kind, outcome.continuation, outcome.converged) == ("minimal", None, True)
        assert "the patch was not continued smoothly" in outcome.remarks[0]
        assert message in outcome.remarks[0]


@pytest.mark.parametrize("is_crossed", [True, False])
def test_a_defective_continuation_is_kept_if_it_crosses_less(monkeypatch: pytest.MonkeyPatch, is_crossed: bool) -> None:
    # less than half a sphere, cut along a circle: the film lies over it as a lid, at z = -0.7
    mesh = cut_sphere(180 - np.degrees(0.8), rows=8)
    if is_crossed:
        mesh = with_face(mesh, [0.0, 0, -0.75], [0.05, 0, -0.6], [0, 0.05, -0.6])

    def low_dome(patch: Patch, *_: object, **__: object) -> Faired:
        x = patch.vertices.copy()
        m = patch.boundary_size
        x[m:, 2] += 0.5 * (np.hypot(*x[:m, :2].T).mean() - np.hypot(*x[m:, :2].T))
        return Faired(patch=replace(patch, vertices=x), steps=7, next_step=0.5, stretch=1.0)

    monkeypatch.setattr("spinor_geom.fill.smooth_patch.continue_patch", low_dome)
    _, outcome = continued(mesh, loop=0)
    assert not outcome.intersections
    if is_crossed:
        assert (outcome.kind, outcome.continuation, outcome.converged) == ("discrete", None, False)
        assert "after 7 steps the next" in outcome.reason
        assert "the film" in outcome.reason
    else:
        assert (outcome.kind, outcome.converged) == ("minimal", True)
        assert "after 7 steps the next" in outcome.remarks[0]


@pytest.mark.parametrize("error", [SingularMatrixError(size=5), TooManyPointsError("too many points")])
@pytest.mark.parametrize("failing", ["remesh", "minimised_curvature"])
def test_a_failed_remeshing_keeps_the_continuation(
    monkeypatch: pytest.MonkeyPatch, failing: str, error: SpinorGeomError
) -> None:
    mesh = bowl_below(-0.3)
    _, film, collar = with_film(mesh)
    # at rest, but with triangles stretched by more than 2, so that it is meshed again
    first, calls = replace(minimised_curvature(film, collar), next_step=0.0, stretch=3.0), []

    def fails(*arguments: object, **_: object) -> Faired:
        calls.append(arguments)
        if failing == "minimised_curvature" and len(calls) == 1:
            return first
        raise error

    monkeypatch.setattr(f"spinor_geom.fill.continuation.{failing}", fails)
    moved = continue_patch(film, collar, GRADED)
    assert len(calls) > (failing == "minimised_curvature")
    if failing == "remesh":
        np.testing.assert_array_equal(moved.patch.faces, film.faces)
        assert moved.converged
    else:
        np.testing.assert_array_equal(moved.patch.vertices, first.patch.vertices)


@pytest.mark.parametrize(("second", "rounds"), [(3.0, 2), (1.9, 3)])
def test_a_slow_continuation_is_left(monkeypatch: pytest.MonkeyPatch, second: float, rounds: int) -> None:
    _, film, collar = with_film(without(icosphere(3), centres(icosphere(3))[:, 2] > -0.3))
    good, left = minimised_curvature(film, collar), [0.001, second, 4.0]

    def slow(*_: object) -> Faired:
        return replace(good, next_step=left.pop(), stretch=1.0)

    monkeypatch.setattr(continuation, "minimised_curvature", slow)
    monkeypatch.setattr(continuation, "_from_domain_of_angles", lambda *_: None)
    monkeypatch.setattr(continuation, "_refined", lambda faired, *_: faired)
    moved = continue_patch(film, collar, GRADED)
    assert len(left) == 3 - rounds
    assert moved.order == ("curvature" if rounds == 3 else "thin plate")


@pytest.mark.parametrize("error", [SingularMatrixError(size=5), TooManyPointsError("too many points")])
def test_a_patch_without_meshed_angles_is_continued(monkeypatch: pytest.MonkeyPatch, error: SpinorGeomError) -> None:
    hole = reported_bowl(5)
    _, film, collar = with_film((hole.vertices, hole.faces))
    calls = []

    def fails(*arguments: object) -> Patch:
        calls.append(arguments)
        raise error

    monkeypatch.setattr("spinor_geom.fill.continuation.over_domain_of_angles", fails)
    # the film turns back over the mesh, so that it does not come to rest
    assert minimised_curvature(film, collar).defect
    moved = continue_patch(film, collar, GRADED)
    assert len(calls) == 1
    assert not np.array_equal(moved.patch.vertices, film.vertices)


def test_a_continuation_out_of_time_is_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = bowl_below(-0.6)
    _, film, collar = with_film(mesh)
    with time_limit(0.0), pytest.raises(OutOfTimeError):
        continue_patch(film, collar, GRADED)
    real, left = fairing.factor_symmetric, [4]  # for two thin plates, the metric and the first Newton step

    def late_after_two(matrix: csc_array) -> SuperLU:
        left[0] -= 1
        if left[0] < 0:
            raise OutOfTimeError
        return real(matrix)

    monkeypatch.setattr(fairing, "factor_symmetric", late_after_two)
    monkeypatch.setattr(continuation, "is_out_of_time", lambda: left[0] < 0)
    moved = continue_patch(film, collar, GRADED)
    assert left[0] < 0
    assert not moved.converged
    assert np.isfinite(moved.next_step)
    assert bend_across(collar, moved.patch).rms < bend_across(collar, film).rms


def test_attributes_follow() -> None:
    mesh = bowl_below(0.7)
    named = TriangleMesh(*mesh, vertex_attributes={"normal": mesh[0], "place": mesh[0][:, :1]})
    filled, _ = fill_hole(named, continuity="C1", return_report=True)
    new = slice(len(mesh[0]), None)
    normals = filled.vertex_attributes["normal"][new]
    # the normals are those of the continuation, not of the film, whose are all (0, 0, 1)
    assert np.einsum("ik,ik->i", normals, filled.vertices[new]).min() > 0.99
    assert np.corrcoef(filled.vertex_attributes["place"][new, 0], filled.vertices[new, 0])[0, 1] > 0.99


def cut_sphere(polar_angle: float, rows: int = 20) -> Mesh:
    """The unit sphere below a circle of latitude, which the film over it meets at the circle's polar angle."""
    rows_of = np.linspace(0.15, np.pi - np.radians(polar_angle), rows)
    return rounds_and_rows(lambda a, t: (np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), -np.cos(t)), 32, rows_of)


@pytest.mark.parametrize(("angle", "kind"), [(50, "smooth"), (80, "minimal"), (120, "minimal")])
def test_auto_takes_the_film_where_it_meets_the_mesh_steeply(angle: float, kind: str) -> None:
    mesh = cut_sphere(angle)
    rim = max(boundary_loops(mesh), key=lambda loop: loop.perimeter)
    _, outcome = continued(mesh, loop=rim, continuity="auto")
    assert outcome.kind == kind
    assert f"{'at most' if kind == 'smooth' else 'more than'} 65°" in outcome.choice
    stated = float(outcome.choice.split("meet at ")[1].split("°")[0])
    assert abs(stated - angle) < 5  # half the polar angle of a face
    assert not any("not continued" in remark for remark in outcome.remarks)


def test_auto_takes_the_continuation_if_the_film_intersects() -> None:
    mesh = with_face(cut_sphere(120), [0.0, 0, -0.52], [0.05, 0, -0.35], [0, 0.05, -0.35])
    rim = max(boundary_loops(mesh), key=lambda loop: loop.perimeter)
    film, smooth = (continued(mesh, loop=rim, continuity=continuity)[1] for continuity in ("film", "auto"))
    assert film.intersections or film.faces_replaced
    assert smooth.kind == "smooth"
    assert smooth.intersections == 0


@pytest.mark.parametrize(
    ("continuity", "kinds"),
    [
        ("Smooth", ["smooth", "smooth"]),
        ("film", ["minimal", "minimal"]),
        ({1: "c1"}, ["minimal", "smooth"]),
        ({1: "film", "default": "smooth"}, ["smooth", "minimal"]),
    ],
)
def test_continuity_can_be_given_for_each_loop(continuity: Any, kinds: list[str]) -> None:
    _, report = fill_hole(cylinder(16, 3), continuity=continuity, return_report=True)
    assert [outcome.kind for outcome in report.loops] == kinds


@pytest.mark.parametrize("named", [0, 1])
def test_a_bridge_has_the_continuity_of_any_of_its_loops(named: int) -> None:
    mesh = together(tube(), (tube()[0] * [1, -1, -1] - [0, 0, 0.8], tube()[1]))
    _, report = fill_hole(mesh, bridge=(0, 1), continuity={named: "smooth"}, return_report=True)
    assert [report.loops[k].kind for k in (0, 1)] == ["smooth", "smooth"]


def test_the_bend_is_the_angle_between_the_faces_at_the_rim() -> None:
    mesh = cylinder(16, 3)
    loop = boundary_loops(mesh)[0]
    lid = cone(loop)
    collar = collar_of(PatchedMesh(TriangleMesh(*mesh)), loop.vertex_ids, lid)
    for tip, angle in ((0.0, 90.0), (np.cos(np.pi / 16), 45.0)):
        vertices = lid.vertices.copy()
        vertices[-1, 2] += tip * np.sign(loop.centroid[2])
        bend = bend_across(collar, replace(lid, vertices=vertices))
        np.testing.assert_allclose([bend.largest, bend.rms], angle, rtol=1e-9)


def test_triangles_that_a_limit_leaves_larger_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    remesh = continuation.remesh

    def slow(patch: Patch, lengths: Any, *rest: Any, **options: Any) -> Patch:
        if lengths != GRADED:
            raise OutOfTimeError()
        return remesh(patch, lengths, *rest, **options)

    monkeypatch.setattr(continuation, "remesh", slow)
    _, report = fill_hole(bowl_below(0.3), continuity="C1", target_edge_length=0.05, return_report=True)
    (outcome,) = report.loops
    assert outcome.kind == "smooth"
    assert "larger than asked for" in "".join(outcome.remarks)
