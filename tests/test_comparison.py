import json

import numpy as np
import pytest
import trimesh

from spinor_geom import gallery
from spinor_geom.comparison import compare
from spinor_geom.errors import (
    ForeignRimError,
    LoopIndexError,
    MeshShapeError,
    OptionError,
    SurfaceError,
    UnknownMeshTypeError,
)
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solve import solve_plateau
from tests.exact_solutions import ENNEPER, PLANE, exact_solution
from tests.fill.shapes import circle, collar, spokes, tube


@pytest.fixture(scope="module")
def enneper():
    """Enneper's surface over |z| ≤ 0.8, far inside its range of stability, against the discrete one."""
    return compare(exact_solution(ENNEPER, 40, radius=0.8))


def test_exact_surface_has_its_closed_form_area_and_no_mean_curvature(enneper):
    r2 = 0.64
    assert enneper.exact_area == pytest.approx(np.pi * r2 * (1 + r2 + r2**2 / 3), rel=1e-12)
    # round-off of second derivatives
    assert enneper.exact_curvature.max < 1e-10
    assert enneper.exact_curvature.rms <= enneper.exact_curvature.max


def test_both_meshes_are_near_the_surface_and_each_other(enneper):
    # 40 chords of the rim lower the area by 0.7 %
    assert enneper.patch_area == pytest.approx(enneper.exact_area, rel=0.02)
    assert enneper.baseline_area == pytest.approx(enneper.exact_area, rel=0.02)
    assert enneper.baseline_curvature.max > 0
    # the chords lower both alike: the meshes' areas are nearer to each other than to the surface's
    assert abs(enneper.baseline_area / enneper.patch_area - 1) < 0.1 * (1 - enneper.patch_area / enneper.exact_area)
    # both meshes' sagitta at edges of 0.15 and curvature 1 is about 0.01
    assert 0 < enneper.hausdorff.mean < enneper.hausdorff.max < 0.05


def test_meshes_have_the_same_resolution(enneper):
    solution = exact_solution(ENNEPER, 40, radius=0.8)
    finer = compare(solution, target_edge_length=0.5 * solution.loop.mean_edge_length)
    for comparison in (enneper, finer):
        assert 0.8 < comparison.baseline_vertices / comparison.patch_vertices < 1.25


def test_the_discrete_surface_has_no_normal_curvature_left(enneper):
    # what the chords leave on the exact surface's mesh is a thousand times as much
    assert enneper.baseline_curvature.max < 1e-3 * enneper.patch_curvature.max
    # in its own plane it is pulled as the other mesh is: its triangles are no more even
    assert enneper.baseline_curvature.tangential_rms == pytest.approx(enneper.patch_curvature.tangential_rms, rel=1)
    assert enneper.exact_curvature.tangential_rms == 0


def test_table_and_dictionary_hold_the_figures(enneper):
    assert f"{enneper.exact_area:.8g}" in str(enneper)
    figures = json.loads(json.dumps(enneper.to_dict()))
    assert figures["hausdorff"]["max"] == enneper.hausdorff.max
    assert figures["hausdorff"]["forward"]["mean"] == enneper.hausdorff.forward.mean
    assert figures["exact_curvature"]["max"] == enneper.exact_curvature.max
    assert figures["solution_seconds"] == 0.25


def test_plane_is_the_same_for_both_methods():
    comparison = compare(exact_solution(PLANE, 16))
    assert comparison.hausdorff.max < 1e-12
    assert comparison.patch_curvature.max < 1e-11
    assert comparison.patch_area == pytest.approx(comparison.baseline_area, rel=1e-12)


@pytest.fixture(scope="module")
def known():
    return gallery.enneper(0.8)


