"""The PNG: the patch is in its colour, on the right only; clear errors where it cannot be drawn."""

import numpy as np
import pytest

from spinor_geom.cli.main import main
from spinor_geom.errors import RenderError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.render import png
from spinor_geom.render.fill_scene import fill_scene
from tests.fill.shapes import tube
from tests.systems import signals


@pytest.fixture(scope="module")
def scene():
    return fill_scene(fill_hole(tube(), return_report=True)[1])


def pixels(path):
    """(height, width, 3) of a PNG, top row first."""
    import pyvista

    image = pyvista.read(path)
    width, height, _ = image.dimensions
    return np.asarray(image.active_scalars).reshape(height, width, -1)[::-1, :, :3].astype(int)


def test_the_patch_is_orange_and_only_on_the_right(scene, tmp_path):
    path = tmp_path / "picture.png"
    png.write_png(scene, path)
    image = pixels(path)
    assert image.shape == (*png.SIZE[::-1], 3)
    red, green, blue = np.moveaxis(image, -1, 0)
    orange = (red > 1.4 * green) & (green > 1.4 * blue) & (red > 120)
    left, right = np.split(orange, 2, axis=1)
    assert right.mean() > 0.05
    assert left.mean() < 0.001
    white = (image == 255).all(axis=-1)
    assert 0.2 < white.mean() < 0.9
    assert [item.name for item in tmp_path.iterdir()] == ["picture.png"]


SKINS = {"texture": "v {0} {1} {2}\n", "colours": "v {0} {1} {2} 0 0.8 0\n"}


def green_tube(folder, skin):
    """A file of a green tube: by a texture whose lower half is red, with a seam in each edge, or by colours."""
    from PIL import Image

    vertices, faces = tube()
    image = np.full((8, 8, 3), (255, 0, 0), dtype=np.uint8)
    image[:4] = (0, 200, 0)  # the upper half
    Image.fromarray(image).save(folder / "skin.png")
    (folder / "skin.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    lines = [SKINS[skin].format(*row) for row in vertices.tolist()]
    lines += ["vt 0.1 0.9\n", "vt 0.9 0.9\n", "vt 0.9 0.6\n"] * (skin == "texture")
    marks = ("/1", "/2", "/3") if skin == "texture" else ("", "", "")
    lines += ["f " + " ".join(f"{v + 1}{mark}" for v, mark in zip(face, marks, strict=True)) + "\n" for face in faces]
    (folder / "tube.obj").write_text("mtllib skin.mtl\n" + "".join(lines))
    return folder / "tube.obj"


@pytest.mark.usefixtures("drawn_by_one_process")
def test_pictures_show_the_colours_of_the_mesh(tmp_path):
    source, picture = green_tube(tmp_path, "texture"), tmp_path / "picture.png"
    commands = (["fill", str(source), "-o", str(tmp_path / "o.obj"), "--picture"], ["render", str(source), "-o"])
    for command in (*commands, ["loops", str(source), "--picture"]):
        assert main([*command, str(picture)]) == 0
        red, green, blue = np.moveaxis(pixels(picture), -1, 0)
        assert ((green > 2 * red) & (green > 2 * blue)).mean() > 0.04, command
        assert ((red > 2 * green) & (red > 150) & (blue < 30)).mean() < 1e-4, command


# what a process does that is to draw
DRAWING = "import {}; from spinor_geom.isolate import serve; serve(lambda *_: exec({!r}))"


@pytest.mark.parametrize(
    ("imported", "done", "words"),
    [
        ("os", "print('WARN| libOSMesa not found'); os.abort()", "no usable OpenGL library"),
        ("os", "raise ImportError('libGL.so.1: cannot open shared object file')", "no usable OpenGL library"),
        ("os", "raise MemoryError('out of memory')", "MemoryError: out of memory"),
        ("os", "os._exit(1)", "status 1"),
        pytest.param(*("os", "os.kill(os.getpid(), 9)", "the drawing process was killed"), marks=signals),
        ("time", "time.sleep(100)", "took longer than 0.5 s"),
    ],
)
def test_a_failed_drawing_is_a_typed_error_and_leaves_no_file(scene, tmp_path, monkeypatch, imported, done, words):
    (tmp_path / "instead_of_drawing.py").write_text(DRAWING.format(imported, done))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(png, "DRAWING", "instead_of_drawing")
    monkeypatch.setattr(png, "TIME_LIMIT", 0.5 - png.TIME_OF_FRAME if imported == "time" else 60.0)
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(RenderError, match=words):
        png.write_png(scene, folder / "picture.png")
    assert not list(folder.iterdir())
