"""Fills the holes of a mesh with minimal surfaces."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, TypeAlias, TypeVar, overload

from spinor_geom.adapters import MeshFile, extend, read_mesh, to_mesh
from spinor_geom.errors import OptionError, SpinorGeomError, TooManyRimsError
from spinor_geom.fill.bridge import fill_between, find_islands, require_two
from spinor_geom.fill.clock import Clock
from spinor_geom.fill.loops import LoopChoice, chosen_places, reasons_to_leave_open
from spinor_geom.fill.one_loop import FillOptions, fill_loop, refuse_what_is_no_hole, require_positive
from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.fill.stitch import LoopPatch, RimEdges, joined, stitch
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch
from spinor_geom.plateau.task import Model
from spinor_geom.plateau.threads import one_thread

MeshT = TypeVar("MeshT")
Islands: TypeAlias = Literal["join", "ignore"]


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
            of the loop; a fill that misses it is kept and reported as not converged.
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
    loops = find_boundary_loops(triangles)
    places = chosen_places(loop, loops)
    reasons = reasons_to_leave_open(loops, places, keep_largest=keep_largest, max_perimeter=max_perimeter)
    if isinstance(loop, BoundaryLoop):
        loops[places[0]] = loop  # keeps the corners that the caller gave it
    joins = _joins(triangles, loop, loops, reasons, islands)
    clock.lap("loops")
    with one_thread():
        outcomes, patches = _fill_loops(triangles, loops, reasons, joins, options, on_loop)
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
        watertight=watertight,
        timings=clock.laps(),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joins:
    """What is joined to what.

    Attributes:
        pairs: for the first place of each bridge the second.
        refused: errors of loops that cannot be joined as they should be.
        notes: of the loops of whose gaps something is to be said.
    """

    pairs: dict[int, int]
    refused: dict[int, SpinorGeomError]
    notes: dict[int, str]

    @property
    def alone(self) -> set[int]:
        """Places that are not filled by themselves."""
        return {*self.pairs, *self.pairs.values(), *self.refused}


def _joins(
    mesh: TriangleMesh,
    choice: LoopChoice,
    loops: Sequence[BoundaryLoop],
    reasons: Sequence[str | None],
    islands: Islands,
) -> _Joins:
    """The bridge that was asked for, or the islands in the holes that are to be filled."""
    if isinstance(choice, tuple):
        first, second = require_two(choice, loops)
        return _Joins(pairs={first: second}, refused={}, notes={})
    pairs: dict[int, int] = {}
    refused: dict[int, SpinorGeomError] = {}
    notes: dict[int, str] = {}
    for hole, pieces in find_islands(mesh, loops).items():
        if reasons[hole] is not None:
            continue
        open_pieces = [piece for piece in pieces if reasons[piece] is None]
        if islands == "ignore" or not open_pieces:
            names = ", ".join(map(str, pieces))
            notes[hole] = f"a loose piece lies in the hole (loop {names}); it was ignored: islands='join' joins it"
        elif len(open_pieces) == 1:
            pairs[hole] = open_pieces[0]
            notes[hole] = f"the loose piece in the hole (loop {open_pieces[0]}) was joined to it"
        else:
            places = [hole, *open_pieces]
            error = TooManyRimsError(sizes=[len(loops[place]) for place in places], names=places)
            refused.update(dict.fromkeys(places, error))
    return _Joins(pairs=pairs, refused=refused, notes=notes)


def _fill_loops(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop],
    reasons: Sequence[str | None],
    joins: _Joins,
    options: FillOptions,
    on_loop: Callable[[LoopOutcome, int], None] | None,
) -> tuple[list[LoopOutcome], list[LoopPatch]]:
    """One outcome for every loop, and the patches of those that are filled."""
    taken, surroundings = RimEdges(mesh, loops), Surroundings(mesh)
    requested = [place for place, reason in enumerate(reasons) if reason is None]
    surfaces = _minimal_surfaces([loops[place] for place in requested if place not in joins.alone], taken, options)
    outcomes: dict[int, LoopOutcome] = {}
    patches: list[LoopPatch] = []
    for place, (loop, reason) in enumerate(zip(loops, reasons, strict=True)):
        if place in outcomes:
            continue
        if reason is not None:
            outcomes[place] = LoopOutcome(
                index=place, loop=loop, requested=False, filled=False, reason=reason, timings={}
            )
            continue
        done: tuple[LoopOutcome, ...]
        if place in joins.pairs:
            pair = (place, joins.pairs[place])
            done, patch = fill_between(mesh, pair, loops, taken, surroundings, options)
        else:
            solve = partial(_raise, joins.refused[place]) if place in joins.refused else partial(_next, surfaces)
            outcome, patch = fill_loop(mesh, place, loop, solve, taken, surroundings, options)
            done = (outcome,)
        if place in joins.notes and done[0].filled:
            done = (replace(done[0], notes=(*done[0].notes, joins.notes[place])), *done[1:])
        if patch is not None:
            patches.append(patch)
        for outcome in done:
            outcomes[outcome.index] = outcome
            if on_loop is not None:
                on_loop(outcome, len(requested))
    return [outcomes[place] for place in range(len(loops))], patches


def _raise(error: SpinorGeomError) -> PlateauSolution:
    raise error


def _minimal_surfaces(
    loops: Sequence[BoundaryLoop], taken: RimEdges, options: FillOptions
) -> Iterator[PlateauSolution | SpinorGeomError]:
    """For each loop in order its surface, or why it has none."""
    refusals = [_refusal(loop, taken) for loop in loops]
    holes = (loop for loop, error in zip(loops, refusals, strict=True) if error is None)
    solutions = solve_plateau_batch(holes, model=options.model, tolerance=options.tolerance)
    for error in refusals:
        yield next(solutions) if error is None else error


def _refusal(loop: BoundaryLoop, taken: RimEdges) -> SpinorGeomError | None:
    try:
        refuse_what_is_no_hole(loop, taken)
    except SpinorGeomError as error:
        return error
    return None


def _next(surfaces: Iterator[PlateauSolution | SpinorGeomError]) -> PlateauSolution:
    """The next surface; raises the error in its place."""
    surface = next(surfaces)
    if isinstance(surface, SpinorGeomError):
        raise surface
    return surface
