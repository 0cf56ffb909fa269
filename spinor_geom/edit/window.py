"""The window of `spinor-geom edit`: draws a mesh, its rims and patches, and passes clicks and keys to the session.

This module is also the main program of the window's process.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from spinor_geom.adapters import MeshFile
from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.edit.filler import Work
from spinor_geom.edit.panel import panel
from spinor_geom.edit.pointing import plane_depth, polygons_at, rim_at, triangles_at
from spinor_geom.edit.session import Preview, Session
from spinor_geom.files import up_axis
from spinor_geom.fill.filling import Filling
from spinor_geom.isolate import Send, serve
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.camera import Camera
from spinor_geom.render.fill_scene import skin_of, used_vertices
from spinor_geom.render.png import add_faces, place, require_window
from spinor_geom.render.scene import MESH, PATCH, RIM_COLOUR, Faces
from spinor_geom.render.thinned import thinned

SIZE, PANEL = (1400, 900), 0.34  # of the window, and the panel's share of its width
COLOURS = {"film": PATCH["colour"], "smooth": "#3aa687", "open": RIM_COLOUR, "waits": "#9b3fc4", "bad": "#d62728"}
POINTED, MARKED = "#ffd400", "#e0218a"
_MOST_FACES = 100_000  # drawn as they are
_CELLS = 110  # of the grid of a coarser mesh, along its longest side. The surface has about four times the square
_STEP = 100  # milliseconds between two looks at the processes
_DRAG = 4  # pixels that the pointer moves at least in a drag
_DEPTH = 0.02  # what is hidden by less than this share of the mesh's size counts as seen
_LETTERS = 7, (8.5, 15)  # of the panel: size in points, width and height in pixels
_LINES: dict[str, Any] = {"render_lines_as_tubes": True, "lighting": False}


class Window:
    """The window. Its lengths are in units of the mesh's size, from its centre: VTK has single precision.

    Attributes:
        session: the choices.
        work: the processes that make the patches.
        pointed: the loop under the pointer, or None.
        marked: the loop that was clicked with Shift and is to be joined, or None.
    """

    def __init__(
        self,
        mesh: MeshFile,
        filling: Filling,
        output: Path,
        command: Sequence[str],
        on_saved: Send,
        *,
        off_screen: bool = False,
    ) -> None:
        """Draws the mesh.

        Args:
            mesh: the mesh, which has at least one boundary loop.
            filling: its loops.
            output: where the filled mesh is saved.
            command: the beginning of the equivalent command.
            on_saved: gets an event after each save that succeeded.
            off_screen: for tests, without a display.
        """
        import pyvista

        self._loops = filling.loops
        self.session = Session([index for index in range(len(self._loops)) if index not in filling.left_open])
        self.work = Work(self.session, mesh, filling, on_saved)
        self.pointed: int | None = None
        self.marked: int | None = None
        self._question = ""
        self._output, self._start = output, command
        used = used_vertices(filling.mesh)
        low, high = used.min(axis=0), used.max(axis=0)
        self._centre, self._size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
        self._points = self._drawn(np.concatenate([loop.points for loop in self._loops]))
        self._ends = rim_successors(tuple(map(len, self._loops)))
        self._loop_of = np.repeat(np.arange(len(self._loops)), [len(loop) for loop in self._loops])
        self._previews: list[Preview] | None = None  # that are drawn
        self._pressed = np.zeros(2)
        plotter: Any = pyvista.Plotter
        self.plotter = plotter(
            shape=(1, 2),
            col_weights=[PANEL, 1 - PANEL],
            window_size=list(SIZE),
            border=False,
            lighting="none",
            off_screen=off_screen,
            title=Path(command[2]).name,
        )
        self.plotter.disable_anti_aliasing()  # takes most of the time without a graphics card
        self.plotter.set_background("white", all_renderers=True)
        self.plotter.subplot(0, 1)
        self._renderer = self.plotter.renderer
        # the five lights of a light kit take half of the time of a frame without a graphics card
        self._renderer.add_light(pyvista.Light(light_type="headlight", intensity=0.8))
        self._add_mesh(filling.mesh, skin_of(mesh, filling.mesh))
        camera = Camera.facing(self._drawn(used), self._loops[0].plane.normal, up_axis(mesh.path))
        self._add_rims(camera.up)
        place(self.plotter, camera, self._drawn(used))
        self._listen()
        self.show()

    def _drawn(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        return np.asarray((points - self._centre) / self._size)

    def _add_mesh(self, mesh: TriangleMesh, skin: dict[str, Any]) -> None:
        vertices, faces = self._drawn(mesh.vertices), mesh.faces
        if len(faces) > _MOST_FACES:
            is_kept = np.zeros(len(vertices), dtype=bool)
            is_kept[np.concatenate([loop.vertex_ids for loop in self._loops])] = True
            step = float(np.ptp(self._drawn(used_vertices(mesh)), axis=0).max()) / _CELLS
            vertices, faces, places, kept = thinned(vertices, faces, is_kept, step)
            if "image" in skin:
                skin = {**skin, "skin": skin["skin"].reshape(-1, 3, 2)[kept].reshape(-1, 2)}
            elif skin:
                skin = {"skin": skin["skin"][places]}
        add_faces(self.plotter, Faces(vertices=vertices, faces=faces, **skin, **MESH), {}, with_bar=False)

    def _add_rims(self, up: Float[np.ndarray, "3"]) -> None:
        import pyvista

        count = len(self._points)
        cells = np.stack([np.full(count, 2), np.arange(count), self._ends], axis=1)
        self._rims: Any = pyvista.PolyData(self._points, lines=cells.ravel())
        self._rims.cell_data["colour"] = np.zeros((count, 3), dtype=np.uint8)
        self.plotter.add_mesh(self._rims, scalars="colour", rgb=True, line_width=4, **_LINES)
        tops = [self._drawn(loop.points[np.argmax(loop.points @ up)]) for loop in self._loops]
        names = [f"{index}  ({loop.diagonal:.2g})" for index, loop in enumerate(self._loops)]
        box = {"shape_color": "white", "shape_opacity": 0.7, "show_points": False, "always_visible": False}
        look = {"font_size": 14, "text_color": "black", "tolerance": _DEPTH}
        self.plotter.add_point_labels(np.array(tops), names, **box, **look)

    def _listen(self) -> None:
        events = {
            "MouseMoveEvent": self._move,
            "LeftButtonPressEvent": self._press,
            "LeftButtonReleaseEvent": self._release,
            "TimerEvent": self.step,
        }
        for name, act in events.items():
            self.plotter.iren.add_observer(name, lambda *_, act=act: act())
        # instead of VTK's own keys, such as e for exit
        self.plotter.iren.interactor.GetInteractorStyle().AddObserver("CharEvent", lambda *_: self._type())

    def open(self) -> None:
        """Shows the window until it is closed."""
        self.plotter.iren.initialize()
        self.plotter.iren.create_timer(_STEP)
        try:
            self.plotter.show()
        finally:
            self.work.close()

    def step(self) -> None:
        """Takes what the processes have done, and shows it."""
        self._is_old |= self.work.step() or any(filler.job is not None for filler in self.work.fillers)
        if self._is_old and monotonic() > self._next:
            self.show()

    def _move(self) -> None:
        if self.plotter.iren.interactor.GetInteractorStyle().GetState() != 0:  # the mesh is turned
            return
        pointed = self.loop_at(*self.plotter.iren.get_event_position())
        if pointed != self.pointed:
            self.pointed = pointed
            self.show()

    def _press(self) -> None:
        self._pressed = np.array(self.plotter.iren.get_event_position())

    def _release(self) -> None:
        here = np.array(self.plotter.iren.get_event_position())
        index = self.loop_at(*here.tolist())
        if np.abs(here - self._pressed).max() >= _DRAG or index is None:
            return
        marked, self.marked, self.work.message, self._question = self.marked, None, "", ""
        if not self.plotter.iren.interactor.GetShiftKey():
            self.session.click(index)
        elif marked is None:
            self.marked, self.work.message = index, f"loop {index} is to be joined: click another rim with Shift"
        else:
            self.session.join(marked, index)
        self.work.step()
        self.show()

    def _type(self) -> None:
        key = self.plotter.iren.interactor.GetKeyCode()
        is_sure = self._question == key
        actions: dict[str, Callable[[], None]] = {
            "a": self.session.click_all,
            "u": self.session.undo,
            "c": self.work.cancel,
            "s": lambda: self._save(is_sure),
            "q": lambda: self._quit(is_sure),
        }
        if key in actions:
            self.marked, self.work.message, self._question = None, "", ""
            actions[key]()
            self.work.step()
            self.show()

    def _save(self, is_sure: bool) -> None:
        if not self.session.choices:
            self.work.message = "nothing to save: no loop is chosen"
        elif self.work.is_saving:
            self.work.message = "the mesh is being saved; c cancels it"
        elif self._output.exists() and not is_sure:
            self.work.message, self._question = f"{self._output} exists; press s again to replace it", "s"
        else:
            self.work.save(self._output, self.session.command(self._start))

    def _quit(self, is_sure: bool) -> None:
        if self.session.choices not in ({}, self.work.saved) and not is_sure:
            how = "not saved yet" if self.work.is_saving else "not saved; s saves them"
            self.work.message, self._question = f"the patches are {how}; press q again to quit", "q"
        else:
            self.plotter.iren.terminate_app()

    def loop_at(self, x: int, y: int) -> int | None:
        """The visible loop whose rim, patch or opening is at a pixel, counted from the lower left. None without one."""
        if not self._renderer.IsInViewport(x, y):
            return None
        near, far = self._renderer.camera.clipping_range
        here, seen, slack = np.array([x, y], dtype=np.float64), self._depth(x, y), _DEPTH / (far - near)
        begins = self._pixels(self._points)
        ends = begins[self._ends]
        if (segment := rim_at(here, begins, ends, lambda x, y: self._depth(x, y) + slack)) is not None:
            return int(self._loop_of[segment])
        corners = self._pixels(self._patch_corners)
        for face in triangles_at(here, corners).tolist():
            if abs(corners[face, :, 2].mean() - seen) <= slack:
                return int(self._patch_loops[face])
        openings = polygons_at(here, begins, ends, self._loop_of).tolist()
        depths = {index: plane_depth(here, begins[self._loop_of == index]) for index in openings}
        # what is seen through an opening is behind it
        limit = min((*depths.values(), seen - 2 * slack)) + slack
        return max((index for index, depth in depths.items() if depth <= limit), default=None)

    def _pixels(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Positions in the picture, in pixels from its lower left, and depths from 0 to 1."""
        renderer = self._renderer
        matrix = renderer.camera.GetCompositeProjectionTransformMatrix(renderer.GetTiledAspectRatio(), 0, 1)
        rows = np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(3)])
        found = points @ rows[:, :3].T + rows[:, 3]  # of a parallel projection
        found[..., :2] = renderer.GetOrigin() + (found[..., :2] + 1) / 2 * renderer.GetSize()
        return np.asarray(found)

    def _depth(self, x: float, y: float) -> float:
        """The depth of what is seen at a pixel, from 0 to 1."""
        return float(self._renderer.GetZ(round(x), round(y)))

    def show(self) -> None:
        """Draws the state of the session."""
        previews = self.session.previews()
        begin = monotonic()
        self.plotter.suppress_rendering = True
        states = ["open"] * len(self._loops)
        for loops, (preview, is_current) in previews.items():
            is_bad = preview is not None and (preview.patch is None or preview.intersections != 0)
            for index in loops:
                states[index] = "waits" if not is_current else "bad" if is_bad else self.session.choices[loops]
        self.plotter.subplot(0, 1)
        self._rims.cell_data["colour"] = _rgb([COLOURS[state] for state in states])[self._loop_of]
        self._show_patches([preview for preview, _ in previews.values() if preview is not None])
        for name, shown, colour in (("pointed", self.pointed, POINTED), ("marked", self.marked, MARKED)):
            self.plotter.remove_actor(name)
            if shown is not None:
                line = self._rims.extract_cells(self._loop_of == shown)
                self.plotter.add_mesh(line, name=name, color=colour, line_width=7, **_LINES)
        points, (width, height) = _LETTERS
        text = panel(
            self.session,
            self.work,
            self._loops,
            pointed=self.pointed,
            command=self.session.command(self._start),
            size=(int(PANEL * self.plotter.window_size[0] / width) - 3, int(self.plotter.window_size[1] / height) - 1),
        )
        self.plotter.subplot(0, 0)
        look = {"font": "courier", "color": "black", "name": "panel", "position": (0.03, 0.985)}
        # VTK reads | as the end of a column, and $ as that of a formula
        text = text.replace("|", "\\|").replace("$", "\\$")
        words = self.plotter.add_text(text, viewport=True, font_size=points, **look)
        words.prop.SetVerticalJustificationToTop()
        self.plotter.subplot(0, 1)
        self.plotter.suppress_rendering = False
        self.plotter.render()
        # half of the time is left to the mouse
        self._is_old, self._next = False, 2 * monotonic() - begin

    def _show_patches(self, previews: list[Preview]) -> None:
        if previews == self._previews:
            return
        self._previews = previews
        vertices, faces, colours, loops = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], [], []
        for preview in previews:
            if preview.patch is not None:
                patch = preview.patch.patch
                faces.append(sum(map(len, vertices)) + patch.faces)
                vertices.append(patch.vertices)
                colours += [COLOURS[preview.chosen]] * len(patch.vertices)
                loops += [preview.loops[0]] * len(patch.faces)
        points, corners = self._drawn(np.concatenate(vertices)), np.concatenate(faces)
        self._patch_corners, self._patch_loops = points[corners], list[int](loops)
        self.plotter.remove_actor("patches")
        if loops:
            layer = Faces(vertices=points, faces=corners, skin=_rgb(colours) / 255)
            add_faces(self.plotter, layer, {}, with_bar=False, name="patches")


def _rgb(colours: Sequence[str]) -> UInt8[np.ndarray, "n 3"]:
    return np.array([tuple(bytes.fromhex(colour[1:])) for colour in colours], dtype=np.uint8)


def work(job: dict[str, str], send: Send) -> None:
    """Shows the window, and sends an event after each save."""
    mesh, filling, output, command = pickle.loads(Path(job["arguments"]).read_bytes())
    window = Window(mesh, filling, output, command, send)
    require_window(window.plotter)
    window.open()


if __name__ == "__main__":
    serve(work)
