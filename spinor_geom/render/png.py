"""Draws scenes as PNGs, without a display: in a process of its own, which is the main program of this module."""

import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.errors import RenderError, require
from spinor_geom.files import atomic_path
from spinor_geom.isolate import FaultError, Process, serve
from spinor_geom.render.layers import Camera, Faces, Lines, View, turned

WIDTH, HEIGHT = 1600, 800
TIME_LIMIT = 300.0  # seconds; software rendering of a million triangles takes a few
TIME_OF_FRAME = 5.0  # seconds that each frame may take besides
DRAWING, WINDOW = "spinor_geom.render.png", "VTK_DEFAULT_OPENGL_WINDOW"  # a module, and a variable of what it uses
COLOURS, LABEL_SIZE, TUBE_SIDES, MARGIN = "viridis", 14, 10, 1.06
_THICKNESS = 1 / 250  # radius of a line of one pixel, per half the height of what is shown
# direction to the light in the camera's frame (right, up, to the eye), and its strength: all from before the picture
LIGHTS = (((-0.5, 0.7, 0.8), 0.55), ((0.9, 0.1, 0.6), 0.25), ((0.1, -0.7, 0.7), 0.2), ((0.0, 0.0, 1.0), 0.2))
LOOK = {"ambient": 0.38, "diffuse": 0.72, "specular": 0.18, "specular_power": 25}
_KEYS = "w wireframe, s surface, r reset, q quit"
_WITHOUT_WINDOW = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def write_png(views: Sequence[View], path: str | os.PathLike[str], *, size: tuple[int, int] | None = None) -> None:
    """Draws views off-screen, side by side, as `drawn`; the file is replaced as a whole.

    A RenderError tells of a name that is not that of a PNG.
    """
    require_png(path)
    with drawn(views, size=size or (WIDTH, HEIGHT)) as (picture,), atomic_path(path) as target:
        target.write_bytes(picture.read_bytes())


def require_png(path: str | os.PathLike[str]) -> None:
    """Raises a RenderError where the name of a picture is not that of a PNG."""
    if Path(path).suffix.lower() != ".png":
        raise RenderError(f"{os.fspath(path)}: a picture is written as .png, not '{Path(path).suffix}'")


@contextmanager
def drawn(views: Sequence[View], *, size: tuple[int, int], angles: Sequence[float] = (0.0,)) -> Iterator[list[Path]]:
    """Draws views side by side: a PNG for each angle of the associate family; they go with the block."""
    require("pyvista", extra="render")
    with tempfile.TemporaryDirectory() as folder:
        draw_apart(views, size, angles, folder, time_limit=TIME_LIMIT + TIME_OF_FRAME * len(angles))
        yield [Path(folder) / f"{number:04d}.png" for number in range(len(angles))]


def draw_apart(*job: Any, time_limit: float) -> None:
    """Calls `draw` in a process of its own, which the drawing package ends where there is no OpenGL library."""
    without_display = sys.platform.startswith("linux") and not os.environ.get("DISPLAY")
    process = Process(DRAWING, {WINDOW: os.environ.get(WINDOW, "vtkEGLRenderWindow")} if without_display else {})
    try:
        with tempfile.TemporaryDirectory() as folder:
            arguments = Path(folder, "arguments")
            arguments.write_bytes(pickle.dumps(job))
            process.run({"arguments": str(arguments)}, lambda _: None, seconds=time_limit)
    except FaultError as fault:
        raise RenderError(_explanation(fault)) from fault
    finally:
        process.end()


def _explanation(fault: FaultError) -> str:
    if "bad X server" in fault.said:
        return "no window was opened: the display cannot be reached; check DISPLAY, or 'spinor-geom render' a picture"
    if fault.crash == "SIGKILL":
        return "no picture was drawn: its process was killed, as the system does where memory runs out; free some"
    if fault.crash or any(name in fault.said for name in ("libGL", "EGL", "OpenGL", "OSMesa")):
        advice = "install one (Debian, Ubuntu: apt-get install libgl1 libegl1 libgl1-mesa-dri)"
        if not sys.platform.startswith("linux"):  # there it comes with the system
            advice = "update the graphics driver"
        return f"no picture was drawn: no usable OpenGL library was found; {advice}"
    return f"no picture was drawn: {fault}"


