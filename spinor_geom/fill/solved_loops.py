"""Solves Plateau's problem for many loops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import perf_counter
from typing import NamedTuple, TypeAlias

from spinor_geom.errors import NoAreaError, RepeatedPointError, SpinorGeomError, SurfaceError, in_mesh_units
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.loop_choice import free_rim
from spinor_geom.fill.no_holes import require_area
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch

# RMS distance from the loop, in mean edges, above which a surface is not used. Over 120 rough loops, 78 surfaces are
# within 0.01 and 16 are farther than 0.2. None is between.
MAX_RESIDUAL_PER_EDGE = 0.1

Solved: TypeAlias = PlateauSolution | SpinorGeomError


class SolvedLoop(NamedTuple):
    """The exact surface that was found over a loop, why it is not used, and the seconds of the search."""

    solution: PlateauSolution | None
    error: SpinorGeomError | None
    seconds: float
    frame: LoopFrame | None = None  # of the loop, or of several
    in_frame: PlateauSolution | None = None  # the surface in this frame, where it was computed


def solved_loops(
    loops: Sequence[BoundaryLoop], options: FillOptions, *, is_rim: bool = True, device: str | None = None
) -> Iterator[SolvedLoop]:
    """The exact surfaces over loops, in their order. The loops may be of several meshes.

    Γ is free between the points of rough loops, as with `between="free"` of `solve_plateau`. Boundary loops of meshes
    (`is_rim`) are first replaced by `free_rim`. Surfaces are computed in the loops' own frames, so that they
    do not depend on position, units, and the numbers of the vertices.
    """
    rims = [free_rim(loop, tolerance=options.tolerance) for loop in loops] if is_rim else loops
    frames = [LoopFrame.of(rim) for rim in rims]
    local = [frame.loop(rim) for frame, rim in zip(frames, rims, strict=True)]
    found = solve_plateau_batch(
        local,
        model=options.model,
        tolerance=options.tolerance,
        between="free",
        time_limit=options.seconds_to_solve,
        device=device,
    )
    last = perf_counter()
    for rim, frame, loop, solved in zip(rims, frames, local, found, strict=True):
        yield placed(solved_loop(loop, solved, perf_counter() - last), frame, rim)
        last = perf_counter()


def placed(local: SolvedLoop, frame: LoopFrame, *loops: BoundaryLoop) -> SolvedLoop:
    """The surface over a loop or between several, or the error, from those in their frame."""
    solution, error = local.solution, local.error
    if isinstance(error, RepeatedPointError):
        count = len(loops[0])
        place = error.fields["index"] + frame.is_backward
        error = RepeatedPointError(index=int(frame.order(count)[place % count]))
    elif error is not None:
        error = in_mesh_units(error, frame.size)
    outside = None if solution is None else solution.placed_by(frame, *loops)
    return SolvedLoop(outside, error, local.seconds, frame, solution)


def solved_loop(loop: BoundaryLoop, solved: Solved, waited: float) -> SolvedLoop:
    """A surface or an error that took some seconds. The surface is not used if it misses the loop or has no area."""
    if isinstance(solved, SpinorGeomError):
        return SolvedLoop(None, solved, waited)
    # the timings of a solution are its share of a common solve
    return SolvedLoop(solved, _reason_against(loop, solved), sum(solved.timings.values()))


def _reason_against(loop: BoundaryLoop, surface: PlateauSolution) -> SpinorGeomError | None:
    if not surface.boundary_residual.rms_per_edge <= MAX_RESIDUAL_PER_EDGE:
        return SurfaceError(f"no surface was found that follows the loop; the best one: {surface.reason}")
    try:
        require_area(loop, 2 * surface.area / loop.perimeter)
    except NoAreaError as error:
        return error
    return None
