"""`view` and `render`: pictures of files, and the messages if none can be made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import spinor_geom
from spinor_geom import fill_hole, gallery, read_mesh, solve_plateau
from spinor_geom.adapters.open_cascade import read_shape, triangulated
from spinor_geom.cli import pictures
from spinor_geom.cli.main import main
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.camera import Camera
from spinor_geom.render.fill_scene import fill_scene, loops_scene, up_of
from spinor_geom.render.portrait import Portrait
from tests.fill.shapes import circle

pytestmark = pytest.mark.usefixtures("drawn_by_one_process")
MESH = Path(__file__).parents[2] / "data" / "trimesh_reference.obj"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("surface") / "enneper.safetensors"
    spinor_geom.solve_plateau(gallery.enneper(0.8).rim(48)).surface.save(path)
    return path


def test_a_mesh_and_a_surface_are_drawn_on_white_with_their_boundaries(saved, tmp_path):
    for source, options in ((MESH, []), (saved, ["--curvature"])):
        target = tmp_path / "new" / f"{source.stem}.png"
        assert main(["render", str(source), "-o", str(target), "--size", "300x240", *options]) == 0
        image = np.asarray(Image.open(target).convert("RGB")).astype(int)
        assert image.shape == (240, 300, 3)
        assert (image[[0, -1]] > 250).all()
        assert 0.1 < (image.min(axis=-1) < 230).mean() < 0.9
        red, _, blue = np.moveaxis(image, -1, 0)
        assert (blue > red + 40).mean() > 0.001  # the rim
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 200  # shaded


def test_the_eye_and_the_upright_axis_are_chosen(tmp_path, monkeypatch):
    seen: list[Any] = []
    # what would be drawn is looked at: to draw it takes a process
    monkeypatch.setattr(Portrait, "write", lambda self, _, *, eye, size: seen.append((self.layers[0], eye, size)))
    for options in (["--eye", "0,-1,0"], ["--eye=-1,-1,0"], ["--eye", "0,-1,0", "--up", "z"]):
        assert main(["render", str(MESH), "-o", str(tmp_path / "p.png"), "--size", "120x90", *options]) == 0
    lying, _, upright = (layer.vertices for layer, _, _ in seen)
    np.testing.assert_array_equal(lying, upright @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert [(eye, size) for _, eye, size in seen] == [(eye, (120, 90)) for eye in ((0, -1, 0), (-1, -1, 0), (0, -1, 0))]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", str(MESH), "-o", "picture.jpg"], "a picture is written as .png"),
        (["render", "missing.obj", "-o", "picture.png"], "missing.obj: cannot be read"),
        (["render", "missing.safetensors", "-o", "picture.png"], "missing.safetensors cannot be read"),
        (["render", str(MESH), "-o", "."], "a picture is written as .png"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_view_without_a_display_advises(monkeypatch, capsys):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(MESH)]) == 2
    error = capsys.readouterr().err
    assert "spinor-geom render IN -o out.png" in error
    assert len(error.splitlines()) == 1


def test_a_window_gets_mesh_rims_and_curvature(saved, tmp_path, monkeypatch):
    shown: list[tuple[Any, ...]] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(pictures, "draw_apart", lambda *job, time_limit: shown.append(job))
    assert main(["view", str(saved), "--curvature"]) == 0
    mesh, rims = shown[0][0][0].layers
    assert shown[0][0][0].title == "enneper.safetensors"
    ((name, values),) = mesh.fields.items()
    assert "gauss curvature" in name
    assert len(values) == len(mesh.vertices)
    assert len(rims.edges) > 40
    assert main(["view", str(MESH)]) == 0
    assert not shown[1][0][0].layers[0].fields


def test_the_upward_axis_is_that_of_the_format_in_all_commands(tmp_path, monkeypatch):
    shown: list[Any] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(pictures, "draw_apart", lambda *job, time_limit: shown.append(job[0][0].layers[0].vertices))
    monkeypatch.setattr(Portrait, "write", lambda self, _, *, eye, size: shown.append(self.layers[0].vertices))
    mesh = read_mesh(MESH)
    for suffix, is_turned in ((".ply", True), (".stl", False), (".3mf", False), (".glb", True)):
        path = tmp_path / f"mesh{suffix}"
        mesh.write(path)
        shown.clear()
        assert main(["view", str(path)]) == 0
        assert main(["render", str(path), "-o", str(tmp_path / "p.png")]) == 0
        np.testing.assert_array_equal(*shown)
        assert np.array_equal(shown[0], read_mesh(path).mesh.vertices) is not is_turned
        up = np.array([0, 1, 0] if is_turned else [0, 0, 1])
        _, report = fill_hole(path, [], return_report=True)
        for scene in (fill_scene(report)[0], loops_scene(report.original, [], up=up_of(report))[0]):
            assert scene.camera.up @ up >= 0
            side = np.array([1.0, 0.0, 0.0])
            assert Camera.facing(mesh.mesh.vertices, side, up_of(report)).up @ up == 1


def test_a_cad_file_is_drawn(tmp_path, capsys):
    pytest.importorskip("OCP")
    film = solve_plateau(circle(40, bend=0.3))
    path = tmp_path / "film.step"
    film.save(path)
    mesh = TriangleMesh(*triangulated(read_shape(path))).merged("rounding")[0]
    assert len(boundary_edges(mesh.faces)) > 20
    assert face_areas(mesh.vertices, mesh.faces).sum() == pytest.approx(film.area, rel=1e-2)
    assert main(["render", str(path), "-o", str(tmp_path / "film.png"), "--size", "120x90"]) == 0
    assert (tmp_path / "film.png").stat().st_size > 500
    assert main(["render", "none.step", "-o", str(tmp_path / "film.png")]) == 2
    assert "no such file" in capsys.readouterr().err
