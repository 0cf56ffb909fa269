"""The window, drawn without a display, and events of VTK's interactor: what is coloured where, and what is saved."""

import os
import shlex
import shutil
import signal
import subprocess
from time import sleep
from typing import Any

import numpy as np
import pytest

from spinor_geom import fill_hole, read_mesh
from spinor_geom.cli.main import main
from spinor_geom.edit import window as window_module
from spinor_geom.edit.window import COLOURS, POINTED, Window
from spinor_geom.render.png import require_window
from tests.edit.meshes import ball, prepared
from tests.fill.shapes import obj_text

pytest.importorskip("pyvista")
_CYCLES = 3000  # of 0.02 s, until the processes must have done their work


class Person:
    """Points at loops, presses keys, and looks at the picture."""

    def __init__(self, folder, mesh, *, off_screen=True):
        self.path, self.filling = folder / "ball.obj", prepared(mesh)
        self.path.write_text(obj_text(*mesh))
        self.output, self.saved = folder / "out.ply", list[dict[str, Any]]()
        command = ["spinor-geom", "fill", str(self.path), "-o", str(self.output)]
        given = read_mesh(self.path), self.filling, self.output, command, self.saved.append
        self.window = Window(*given, off_screen=off_screen)
        self.window.plotter.show(auto_close=False, interactive_update=True)
        self.events = self.window.plotter.iren

    def wait(self):
        """Until everything that is chosen is computed and saved, and shown."""
        for _ in range(_CYCLES):
            self.window.step()
            work, previews = self.window.work, self.window.session.previews().values()
            if all(filler.job is None for filler in work.fillers) and all(is_current for _, is_current in previews):
                self.window.show()
                return
            sleep(0.02)
        raise AssertionError("the processes did not finish")

    def place(self, index, *, on_rim=False):
        """The pixel of a hole's centre, or of a point of its rim."""
        loop = self.filling.loops[index]
        point = loop.points[0] if on_rim else loop.centroid
        x, y, _ = self.window._pixels(self.window._drawn(point)).tolist()
        return round(x), round(y)

    def click(self, index, *, shift=False, on_rim=False):
        """Clicks a hole."""
        self.events.interactor.SetShiftKey(int(shift))
        self.events._mouse_left_button_click(*self.place(index, on_rim=on_rim))
        self.events.interactor.SetShiftKey(0)

    def press(self, keys):
        """Presses keys, one after the other."""
        for key in keys:
            self.events._simulate_keypress(key)

    def colour(self, x, y):
        """The red, green and blue around a pixel, from 0 to 1, the mean of a few pixels."""
        image = np.asarray(self.window.plotter.screenshot(return_img=True))[::-1] / 255
        return np.asarray(image[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1)))

    def sees(self, x, y, colour):
        """Whether a pixel has the hue of a colour, whatever its brightness."""
        seen, wanted = self.colour(x, y), np.array(list(bytes.fromhex(colour[1:]))) / 255
        seen, wanted = (own - own.mean() for own in (seen, wanted))
        return bool(seen @ wanted > 0.9 * np.linalg.norm(seen) * np.linalg.norm(wanted) and np.linalg.norm(seen) > 0.1)


@pytest.fixture(params=[0.0])
def person(request, tmp_path, monkeypatch):
    if not os.environ.get("DISPLAY"):
        monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    monkeypatch.setattr(window_module, "SIZE", (800, 500))  # is drawn in a third of the time
    made = Person(tmp_path, ball(request.param))
    yield made
    made.window.work.close()
    made.window.plotter.close()


