"""Fills the loops of one mesh, each with the surface that was found for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.bridge import Joins, fill_between
from spinor_geom.fill.one_loop import FillOptions, fill_loop
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
    reasons: Sequence[str | None],
    surfaces: Iterator[PlateauSolution | SpinorGeomError],
    taken: RimEdges,
    options: FillOptions,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
    *,
    joins: Joins | None = None,
) -> tuple[list[LoopOutcome], list[LoopPatch]]:
    """One outcome for every loop, and the patches of those that are filled.

    Args:
        mesh: the mesh.
        loops: all of its loops.
        reasons: for each why it is to stay open, or None.
        surfaces: for each of the others that is filled by itself, in order, its surface, or why it has none.
        taken: edges that no patch may have; takes those of the patches.
        options: of the call.
        on_loop: is called after each loop that is not to stay open, with its outcome and their number.
        joins: what is joined to what; by default nothing.
    """
    joins = joins or Joins()
    surroundings = Surroundings(mesh)
    requested = sum(reason is None for reason in reasons)
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
            done, patch = fill_between(mesh, (place, joins.pairs[place]), loops, taken, surroundings, options)
        else:
            solve = partial(_raise, joins.refused[place]) if place in joins.refused else partial(_next, surfaces)
            outcome, patch = fill_loop(mesh, place, loop, solve, taken, surroundings, options)
            done = (outcome,)
        if place in joins.notes and done[0].filled:
            done = (replace(done[0], remarks=(*done[0].remarks, joins.notes[place])), *done[1:])
        if patch is not None:
            patches.append(patch)
        for outcome in done:
            outcomes[outcome.index] = outcome
            if on_loop is not None:
                on_loop(outcome, requested)
    return [outcomes[place] for place in range(len(loops))], patches


def minimal_surfaces(
    loops: Sequence[BoundaryLoop],
    refusals: Sequence[SpinorGeomError | None],
    options: FillOptions,
    *,
    device: str = "cpu",
) -> Iterator[PlateauSolution | SpinorGeomError]:
    """For each loop in order its surface, or why it has none; small loops of similar size are solved side by side.

    Args:
        loops: any, also of several meshes.
        refusals: for each why it is not to be solved, or None.
        options: of the call.
        device: of the linear algebra.
    """
    accepted = (loop for loop, error in zip(loops, refusals, strict=True) if error is None)
    solutions = solve_plateau_batch(accepted, model=options.model, tolerance=options.tolerance, device=device)
    for error in refusals:
        yield next(solutions) if error is None else error


def _raise(error: SpinorGeomError) -> PlateauSolution:
    raise error


def _next(surfaces: Iterator[PlateauSolution | SpinorGeomError]) -> PlateauSolution:
    """The next surface; raises the error in its place."""
    surface = next(surfaces)
    if isinstance(surface, SpinorGeomError):
        raise surface
    return surface
