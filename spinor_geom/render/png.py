"""Draws scenes as PNGs or in a window, with PyVista in a subprocess that runs this module."""

import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.errors import RenderError, require
from spinor_geom.files import atomic_path
from spinor_geom.isolate import FaultError, Process, Send, serve
from spinor_geom.render.camera import Camera
from spinor_geom.render.scene import Dots, Faces, Lines, Scale, Scene, overview

SIZE = (1600, 800)
TIME_LIMIT = 300.0  # seconds. Software rendering of a million triangles takes a few
TIME_OF_FRAME = 5.0  # additional seconds for each frame
DRAWING, WINDOW = "spinor_geom.render.png", "VTK_DEFAULT_OPENGL_WINDOW"  # module, and environment variable of VTK
PICTURE = "{:04d}.png"  # name of the file of an angle
_LABEL_SIZE, _TUBE_SIDES, _MARGIN = 14, 10, 1.06
_THICKNESS = 1 / 250  # radius of a line of one pixel, per half the height of what is shown
# direction to the light in the camera's frame (right, up, to the eye), and its strength
_LIGHTS = (((-0.5, 0.7, 0.8), 0.55), ((0.9, 0.1, 0.6), 0.25), ((0.1, -0.7, 0.7), 0.2), ((0.0, 0.0, 1.0), 0.2))
_SURFACE = {"ambient": 0.38, "diffuse": 0.72, "specular": 0.18, "specular_power": 25}
_LINE = {"ambient": 0.3, "diffuse": 0.75, "specular": 0.2, "smooth_shading": True}
_KEYS = "w wireframe, s surface, r reset, q quit"
_WITHOUT_WINDOW = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def write_png(scenes: Sequence[Scene], path: str | os.PathLike[str], *, size: tuple[int, int] = SIZE) -> None:
    """Draws scenes side by side. The file is replaced as a whole.

    Raises a RenderError if the suffix is not .png or the drawing failed, and a MissingPackageError without pyvista.
    """
    require_png(path)
    with drawn(scenes, size=size) as (picture,), atomic_path(path) as target:
        target.write_bytes(picture.read_bytes())


def require_png(path: str | os.PathLike[str]) -> None:
    """Raises a RenderError unless the suffix is .png."""
    if Path(path).suffix.lower() != ".png":
        raise RenderError(f"{os.fspath(path)}: a picture is written as .png, not '{Path(path).suffix}'")


@contextmanager
def drawn(scenes: Sequence[Scene], *, size: tuple[int, int], angles: Sequence[float] = (0.0,)) -> Iterator[list[Path]]:
    """Draws scenes side by side, one PNG for each angle of the associate family. The files are temporary."""
    require("pyvista", extra="render")
    with tempfile.TemporaryDirectory() as folder:
        draw_apart(scenes, size, angles, folder, time_limit=TIME_LIMIT + TIME_OF_FRAME * len(angles))
        yield [Path(folder, PICTURE.format(number)) for number in range(len(angles))]


def draw_apart(*job: Any, time_limit: float, module: str | None = None, on_event: Send = lambda event: None) -> None:
    """Calls `draw` in a subprocess that then ends. Another `module` gets the same arguments and sends events."""
    painter = Painter(module or DRAWING)
    try:
        painter.run(*job, time_limit=time_limit, on_event=on_event)
    finally:
        painter.end()


