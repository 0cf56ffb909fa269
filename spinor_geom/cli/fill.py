"""`spinor-geom fill`: fills the holes of a mesh file, and writes the result, a report, a page and a picture."""

from __future__ import annotations

import argparse
import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import count
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.text import Text

from spinor_geom.adapters.mesh_files import known_suffix
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines, show_table
from spinor_geom.cli.source import read_surface, require_writable
from spinor_geom.errors import OptionError, SpinorGeomError, require
from spinor_geom.files import together, write_json
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import LoopContinuity
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.loop_choice import LoopChoice
from spinor_geom.render.page import require_html

if TYPE_CHECKING:
    from spinor_geom.comparison import Comparison

# columns to leave out on a narrow terminal, in this order
_OPTIONAL = ("stability", "perimeter", "seconds", "residual", "points")
# Loops. Of more, only warnings are listed on standard error, those that are alike in one line.
_MOST_LISTED = 20
_MOST_INDICES = 5  # of loops with the same warning that are listed
_WITHOUT_NUMBERS = str.maketrans("", "", "0123456789.,+-e ")  # nor their separators
# columns that are left out if empty: the RMS angle between patch and mesh along the boundary loop before and after the
# continuation, the number of intersections, and the area of the mesh where it differs from that of the surface
BEND, CROSSINGS, MESH_AREA = "bend", "crossings", "mesh area"


