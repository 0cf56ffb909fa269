"""Scenes of fills and loops: cameras, boundary loops, patches."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.camera import Camera
from spinor_geom.render.fill_scene import fill_scene, loops_scene, most_seen, whole_scene
from tests.fill.shapes import bowl_below, tube
from tests.fill.test_bridge import ring


@pytest.fixture(scope="module")
def result():
    return fill_hole(tube(), return_report=True)[1]


@pytest.fixture(scope="module")
def scene(result):
    return fill_scene(result)


def test_the_scene_holds_the_mesh_its_patches_and_all_rims(result, scene):
    mesh, rims, patch = scene[1].layers
    np.testing.assert_array_equal(mesh.faces, result.original.faces)
    np.testing.assert_array_equal(patch.faces, result.extension.faces)
    assert len(patch.vertices) == 48 + len(result.extension.vertices)
    assert rims.edges.shape == (32, 2)
    assert scene[0].layers == [mesh, rims]


def test_the_largest_patch_is_that_of_largest_area_not_of_longest_rim():
    # the lower end squeezed to a slit and lengthened: a longer rim around less area
    vertices, faces = tube(squeeze=1.0)
    squeezed = np.where(vertices[:, 2:] == 0, vertices * [1.3, 0.05, 1.0], vertices)
    _, report = fill_hole((squeezed, faces), return_report=True)
    first, second = report.loops
    assert first.area < second.area
    assert fill_scene(report)[0].camera.direction[2] > 0.9


def test_everything_is_in_the_picture_and_patches_far_wider_than_the_mesh(scene):
    assert_shown(scene)
    bowl = bowl_below(-0.4, 2)
    _, report = fill_hole(bowl, 0, continuity="C1", return_report=True)
    assert np.ptp(report.extension.vertices[:, 0]) > 1.02 * np.ptp(bowl[0][:, 0])
    assert_shown(fill_scene(report))


def assert_shown(scene):
    camera = scene[0].camera
    right = np.cross(camera.up, camera.direction)
    offset = scene[1].layers[-1].vertices - camera.focus
    assert np.abs(offset @ right).max() <= camera.radius * (1 + 1e-12)
    assert np.abs(offset @ camera.up).max() <= camera.radius * (1 + 1e-12)


def test_a_small_hole_is_shown_close_up():
    _, report = fill_hole(ring(1.0, 10.0), return_report=True)
    assert [loop.filled for loop in report.loops] == [False, True]
    camera = fill_scene(report)[0].camera
    np.testing.assert_allclose(camera.focus, 0.0, atol=1e-12)
    assert 1.0 < camera.radius < 3.0


def test_rims_are_numbered_where_the_mesh_beside_them_is_seen():
    mesh = TriangleMesh(*tube())
    loops = boundary_loops(mesh)
    scene = loops_scene(mesh, loops)
    for point, number in (label for one in scene for label in one.labels):
        assert (loops[int(number)].points == point).all(axis=1).any()
    # the sides of the tube look away from its narrower end, so the wider is in front
    before, behind = (one.camera for one in scene)
    np.testing.assert_allclose(before.direction, -behind.direction)
    np.testing.assert_allclose(before.up, behind.up)
    ball = icosphere_without_two_faces()
    loops = boundary_loops(ball)
    assert [[number for _, number in one.labels] for one in loops_scene(ball, loops)] == [["0"], ["1"]]
    assert not any(one.labels for one in loops_scene(ball, []))


def icosphere_without_two_faces():
    """Two holes that look opposite ways."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    normals = ball.face_normals
    opposite = int(np.argmin(normals @ normals[0]))
    return TriangleMesh(ball.vertices, np.delete(ball.faces, [0, opposite], axis=0))


def test_a_whole_mesh_is_seen_from_the_side_of_its_patches():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    middles = sphere.triangles_center
    holes = [middles @ np.array(towards) > limit for towards, limit in (((0, 0, 1), 0.93), ((0, 0, -1), 0.9))]
    small = [middles @ np.array(towards) / np.sqrt(1.25) > 0.95 for towards in ((1, 0.5, 0), (1, -0.5, 0))]
    faces = sphere.faces[~np.any(holes + small, axis=0)]
    _, report = fill_hole((sphere.vertices, faces), [0, 2, 3], return_report=True)
    scene = whole_scene(report, "z", aspect=2)
    mesh, rims, patches = scene.layers
    towards = [outcome.loop.plane.normal @ scene.camera.direction for outcome in report.loops]
    assert (np.array(towards) > 0.5).tolist() == [True, False, True, True]  # those that are filled
    assert len(rims.vertices) == len(report.loops[1].loop)
    assert len(patches.faces) == len(report.extension.faces)
    seen = (mesh.vertices - scene.camera.focus) @ scene.camera.frame.T
    np.testing.assert_allclose(np.abs(seen[:, 1]).max(), scene.camera.radius, rtol=1e-9)
    closed = fill_hole(fill_hole(tube()), return_report=True)[1]
    assert whole_scene(closed, "y", aspect=1).camera.radius > 0


@given(st.integers(0, 10_000))
def test_no_direction_shows_more(seed):
    rng = np.random.default_rng(seed)
    areas = rng.normal(size=(int(rng.integers(1, 9)), 3))
    found, others = most_seen(areas), rng.normal(size=(2000, 3))
    others /= np.linalg.norm(others, axis=1)[:, None]
    assert found is not None
    shown = np.maximum(areas @ np.array([found, *others]).T, 0).sum(axis=0)
    assert shown[0] >= 0.85 * shown.max()  # a local maximum


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_views_are_orthonormal_straight_at_the_normal_and_upright(vector):
    normal = np.array(vector) / np.linalg.norm(vector)
    camera = Camera.facing(np.eye(3), normal)
    direction, up = camera.direction, camera.up
    np.testing.assert_allclose([direction @ direction, up @ up, direction @ up], [1, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(direction, normal)
    if abs(normal[1]) < 0.7:
        assert up[1] > 0.7
