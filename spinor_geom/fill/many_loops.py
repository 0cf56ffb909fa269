"""Fills the loops of one mesh, each with the surface that was found for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

from spinor_geom.fill.bridge import Joins, fill_between
from spinor_geom.fill.loops import free_rim
from spinor_geom.fill.one_loop import Answer, FillOptions, Solved, exact_patches, fill_loop
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.stitch import LoopPatch
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solve import solve_plateau_batch

# Seconds that a surface may wait for others to be meshed together; their meshes do not depend on it.
_WAITING = 1.0


def fill_loops(
    surroundings: Surroundings,
    loops: Sequence[BoundaryLoop],
    answers: Iterator[Answer],
    options: FillOptions,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
    *,
    left_open: Mapping[int, LoopOutcome] | None = None,
    joins: Joins | None = None,
) -> tuple[list[LoopOutcome], list[LoopPatch]]:
    """One outcome for every loop, and the patches of those that are filled.

    Args:
        surroundings: the mesh; takes the patches.
        loops: all of its loops.
        answers: for each loop that is to be filled by itself, in order, its exact patch, or why it has none.
        options: of the call.
        on_loop: as for `fill_hole`.
        left_open: outcomes of the loops that nothing is tried for, by their places.
        joins: what is joined to what; by default nothing.
    """
    left_open, joins = left_open or {}, joins or Joins()
    asked = len(loops) - sum(not _was_asked(outcome) for outcome in left_open.values())
    outcomes: dict[int, LoopOutcome] = {}
    patches: list[LoopPatch] = []
    for place, loop in enumerate(loops):
        if place in outcomes:
            continue
        patch: LoopPatch | None = None
        done: tuple[LoopOutcome, ...]
        if place in left_open:
            done = (left_open[place],)
        elif place in joins.others:
            done, patch = fill_between(surroundings, (place, *joins.others[place]), loops, options)
        else:
            outcome, patch = fill_loop(surroundings, place, loop, partial(next, answers), options)
            done = (outcome,)
        if place in joins.notes and done[0].filled:
            done = (replace(done[0], remarks=(*done[0].remarks, joins.notes[place])), *done[1:])
        if patch is not None:
            patches.append(patch)
        for outcome in done:
            outcomes[outcome.index] = outcome
            if on_loop is not None and _was_asked(outcome):
                on_loop(outcome, asked)
    return [outcomes[place] for place in range(len(loops))], patches


def _was_asked(outcome: LoopOutcome) -> bool:
    return outcome.requested or outcome.is_border


def minimal_patches(
    loops: Sequence[BoundaryLoop], options: FillOptions, *, is_rim: bool = True, device: str = "cpu"
) -> Iterator[Answer]:
    """For each loop in order its surface and that one's mesh, or why there is none; small ones are made side by side.

    Between the points of rough loops Γ is free. Loops may be of several meshes; the corners of rims are those of
    triangles.
    """
    found = solve_plateau_batch(
        (free_rim(loop, tolerance=options.tolerance) for loop in loops) if is_rim else loops,
        model=options.model,
        tolerance=options.tolerance,
        between="free",
        time_limit=options.time_limit,
        device=device,
    )
    waiting: list[tuple[BoundaryLoop, Solved, float]] = []
    start = last = perf_counter()
    for loop, one in zip(loops, found, strict=True):
        now = perf_counter()
        waiting.append((loop, one, now - last))
        last = now
        if now - start > _WAITING:
            yield from exact_patches(waiting, options)
            waiting.clear()
            start = last = perf_counter()
    yield from exact_patches(waiting, options)