@pytest.mark.parametrize("points", [24, 64])
def test_both_meshes_are_measured_against_the_surface_as_its_formula_has_it(known, points):
    rim = known.rim(points)
    comparison = compare(rim, spokes(rim.points))
    patch = mesh_patch(solve_plateau(rim))
    for found, (vertices, faces) in (
        (comparison.patch_to_surface, (patch.vertices, patch.faces)),
        (comparison.baseline_to_surface, spokes(rim.points)),
    ):
        exact = known.chart.hausdorff(vertices, faces)
        # the rims' points are fitted to 1e-3 of an edge. The chart goes on a little beyond the rim, the surface ends
        slack = comparison.surface_error + 2e-3 * rim.mean_edge_length
        assert found.mean == pytest.approx(exact.mean, rel=0.05)
        assert found.max == pytest.approx(exact.max, rel=0.08, abs=slack)
    assert comparison.surface_error < comparison.patch_to_surface.max / 10


def test_what_a_user_holds_is_compared(known, tmp_path):
    rim = known.rim(24)
    vertices, faces = spokes(rim.points)
    pipe = collar(rim.points, [0, 0, 1])
    tube = TriangleMesh(pipe[0], pipe[1][:, ::-1])
    place = next(k for k, loop in enumerate(boundary_loops(tube)) if loop.vertex_ids.max() < 24)
    mine = trimesh.Trimesh(vertices, faces, process=False)
    mine.export(tmp_path / "mine.ply")
    solution = solve_plateau(rim)
    wanted = compare(solution, (vertices, faces)).baseline_to_surface.mean
    for surface, baseline in (
        (rim, tmp_path / "mine.ply"),
        (rim.points.tolist(), TriangleMesh(vertices, faces[:, ::-1])),
    ):
        # files hold single precision
        assert compare(surface, baseline).baseline_to_surface.mean == pytest.approx(wanted, rel=1e-2)
    assert compare(tube, mine, loop=place).baseline_to_surface.mean == pytest.approx(wanted, rel=1e-2)


@pytest.mark.parametrize("loop", [0, 1])
def test_the_patch_of_a_filled_mesh_is_compared(loop):
    mesh = tube()
    filled, report = fill_hole(mesh, return_report=True)
    patch = report.loops[loop].patch
    wanted = compare(mesh, (patch.vertices, patch.faces), loop=loop)
    given = compare(mesh, filled, loop=loop)
    assert given.baseline_vertices == wanted.baseline_vertices
    assert given.baseline_area == pytest.approx(wanted.baseline_area, rel=1e-12)


def test_two_rims_are_compared_with_a_strip_of_mine():
    strip = collar(circle(24, height=-0.5), [0, 0, 1])
    comparison = compare([circle(24, height=-0.5), circle(24, height=0.5)], (strip[0], strip[1][:, ::-1]))
    # the catenoid's neck of 0.848 in a cylinder of radius 1
    assert comparison.baseline_to_surface.max == pytest.approx(1 - 0.848, abs=0.02)
    with pytest.raises(SurfaceError):
        compare([circle(24, height=-2), circle(24, height=2)])


def test_what_cannot_be_compared_is_refused_with_a_sentence(known):
    rim = known.rim(24)
    vertices, faces = spokes(rim.points)
    two = TriangleMesh(np.vstack([vertices, vertices + 5]), np.concatenate([faces, faces + 25]))
    with pytest.raises(ForeignRimError, match="mean edges"):
        compare(rim, spokes(1.2 * rim.points))
    with pytest.raises(ForeignRimError, match="2 boundary loops"):
        compare(rim, two)
    with pytest.raises(OptionError, match="2 boundary loops"):
        compare(two)
    with pytest.raises(OptionError, match="a curve was given"):
        compare(rim, loop=0)
    with pytest.raises(LoopIndexError):
        compare(two, loop=2)
    with pytest.raises(MeshShapeError):
        compare([[0.0, 1.0], [1.0, 2.0], [0.0, 0.0]])
    for nothing in (7, None, object()):
        with pytest.raises(UnknownMeshTypeError):
            compare(nothing)
