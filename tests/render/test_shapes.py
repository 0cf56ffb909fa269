"""Surfaces and meshes as objects of other libraries, as glTF, and in a notebook."""

import html
import json

import numpy as np
import pytest
import trimesh

import spinor_geom
from spinor_geom import fill_hole, gallery
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render import shapes
from spinor_geom.render.scene import VIRIDIS
from tests.browser import visit
from tests.fill.shapes import tube
from tests.render.test_viewer import data_of


@pytest.fixture(scope="module")
def enneper():
    return spinor_geom.solve_plateau(gallery.enneper(0.8).rim(48))


@pytest.fixture(scope="module")
def filled():
    return spinor_geom.fill_hole(TriangleMesh(*tube()), return_report=True)[1]


def sphere():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    arrays = np.asarray(ball.vertices), np.asarray(ball.faces)
    return TriangleMesh(*arrays, vertex_attributes={"heat": ball.vertices[:, :1]})


def test_a_surface_as_pyvista_has_the_exact_curvature_at_its_vertices(enneper):
    mesh = enneper.surface.to_pyvista()
    assert 2000 < mesh.n_points < 8000
    assert mesh.area == pytest.approx(enneper.area, rel=1e-3)
    # Enneper's surface: K = −4/(1 + |z|²)⁴, so −4 in the middle, the least of all
    assert mesh.point_data["gauss_curvature"].min() == pytest.approx(-4, rel=1e-2)
    np.testing.assert_allclose(np.linalg.norm(mesh.point_data["normal"], axis=1), 1, rtol=1e-12)
    # the faces run about the normals
    mesh = mesh.compute_normals(point_normals=False, consistent_normals=False, auto_orient_normals=False)
    corner = np.asarray(mesh.regular_faces)[:, 0]
    assert (np.sum(mesh.cell_data["Normals"] * mesh.point_data["normal"][corner], axis=1) > 0.9).all()


def test_a_mesh_as_pyvista_has_mean_curvature_and_its_own_attributes():
    mesh = sphere().to_pyvista()
    np.testing.assert_allclose(mesh.point_data["mean_curvature"], 0.5, rtol=0.05)
    np.testing.assert_array_equal(np.ravel(mesh.point_data["heat"]), sphere().vertices[:, 0])


def test_trimesh_has_the_same_vertices_and_faces(enneper):
    patch = spinor_geom.mesh_patch(enneper)
    made = patch.to_trimesh()
    np.testing.assert_array_equal(made.vertices, patch.vertices)
    np.testing.assert_array_equal(made.faces, patch.faces)
    np.testing.assert_allclose(enneper.to_trimesh().vertex_normals, enneper.surface.normal(patch.points), atol=1e-9)


def test_gltf_has_curvature_as_colours(enneper, tmp_path):
    enneper.to_gltf(tmp_path / "enneper.glb")
    patch = spinor_geom.mesh_patch(enneper)
    (read,) = trimesh.load(tmp_path / "enneper.glb").geometry.values()
    np.testing.assert_allclose(read.vertices, patch.vertices, atol=1e-6)
    np.testing.assert_allclose(read.visual.vertex_colors[:, 3], 255)
    # from violet in the middle, where K is least, to yellow at the rim; linear in the file
    curvature = enneper.surface.gauss_curvature(patch.points)
    srgb = 255 * (read.visual.vertex_colors[:, :3] / 255.0) ** (1 / 2.2)
    for at, stop in ((curvature.argmin(), VIRIDIS[0]), (curvature.argmax(), VIRIDIS[-1])):
        wanted = [int(stop[k : k + 2], 16) for k in (1, 3, 5)]
        np.testing.assert_allclose(srgb[at], wanted, atol=20)


@pytest.mark.slow
def test_what_a_notebook_shows_is_a_page_of_its_own_and_drawn(enneper, filled, chromium, tmp_path):
    shown = {"surface": enneper.surface, "fill": filled}
    frames = {name: one._repr_html_() for name, one in shown.items()}
    for other in (enneper, filled.original):
        assert f'title="{type(other).__name__}' in other._repr_html_()
    page = tmp_path / "notebook.html"
    page.write_text("<!doctype html><meta charset=utf-8>" + "".join(frames.values()), encoding="utf-8")
    with visit(chromium, page.as_uri()) as opened:
        for number, (frame, name) in enumerate(zip(opened.page.frames[1:], shown, strict=True)):
            opened.page.locator("iframe").nth(number).scroll_into_view_if_needed()
            frame.wait_for_function("document.title.startsWith('ready: ')", timeout=60_000)
            assert type(shown[name]).__name__ in frame.title()
            box = frame.locator("canvas").bounding_box()
            assert box["width"] > 300
            drawn = frame.wait_for_function(
                """() => { const canvas = document.querySelector("canvas");
                const seen = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
                return new Set(new Uint32Array(seen.buffer)).size > 1; }""",  # colours. A plane patch has one
                timeout=10_000,
            )
            assert drawn.json_value()
        assert opened.errors == []
        assert opened.foreign == []


def test_a_fill_is_shown_with_its_patches_and_a_table_of_its_loops():
    _, report = fill_hole(tube(), return_report=True)
    frame = report._repr_html_()
    assert '"#f28e2b"' in json.dumps(data_of(html.unescape(frame)))  # the colour of patches
    assert len(frame) < 300_000  # the program, which is compressed, has 600,000
    shape = shapes.shape_of(report)
    assert np.flatnonzero(shape.is_new)[0] == len(report.original.faces)
    assert [text for _, text in shape.labels] == ["0", "1"]
    expected = [(str(k), str(len(o.loop)), "minimal") for k, o in enumerate(report.loops)]
    assert [row[:3] for row in shape.loops[1:]] == expected
