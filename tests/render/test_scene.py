"""What a picture shows: camera, rims, patches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.result import FillResult
from spinor_geom.render.scene import FillScene, fill_scene, tilted, whole_mesh
from tests.fill.shapes import tube


@pytest.fixture(scope="module")
def result() -> FillResult:
    return fill_hole(tube(), return_report=True)[1]


@pytest.fixture(scope="module")
def scene(result: FillResult) -> FillScene:
    return fill_scene(result)


def test_the_scene_holds_the_mesh_its_patches_and_all_rims(result: FillResult, scene: FillScene) -> None:
    np.testing.assert_array_equal(scene.faces, result.original.faces)
    np.testing.assert_array_equal(scene.patch_faces, result.extension.faces)
    assert len(scene.vertices) == 48 + len(result.extension.vertices)
    assert scene.rim_edges.shape == (32, 2)


def test_the_camera_looks_at_the_largest_hole_from_outside(scene: FillScene) -> None:
    # the larger hole of the tube looks down
    assert scene.camera.direction[2] < -0.7


def test_everything_is_in_the_picture(scene: FillScene) -> None:
    camera = scene.camera
    right = np.cross(camera.up, camera.direction)
    offset = scene.vertices - camera.focus
    assert np.abs(offset @ right).max() <= camera.radius * (1 + 1e-12)
    assert np.abs(offset @ camera.up).max() <= camera.radius * (1 + 1e-12)


def test_a_small_hole_is_shown_close_up() -> None:
    vertices, faces = tube(16, 3)
    long_tube = np.where(vertices[:, 2:] > 0, vertices * [1.0, 1.0, 30.0], vertices)
    camera = fill_scene(fill_hole((long_tube, faces), return_report=True)[1]).camera
    np.testing.assert_allclose(camera.focus, 0.0, atol=1e-12)
    assert camera.radius < 3.0


def test_where_nothing_was_filled_the_longest_open_loop_is_shown() -> None:
    _, report = fill_hole(tube(), [], return_report=True)
    scene = fill_scene(report)
    assert len(scene.patch_faces) == 0
    assert scene.camera.direction[2] < -0.7


def test_a_closed_mesh_has_a_scene() -> None:
    _, report = fill_hole(fill_hole(tube()), return_report=True)
    assert fill_scene(report).rim_edges.shape == (0, 2)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_view_directions_are_orthonormal_and_on_the_normal_s_side(vector: tuple[float, float, float]) -> None:
    normal = np.array(vector) / np.linalg.norm(vector)
    direction, up = tilted(normal)
    np.testing.assert_allclose([direction @ direction, up @ up, direction @ up], [1, 1, 0], atol=1e-12)
    assert direction @ normal > 0.5


def test_the_whole_mesh_fits_exactly() -> None:
    box = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 1.0]])
    camera = whole_mesh(box, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(camera.focus, [2.0, 1.0, 0.5])
    assert camera.radius == 2.0
