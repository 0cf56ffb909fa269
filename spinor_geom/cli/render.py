"""`spinor-geom render`: draws a mesh or a saved surface as a PNG, without a display."""

from __future__ import annotations

import argparse

from spinor_geom.cli.console import ExitStatus
from spinor_geom.cli.fill import require_writable
from spinor_geom.cli.source import SURFACE_SUFFIX, read_shape
from spinor_geom.errors import RenderError
from spinor_geom.optional import require


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Draws; what cannot be drawn or written is refused before anything is computed."""
    require("pyvista", extra="render")
    if arguments.output.suffix.lower() != ".png":
        raise RenderError(f"{arguments.output}: a picture is written as .png, not '{arguments.output.suffix}'")
    require_writable(arguments.output)
    from spinor_geom.render.portrait import plain_portrait

    shape = read_shape(arguments.input)
    portrait = plain_portrait(shape.vertices, shape.faces, shape.told if arguments.curvature else None)
    # scans and models stand on y in most formats, formulas on z
    if (arguments.up or ("z" if arguments.input.suffix.lower() == SURFACE_SUFFIX else "y")) == "y":
        portrait = portrait.moved([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    portrait.write(arguments.output, eye=arguments.eye, size=arguments.size)
    return ExitStatus.DONE
