"""Fills the loops of one mesh, each with the surface that was found for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.bridge import Joins, fill_between
from spinor_geom.fill.loops import free_rim
from spinor_geom.fill.one_loop import FillOptions, fill_loop, unfilled
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.stitch import LoopPatch, RimEdges
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch


def fill_loops(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop],
    surfaces: Iterator[PlateauSolution | SpinorGeomError],
    taken: RimEdges,
    options: FillOptions,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
    *,
    reasons: Mapping[int, str] | None = None,
    refusals: Mapping[int, SpinorGeomError] | None = None,
    joins: Joins | None = None,
) -> tuple[list[LoopOutcome], list[LoopPatch]]:
    """One outcome for every loop, and the patches of those that are filled.

    Args:
        mesh: the mesh.
        loops: all of its loops.
        surfaces: for each loop that is to be filled by itself, in order, its surface, or why it has none.
        taken: edges that no patch may have; takes those of the patches.
        options: of the call.
        on_loop: is called after each loop that was asked for, with its outcome and their number.
        reasons: of the loops that the caller wants left open, by their places.
        refusals: of the loops that were asked for and are no holes, by their places.
        joins: what is joined to what; by default nothing.
    """
    reasons, refusals, joins = reasons or {}, refusals or {}, joins or Joins()
    surroundings = Surroundings(mesh)
    outcomes: dict[int, LoopOutcome] = {}
    patches: list[LoopPatch] = []
    for place, loop in enumerate(loops):
        if place in outcomes:
            continue
        patch: LoopPatch | None = None
        done: tuple[LoopOutcome, ...]
        if place in reasons:
            outcomes[place] = unfilled(place, loop, reasons[place], requested=False)
            continue
        if place in refusals:
            error = refusals[place]
            done = (unfilled(place, loop, str(error), is_border=isinstance(error, SheetBorderError)),)
        elif place in joins.others:
            done, patch = fill_between(mesh, (place, *joins.others[place]), loops, taken, surroundings, options)
        else:
            outcome, patch = fill_loop(mesh, place, loop, partial(next, surfaces), taken, surroundings, options)
            done = (outcome,)
        if place in joins.notes and done[0].filled:
            done = (replace(done[0], remarks=(*done[0].remarks, joins.notes[place])), *done[1:])
        if patch is not None:
            patches.append(patch)
        for outcome in done:
            outcomes[outcome.index] = outcome
            if on_loop is not None:
                on_loop(outcome, len(loops) - len(reasons))
    return [outcomes[place] for place in range(len(loops))], patches


def minimal_surfaces(
    loops: Iterable[BoundaryLoop], options: FillOptions, *, is_rim: bool = True, device: str = "cpu"
) -> Iterator[PlateauSolution | SpinorGeomError]:
    """For each loop in order its surface, or why it has none; small loops of similar size are solved side by side.

    Between the points of rough loops Γ is free.

    Args:
        loops: any, also of several meshes.
        options: of the call.
        is_rim: whether they are rims of meshes, whose corners are those of triangles.
        device: of the linear algebra.
    """
    return solve_plateau_batch(
        (free_rim(loop, tolerance=options.tolerance) for loop in loops) if is_rim else loops,
        model=options.model,
        tolerance=options.tolerance,
        between="free",
        time_limit=options.time_limit,
        device=device,
    )
