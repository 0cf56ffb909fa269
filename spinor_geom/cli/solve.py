"""`spinor-geom solve`: spans the closed curves of a file, and writes the minimal surface as a CAD file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from spinor_geom.adapters import CadCurve, Rim, read_mesh, to_rims
from spinor_geom.adapters.obj import read_obj_stream
from spinor_geom.adapters.open_cascade import is_cad_file, require_cad_suffix
from spinor_geom.batching.obj_curves import curve_loops
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.source import require_writable
from spinor_geom.errors import LoopIndexError, OptionError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solution import NoConnectedSurface
from spinor_geom.plateau.solve import solve_plateau

_CLOSING = 1e-3  # as of a batch: gaps of OBJ curves that are closed, in mean edges
_OF_POINTS = 1e-3  # smallest tolerance of the distance from curves through points, in edges
_TOLD = 1e-9  # gaps are named from this share of the length


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Solves and writes; an output that cannot be written is an error before solving."""
    require_cad_suffix(arguments.output)
    require_writable(arguments.output, arguments.input)
    if arguments.unit is not None and is_cad_file(arguments.input):
        raise OptionError("a CAD file states its unit; leave --unit out")
    curves = read_curves(arguments.input, arguments.loop)
    show_lines(f"{arguments.input}: {_description(curves)}", piped=True)
    is_exact = all(isinstance(curve, CadCurve) for curve in curves)
    tolerance = arguments.tolerance if is_exact else max(arguments.tolerance, _OF_POINTS)
    with progress("solving"):
        solution = solve_plateau(curves, tolerance=tolerance, time_limit=arguments.time_limit)
        if isinstance(solution, NoConnectedSurface):
            raise SurfaceError(solution.reason)
        surface = solution.to_nurbs(tolerance=arguments.tolerance)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    surface.save(arguments.output, unit=arguments.unit or "mm")
    deviations = surface.deviations
    show_lines(
        f"{arguments.output}: {len(surface.patches)} faces, area {surface.area:.9g}, rims within {deviations.rim:.1e} "
        f"of their curves, faces within {deviations.surface:.1e} of the minimal surface",
        piped=True,
    )
    if not surface.converged:
        complain(surface.reason)
    return ExitStatus.DONE if surface.converged else ExitStatus.IMPERFECT


def read_curves(path: Path, loop: int | None) -> list[Rim]:
    """The closed curves of a file: edges of a CAD file, curves of an OBJ file without faces, or a loop of a mesh.

    Args:
        path: the file.
        loop: the number of one curve, or loop of a mesh; None for all curves, or the only loop.

    Raises:
        LoopError: a curve cannot be used, or there is none of this number.
        OptionError, CadFileError, MeshFileError: as `to_rims`.
    """
    if is_cad_file(path):
        return to_rims(path, loop)
    mesh = read_mesh(path)
    if len(mesh.mesh.faces) or not mesh.polylines:
        return to_rims(mesh, loop)
    with open(path, "rb") as stream:
        curves = curve_loops(read_obj_stream(stream), closing=_CLOSING)
    if loop is not None:
        if loop >= len(curves):
            raise LoopIndexError(index=loop, loops=len(curves))
        curves = [curves[loop]]
    for curve in curves:
        if curve.error is not None:
            raise curve.error
    return [curve.loop for curve in curves if curve.loop is not None]


def _description(curves: Sequence[Rim]) -> str:
    count = f"{len(curves)} closed {'curve' if len(curves) == 1 else 'curves'}"
    cad = [curve for curve in curves if isinstance(curve, CadCurve)]
    if not cad:
        return f"{count} of {sum(len(curve) for curve in curves if isinstance(curve, BoundaryLoop))} points"
    edges = sum(curve.edges for curve in cad)
    what = "edges that belong to no face" if cad[0].kind == "edges" else "edges on the free boundary of faces"
    gap = max(curve.gap for curve in cad)
    closed = f"; gaps of up to {gap:.1e} were closed" if gap > _TOLD * max(curve.length for curve in cad) else ""
    return f"{count} of {edges} {what}, lengths in mm{closed}"
