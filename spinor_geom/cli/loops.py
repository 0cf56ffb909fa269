"""`spinor-geom loops`: lists the boundary loops of a mesh file, and draws them with their numbers."""

import argparse
import json
import math
from contextlib import suppress
from typing import Any

from spinor_geom.cli.console import ExitStatus, complain, show_lines, show_table
from spinor_geom.cli.source import read_surface, require_writable
from spinor_geom.deadline import time_limit
from spinor_geom.errors import OutOfTimeError, require
from spinor_geom.files import up_axis, write_text
from spinor_geom.fill.fill_options import Choice, FillOptions
from spinor_geom.fill.filling import Filling
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import MOST_CROSSINGS, crossings_found, loop_crossings
from spinor_geom.mesh.triangle_mesh import require_faces
from spinor_geom.render.page import require_html

COLUMNS = ("loop", "points", "perimeter", "mean edge", "size", "centre", "elongation", "corners", "remark")
_SECONDS_TO_COUNT = 5.0  # the crossings of a loop, of which only tangles of more than 10,000 long edges take longer
_CROSSING = {
    0: "",
    1: "crosses or touches itself in 1 pair of edges",
    None: f"its crossings were not counted, which takes more than {_SECONDS_TO_COUNT:.0f} s",
}
# columns to leave out on a narrow terminal, in this order
_OPTIONAL = ("elongation", "mean edge", "corners", "size", "centre", "perimeter")


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Prints a table or JSON, draws the picture and writes the page."""
    if arguments.picture is not None:
        require("pyvista", extra="render")
        require_writable(arguments.picture, arguments.input)
    if arguments.html is not None:
        require_html(arguments.html)
        require_writable(arguments.html, arguments.input)
    mesh = read_surface(arguments.input, merge=arguments.merge)
    require_faces(mesh.mesh)
    filling = Filling(mesh.mesh, Choice(), FillOptions())
    loops, notes = filling.loops, filling.mesh_notes
    borders = {index for index, outcome in filling.left_open.items() if outcome.is_border}
    if arguments.picture is not None:
        from spinor_geom.render.fill_scene import loops_scene, skin_of
        from spinor_geom.render.png import write_png

        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        write_png(
            loops_scene(mesh.mesh, loops, up=up_axis(arguments.input), skin=skin_of(mesh, mesh.mesh)), arguments.picture
        )
    rows = [_row(index, loop, is_border=index in borders) for index, loop in enumerate(loops)]
    if arguments.html is not None:
        from spinor_geom.render.report import loops_page

        page = loops_page(
            mesh,
            loops,
            [COLUMNS, *rows],
            left_open=filling.left_open,
            name=arguments.input.name,
            up=up_axis(arguments.input),
        )
        arguments.html.parent.mkdir(parents=True, exist_ok=True)
        write_text(arguments.html, page)
    if arguments.json:
        listed = [_json(index, loop) | {"border": index in borders} for index, loop in enumerate(loops)]
        show_lines(json.dumps(listed, indent=2), piped=True)
    elif loops:
        show_table(COLUMNS, rows, piped=True, optional=_OPTIONAL, wrapped=COLUMNS[-1])
    else:
        show_lines("\n".join(["no boundary loops", *notes]), piped=True)
    for note in notes if loops or arguments.json else ():
        complain(note)
    return ExitStatus.DONE


def _json(index: int, loop: BoundaryLoop) -> dict[str, Any]:
    crossings = _crossings(loop)
    return {
        "index": index,
        "vertices": len(loop),
        "perimeter": loop.perimeter,
        "mean_edge_length": loop.mean_edge_length,
        "elongation": loop.elongation if math.isfinite(loop.elongation) else None,  # infinite for points on a line
        "centroid": loop.centroid.tolist(),
        "normal": loop.plane.normal.tolist(),
        "slit_fraction": loop.slit_fraction,
        "seam_edges": len(loop.seam_edges),
        "seam_distance": loop.seam_distance,
        "junctions": len(loop.junctions),
        "crossings": crossings,
        "all_crossings_counted": crossings is not None and crossings < MOST_CROSSINGS,
        "obstacle": None if loop.obstacle is None else str(loop.obstacle),
        "remarks": list(loop.remarks),
        "corners": loop.vertex_ids[loop.corners].tolist(),
        "vertex_ids": loop.vertex_ids.tolist(),
    }


def _crossings(loop: BoundaryLoop) -> int | None:
    """The number of pairs of edges that meet, or None if counting them takes too long."""
    with time_limit(_SECONDS_TO_COUNT), suppress(OutOfTimeError):
        return len(loop_crossings(loop.points))
    return None


def _row(index: int, loop: BoundaryLoop, *, is_border: bool) -> list[str]:
    crossings = 0 if loop.slit_fraction else _crossings(loop)
    remarks = [
        f"zero-width slit ({loop.slit_fraction:.0%})" if loop.slit_fraction else "",
        f"{len(loop.seam_edges)} edges on another loop" if len(loop.seam_edges) else "",
        f"{len(loop.junctions)} T-junctions" if len(loop.junctions) else "",
        _CROSSING.get(crossings, f"crosses or touches itself in {crossings_found(crossings or 0)} pairs of edges"),
        "" if loop.obstacle is None else f"no patch: {loop.obstacle}",
        "border of a sheet, left open unless named" if is_border else "",
        *loop.remarks,
    ]
    return [
        str(index),
        str(len(loop)),
        f"{loop.perimeter:.5g}",
        f"{loop.mean_edge_length:.4g}",
        f"{loop.diagonal:.4g}",
        " ".join(f"{x:.4g}" for x in loop.centroid.tolist()),
        f"{loop.elongation:.3g}",
        str(int(loop.corners.sum())),
        "; ".join(filter(None, remarks)),
    ]
