"""Fills the loops of one mesh, each with the surface that was found for it, and bridges between them.

Islands are loose pieces that lie in a hole; they are joined to its rim, or ignored.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from spinor_geom.errors import OptionError, SpinorGeomError, SurfaceError, TwistedRimsError
from spinor_geom.fill.discrete_patch import refuse_what_is_no_hole
from spinor_geom.fill.loops import free_rim
from spinor_geom.fill.one_loop import Answer, FillOptions, Solved, exact_patches, fill_loop
from spinor_geom.fill.options import Islands
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.surroundings import LoopPatch, Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import winding_numbers
from spinor_geom.mesh.topology import face_components
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.solution import NoConnectedSurface
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch

# An island lies no farther over or under the plane of its hole than the hole itself, and this share of its box's
# diagonal, of a long hole divided by its elongation. For a round hole of radius 1 that is a height of 0.57; it has an
# annulus to pieces of radius 0.2, 0.4 and 0.6 up to heights of 0.4, 0.7 and 0.85.
_HEIGHT_PER_WIDTH = 0.2

Loops: TypeAlias = Sequence[BoundaryLoop]
_WAITING = 1.0  # seconds that a surface may wait for others to be meshed together; their meshes do not depend on it


def planned_joins(
    mesh: TriangleMesh, loops: Loops, wanted: Collection[int], islands: Islands, bridge: Sequence[int] | None
) -> tuple[dict[int, tuple[int, ...]], dict[int, str]]:
    """The bridge that was asked for, or the islands in the holes that are to be filled, and what is to be said of them.

    Both by the first place of those that are joined, the bridge with all others. One of a single loop, or from a loop
    to itself, is an OptionError.
    """
    if bridge is not None:
        if len(bridge) < 2:
            raise OptionError(f"a bridge joins two loops or more, got {len(bridge)}; name another, or fill it alone")
        first, *others = sorted(bridge)
        if twice := [place for place in bridge if list(bridge).count(place) > 1]:
            raise OptionError(f"a bridge joins different loops, got loop {twice[0]} twice; name another")
        return {first: tuple(others)}, {}
    joins, notes = dict[int, tuple[int, ...]](), dict[int, str]()
    for hole, pieces in find_islands(mesh, loops).items():
        if hole not in wanted:
            continue
        open_pieces = [piece for piece in pieces if piece in wanted]
        if islands == "ignore" or not open_pieces:
            names = ", ".join(map(str, pieces))
            notes[hole] = f"a loose piece lies in the hole (loop {names}); it was ignored: islands='join' joins it"
        else:
            joins[hole] = tuple(open_pieces)
            names, (s, were) = ", ".join(map(str, open_pieces)), ("", "was") if len(open_pieces) == 1 else ("s", "were")
            notes[hole] = f"the loose piece{s} in the hole (loop{s} {names}) {were} joined to it"
    return joins, notes


def fill_between(
    surroundings: Surroundings, places: tuple[int, ...], loops: Loops, options: FillOptions
) -> tuple[tuple[LoopOutcome, ...], LoopPatch | None]:
    """The patch between several of a mesh's loops, with the outcomes of all, or the reason why there is none."""
    first, *others = places
    options.on_stage(first, "exact surface")
    begin = perf_counter()
    found: Solved
    try:
        for place in places:
            refuse_what_is_no_hole(loops[place], surroundings)
        rims = [loops[place] for place in places]
        solution = solve_plateau(
            rims, model=options.model, tolerance=options.tolerance, between="free", time_limit=options.time_limit
        )
        if isinstance(solution, NoConnectedSurface):
            advice = f"fill the {'two ' if len(places) == 2 else ''}loops one by one instead"
            if all(surroundings.is_outline(rim) for rim in rims):
                advice = (
                    "the loops are the outer borders of open sheets, and only parts of them face each other: join the "
                    "sheets by two triangles at each end of the gap, and fill the hole that this leaves, without "
                    "bridge= (--bridge)"
                )
            raise SurfaceError(f"{solution.reason}; {advice}")
        # the outside of one rim would be joined to the inside of another
        if solution.annulus is not None and solution.annulus.reversed:
            raise TwistedRimsError(loops=places)
        found = solution
    except SpinorGeomError as error:
        found = error
    (answer,) = exact_patches([(loops[first], found, perf_counter() - begin)], options)
    beyond = {place: loops[place] for place in others}
    here, patch = fill_loop(surroundings, first, loops[first], answer, options, others=beyond)
    there = [
        LoopOutcome(
            index=place,
            loop=loops[place],
            requested=True,
            filled=here.filled,
            reason=here.reason,
            solution=here.solution,
            continuation=here.continuation,
            joined_to=following,
            remarks=loops[place].remarks,
            timings={},
        )
        for place, following in zip(others, [*others[1:], first], strict=True)
    ]
    return (here, *there), patch


