"""A window to turn a shape in: the process that shows it, `python -m spinor_geom.render.window SCENE.npz`."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.errors import RenderError
from spinor_geom.optional import require
from spinor_geom.render.colours import INSIDE_COLOUR, MESH_COLOUR, RIM_COLOUR

NO_DISPLAY = (
    "there is no display to open a window on; 'spinor-geom render IN -o out.png' draws a picture without one, "
    "'spinor-geom fill ... --html report.html' writes a page for any browser"
)
RIM_WIDTH = 4
_WITHOUT_WINDOW = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
_KEYS = "w wireframe, s surface, r reset, q quit"


def has_display() -> bool:
    """Whether windows can be opened; on Linux that needs DISPLAY or WAYLAND_DISPLAY."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def show(vertices: np.ndarray, faces: np.ndarray, rims: np.ndarray, values: np.ndarray | None, *, title: str) -> None:
    """Opens a window and waits until it is closed.

    It belongs to a process of its own: where the display cannot be reached the drawing package ends its process.

    Args:
        vertices: (n, 3) positions.
        faces: (f, 3) triangles.
        rims: (r, 2) edges drawn as tubes.
        values: (n,) what colours tell, or None for one colour.
        title: of the window, and of the scale of colours.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: there is no display, or none that can be reached.
    """
    require("pyvista", extra="render")
    if not has_display():
        raise RenderError(NO_DISPLAY)
    from spinor_geom.render.png import draw_apart

    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.npz"
        colours = np.zeros(0) if values is None else values
        np.savez(scene, vertices=vertices, faces=faces, rims=rims, values=colours, title=np.array(title))
        draw_apart("spinor_geom.render.window", str(scene), time_limit=None)


def _open(path: Path) -> None:
    import pyvista

    scene = dict(np.load(path))
    title = str(scene["title"])
    mesh = pyvista.PolyData.from_regular_faces(scene["vertices"], scene["faces"])
    plotter: Any = pyvista.Plotter(title=title)
    if len(scene["values"]):
        mesh.point_data[title] = scene["values"]
        plotter.add_mesh(mesh, scalars=title, cmap="viridis", smooth_shading=True)
    else:
        plotter.add_mesh(mesh, color=MESH_COLOUR, backface_params={"color": INSIDE_COLOUR, "ambient": 0.1})
    if len(scene["rims"]):
        cells = np.column_stack([np.full(len(scene["rims"]), 2), scene["rims"]]).ravel()
        rims = pyvista.PolyData(scene["vertices"], lines=cells)
        plotter.add_mesh(rims, color=RIM_COLOUR, line_width=RIM_WIDTH, render_lines_as_tubes=True)
    if plotter.render_window.GetClassName() in _WITHOUT_WINDOW:
        # the drawing package takes another way when the display does not answer, and shows nothing
        sys.exit("bad X server")
    plotter.add_text(_KEYS, font_size=8, color="black")
    plotter.show()


if __name__ == "__main__":
    _open(Path(sys.argv[1]))
