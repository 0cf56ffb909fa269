"""`spinor-geom view`: opens a window with a mesh or a saved surface."""

from __future__ import annotations

import argparse

from spinor_geom.cli.console import ExitStatus
from spinor_geom.cli.source import read_shape
from spinor_geom.errors import RenderError
from spinor_geom.optional import require
from spinor_geom.render.window import NO_DISPLAY, has_display, show


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Shows the file until the window is closed; says what to do where there is no display."""
    require("pyvista", extra="render")
    if not has_display():
        raise RenderError(NO_DISPLAY)
    shape = read_shape(arguments.input)
    title = f"{arguments.input.name}{f', {shape.curvature}'.replace('_', ' ') * arguments.curvature}"
    show(shape.vertices, shape.faces, shape.rims, shape.told if arguments.curvature else None, title=title)
    return ExitStatus.DONE
