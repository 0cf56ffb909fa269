"""`spinor-geom view`, `render` and `morph`: windows, pictures and animations of meshes and saved surfaces."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from spinor_geom.adapters.open_cascade import is_cad_file, read_shape, triangulated
from spinor_geom.cli.console import ExitStatus
from spinor_geom.cli.source import read_surface, require_display, require_writable
from spinor_geom.errors import OptionError, require
from spinor_geom.files import SURFACE_SUFFIX, up_axis
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.fill_scene import MOST_LABELS
from spinor_geom.render.png import draw_apart, require_png
from spinor_geom.render.scene import Scene

if TYPE_CHECKING:
    from spinor_geom.render.portrait import Portrait
    from spinor_geom.render.shapes import Shape

_SIZE = (1024, 768)  # of a window


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Runs `view`, `render` or `morph`. Raises an error before computing if the output cannot be written."""
    {"view": _view, "render": _render, "morph": _morph}[arguments.command](arguments)
    return ExitStatus.DONE


def _view(arguments: argparse.Namespace) -> None:
    require("pyvista", extra="render")
    require_display(
        "draw a picture with 'spinor-geom render IN -o out.png', or write a page with 'spinor-geom fill ... --html "
        "report.html'"
    )
    shape = _shape(arguments.input, arguments.merge)
    upright = _upright(shape, arguments)
    loops = boundary_loops(TriangleMesh(upright.layers[0].vertices, shape.faces))
    labels = [(loop.points[0], str(number)) for number, loop in enumerate(loops[:MOST_LABELS])]
    scene = Scene(layers=upright.layers, title=arguments.input.name, labels=labels)
    draw_apart([scene], _SIZE, [0.0], None, time_limit=math.inf)  # until the user closes the window


def _render(arguments: argparse.Namespace) -> None:
    require("pyvista", extra="render")
    require_png(arguments.output)
    require_writable(arguments.output)
    shape = _shape(arguments.input, arguments.merge)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    _upright(shape, arguments).write(arguments.output, eye=arguments.eye, size=arguments.size)


def _upright(shape: Shape, arguments: argparse.Namespace) -> Portrait:
    """The picture of a shape, turned so that its vertical axis is the third one."""
    portrait = shape.portrait(curvature=arguments.curvature)
    is_upright = (arguments.up or up_axis(arguments.input)) == "z"
    return portrait if is_upright else portrait.moved([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def _morph(arguments: argparse.Namespace) -> None:
    from spinor_geom.gallery import named_surface
    from spinor_geom.render.morph import checked_suffix, morph
    from spinor_geom.surface.array_surface import ArraySurface

    checked_suffix(arguments.output)
    require_writable(arguments.output)
    path = Path(arguments.surface)
    surface = ArraySurface.load(path) if path.suffix or path.exists() else named_surface(arguments.surface)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    morph(surface, arguments.output, frames=arguments.frames)


def _shape(path: Path, merge: bool | float) -> Shape:
    from spinor_geom.render.shapes import shape_of

    if is_cad_file(path):
        if merge is not False:
            raise OptionError(f"{path} is a CAD file, which has no vertices to merge; remove --merge")
        return shape_of(TriangleMesh(*triangulated(read_shape(path))).merged("rounding")[0])
    if path.suffix.lower() != SURFACE_SUFFIX:
        return shape_of(read_surface(path, merge=merge))
    if merge is not False:
        raise OptionError(f"{path} is a saved surface, which has no vertices to merge; remove --merge")
    from spinor_geom.surface.array_surface import ArraySurface

    return shape_of(ArraySurface.load(path))