def test_holes_are_pointed_at_and_get_films_and_smooth_patches(person):
    window = person.window
    # openings and rims, not those behind the mesh, and nothing beside it
    assert [window.loop_at(*person.place(k)) for k in range(4)] == [0, 1, 2, None]
    assert [window.loop_at(*person.place(k, on_rim=True)) for k in range(4)] == [0, 1, 2, None]
    width, height = window.plotter.window_size
    assert window.loop_at(width - 5, 5) is None
    assert window.loop_at(10, height // 2) is None
    # the rim under the pointer lights up
    rim = person.place(1, on_rim=True)
    assert person.sees(*rim, COLOURS["open"])
    person.events._mouse_move(*person.place(1))
    assert window.pointed == 1
    assert person.sees(*rim, POINTED)
    person.events._mouse_move(width - 5, 5)
    assert window.pointed is None
    assert person.sees(*rim, COLOURS["open"])
    # clicks: film, smooth, open. The patch can be clicked, too
    person.click(0)
    person.click(1, on_rim=True)
    person.wait()
    assert person.sees(*person.place(0), COLOURS["film"])
    assert person.sees(*person.place(1), COLOURS["film"])
    assert not person.sees(*person.place(2), COLOURS["film"])
    person.click(1)
    person.wait()
    assert person.sees(*person.place(0), COLOURS["film"])
    assert person.sees(*person.place(1), COLOURS["smooth"])
    person.click(1)
    person.wait()
    assert window.session.choices == {(0,): "film"}
    assert not person.sees(*person.place(1), COLOURS["smooth"])
    # turning the mesh is no click
    x, y = person.place(0)
    person.events._mouse_left_button_press(x, y)
    person.events._mouse_left_button_release(x + 40, y)
    assert window.session.choices == {(0,): "film"}
    assert window.loop_at(*person.place(0)) == 0  # where it is now
    person.press("u")
    assert window.session.choices == {(0,): "film", (1,): "smooth"}


def test_what_is_saved_is_what_the_command_makes(person, capsys):
    window = person.window
    person.press("s")
    assert "nothing to save" in window.work.message
    person.press("aa")
    person.click(0)
    person.click(0)
    person.wait()
    assert window.session.choices == {(0,): "film", **{(k,): "smooth" for k in (1, 2, 3)}}
    person.press("q")
    assert "q again" in window.work.message
    person.press("s")
    person.wait()
    assert "watertight" in window.work.message
    (event,) = person.saved
    assert event["command"] == f"spinor-geom fill {person.path} -o {person.output} --film 0 --smooth 1-3"
    written = person.output.read_bytes()
    # an existing file is replaced only if s is pressed again
    person.output.write_text("mine")
    person.press("s")
    assert "press s again" in window.work.message
    person.press("us")
    assert "press s again" in window.work.message
    person.wait()
    assert person.output.read_text() == "mine"
    person.press("s")
    person.wait()
    assert person.output.read_bytes() != written
    person.click(0)
    person.press("ss")
    person.wait()
    assert main(shlex.split(person.saved[0]["command"])[1:]) == 0
    assert person.output.read_bytes() == written
    # the patches that were shown
    report = fill_hole(person.path, **window.session.options, return_report=True)[1]
    for loops, (preview, _) in window.session.previews().items():
        patch = report.loops[loops[0]].patch
        np.testing.assert_array_equal(preview.patch.patch.vertices, patch.vertices)


def test_a_process_that_dies_and_a_cancelled_one_leave_the_loop_open(person):
    window = person.window
    person.wait()
    person.click(0)
    person.press("c")
    assert window.session.choices == {}
    person.press("u")
    person.wait()
    assert person.sees(*person.place(0), COLOURS["film"])
    person.output.mkdir()
    window.work.save(person.output, "")
    person.wait()
    assert "not saved" in window.work.message
    assert person.saved == []
    running = [filler._process._process for filler in window.work.fillers if filler._process._process is not None]
    for process in running:
        process.send_signal(signal.SIGSTOP)
    person.click(1)
    for process in running:
        process.kill()
    person.wait()
    preview, _ = window.session.previews()[(1,)]
    assert preview.patch is None
    assert "SIGKILL" in preview.sentences[0]
    # a window that is closed during a fill
    person.click(2)
    processes = [filler._process._process for filler in window.work.fillers]
    window.open()
    assert all(process is None or process.poll() is not None for process in processes)


@pytest.fixture
def display(monkeypatch):
    """An X server of its own, on which VTK opens windows. It keeps its state when its last window is closed."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp", "-noreset"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        monkeypatch.setenv("DISPLAY", f":{server.stdout.readline().strip()}")
        monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkXOpenGLRenderWindow")
        yield
        server.terminate()


def test_holes_are_clicked_on_a_display(display, tmp_path, monkeypatch):
    monkeypatch.setattr(window_module, "SIZE", (800, 500))
    person = Person(tmp_path, ball(), off_screen=False)
    try:
        require_window(person.window.plotter)
        rim = person.place(2, on_rim=True)
        assert person.sees(*rim, COLOURS["open"])
        person.events._mouse_move(*person.place(2))
        assert person.sees(*rim, POINTED)
        person.click(0)
        person.click(1)
        person.click(1)
        person.wait()
        seen = {name: [person.sees(*person.place(k), COLOURS[name]) for k in range(3)] for name in ("film", "smooth")}
        assert seen == {"film": [True, False, False], "smooth": [False, True, False]}
        person.press("s")
        person.wait()
        (event,) = person.saved
        assert event["command"].endswith("--film 0 --smooth 1")
    finally:
        person.window.work.close()
        person.window.plotter.close()
