"""Joins several loops by one patch: a bridge between loops, or a hole with the islands in it.

An island is a loose piece of the mesh that lies in a hole.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from spinor_geom.errors import SpinorGeomError, SurfaceError, TwistedRimsError
from spinor_geom.fill.fill_loop import fill_loop
from spinor_geom.fill.fill_options import FillOptions, Islands
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.no_holes import require_hole
from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh, overlapping
from spinor_geom.fill.solved_loops import Solved, placed, solved_loop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import Sheets
from spinor_geom.mesh.loop_frame import LoopFrame, ordered_loops
from spinor_geom.mesh.operators import winding_numbers
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

# Largest height of an island above or below its hole, relative to diagonal / elongation of the hole: 0.57 for a round
# hole of radius 1. There, annuli to islands of radius 0.2, 0.4 and 0.6 exist up to heights of 0.4, 0.7 and 0.85.
_HEIGHT_PER_WIDTH = 0.2


def planned_joins(
    mesh: TriangleMesh,
    sheets: Sheets,
    loops: Sequence[BoundaryLoop],
    wanted: Collection[int],
    islands: Islands,
    bridges: Sequence[Sequence[int]],
) -> tuple[dict[int, tuple[int, ...]], dict[int, str]]:
    """The loops of bridges, and the holes and islands among the other `wanted` loops, that are to be joined.

    Returns:
        The other loops of each join, by the index of its first loop, and remarks on islands, by the hole's index.
    """
    joins = {min(bridge): tuple(sorted(bridge)[1:]) for bridge in bridges}
    notes = dict[int, str]()
    alone = {*wanted} - {index for bridge in bridges for index in bridge}
    for hole, pieces in find_islands(mesh, loops, sheets).items() if alone else ():
        if hole not in alone:
            continue
        joined = [] if islands == "ignore" else [piece for piece in pieces if piece in alone]
        names = ", ".join(map(str, joined or pieces))
        what = "joined to it" if joined else "ignored; islands='join' (--islands join) joins them"
        notes[hole] = f"loose pieces in the hole (loop indices: {names}): {what}"
        if joined:
            joins[hole] = tuple(joined)
    return joins, notes


def find_islands(
    mesh: TriangleMesh, loops: Sequence[BoundaryLoop], sheets: Sheets | None = None
) -> dict[int, tuple[int, ...]]:
    """The islands in each hole, by the hole's index: the indices of the longest loop of each island.

    Such a loop satisfies `lies_in`, and its piece is smaller than that of the hole, by their bounding boxes. If several
    holes contain an island, it belongs to the shortest. `sheets` are those of the mesh, if already computed.
    """
    if len(loops) < 2:
        return {}
    sheets = sheets or Sheets.of(mesh.vertices, mesh.faces)
    component = np.zeros(len(mesh.vertices), dtype=np.int64)
    component[mesh.faces[sheets.face_ids]] = sheets.half_edges.components[:, None]
    own = np.array([component[loop.vertex_ids[0]] for loop in loops])
    if (own == own[0]).all():
        return {}
    order = np.argsort(sheets.half_edges.components, kind="stable")
    first = np.flatnonzero(np.diff(sheets.half_edges.components[order], prepend=-1))
    corners = mesh.vertices[mesh.faces[sheets.face_ids[order]]].transpose(1, 2, 0)
    low, high = (extreme.reduceat(corners, first, axis=2) for extreme in (np.minimum, np.maximum))
    size = np.linalg.norm(high.max(axis=0) - low.min(axis=0), axis=0)[own]
    points, starts = np.concatenate([loop.points for loop in loops]), np.cumsum([0, *map(len, loops[:-1])])
    lows, highs = (extreme.reduceat(points, starts) for extreme in (np.minimum, np.maximum))
    reach = np.linalg.norm(highs - lows, axis=1)[:, None]
    # the enlarged boxes of the loops, those of the largest pieces first
    order = np.argsort(-size, kind="stable")
    larger = np.searchsorted(-size[order], -size, side="left")  # number of loops of larger pieces
    around_lows, around_highs = (np.ascontiguousarray(box[order].T) for box in (lows - reach, highs + reach))
    found: dict[int, list[int]] = {}
    # loops come longest first
    for piece in np.unique(own, return_index=True)[1].tolist():
        centre = (lows[piece] + highs[piece]) / 2
        count = larger[piece]
        holes = order[overlapping(around_lows[:, :count], around_highs[:, :count], centre, centre)]
        for hole in np.sort(holes)[::-1].tolist():
            if lies_in(loops[piece], loops[hole]):
                found.setdefault(hole, []).append(piece)
                break
    return {hole: tuple(pieces) for hole, pieces in found.items()}


def lies_in(piece: BoundaryLoop, hole: BoundaryLoop) -> bool:
    """Whether a loop, projected to the plane of a hole, lies inside the hole, and is near that plane."""
    plane = hole.plane
    inside, around = piece.points - plane.centroid, hole.points - plane.centroid
    limit = np.abs(around @ plane.normal).max() + _HEIGHT_PER_WIDTH * hole.diagonal / hole.elongation
    if np.abs(inside @ plane.normal).max() > limit:
        return False
    axes = np.linalg.svd(plane.normal[None])[2][1:]
    # the winding number is ±1 inside, and a fraction where the piece touches the hole's boundary
    return bool((np.abs(winding_numbers(around @ axes.T, inside @ axes.T)) > 0.9).all())


def fill_between(
    patched: PatchedMesh, indices: Sequence[int], loops: Sequence[BoundaryLoop], options: FillOptions
) -> tuple[list[LoopOutcome], LoopPatch | None]:
    """Joins several loops of the mesh by one patch. Returns the outcomes of all loops, and the patch or None."""
    first, *others = indices
    options = replace(options, continuity=options.continuity_of(*indices))
    options.on_stage(first, "exact surface")
    begin = perf_counter()
    rims = ordered_loops([loops[index] for index in indices])
    frame = LoopFrame.of(*rims)
    local = [frame.loop(rim) for rim in rims]
    surface: Solved
    try:
        for rim in rims:
            require_hole(rim, patched)
        surface = _surface_between(indices, local, options, are_borders=all(patched.turning(rim) > 0 for rim in rims))
    except SpinorGeomError as error:
        surface = error
    solved = placed(solved_loop(local[0], surface, perf_counter() - begin), frame, *rims)
    outcome, patch = fill_loop(patched, first, loops[first], solved, options, rims=rims, joined_to=others[0])
    further = [
        LoopOutcome(
            index=index,
            loop=loops[index],
            requested=True,
            filled=outcome.filled,
            reason=outcome.reason,
            solution=outcome.solution if outcome.filled else None,
            continuation=outcome.continuation,
            joined_to=following,
            remarks=loops[index].remarks,
            timings={},
        )
        for index, following in zip(others, [*others[1:], first], strict=True)
    ]
    return [outcome, *further], patch


def _surface_between(
    indices: Sequence[int], rims: Sequence[BoundaryLoop], options: FillOptions, *, are_borders: bool
) -> PlateauSolution:
    """The exact surface between loops. Raises a SurfaceError if there is none."""
    solution = solve_plateau(
        rims, model=options.model, tolerance=options.tolerance, between="free", time_limit=options.seconds_to_solve
    )
    if isinstance(solution, NoConnectedSurface):
        advice = f"fill the {'two ' if len(indices) == 2 else ''}loops one by one instead"
        if are_borders:
            advice = (
                "the loops are the outer borders of open sheets, and only parts of them face each other: join the "
                "sheets by two triangles at each end of the gap, and fill the remaining hole without bridge= "
                "(--bridge)"
            )
        raise SurfaceError(f"{solution.reason}; {advice}")
    if solution.annulus is not None and solution.annulus.reversed:
        # the patch would join the outside of one rim to the inside of the other
        raise TwistedRimsError(loops=tuple(indices))
    return solution
