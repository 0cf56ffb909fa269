"""`spinor-geom solve`: a minimal surface over the curves of a file, or rims of a mesh, written as CAD data."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from spinor_geom.adapters import CadCurve, read_mesh, to_rims
from spinor_geom.adapters.open_cascade import is_cad_file, require_cad_suffix
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.source import require_writable
from spinor_geom.errors import MeshFileError, NoConnectedSurfaceFoundError, OptionError
from spinor_geom.fill.loop_choice import boundary_loops, chosen_indices
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solution import NoConnectedSurface
from spinor_geom.plateau.solve import solve_plateau

_OF_POINTS, _OF_EDGES = 1e-3, 1e-6  # tolerances of surfaces over points, as of `solve_plateau`, and over CAD edges
_LEAST_GAP = 1e-9  # smallest reported gap between edges, per length of the curve


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Solves Plateau's problem and writes the patches; raises an error before solving if the file cannot be written."""
    require_cad_suffix(arguments.output)
    require_writable(arguments.output, arguments.input)
    is_cad = is_cad_file(arguments.input)
    if is_cad and arguments.unit is not None:
        raise OptionError("CAD files contain their unit; remove --unit")
    curves = _curves(arguments.input, arguments.loop)
    tolerance = arguments.tolerance or (_OF_EDGES if is_cad else _OF_POINTS)
    with progress("solving") as bar:
        solution = solve_plateau(
            curves[0] if len(curves) == 1 else curves, tolerance=tolerance, time_limit=arguments.time_limit
        )
        if isinstance(solution, NoConnectedSurface):
            raise NoConnectedSurfaceFoundError(reason=solution.reason)
        bar.stage("patches")
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        surface = solution.save(
            arguments.output,
            tolerance=arguments.deviation,
            time_limit=arguments.time_limit,
            unit=arguments.unit or "mm",
        )
    deviations = surface.deviations
    show_lines(
        f"{len(surface.patches)} patches, {surface.size} control points, area {surface.area:.9g}, at most "
        f"{deviations.surface:.1e} from the minimal surface and {deviations.rim:.1e} from the curve",
        piped=False,
    )
    if surface.converged:
        return ExitStatus.DONE
    complain(surface.reason)
    return ExitStatus.IMPERFECT


def _curves(path: Path, chosen: list[int] | None) -> list[Any]:
    """The closed curves of a CAD file or a file without faces, or boundary loops of a mesh: all, or those chosen."""
    if is_cad_file(path):
        edges = to_rims(path) if chosen is None else [rim for number in chosen for rim in to_rims(path, number)]
        show_lines(f"{path}: {_description([rim for rim in edges if isinstance(rim, CadCurve)])}", piped=True)
        return edges
    mesh = read_mesh(path)
    if len(mesh.mesh.faces):
        loops: list[Any] = list(boundary_loops(mesh))
    else:
        vertices = mesh.mesh.vertices
        closed = [line[:-1] for line in mesh.polylines if len(line) > 3 and line[0] == line[-1]]
        if len(closed) < len(mesh.polylines):
            raise MeshFileError(f"{path}: has an open curve; close it: its last point must be its first", path=path)
        loops = [BoundaryLoop.from_points(vertices[line]) for line in closed]
    if not loops:
        raise MeshFileError(f"{path}: has no curves and no boundary loops", path=path)
    if chosen is None and len(mesh.mesh.faces) and len(loops) > 1:
        raise MeshFileError(
            f"{path}: has {len(loops)} boundary loops; choose with --loop (see 'spinor-geom loops')", path=path
        )
    indices = range(len(loops)) if chosen is None else chosen_indices(chosen, loops)
    return [loops[index] for index in indices]


def _description(curves: Sequence[CadCurve]) -> str:
    """A sentence on the curves that were read."""
    edges = sum(curve.edges for curve in curves)
    what = "edges that belong to no face" if curves[0].kind == "edges" else "edges on the free boundary of faces"
    gap = max(curve.gap for curve in curves)
    is_gap = gap > _LEAST_GAP * max(curve.length for curve in curves)
    closed = f"; gaps of up to {gap:.1e} were closed" if is_gap else ""
    return f"{len(curves)} closed {'curve' if len(curves) == 1 else 'curves'} of {edges} {what}, in mm{closed}"
