"""`spinor-geom view`: opens a window with a mesh or a saved surface."""

from __future__ import annotations

import argparse
import math
import os
import sys

from spinor_geom.cli.console import ExitStatus
from spinor_geom.cli.source import read_shape
from spinor_geom.errors import RenderError
from spinor_geom.optional import require
from spinor_geom.render.colours import INSIDE_COLOUR, MESH_COLOUR
from spinor_geom.render.layers import Faces, Lines, View
from spinor_geom.render.png import draw_apart

_SIZE = (1024, 768)


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Shows the file until the window is closed; says what to do where there is no display."""
    require("pyvista", extra="render")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise RenderError(
            "there is no display to open a window on; 'spinor-geom render IN -o out.png' draws a picture without one, "
            "'spinor-geom fill ... --html report.html' writes a page for any browser"
        )
    shape = read_shape(arguments.input)
    title = f"{arguments.input.name}{f', {shape.curvature}'.replace('_', ' ') * arguments.curvature}"
    fields = {title: shape.told} if arguments.curvature else {}
    mesh = Faces(vertices=shape.vertices, faces=shape.faces, colour=MESH_COLOUR, inside=INSIDE_COLOUR, fields=fields)
    view = View(layers=[mesh, Lines(vertices=shape.vertices, edges=shape.rims, width=1.0)])
    draw_apart([view], _SIZE, [0.0], None, title, time_limit=math.inf)  # as long as it is looked at
    return ExitStatus.DONE
