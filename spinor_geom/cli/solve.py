"""`spinor-geom solve`: a minimal surface over curves of a file, or rims of a mesh, written as CAD data or a mesh."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from spinor_geom.adapters import CadCurve, read_mesh, to_rims
from spinor_geom.adapters.mesh_files import known_suffix
from spinor_geom.adapters.open_cascade import is_cad_file, require_cad_suffix
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.source import require_writable
from spinor_geom.errors import MeshFileError, OptionError, SurfaceError
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.fill.loop_choice import boundary_loops, chosen_indices
from spinor_geom.fill.obj_curves import NamedLoop, curve_loops
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

_OF_POINTS, _OF_EDGES = 1e-3, 1e-6  # tolerances of surfaces over points, as of `solve_plateau`, and over CAD edges
_LEAST_GAP = 1e-9  # smallest reported gap between edges, per length of the curve


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Solves Plateau's problem and writes the patches. Raises an error before solving if the file cannot be written."""
    write = film_writer(arguments)
    is_cad = is_cad_file(arguments.input)
    if is_cad and arguments.unit is not None:
        raise OptionError("CAD files contain their unit; remove --unit")
    curves = _curves(arguments.input, arguments.loop, arguments.closing)
    tolerance = arguments.tolerance or (_OF_EDGES if is_cad else _OF_POINTS)
    with progress("solving") as bar:
        solution = solve_plateau(
            curves[0] if len(curves) == 1 else curves,
            tolerance=tolerance,
            time_limit=arguments.time_limit,
            on_iteration=lambda one: bar.stage(f"{one.method}, step {one.index}, residual {one.residual:.0e}"),
        )
        if isinstance(solution, NoConnectedSurface):
            raise SurfaceError(f"{solution.reason}; solve the curves one by one")
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        bar.stage("film")
        facts, problem = write(solution, arguments)
    show_lines(facts, piped=False)
    if not problem:
        return ExitStatus.DONE
    complain(problem)
    return ExitStatus.IMPERFECT


def film_writer(arguments: argparse.Namespace) -> Callable[[PlateauSolution, argparse.Namespace], tuple[str, str]]:
    """What writes a film to the output. Raises an error if the options do not fit it, or it cannot be written."""
    is_mesh = arguments.output.suffix.lower() in MESH_SUFFIXES
    if is_mesh:
        known_suffix(arguments.output)
        if arguments.unit is not None:
            raise OptionError(f"{arguments.output}: mesh files have no unit; remove --unit, or write a CAD file")
    else:
        require_cad_suffix(arguments.output)
        if arguments.thickness is not None or arguments.edge_length is not None:
            raise OptionError(
                "--thickness and --edge-length are for mesh files, such as film.stl; thicken a shell in the CAD program"
            )
    require_writable(arguments.output, arguments.input)
    return _write_mesh if is_mesh else _write_patches


def _write_patches(solution: PlateauSolution, arguments: argparse.Namespace) -> tuple[str, str]:
    """Writes a CAD file. Returns the figures, and why it is not good."""
    surface = solution.to_nurbs(tolerance=arguments.deviation, time_limit=arguments.time_limit)
    surface.save(arguments.output, unit=arguments.unit or "mm")
    deviations = surface.deviations
    facts = (
        f"{len(surface.patches)} patches, {surface.size} control points, area {surface.area:.9g}, at most "
        f"{deviations.surface:.1e} from the minimal surface and {deviations.rim:.1e} from the curve"
    )
    if not surface.converged:
        return facts, surface.reason
    return facts, "" if solution.converged or arguments.tolerance is None else solution.reason


def _write_mesh(solution: PlateauSolution, arguments: argparse.Namespace) -> tuple[str, str]:
    """Writes a mesh of the surface, or of the solid of some thickness. Returns the figures, and why it is not good."""
    length: float | Literal["auto"] = arguments.edge_length or "auto"
    problems = [] if solution.converged else [solution.reason]
    if arguments.thickness is None:
        patch = mesh_patch(solution, length)
        patch.write(arguments.output)
        return f"{len(patch.faces)} triangles, area {patch.area:.9g}, of the surface {solution.area:.9g}", "; ".join(
            problems
        )
    solid = solution.solid(arguments.thickness, target_edge_length=length, edge=arguments.edge)
    solid.write(arguments.output)
    if solid.intersections:
        where = f"the solid intersects itself at {solid.intersections} pairs of faces"
        problems.append(f"{where}; choose a smaller --thickness or --edge straight")
    return f"{len(solid.faces)} triangles, watertight, volume {solid.volume:.9g}", "; ".join(problems)


def _closed(path: Path, number: int, curve: NamedLoop) -> BoundaryLoop:
    """The loop of a curve of a file, whose repairs are told. Raises a MeshFileError if there is none."""
    for note in curve.notes:
        complain(f"{path}: curve {number}: {note}")
    if curve.loop is None:
        raise MeshFileError(f"{path}: curve {number}: {curve.error}", path=path) from curve.error
    return curve.loop


def _curves(path: Path, chosen: list[int] | None, closing: float) -> list[Any]:
    """The closed curves of a CAD file or a file without faces, or boundary loops of a mesh: all, or those chosen."""
    if is_cad_file(path):
        edges = to_rims(path) if chosen is None else [rim for number in chosen for rim in to_rims(path, number)]
        show_lines(f"{path}: {_description([rim for rim in edges if isinstance(rim, CadCurve)])}", piped=True)
        return edges
    mesh = read_mesh(path)
    if len(mesh.mesh.faces):
        loops: list[Any] = list(boundary_loops(mesh))
    else:
        loops = [
            _closed(path, number, curve) for number, curve in enumerate(curve_loops(mesh.contents, closing=closing))
        ]
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