# options that `fill_hole` has under the same names
_SAME = ("bridge", "islands", "keep_largest", "max_perimeter", "tolerance", "time_limit")


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Fills the holes and writes all outputs or none. Raises an error before solving if one cannot be written."""
    if arguments.picture is not None:
        require("pyvista", extra="render")
    if arguments.html is not None:
        require("matplotlib", extra="render")
    mesh = read_surface(arguments.input, merge=arguments.merge)
    edge_length: float | Literal["auto"] = arguments.edge_length or "auto"
    mesh = mesh.as_stored(known_suffix(arguments.output))
    require_writable(arguments.output)  # the filled mesh may replace the input. No other output may
    is_replaced = os.path.realpath(arguments.output) == os.path.realpath(arguments.input)
    outputs = [arguments.output]
    for path in (arguments.report, arguments.picture, arguments.html):
        if path is not None:
            require_writable(path, arguments.input, *outputs)
            outputs.append(path)
    if arguments.html is not None:
        require_html(arguments.html)
    loop, continuity = _choice(arguments)
    with progress("filling") as bar:
        done = count(1)
        filled, result = fill_hole(
            mesh,
            loop,
            **{name: getattr(arguments, name) for name in _SAME},
            continuity=continuity,
            target_edge_length=edge_length,
            return_report=True,
            on_loop=lambda _, requested: bar(next(done), requested),
            on_stage=lambda place, stage: bar.stage(f"loop {place}: {stage}"),
        )
    for path in outputs:
        path.parent.mkdir(parents=True, exist_ok=True)
    compared = _compared(result, edge_length) if arguments.compare else {}
    comparisons = {index: one for index, one in compared.items() if not isinstance(one, str)}
    # solves for the disks that a surface between rims is compared with
    report = None if arguments.report is None else result.to_dict()
    with together():
        left_out = filled.write(arguments.output)
        if report is not None:
            for index, one in compared.items():
                entry = {"reason": one} if isinstance(one, str) else one.to_dict()
                report["loops"][index]["comparison"] = entry
            report["notes"] += left_out
            files = {"input": str(arguments.input), "output": str(arguments.output)}
            write_json(arguments.report, files | report)
        if arguments.picture is not None:
            from spinor_geom.render.fill_scene import fill_scene
            from spinor_geom.render.png import write_png

            write_png(fill_scene(result), arguments.picture)
        if arguments.html is not None:
            from spinor_geom.render.report import report as write_page

            write_page(result, arguments.html, comparisons=comparisons)
    # after all files are written, because standard output may be closed or full
    for index, comparison in comparisons.items():
        show_lines(f"loop {index}\n{comparison}", piped=True)
    _show_result(result, quiet=arguments.quiet)
    if is_replaced:
        complain(f"{arguments.output}: the input was replaced by the filled mesh")
    for note in left_out:
        complain(note)
    good = result.closed and result.intersection_free and (result.complete or not arguments.strict)
    return ExitStatus.DONE if good else ExitStatus.IMPERFECT


def _choice(arguments: argparse.Namespace) -> tuple[LoopChoice, LoopContinuity]:
    """The loops to fill, and the continuity of each. Raises an OptionError for a loop with two of them."""
    film, smooth = arguments.film or (), arguments.smooth or ()
    if twice := sorted({*film} & {*smooth}):
        raise OptionError(f"loop {twice[0]} is in --film and in --smooth; name it in one of them")
    loop: LoopChoice = "all"
    if arguments.loop is not None or ((film or smooth) and arguments.continuity is None):
        loop = [*(arguments.loop or ()), *film, *smooth]
    return loop, {"default": arguments.continuity or "C0", **dict.fromkeys(film, "C0"), **dict.fromkeys(smooth, "C1")}


def _compared(result: FillResult, edge_length: float | Literal["auto"]) -> dict[int, Comparison | str]:
    """Each exact patch compared with a discrete minimal surface, or why it was not, by loop index."""
    from spinor_geom.comparison import compare

    compared: dict[int, Comparison | str] = {}
    for outcome in result.loops:
        if outcome.kind != "minimal" or outcome.solution is None or not outcome.faces_added:
            continue
        try:
            compared[outcome.index] = compare(outcome.solution, target_edge_length=edge_length)
        except SpinorGeomError as error:
            compared[outcome.index] = str(error)
            complain(f"loop {outcome.index}: no comparison: {error}")
    return compared


def _show_result(result: FillResult, *, quiet: bool) -> None:
    """Prints a table of loops on a terminal, and warnings on standard error.

    Without a terminal, a line of counts and, of at most `_MOST_LISTED` loops, those filled without warnings are on
    standard error too, unless `quiet`. Of more loops, warnings that are alike are one line.
    """
    if not result.loops:
        show_lines("no boundary loops: nothing to fill", piped=True)
    elif Console().is_terminal:
        rows = [_row(outcome) for outcome in result.loops]
        columns = [
            name for name in rows[0] if name not in (BEND, CROSSINGS, MESH_AREA) or any(str(row[name]) for row in rows)
        ]
        show_table(columns, [[row[name] for name in columns] for row in rows], piped=False, optional=_OPTIONAL)
    for note in result.notes:
        if result.loops and note not in result.mesh.notes:
            complain(note)
        else:
            show_lines(note, piped=not result.loops)
    summary = f"{result.summary}, {result.timings['total']:.1f} s"
    show_lines(summary, piped=False)
    is_told = not quiet and not sys.stdout.isatty()
    if len(result.loops) > _MOST_LISTED:
        for line in _grouped(result.loops):
            complain(line)
    else:
        for outcome in result.loops:
            lines = outcome.shortcomings
            if (not lines or outcome.choice) and outcome.filled and is_told:
                lines = (f"loop {outcome.index} ({len(outcome.loop)} vertices): {_description(outcome)}", *lines)
            for line in lines:
                complain(line)
    if is_told and result.loops:
        complain(summary)


def _grouped(outcomes: Iterable[LoopOutcome]) -> Iterator[str]:
    """The warnings on loops, one of those that differ by their numbers only, with the indices of the other loops."""
    alike = defaultdict[str, list[tuple[int, str]]](list)
    for outcome in outcomes:
        for line in outcome.shortcomings:
            alike[line.translate(_WITHOUT_NUMBERS)].append((outcome.index, line))
    for (_, line), *others in alike.values():
        some = ", ".join(str(index) for index, _ in others[:_MOST_INDICES])
        rest = ", ... (--report lists all)" if len(others) > _MOST_INDICES else ""
        name = "loop" if len(others) == 1 else "loops"
        yield f"{line}; likewise {len(others)} other {name}: {some}{rest}" if others else line


def _description(outcome: LoopOutcome) -> str:
    if not outcome.faces_added:
        return f"joined to loop {outcome.joined_to}"
    residual = "" if outcome.solution is None else f", residual {outcome.solution.boundary_residual.rms_per_edge:.1e}"
    choice = f"; {outcome.choice}" if outcome.choice else ""
    mesh = f" (mesh {outcome.mesh_area:.6g})" if outcome.areas_differ else ""
    return f"{outcome.kind}, {outcome.faces_added} faces, area {outcome.area:.6g}{mesh}{residual}{choice}"


def _row(outcome: LoopOutcome) -> dict[str, str | Text]:
    """A row of the table, by columns."""
    area, bend = outcome.area, outcome.continuation
    solution = None if area is None else outcome.solution
    return {
        "loop": str(outcome.index),
        "kind": _kind(outcome),
        "points": str(len(outcome.loop)),
        "perimeter": f"{outcome.loop.perimeter:.4g}",
        "residual": "" if solution is None else f"{solution.boundary_residual.rms_per_edge:.1e}",
        "area": "" if area is None else f"{area:.4g}",
        MESH_AREA: f"{outcome.mesh_area:.4g}" if outcome.areas_differ else "",
        "stability": "" if solution is None else solution.stability.verdict,
        "faces": str(outcome.faces_added),
        "seconds": f"{outcome.timings['total']:.2f}" if outcome.timings else "",
        BEND: "" if bend is None else f"{bend.before.rms:.0f}° to {bend.after.rms:.0f}°",
        CROSSINGS: Text("unknown" if not outcome.is_searched else str(outcome.intersections or ""), style="red"),
    }


def _kind(outcome: LoopOutcome) -> Text:
    """The kind of a patch: green if converged, yellow if not or for a border, red for a requested loop left open."""
    text = f"joined to {outcome.joined_to}" if outcome.filled and outcome.joined_to is not None else outcome.state
    style = {"open": "red", "left open": "dim"}.get(text, "green" if outcome.converged else "yellow")
    return Text(text, style=style)