class Painter:
    """A process that draws, as VTK terminates its process if there is no OpenGL library. It starts on first use."""

    def __init__(self, module: str = DRAWING) -> None:
        """The module that `run` passes its arguments to."""
        without_display = sys.platform.startswith("linux") and not os.environ.get("DISPLAY")
        own = {WINDOW: os.environ.get(WINDOW, "vtkEGLRenderWindow")} if without_display else {}
        self._process = Process(module, own)

    def drawn_png(self, scenes: Sequence[Scene], *, size: tuple[int, int], time_limit: float) -> bytes:
        """A picture of scenes side by side, without their titles. Raises as `write_png`."""
        require("pyvista", extra="render")
        untitled = [replace(scene, title="") for scene in scenes]
        with tempfile.TemporaryDirectory() as folder:
            self.run(untitled, size, [0.0], folder, time_limit=time_limit)
            return Path(folder, PICTURE.format(0)).read_bytes()

    def run(self, *job: Any, time_limit: float, on_event: Send = lambda event: None) -> None:
        """Passes a job to the process and waits until it is done. Raises a RenderError."""
        try:
            with tempfile.TemporaryDirectory() as folder:
                arguments = Path(folder, "arguments")
                arguments.write_bytes(pickle.dumps(job))
                self._process.run({"arguments": str(arguments)}, on_event, seconds=time_limit)
        except FaultError as fault:
            raise RenderError(_explanation(fault)) from fault

    def end(self) -> None:
        """Ends the process, if there is one."""
        self._process.end()


def _explanation(fault: FaultError) -> str:
    if "bad X server" in fault.output:
        return "no window was opened: the display cannot be reached; check DISPLAY, or use 'spinor-geom render'"
    if fault.crash == "SIGKILL":
        return "no picture was drawn: the drawing process was killed, probably for lack of memory; free memory"
    if fault.crash or any(name in fault.output for name in ("libGL", "EGL", "OpenGL", "OSMesa")):
        advice = "install one (Debian, Ubuntu: apt-get install libgl1 libegl1 libgl1-mesa-dri)"
        if not sys.platform.startswith("linux"):
            advice = "update the graphics driver"
        return f"no picture was drawn: no usable OpenGL library was found; {advice}"
    return f"no picture was drawn: {fault}"


def draw(scenes: Sequence[Scene], size: tuple[int, int], angles: Sequence[float], folder: str | None) -> None:
    """Draws scenes side by side. Without a folder, opens a window and waits until it is closed.

    The pictures are 0000.png, 0001.png, …, one for each angle of the associate family, in radians.
    """
    import pyvista

    plotter: Any = pyvista.Plotter(
        off_screen=folder is not None,
        shape=(1, len(scenes)),
        window_size=list(size),
        border=False,
        lighting="light kit" if folder is None else "none",
        title=scenes[0].title,
    )
    turning = []
    for column, scene in enumerate(scenes):
        plotter.subplot(0, column)
        plotter.set_background("white")
        points, scales = np.concatenate([layer.vertices for layer in scene.layers]), scene.colour_scales
        camera = scene.camera or overview(scene.layers)
        for layer in scene.layers:
            if isinstance(layer, Faces) and len(layer.faces):
                move = add_faces(plotter, layer, scales, with_bar=folder is None)
            elif isinstance(layer, Lines) and len(layer.edges):
                move = _add_lines(plotter, layer, _THICKNESS * layer.width * camera.radius)
            elif isinstance(layer, Dots) and len(layer.vertices):
                ball = pyvista.Sphere(radius=_THICKNESS * layer.width * camera.radius)
                balls = pyvista.PolyData(layer.vertices).glyph(geom=ball, scale=False, orient=False)
                plotter.add_mesh(balls, color=layer.colour, **_LINE)
                continue
            else:
                continue
            if layer.conjugate is not None:
                turning.append((layer, move))
        plotter.add_text(scene.title, font_size=_LABEL_SIZE, color="black")
        if scene.labels:
            places, texts = zip(*scene.labels, strict=True)
            boxes = {"text_color": "black", "shape_color": "white", "shape_opacity": 0.8, "show_points": False}
            plotter.add_point_labels(np.array(places), list(texts), font_size=_LABEL_SIZE, always_visible=True, **boxes)
        place(plotter, camera, points)
        if folder is not None:
            _light(plotter, camera)
    if folder is None:
        require_window(plotter)
        plotter.add_text(_KEYS, position="lower_left", font_size=8, color="black")
        plotter.show()
        return
    plotter.enable_anti_aliasing("ssaa", all_renderers=True)
    for number, angle in enumerate(angles):
        if number or angle:
            for layer, move in turning:
                move(layer.turned(angle))
        for renderer in plotter.renderers:
            renderer.ResetCameraClippingRange()
        plotter.render()
        plotter.screenshot(str(Path(folder, PICTURE.format(number))))
    plotter.close()