def draw(
    views: Sequence[View], size: tuple[int, int], angles: Sequence[float], folder: str | None, title: str = ""
) -> None:
    """Draws views side by side, or without a folder opens a window with them and waits until it is closed.

    The pictures are 0000.png, 0001.png, …, one for each angle of the associate family, in radians. The title is that of
    the window and of its scale of colours.
    """
    import pyvista

    plotter: Any = pyvista.Plotter(
        off_screen=folder is not None,
        shape=(1, len(views)),
        window_size=list(size),
        border=False,
        lighting="light kit" if folder is None else "none",
        title=title,
    )
    turning = []
    for column, view in enumerate(views):
        plotter.subplot(0, column)
        plotter.set_background("white")
        height = view.camera.radius if view.camera else float(np.ptp(view.layers[0].vertices, axis=0).max()) / 2
        values = [own for layer in view.layers if isinstance(layer, Faces) for own in layer.fields.values()]
        known = np.concatenate([np.zeros(0), *values])
        known = known[np.isfinite(known)]
        scale = {"clim": [known.min(), known.max()]} if len(known) else {}
        for layer in view.layers:
            if isinstance(layer, Faces) and len(layer.faces):
                moved = _add_faces(plotter, layer, title, scale)
            elif isinstance(layer, Lines) and len(layer.edges):
                moved = _add_lines(plotter, layer, _THICKNESS * layer.width * height)
            else:
                continue
            if layer.conjugate is not None:
                turning.append((layer, moved))
        plotter.add_text(view.title, font_size=LABEL_SIZE, color="black")
        if view.labels:
            points, texts = zip(*view.labels, strict=True)
            boxes = {"text_color": "black", "shape_color": "white", "shape_opacity": 0.8, "show_points": False}
            plotter.add_point_labels(np.array(points), list(texts), font_size=LABEL_SIZE, always_visible=True, **boxes)
        if view.camera is not None:
            _look(plotter, view.camera, np.concatenate([layer.vertices for layer in view.layers]))
    if folder is None:
        if plotter.render_window.GetClassName() in _WITHOUT_WINDOW:
            # the drawing package takes another way when the display does not answer, and shows nothing
            sys.exit("bad X server")
        plotter.add_text(_KEYS, font_size=8, color="black")
        plotter.show()
        return
    plotter.enable_anti_aliasing("ssaa", all_renderers=True)
    for number, angle in enumerate(angles):
        if number or angle:
            for layer, moved in turning:
                moved(turned(layer, angle))
        for renderer in plotter.renderers:
            renderer.ResetCameraClippingRange()
        plotter.render()
        plotter.screenshot(str(Path(folder) / f"{number:04d}.png"))
    plotter.close()


def _add_faces(plotter: Any, layer: Faces, told: str, scale: dict[str, Any]) -> Callable[[Any], None]:
    """Adds a surface; what is returned moves its vertices, with normals that stay, as those of a family do."""
    import pyvista

    mesh: Any = pyvista.PolyData.from_regular_faces(layer.vertices, layer.faces)
    mesh.compute_normals(
        cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False, inplace=True
    )
    normals = np.array(mesh.point_data["Normals"])
    look: dict[str, Any] = {**LOOK, "smooth_shading": not layer.edges, "split_sharp_edges": False}
    if layer.fields:
        (mesh.point_data[told or "values"],) = layer.fields.values()
        plotter.add_mesh(mesh, scalars=told or "values", cmap=COLOURS, show_scalar_bar=bool(told), **scale, **look)
    else:
        inside = {"color": layer.inside or layer.colour, **LOOK}
        look |= {"show_edges": bool(layer.edges), "edge_opacity": 0.4}
        plotter.add_mesh(mesh, color=layer.colour, backface_params=inside, **look)

    def move(points: Any) -> None:
        mesh.points = points
        mesh.point_data["Normals"] = normals

    return move


def _add_lines(plotter: Any, layer: Lines, radius: float) -> Callable[[Any], None]:
    """Adds lines, joined as long as possible; what is returned moves their vertices."""
    import pyvista

    cells = np.column_stack([np.full(len(layer.edges), 2), layer.edges]).ravel()
    curve: Any = pyvista.PolyData(layer.vertices, lines=cells).strip(join=True, max_length=100_000)
    tube = curve.tube(radius=radius, n_sides=TUBE_SIDES)
    plotter.add_mesh(tube, color=layer.colour, ambient=0.3, diffuse=0.75, specular=0.2, smooth_shading=True)

    def move(points: Any) -> None:
        curve.points = points
        tube.copy_from(curve.tube(radius=radius, n_sides=TUBE_SIDES))

    return move


def _look(plotter: Any, camera: Camera, points: Any) -> None:
    import pyvista

    reach = np.linalg.norm(points - camera.focus, axis=1).max()
    for towards, strength in LIGHTS:
        place = camera.focus + np.array(towards) @ camera.frame
        light = pyvista.Light(position=place, focal_point=camera.focus, intensity=strength, light_type="scene light")
        plotter.add_light(light, only_active=True)
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = camera.focus
    plotter.camera.position = camera.focus + 10 * max(camera.radius, reach) * camera.direction
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = MARGIN * camera.radius


if __name__ == "__main__":
    serve(lambda job, _: draw(*pickle.loads(Path(job["arguments"]).read_bytes())))