def find_islands(mesh: TriangleMesh, loops: Loops) -> dict[int, tuple[int, ...]]:
    """The loose pieces that lie in holes: for the place of a hole those of the pieces' rims.

    A piece is loose in a hole if its longest rim, seen along the normal of the hole's plane, lies inside the hole, is
    shorter than that, and not far over or under it; of several holes around it the shortest counts.
    """
    if len(loops) < 2:
        return {}
    component = np.zeros(len(mesh.vertices), dtype=np.int64)
    component[mesh.faces] = face_components(mesh.faces)[:, None]
    own = np.array([component[loop.vertex_ids[0]] for loop in loops])
    if (own == own[0]).all():
        return {}
    lows, highs = (np.array([limit(loop.points, axis=0) for loop in loops]) for limit in (np.min, np.max))
    reach = np.linalg.norm(highs - lows, axis=1)[:, None]
    found: dict[int, list[int]] = {}
    # loops come longest first
    for piece in np.unique(own, return_index=True)[1].tolist():
        # loops whose boxes, made wider, hold the centre of the piece's
        centre = (lows[piece] + highs[piece]) / 2
        boxes_around = ((lows - reach <= centre) & (centre <= highs + reach)).all(axis=1)
        around = np.flatnonzero(boxes_around & (own != own[piece]))
        for hole in around[around < piece][::-1].tolist():
            if _lies_in(loops[piece], loops[hole]):
                found.setdefault(hole, []).append(piece)
                break
    return {hole: tuple(pieces) for hole, pieces in found.items()}


def _lies_in(piece: BoundaryLoop, hole: BoundaryLoop) -> bool:
    plane = hole.plane
    inside, around = piece.points - plane.centroid, hole.points - plane.centroid
    limit = np.abs(around @ plane.normal).max() + _HEIGHT_PER_WIDTH * hole.diagonal / hole.elongation
    if np.abs(inside @ plane.normal).max() > limit:
        return False
    axes = np.linalg.svd(plane.normal[None])[2][1:]
    # of a point that the piece shares with the hole it is a fraction: those touch, and nothing joins them
    return bool((np.abs(winding_numbers(around @ axes.T, inside @ axes.T)) > 0.9).all())


def fill_loops(
    surroundings: Surroundings,
    loops: Loops,
    answers: Iterator[Answer],
    options: FillOptions,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
    *,
    left_open: Mapping[int, LoopOutcome] = MappingProxyType({}),
    joins: Mapping[int, tuple[int, ...]] = MappingProxyType({}),
    notes: Mapping[int, str] = MappingProxyType({}),
) -> tuple[list[LoopOutcome], list[LoopPatch]]:
    """One outcome for each of a mesh's loops, and the patches of those that are filled, which join the surroundings.

    The answers are those of the loops that are to be filled by themselves, in order; `left_open` has the outcomes of
    the loops that nothing is tried for, by their places; `joins` and `notes` are as `planned_joins` gives them.
    """
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
        elif place in joins:
            done, patch = fill_between(surroundings, (place, *joins[place]), loops, options)
        else:
            options.on_stage(place, "exact surface")
            outcome, patch = fill_loop(surroundings, place, loop, next(answers), options)
            done = (outcome,)
        if place in notes and done[0].filled:
            done = (replace(done[0], remarks=(*done[0].remarks, notes[place])), *done[1:])
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
    loops: Loops, options: FillOptions, *, is_rim: bool = True, device: str = "cpu"
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
