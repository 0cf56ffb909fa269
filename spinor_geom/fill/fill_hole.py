"""Fills the holes of a mesh with minimal surfaces."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Literal, TypeVar, overload

from spinor_geom.adapters import MeshFile, extend, read_mesh, to_mesh
from spinor_geom.errors import OptionError
from spinor_geom.fill.bridge import Islands, planned_joins
from spinor_geom.fill.clock import Clock
from spinor_geom.fill.loops import LoopChoice, chosen_places, loops_of, reasons_to_leave_open
from spinor_geom.fill.many_loops import fill_loops, minimal_surfaces
from spinor_geom.fill.one_loop import FillOptions, refusal, require_positive
from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.fill.stitch import RimEdges, joined, stitch
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.plateau.task import Model
from spinor_geom.plateau.threads import one_thread

MeshT = TypeVar("MeshT")


@overload
def fill_hole(
    mesh: str | os.PathLike[str],
    loop: LoopChoice = "all",
    *,
    islands: Islands = "ignore",
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    return_report: Literal[False] = False,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
) -> MeshFile: ...
@overload
def fill_hole(
    mesh: str | os.PathLike[str],
    loop: LoopChoice = "all",
    *,
    islands: Islands = "ignore",
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    return_report: Literal[True],
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
) -> tuple[MeshFile, FillResult]: ...
@overload
def fill_hole(
    mesh: MeshT,
    loop: LoopChoice = "all",
    *,
    islands: Islands = "ignore",
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    return_report: Literal[False] = False,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
) -> MeshT: ...
@overload
def fill_hole(
    mesh: MeshT,
    loop: LoopChoice = "all",
    *,
    islands: Islands = "ignore",
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    return_report: Literal[True],
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
) -> tuple[MeshT, FillResult]: ...
def fill_hole(
    mesh: Any,
    loop: LoopChoice = "all",
    *,
    islands: Islands = "ignore",
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    return_report: bool = False,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
) -> Any:
    """Fills holes of a mesh, each with a minimal surface that its boundary loop bounds.

    The input is not changed. In the result its vertices, faces and attributes come first, as they were; the patches
    follow loop by loop, share the loop's vertices and are oriented like their neighbours. Vertex attributes are
    interpolated harmonically, normals are those of the surface. A loop that cannot be filled stays open; its reason is
    in the report. Where a patch crosses itself (over a knotted loop every disk does), the mesh or another patch, it is
    kept and the report says so.

    Which point of one rim of a bridge lies opposite to which of the other comes from the surface. Rims too far from
    each other have no annulus between them and stay open, as do those of pieces that are inside out to each other.

    Args:
        mesh: a path, a (vertices, faces) pair of arrays or tensors, or any mesh type that has an adapter.
        loop: which holes: "all", a place in `boundary_loops(mesh)`, a list of places, or one of those loops; a pair of
            places (i, j) joins these two loops by a minimal annulus, a bridge.
        islands: "join" fills a hole in which a loose piece lies by an annulus between both, "ignore" fills hole and
            piece each by themselves; the report says which pieces lie in which holes.
        keep_largest: leaves the loop of longest perimeter open, such as the outer border of a scan.
        max_perimeter: leaves loops longer than this open, in mesh units.
        target_edge_length: of the patches, in mesh units; "auto" takes each loop's mean edge length.
        model: the holomorphic model, as `solve_plateau` takes it.
        tolerance: root mean square distance between a patch's boundary and the curve through its loop, per mean edge
            of the loop; a fill that misses it is kept and reported as not converged, and so is one that misses a part
            of the loop by more than a hundred times as many of the edges there.
        return_report: also returns a `FillResult`.
        on_loop: is called after each requested loop with its outcome and the number of requested loops.

    Returns:
        The filled mesh, of the type of the input; a `MeshFile` for a path. With `return_report` a pair of it and the
        `FillResult`.

    Raises:
        UnknownMeshTypeError: no adapter knows the type.
        MeshFileError: the file is missing or malformed.
        MeshError: the mesh has no unambiguous boundary.
        LoopIndexError: `loop` names a place that does not exist.
        ForeignLoopError: `loop` is not a loop of this mesh.
        TooManyRimsError: a tuple names more loops than two, or fewer.
        OptionError: an option has a value that is not allowed.
    """
    if islands not in ("join", "ignore"):
        raise OptionError(f"islands must be 'join' or 'ignore', not {islands!r}")
    if max_perimeter is not None:
        require_positive("max_perimeter", max_perimeter)
    options = FillOptions(target_edge_length=target_edge_length, model=model, tolerance=tolerance)
    clock = Clock()
    source = read_mesh(mesh) if isinstance(mesh, (str, os.PathLike)) else mesh
    triangles = to_mesh(source)
    clock.lap("read")
    loops = loops_of(source, triangles)
    places = chosen_places(loop, loops)
    reasons = reasons_to_leave_open(loops, places, keep_largest=keep_largest, max_perimeter=max_perimeter)
    if isinstance(loop, BoundaryLoop):
        loops[places[0]] = loop  # keeps the corners that the caller gave it
    joins = planned_joins(triangles, loop, loops, reasons, islands)
    clock.lap("loops")
    with one_thread():
        taken = RimEdges(triangles, loops)
        requested = [
            entry
            for place, (entry, reason) in enumerate(zip(loops, reasons, strict=True))
            if reason is None and place not in joins.alone
        ]
        surfaces = minimal_surfaces(requested, [refusal(entry, taken) for entry in requested], options)
        outcomes, patches = fill_loops(triangles, loops, reasons, surfaces, taken, options, on_loop, joins=joins)
    clock.lap("fill")
    extension = stitch(triangles, patches)
    filled = extend(source, extension)
    watertight = is_watertight(joined(triangles, extension).faces)
    clock.lap("stitch")
    if not return_report:
        return filled
    return filled, FillResult(
        mesh=filled,
        original=triangles,
        extension=extension,
        loops=tuple(outcomes),
        notes=source.notes if isinstance(source, MeshFile) else (),
        watertight=watertight,
        timings=clock.laps(),
    )
