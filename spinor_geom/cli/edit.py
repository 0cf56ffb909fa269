"""`spinor-geom edit`: a window in which the holes of a mesh file are pointed at."""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path
from typing import Any

from spinor_geom.adapters.mesh_files import known_suffix
from spinor_geom.cli.console import ExitStatus, complain, show_lines
from spinor_geom.cli.source import read_surface, require_display, require_writable
from spinor_geom.errors import require
from spinor_geom.fill.fill_options import Choice, FillOptions
from spinor_geom.fill.filling import Filling
from spinor_geom.mesh.triangle_mesh import require_faces
from spinor_geom.render.png import draw_apart

_WINDOW = "spinor_geom.edit.window"


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Shows the window until it is closed, and prints the equivalent command of each save."""
    require("pyvista", extra="render")
    source: Path = arguments.input
    output = arguments.output or source.with_name(f"{source.stem}_filled{source.suffix}")
    known_suffix(output)
    require_writable(output)
    require_display("fill named loops with 'spinor-geom fill ... --film 1,4 --smooth 0,2-9'")
    mesh = read_surface(source, merge=arguments.merge)
    require_faces(mesh.mesh)
    filling = Filling(mesh.mesh, Choice(), FillOptions())
    if not filling.loops:
        show_lines("\n".join(["no boundary loops: nothing to fill", *filling.mesh_notes]), piped=True)
        return ExitStatus.DONE
    command = ["spinor-geom", "fill", str(source), "-o", str(output)]
    if arguments.merge is not False:
        command += ["--merge"] if arguments.merge is True else ["--merge", f"{arguments.merge:.17g}"]
    status = ExitStatus.DONE

    def tell(event: dict[str, Any]) -> None:
        nonlocal status
        status = ExitStatus.DONE if event["is_good"] else ExitStatus.IMPERFECT
        for line in (event["told"], *event["notes"]):
            complain(line)
        if os.path.realpath(output) == os.path.realpath(source):
            complain(f"{output}: the input was replaced by the filled mesh")
        show_lines(event["command"], piped=True)

    draw_apart(mesh, filling, output, command, time_limit=math.inf, module=_WINDOW, on_event=tell)
    return status
