"""Plateau's problem for one loop or many, from the first fill to the verdict."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, overload

import numpy as np
import torch

from spinor_geom import deadline
from spinor_geom.adapters import Rim, to_rims
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.minimal_surface import first_disks
from spinor_geom.errors import ArgumentTypeError, OptionError, SpinorGeomError, require_positive
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.harmonic.harmonic_route import BATCH_NODES, FEWEST_NODES, HarmonicSolver
from spinor_geom.plateau.options import Cauchy, Model, Optimizer, Options, usable_device
from spinor_geom.plateau.plan import Route, Task, all_surfaces, minimal_disk, plan, surface_between
from spinor_geom.plateau.route_result import typed_failures
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.steps import Iteration
from spinor_geom.plateau.threads import one_thread

if TYPE_CHECKING:
    from typing_extensions import Unpack

Planned: TypeAlias = tuple[Task, tuple[Route, ...]]

# Points of rough loops whose first disks are made side by side: those of longer ones would take as long, and memory.
_SHORT = 500


class _Rest(TypedDict, total=False):
    """The options of `solve_plateau` on which its type does not depend."""

    model: Model
    optimizer: Optimizer | None
    warm_start: bool
    tolerance: float
    max_iterations: int
    unstable: Literal["leave", "keep"]
    between: Literal["auto", "smooth", "free"]
    time_limit: float
    device: str | torch.device
    on_iteration: Callable[[Iteration], None] | None


# what is neither a loop nor several is a curve of points, or a mesh with one
_Curve: TypeAlias = "Rim | np.ndarray | str | os.PathLike[str]"


@overload
def solve_plateau(
    loop: _Curve, *, all_solutions: Literal[False] = False, **options: Unpack[_Rest]
) -> PlateauSolution: ...
@overload
def solve_plateau(
    loop: Any, *, all_solutions: Literal[True], **options: Unpack[_Rest]
) -> tuple[PlateauSolution, ...]: ...
@overload
def solve_plateau(
    loop: Any, *, all_solutions: Literal[False] = False, **options: Unpack[_Rest]
) -> PlateauSolution | NoConnectedSurface: ...
def solve_plateau(
    loop: Any,
    *,
    model: Model = "auto",
    optimizer: Optimizer | None = None,
    warm_start: bool = True,
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    between: Literal["auto", "smooth", "free"] = "auto",
    all_solutions: bool = False,
    time_limit: float = math.inf,
    device: str | torch.device = "cpu",
    on_iteration: Callable[[Iteration], None] | None = None,
) -> PlateauSolution | NoConnectedSurface | tuple[PlateauSolution, ...]:
    """A minimal disk over a closed curve, or a minimal surface of one piece between several.

    It is exactly minimal, its boundary on Γ as nearly as the model allows. Γ is the curve through all of the loop's
    points, with its corners kept (`BoundaryCurve`). A plane loop bounds the plane region inside it, exactly. Loops
    without corners take Douglas's route; those with corners, and those that it does not bring near to Γ, a Cauchy
    network, by Gauss-Newton: `spinor_geom.plateau` tells the way, `plateau.plan` the order. Minimal disks need not be
    minima of the area: one that is unstable is left along an eigenvector of its second variation for one of less area.

    Two curves and more take Douglas's route on the unit disk less round holes: all slides and the moduli, then p and q
    as Laurent series; curves in one plane, one with the others inside it, bound the plane region between them. Where
    that takes too many nodes, as for a small hole near the end of a long one, a Cauchy network on a flattened annulus
    does. Which point lies opposite to which, and the directions of the curves after the first, come from the energy and
    not from the order of the points. The area is set against that of the disks: see `PlateauSolution.annulus` and
    `is_area_minimum`. Curves too far from each other have no surface of one piece, and the answer says so.

    Args:
        loop: the curve: a `BoundaryLoop`, (m, 3) points in order, a mesh of any known type or its path where it has one
            loop, or a `ClosedCurve` in formulas, which no sampling limits: the loop then consists of the endpoints of
            the polynomials that represent it. A sequence of loops, curves or arrays of points for a surface between
            several.
        model: "auto" for what suits the loop; "cauchy" for a Cauchy network whatever the loop, or its options; "series"
            for power series on the unit disk, to rounding error: for smooth loops that are not too long for their
            width; "mlp" for the paper's complex-valued network, trained.
        optimizer: of "mlp": "levenberg-marquardt", which it takes by default, or "rmsprop" for the paper's Algorithm 1
            with the paper's settings, both on networks of any size by `LevenbergMarquardt` and `RMSprop` of
            `spinor_geom.training`. RMSprop starts from random parameters on the unit disk, or goes on from a
            checkpoint among its options.
        warm_start: whether Levenberg-Marquardt hands the network the p and q of the solution that "auto" finds, with
            its Ω, before it polishes; else it starts from random parameters on the unit disk.
        tolerance: RMS distance of the surface's boundary from Γ, in mean loop edges, below which the result counts as
            converged, if no part of the loop is missed by more than a hundred times as many of its own edges.
        max_iterations: limit on steps in all; with `all_solutions` on those from each start; between two curves on
            those after the first annulus is found. Training has limits of its own among the optimizer's options.
        unstable: "keep" returns an unstable surface, which is only a critical point of the area, as it was found;
            between several curves with the start that `Laurent(modulus=...)` gives.
        between: what Γ is between the points of a loop. "smooth" is the curve through them that `BoundaryCurve` makes.
            "free", for rims of meshes, of which only the points are in the mesh: where they show no smooth curve, Γ is
            the boundary of the surface through the points that is nearest to a discrete minimal disk, or between
            several loops to the surface between averages of them. It is found in hundredths of a second for tens of
            points, between several loops in seconds, and is not left where it is unstable. "auto" is "smooth" for one
            loop and "free" between several, where the curve through noise of some per cent of an edge takes minutes;
            with a model that is chosen by name it is "smooth".
        all_solutions: look for several disks over the loop, as Cauchy networks, or for annuli, as Laurent series,
            unstable ones too; see `find_disks`. It takes several times as long, and more may exist than are found.
        time_limit: seconds after which the best surface so far is returned: `converged` and `reason` say what it lacks,
            and with `all_solutions` others may be missing. A step that is under way is finished first.
        device: where the linear algebra runs; the surface is returned there.
        on_iteration: called after each step.

    Returns:
        The solution, or `NoConnectedSurface` where none spans several curves; with `all_solutions` all that were found,
        sorted by area, each with its Morse index.

    Raises:
        OptionError: an unknown model or optimizer, a value out of range, options that exclude each other, or what is no
            curve.
        FirstFillError: no discrete disk over the loop was found.
        DomainError: no simple plane domain was found; with "series", the loop crowds on the disk or has corners.
        CurveError: the formulas of a curve are not those of a smooth closed one.
        SelfCrossingLoopError: the loop crosses or touches itself.
        LoopsMeetError: two loops cross or touch each other.
        RepeatedPointError: two neighbouring points of the loop are equal.
        SingularMatrixError: the discrete disk over the loop is degenerate.
        SurfaceError: the annulus that was found is branched.
        OutOfTimeError: no surface was found within the time limit.

    Source: Sun & Chern (2026) for the representation; Douglas, "Solution of the problem of Plateau" (1931).
    """
    options = Options(
        model=model,
        optimizer=optimizer,
        warm_start=warm_start,
        tolerance=tolerance,
        max_iterations=max_iterations,
        unstable=unstable,
        between=between,
        device=usable_device(device),
    )
    rims = to_rims(loop)
    if not rims:
        raise OptionError("a surface spans at least one loop, got an empty sequence")
    if all_solutions:
        _require_model_for_all(model, is_disk=len(rims) == 1)
    require_positive("time_limit", time_limit, finite=False)
    with one_thread(), typed_failures(), deadline.time_limit(time_limit):
        task = Task.of(rims, options, on_iteration)
        if all_solutions:
            return all_surfaces(task)
        return minimal_disk(task, plan(task)) if task.is_disk else surface_between(task)


def _require_model_for_all(model: Model, *, is_disk: bool) -> None:
    """Checks that the search for all disks, or all annuli, knows a model."""
    if model == "mlp":
        raise OptionError("a network is trained for one disk only; use all_solutions with model='auto'")
    if is_disk and model == "series":
        raise OptionError("all_solutions looks for disks as Cauchy networks; use it with model='auto' or 'cauchy'")
    if not is_disk and (model == "cauchy" or isinstance(model, Cauchy)):
        raise OptionError("all_solutions looks for annuli as Laurent series; use it with model='auto' or 'series'")


def solve_plateau_batch(
    loops: Iterable[Any],
    *,
    model: Model = "auto",
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    between: Literal["smooth", "free"] = "smooth",
    time_limit: float = math.inf,
    device: str | torch.device = "cpu",
) -> Iterator[PlateauSolution | SpinorGeomError]:
    """`solve_plateau` for many loops, which are not held in memory together.

    Loops that take the unit disk are solved side by side, those with as many nodes as one batch. On the CPU each
    solution is the same to the last bit in bundles of any size.

    Args:
        loops: any number of them, each as for `solve_plateau`, but for curves in formulas and several rims.
        model: as for `solve_plateau`.
        tolerance: as for `solve_plateau`.
        max_iterations: limit on the steps of each.
        unstable: as for `solve_plateau`.
        between: as for `solve_plateau`.
        time_limit: seconds for each loop after which the best surface so far counts, or `OutOfTimeError` without one;
            a loop may take a step longer.
        device: as for `solve_plateau`.

    Yields:
        For each loop in order its solution, or the error that `solve_plateau` raises for it.

    Raises:
        OptionError: an unknown model or a value out of range, or a single curve in the place of several.
    """
    if not isinstance(loops, Iterable) or isinstance(loops, (str, os.PathLike, np.ndarray)):
        takes = "several loops, arrays of points or meshes, such as boundary_loops(mesh)"
        raise ArgumentTypeError(function="solve_plateau_batch", takes=takes, found=f"one {type(loops).__name__}")
    options = Options(
        model=model,
        tolerance=tolerance,
        max_iterations=max_iterations,
        unstable=unstable,
        between=between,
        device=usable_device(device),
    )
    require_positive("time_limit", time_limit, finite=False)
    return _side_by_side(iter(loops), options, time_limit)


def _side_by_side(
    loops: Iterator[BoundaryLoop], options: Options, seconds: float
) -> Iterator[PlateauSolution | SpinorGeomError]:
    while chunk := list(itertools.islice(loops, BATCH_NODES // FEWEST_NODES)):
        with one_thread():
            answers = [_planned(task) for task in Task.each(chunk, options)]
            _fit_together(answers, seconds)
        for answer in answers:
            yield answer if isinstance(answer, SpinorGeomError) else _solved(*answer, seconds)


def _planned(task: Task | SpinorGeomError) -> Planned | SpinorGeomError:
    try:
        with typed_failures():
            return task if isinstance(task, SpinorGeomError) else (task, plan(task))
    except SpinorGeomError as error:
        return error


def _fit_together(answers: list[Planned | SpinorGeomError], seconds: float) -> None:
    """Hands the tasks what their plans begin with, made side by side: fits on the unit disk, first discrete disks."""
    planned = [(place, *answer) for place, answer in enumerate(answers) if not isinstance(answer, SpinorGeomError)]
    smooth = [(place, task, routes) for place, task, routes in planned if routes[0] == Route.ON_UNIT_DISK]
    rough = [
        (place, task, routes)
        for place, task, routes in planned
        if routes[0] == Route.THROUGH_POINTS and len(task.loop) <= _SHORT
    ]
    with deadline.time_limit(seconds * len(planned)):
        fits = HarmonicSolver.side_by_side([task.harmonic for _, task, _ in smooth])
        begin = time.perf_counter()
        disks = first_disks([task.pinned[0] for _, task, _ in rough])
        share = (time.perf_counter() - begin) / max(1, len(rough))
        are_whole = not deadline.is_out_of_time()
    for (place, task, routes), fit in zip(smooth, fits, strict=True):
        answers[place] = replace(task, on_disk=fit), routes
    for (place, task, routes), disk in zip(rough, disks, strict=True):
        task.clock.add("first fill", share)
        # where there is none, or its descent was cut short, the task makes its own
        answers[place] = replace(task, start=disk if are_whole and isinstance(disk, Disk) else None), routes


def _solved(task: Task, routes: tuple[Route, ...], seconds: float) -> PlateauSolution | SpinorGeomError:
    with one_thread(), deadline.time_limit(seconds):
        try:
            with typed_failures():
                return minimal_disk(task, routes)
        except SpinorGeomError as error:
            return error
