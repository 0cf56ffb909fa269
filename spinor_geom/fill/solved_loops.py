"""Solves Plateau's problem for many loops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import perf_counter
from typing import NamedTuple, TypeAlias

from spinor_geom.errors import NoAreaError, SpinorGeomError, SurfaceError
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.loop_choice import free_rim
from spinor_geom.fill.no_holes import require_area
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch

# RMS distance from the loop, in mean edges, above which a surface is not used. Over 120 rough loops, 78 surfaces are
# within 0.01 and 16 are farther than 0.2; none is between.
MAX_RESIDUAL_PER_EDGE = 0.1

Solved: TypeAlias = PlateauSolution | SpinorGeomError


class SolvedLoop(NamedTuple):
    """The exact surface that was found over a loop, why it is not used, and the seconds of the search."""

    solution: PlateauSolution | None
    error: SpinorGeomError | None
    seconds: float


def solved_loops(
    loops: Sequence[BoundaryLoop], options: FillOptions, *, is_rim: bool = True, device: str | None = None
) -> Iterator[SolvedLoop]:
    """The exact surfaces over loops, in their order; the loops may be of several meshes.

    Γ is free between the points of rough loops, as with `between="free"` of `solve_plateau`. Boundary loops of meshes
    (`is_rim`) are first replaced by `free_rim`.
    """
    found = solve_plateau_batch(
        (free_rim(loop, tolerance=options.tolerance) for loop in loops) if is_rim else loops,
        model=options.model,
        tolerance=options.tolerance,
        between="free",
        time_limit=options.seconds_to_solve,
        device=device,
    )
    last = perf_counter()
    for loop, solved in zip(loops, found, strict=True):
        yield solved_loop(loop, solved, perf_counter() - last)
        last = perf_counter()


def solved_loop(loop: BoundaryLoop, solved: Solved, waited: float) -> SolvedLoop:
    """A surface or an error that took some seconds; the surface is not used if it misses the loop or has no area."""
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
