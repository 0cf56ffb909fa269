"""`spinor-geom fill`: fills the holes of a mesh file, writes the result, a report, a picture."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines, show_table
from spinor_geom.cli.source import read_surface
from spinor_geom.errors import MeshFileError, SpinorGeomError
from spinor_geom.files import write_json
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.optional import require

if TYPE_CHECKING:
    from spinor_geom.comparison import Comparison

COLUMNS = ("loop", "vertices", "perimeter", "filled", "residual/edge", "area", "stability", "new faces")
CROSSINGS = "crossings"  # a column more, where there are some


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Fills, writes, reports; what cannot work is refused before anything is solved."""
    if arguments.picture is not None:
        require("pyvista", extra="render")
    if arguments.html is not None:
        require("matplotlib", extra="render")
    mesh = read_surface(arguments.input, merge=arguments.merge)
    edge_length: float | Literal["auto"] = "auto" if arguments.edge_length is None else arguments.edge_length
    named = (arguments.output, arguments.report, arguments.picture, arguments.html)
    outputs = [path for path in named if path is not None]
    require_format(arguments.output)
    for path in outputs:
        require_writable(path)
    with progress("filling") as advance:
        done: list[LoopOutcome] = []

        def on_loop(outcome: LoopOutcome, requested: int) -> None:
            done.append(outcome)
            advance(len(done), requested)

        filled, result = fill_hole(
            mesh,
            "all" if arguments.loop is None else arguments.loop,
            bridge=arguments.bridge,
            islands=arguments.islands,
            continuity=arguments.continuity,
            keep_largest=arguments.keep_largest,
            max_perimeter=arguments.max_perimeter,
            target_edge_length=edge_length,
            tolerance=arguments.tolerance,
            time_limit=arguments.time_limit,
            return_report=True,
            on_loop=on_loop,
        )
    for path in outputs:
        path.parent.mkdir(parents=True, exist_ok=True)
    filled.write(arguments.output)
    report = {"input": str(arguments.input), "output": str(arguments.output), **result.to_dict()}
    comparisons = add_comparisons(report, result, edge_length) if arguments.compare else {}
    if arguments.report is not None:
        write_json(arguments.report, report)
    show_result(result)
    if arguments.picture is not None:
        draw(result, arguments.picture)
    if arguments.html is not None:
        write_page(result, arguments.html, comparisons)
    good = result.closed and result.intersection_free and (result.complete or not arguments.strict)
    return ExitStatus.DONE if good else ExitStatus.IMPERFECT


def require_format(path: Path) -> None:
    """Checks that the suffix names a format that can be written.

    Raises:
        MeshFileError: it does not.
    """
    if path.suffix.lower() not in FORMATS:
        raise MeshFileError(f"{path}: '{path.suffix}' is no known format; use one of {', '.join(FORMATS)}", path=path)


def require_writable(path: Path) -> None:
    """Checks that a file can be put at a path, its folders being made on the way; makes none.

    Raises:
        MeshFileError: the path is a folder, or the nearest folder above it that exists may not be written to.
    """
    if path.is_dir():
        raise MeshFileError(f"{path}: is a folder; name a file in it", path=path)
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise MeshFileError(f"{path}: cannot be written, {above} is not a folder that may be written to", path=path)


def add_comparisons(
    report: dict[str, Any], result: FillResult, edge_length: float | Literal["auto"]
) -> dict[int, Comparison]:
    """Compares each fill with its discrete minimal surface: printed, and put under its loop in the report."""
    from spinor_geom.comparison import compare

    comparisons = {}
    for outcome, entry in zip(result.loops, report["loops"], strict=True):
        if outcome.kind != "minimal" or outcome.solution is None or not outcome.faces_added:
            continue
        try:
            comparison = compare(outcome.solution, target_edge_length=edge_length)
        except SpinorGeomError as error:
            entry["comparison"] = {"reason": str(error)}
            complain(f"loop {outcome.index}: no comparison: {error}")
            continue
        comparisons[outcome.index] = comparison
        entry["comparison"] = comparison.to_dict()
        show_lines(f"loop {outcome.index}\n{comparison}", piped=True)
    return comparisons


def show_result(result: FillResult) -> None:
    """The table of loops on a terminal; on standard error what is not filled as asked and what patches cross."""
    if result.loops:
        columns = COLUMNS if result.intersection_free else (*COLUMNS, CROSSINGS)
        show_table(columns, [row(outcome)[: len(columns)] for outcome in result.loops], piped=False)
    else:
        show_lines("no boundary loops: the mesh is closed, nothing to fill", piped=False)
    for note in result.notes:
        show_lines(note, piped=False)
    filled = sum(outcome.filled for outcome in result.loops)
    show_lines(
        f"{filled} of {len(result.loops)} loops filled, {len(result.extension.faces)} faces added, "
        f"{'watertight' if result.watertight else 'not watertight'}, {result.timings['total']:.1f} s",
        piped=False,
    )
    for said in result.shortcomings:
        complain(said)


def row(outcome: LoopOutcome) -> list[str]:
    """An outcome as a line of the table, with the column of crossings."""
    entry = outcome.to_dict()
    residual, area, stability = entry["residual_rms_per_edge"], entry["area"], entry["stability"]
    return [
        str(outcome.index),
        str(len(outcome.loop)),
        f"{outcome.loop.perimeter:.4g}",
        _state(outcome),
        "" if residual is None else f"{residual:.1e}",
        "" if area is None else f"{area:.4g}",
        "" if stability is None else str(stability["verdict"]),
        str(outcome.faces_added),
        str(outcome.intersections or ""),
    ]


def _state(outcome: LoopOutcome) -> str:
    if outcome.joined_to is not None and outcome.filled:
        return f"joined to {outcome.joined_to}"
    return outcome.kind or ("border" if outcome.is_border else "no" if outcome.requested else "left open")


def draw(result: FillResult, path: Path) -> None:
    """Draws the open mesh beside the filled one."""
    from spinor_geom.render.png import write_png
    from spinor_geom.render.scene import fill_scene

    write_png(fill_scene(result), path)


def write_page(result: FillResult, path: Path, comparisons: dict[int, Comparison]) -> None:
    """Writes the page that shows the fill."""
    from spinor_geom.render.report import report

    report(result, path, comparisons=comparisons)
