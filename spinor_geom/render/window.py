"""A window to turn a shape in."""

from __future__ import annotations

import os
import sys

import numpy as np

from spinor_geom.errors import RenderError
from spinor_geom.optional import require
from spinor_geom.render.colours import INSIDE_COLOUR, MESH_COLOUR
from spinor_geom.render.layers import Faces, Lines, View
from spinor_geom.render.png import draw_apart

NO_DISPLAY = (
    "there is no display to open a window on; 'spinor-geom render IN -o out.png' draws a picture without one, "
    "'spinor-geom fill ... --html report.html' writes a page for any browser"
)
_SIZE = (1024, 768)


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
    fields = {} if values is None else {title: values}
    mesh = Faces(vertices=vertices, faces=faces, colour=MESH_COLOUR, inside=INSIDE_COLOUR, fields=fields)
    view = View(layers=[mesh, Lines(vertices=vertices, edges=rims, width=1.0)])
    draw_apart([view], _SIZE, [0.0], None, title, time_limit=None)
