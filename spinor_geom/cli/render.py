"""`spinor-geom render`: draws a mesh or a saved surface as a PNG, without a display."""

from __future__ import annotations

import argparse
from typing import Literal

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
    from spinor_geom.render.shapes import portrait_of

    shape = read_shape(arguments.input)
    # scans and models stand on y in most formats, formulas on z
    up: Literal["y", "z"] = arguments.up or ("z" if arguments.input.suffix.lower() == SURFACE_SUFFIX else "y")
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    portrait_of(shape, curvature=arguments.curvature, up=up).write(
        arguments.output, eye=arguments.eye, size=arguments.size
    )
    return ExitStatus.DONE
