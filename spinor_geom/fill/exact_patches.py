"""Solves Plateau's problem for many loops, and meshes the surfaces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from time import perf_counter
from typing import NamedTuple, TypeAlias

import numpy as np

from spinor_geom.deadline import time_limit
from spinor_geom.errors import NoAreaError, SpinorGeomError, SurfaceError
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.loop_choice import free_rim
from spinor_geom.fill.no_holes import require_area
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau_batch

# RMS distance from the loop, in mean edges, above which a surface is not used. Over 120 rough loops, 78 surfaces are
# within 0.01 and 16 are farther than 0.2; none is between.
MAX_RESIDUAL_PER_EDGE = 0.1

Solved: TypeAlias = PlateauSolution | SpinorGeomError


class SolvedLoop(NamedTuple):
    """The exact surface over a loop and its mesh, or the error instead; seconds by stage."""

    solution: PlateauSolution | None
    patch: Patch | SpinorGeomError
    seconds: Mapping[str, float]


def minimal_patches(
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
        time_limit=options.time_limit,
        device=device,
    )
    last = perf_counter()
    for loop, solved in zip(loops, found, strict=True):
        yield exact_patch(loop, solved, perf_counter() - last, options)
        last = perf_counter()


def exact_patch(loop: BoundaryLoop, solved: Solved, waited: float, options: FillOptions) -> SolvedLoop:
    """Meshes a surface, or returns its error; `waited` is the time of its computation, in seconds."""
    begin = perf_counter()
    surface = _usable(loop, solved)
    patch = _meshed(surface, options) if isinstance(surface, PlateauSolution) else surface
    solution = solved if isinstance(solved, PlateauSolution) else None
    # the timings of a solution are its share of a common solve
    seconds = waited if solution is None else sum(solution.timings.values())
    return SolvedLoop(solution, patch, {"solve": seconds, "mesh": perf_counter() - begin})


def _usable(loop: BoundaryLoop, surface: Solved) -> Solved:
    """The surface, or an error if it does not follow the loop or has no area."""
    if isinstance(surface, SpinorGeomError):
        return surface
    if not surface.boundary_residual.rms_per_edge <= MAX_RESIDUAL_PER_EDGE:
        return SurfaceError(f"no surface was found that follows the loop; the best one: {surface.reason}")
    try:
        require_area(loop, 2 * surface.area / loop.perimeter)
    except NoAreaError as error:
        return error
    return surface


def _meshed(solution: PlateauSolution, options: FillOptions) -> Patch | SpinorGeomError:
    try:
        with time_limit(options.time_limit):
            patch = mesh_patch(solution, options.target_edge_length)
    except SpinorGeomError as error:
        return error
    is_finite = np.isfinite(patch.vertices).all()
    return patch if is_finite else SurfaceError("the surface that was found is not finite everywhere")