def require_window(plotter: Any) -> None:
    """Ends the process if the display cannot be reached. VTK then falls back to off-screen rendering."""
    if plotter.render_window.GetClassName() in _WITHOUT_WINDOW:
        sys.exit("bad X server")


def add_faces(
    plotter: Any, layer: Faces, scales: dict[str, Scale], *, with_bar: bool, name: str | None = None
) -> Callable[[Any], None]:
    """Adds a surface, in place of one with the same `name`. The returned function moves its vertices.

    All members of a family have the same normals.
    """
    import pyvista

    mesh: Any = pyvista.PolyData.from_regular_faces(layer.vertices, layer.faces)
    mesh.compute_normals(
        cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False, inplace=True
    )
    normals = np.array(mesh.point_data["Normals"])
    look: dict[str, Any] = {**_SURFACE, "smooth_shading": not layer.edges, "split_sharp_edges": False, "name": name}
    if layer.fields:
        field = next(iter(layer.fields))
        values = layer.fields[field]
        if field in scales:
            ends = scales[field].low, scales[field].high
            values, look["clim"] = np.clip(values, *ends), ends
        mesh.point_data[field or "values"] = values
        plotter.add_mesh(mesh, scalars=field or "values", cmap="viridis", show_scalar_bar=with_bar, **look)
    elif layer.skin is not None and layer.image is None:
        plotter.add_mesh(mesh, scalars=np.rint(255 * layer.skin).astype(np.uint8), rgb=True, **look)
    elif layer.skin is not None:
        corners = layer.faces.ravel()
        faces: Any = np.arange(len(corners)).reshape(-1, 3)
        mesh = pyvista.PolyData.from_regular_faces(layer.vertices[corners], faces)
        mesh.point_data.active_normals = normals[corners]
        mesh.active_texture_coordinates = layer.skin
        as_texture: Any = pyvista.numpy_to_texture
        texture = as_texture(layer.image)
        texture.interpolate = True
        plotter.add_mesh(mesh, color="white", texture=texture, **look)
    else:
        look |= {"show_edges": bool(layer.edges), "edge_opacity": 0.4}
        back = {"color": layer.inside or layer.colour, **_SURFACE}
        plotter.add_mesh(mesh, color=layer.colour, backface_params=back, **look)

    def move(points: Any) -> None:
        mesh.points = points
        mesh.point_data["Normals"] = normals

    return move


def _add_lines(plotter: Any, layer: Lines, radius: float) -> Callable[[Any], None]:
    """Adds lines as tubes. The returned function moves their vertices."""
    import pyvista

    cells = np.column_stack([np.full(len(layer.edges), 2), layer.edges]).ravel()
    curve: Any = pyvista.PolyData(layer.vertices, lines=cells).strip(join=True, max_length=100_000)
    tube = curve.tube(radius=radius, n_sides=_TUBE_SIDES)
    plotter.add_mesh(tube, color=layer.colour, **_LINE)

    def move(points: Any) -> None:
        curve.points = points
        tube.copy_from(curve.tube(radius=radius, n_sides=_TUBE_SIDES))

    return move


def _light(plotter: Any, camera: Camera) -> None:
    import pyvista

    for towards, strength in _LIGHTS:
        place = camera.focus + np.array(towards) @ camera.frame
        light = pyvista.Light(position=place, focal_point=camera.focus, intensity=strength, light_type="scene light")
        plotter.add_light(light, only_active=True)


def place(plotter: Any, camera: Camera, points: Any) -> None:
    """Sets the camera, so that the points are in front of it."""
    reach = np.linalg.norm(points - camera.focus, axis=1).max()
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = camera.focus
    plotter.camera.position = camera.focus + 10 * max(camera.radius, reach) * camera.direction
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = _MARGIN * camera.radius


if __name__ == "__main__":
    serve(lambda job, _: draw(*pickle.loads(Path(job["arguments"]).read_bytes())))
