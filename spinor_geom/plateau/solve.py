"""The functions `solve_plateau` and `solve_plateau_batch`."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, overload

import numpy as np
from numpy.typing import ArrayLike

from spinor_geom import deadline
from spinor_geom.adapters import Rim, to_rims
from spinor_geom.errors import ArgumentTypeError, OptionError, SpinorGeomError, require_positive
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.harmonic.harmonic_route import BATCH_NODES, FEWEST_NODES, UNIT_DISK, begun_on_unit_disk
from spinor_geom.plateau.mirrored import MirrorPlanes, open_curves, solve_mirrored
from spinor_geom.plateau.options import Cauchy, Model, Optimizer, Options, usable_place
from spinor_geom.plateau.plan import all_surfaces, minimal_disk, plan, surface_between
from spinor_geom.plateau.problem import PlateauProblem, Route
from spinor_geom.plateau.route_result import typed_failures
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.steps import Iteration
from spinor_geom.plateau.threads import one_thread

if TYPE_CHECKING:
    import torch
    from typing_extensions import Unpack

_Planned: TypeAlias = tuple[PlateauProblem, tuple[Route, ...]]


class _Rest(TypedDict, total=False):
    """The options of `solve_plateau` on which its return type does not depend."""

    model: Model
    optimizer: Optimizer | None
    warm_start: bool
    tolerance: float
    max_iterations: int
    unstable: Literal["leave", "keep"]
    between: Literal["smooth", "quintic", "free"]
    time_limit: float
    device: str | torch.device | None
    mirror: ArrayLike | None
    on_iteration: Callable[[Iteration], None] | None


# one curve: a loop, formulas, points, or the path of a mesh with one loop
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
    between: Literal["smooth", "quintic", "free"] = "free",
    all_solutions: bool = False,
    time_limit: float = math.inf,
    device: str | torch.device | None = None,
    mirror: ArrayLike | None = None,
    on_iteration: Callable[[Iteration], None] | None = None,
) -> PlateauSolution | NoConnectedSurface | tuple[PlateauSolution, ...]:
    """A minimal disk bounded by a closed curve, or a connected minimal surface bounded by several curves.

    The surface is exactly minimal. Its boundary approximates Γ, the curve through all points of the loop with its
    corners (`BoundaryCurve`). For a plane loop the result is exactly the plane region inside it. Loops without corners
    are solved by Douglas's method. Loops with corners, and loops for which that method does not converge, are solved by
    Gauss-Newton for a Cauchy network. `spinor_geom.plateau` describes the steps and `plateau.plan` the order. A minimal
    disk need not minimise area: an unstable one is displaced along an eigenvector of its second variation, and a disk
    of less area is computed from there.

    Several curves are solved by Douglas's method on the unit disk with round holes, with p and q as Laurent series. If
    that needs too many nodes, as for a small hole near the end of an elongated outer curve, a Cauchy network on a
    flattened annulus is used. For plane curves, one of which encloses all others, the result is the plane region
    between them. Orientation and alignment of the curves minimise the energy. They do not depend on the order of the
    points. The area is compared with that of the disks: see `PlateauSolution.annulus` and `is_area_minimum`. If the
    curves are too far apart for a connected surface, `NoConnectedSurface` is returned.

    Args:
        loop: the curve: a `BoundaryLoop`; (m, 3) points in order; a mesh of any supported type with one boundary loop,
            or its path; or a `ClosedCurve` given by formulas, which is represented by polynomials to rounding error
            (their endpoints are the points of the loop). A sequence of loops, curves or arrays of points for a surface
            between several. A closed edge, a wire, or edges in any order of build123d, CadQuery or OCP, or the path of
            a STEP, IGES or BREP file: edges are used without approximation, several closed wires for a surface between
            them. Of faces the free boundary is used.
        model: "auto" chooses by the loop. "cauchy" or `Cauchy(...)`: a Cauchy network. "series": power series on the
            unit disk, to rounding error, for smooth loops of small elongation, or Laurent series. `Laurent(...)`: as
            "auto", with a choice of the modulus. "mlp": the paper's complex-valued network, trained.
        optimizer: for "mlp": "levenberg-marquardt" (default), or "rmsprop" for the paper's Algorithm 1 with its
            settings; `LevenbergMarquardt(...)` or `RMSprop(...)` of `spinor_geom.training` for other settings. RMSprop
            starts from random parameters on the unit disk.
        warm_start: whether Levenberg-Marquardt first fits the network to p and q of the solution of "auto", on its Ω.
            Otherwise it starts from random parameters on the unit disk.
        tolerance: largest RMS distance of the surface's boundary from Γ, in mean loop edges, for convergence. The
            largest distance, in mean lengths of the three nearest edges, must be within a hundred times this value.
        max_iterations: largest number of steps in all. With `all_solutions` they are counted from each start, and
            between two curves from the first annulus. Training is limited by the optimizer's options instead.
        unstable: what is returned if the surface found is unstable, a critical point of the area but no local minimum.
            "leave": a surface of less area near it, stable if one is found. `reason` then mentions it. "keep": the
            unstable surface itself. Between several curves `Laurent(modulus=...)` selects it.
        between: how the boundary runs from one point of a loop to the next. "smooth": along `BoundaryCurve`. "free":
            the same if the points lie on a smooth curve. If not, as around most holes of scans, only the points are
            prescribed, and also if a single loop has at most 8. The surface is then the minimal surface through the
            points that is nearest to a discrete minimal disk, or for several loops to the surface between averages of
            them, and Γ is its boundary. Over plane loops it is the inside of the polygon. That takes hundredths of a
            second for tens of points and seconds for several loops. One of several loops that has at most 8 points is
            a polygon. With a model other than "auto", and for curves given by formulas or edges, "free" has no effect.
            "quintic": along the spline of
            `BoundaryCurve.from_loop(..., quintic=True)`, so that the area is a differentiable function of the points.
            Of two stable disks over it, the result is the one on the side of its normal.
        all_solutions: search for several disks over the loop, as Cauchy networks, or for annuli, as Laurent series,
            unstable ones too (see `find_disks`). It takes several times as long, and may miss some.
        time_limit: seconds after which the best surface so far is returned (see its `converged` and `reason`). With
            `all_solutions`, other surfaces may be missing. A step in progress is finished first.
        device: the torch device where the linear algebra runs, such as "cuda". The surface is returned there. None for
            numpy, without torch.
        mirror: one to three mutually orthogonal planes, each as a pair (point, normal). The curves are then open: each
            is an `OpenCurve`, or (m, 3) points, on one side of the planes with both ends on them. The surface meets the
            planes at right angles along free edges: the surface over the curves and all their reflections is solved,
            and its part on this side is returned, a disk with the curves and the `free_edges` as boundary.
        on_iteration: called after each step.

    Returns:
        The solution, or `NoConnectedSurface` if none spans several curves. With `all_solutions` all that were found,
        sorted by area, each with its Morse index.

    Raises:
        MeshShapeError: `mirror` has no pairs of a point and a normal.
        OptionError: an unknown model or optimizer, a value out of range, incompatible options, or an argument that is
            not a curve.
        FirstFillError: no discrete disk over the loop was found.
        DomainError: no simple plane domain was found, or, with "series", the loop is too elongated or has corners.
        CurveError: the formulas do not define a smooth closed curve.
        NoEdgesError, OpenWireError, BranchingEdgesError: edges do not form closed curves.
        CadFileError: the file cannot be read.
        MissingPackageError: a CAD file is given, and OCP is not installed.
        SelfCrossingLoopError: the loop crosses or touches itself.
        LoopsMeetError: two loops cross or touch each other.
        RepeatedPointError: two neighbouring points of the loop are equal.
        SingularMatrixError: the discrete disk over the loop is degenerate.
        SurfaceError: the annulus that was found is branched.
        UnresolvedRimsError: the search for a surface between three loops or more needs too many nodes.
        OutOfTimeError: no surface was found within the time limit.

    Source: Sun & Chern (2026) for the representation; Douglas, "Solution of the problem of Plateau" (1931).
    """
    if mirror is not None:
        if all_solutions:
            raise OptionError("mirror= finds one surface; remove all_solutions=")
        return solve_mirrored(
            open_curves(loop),
            MirrorPlanes.of(mirror),
            partial(
                solve_plateau,
                model=model,
                optimizer=optimizer,
                warm_start=warm_start,
                max_iterations=max_iterations,
                unstable=unstable,
                between=between,
                time_limit=time_limit,
                device=device,
                on_iteration=on_iteration,
            ),
            tolerance,
        )
    options = Options(
        model=model,
        optimizer=optimizer,
        warm_start=warm_start,
        tolerance=tolerance,
        max_iterations=max_iterations,
        unstable=unstable,
        between=between,
        place=usable_place(device),
    )
    rims = to_rims(loop)
    if not rims:
        raise OptionError("a surface needs at least one boundary loop, got an empty sequence")
    if all_solutions:
        _require_model_for_all(model, is_disk=len(rims) == 1)
    require_positive("time_limit", time_limit, finite=False)
    with one_thread(), typed_failures(), deadline.time_limit(time_limit):
        problem = PlateauProblem.of(rims, options, on_iteration)
        if all_solutions:
            return all_surfaces(problem)
        solution = minimal_disk(problem, plan(problem)) if problem.is_disk else surface_between(problem)
    if isinstance(solution, NoConnectedSurface) or solution.solved_to is not None:
        return solution
    # without the functions in formulas and `on_iteration`, so that solutions can be pickled
    curves = [curve if curve.is_formula else None for curve in problem.curves]
    return replace(solution, solved_to=partial(_solved_to, problem.loops, curves, options))


def _solved_to(
    loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve | None], options: Options, tolerance: float
) -> PlateauSolution | NoConnectedSurface:
    """The surface over loops within a tolerance."""
    with one_thread(), typed_failures():
        problem = PlateauProblem.over(loops, curves, replace(options, tolerance=tolerance))
        return minimal_disk(problem, plan(problem)) if problem.is_disk else surface_between(problem)


def _require_model_for_all(model: Model, *, is_disk: bool) -> None:
    """Checks that the search for all disks, or all annuli, supports a model."""
    if model == "mlp":
        raise OptionError("a network is trained for one disk only; use all_solutions with model='auto'")
    if is_disk and model == "series":
        raise OptionError("all_solutions represents disks as Cauchy networks; use it with model='auto' or 'cauchy'")
    if not is_disk and (model == "cauchy" or isinstance(model, Cauchy)):
        raise OptionError("all_solutions represents annuli as Laurent series; use it with model='auto' or 'series'")


def solve_plateau_batch(
    loops: Iterable[Any],
    *,
    model: Model = "auto",
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    between: Literal["smooth", "quintic", "free"] = "free",
    time_limit: float = math.inf,
    device: str | torch.device | None = None,
) -> Iterator[PlateauSolution | SpinorGeomError]:
    """`solve_plateau` for an iterable of loops, of which a limited number is in memory at a time.

    Loops on the unit disk are solved in batches of equal node count. On the CPU each solution is bit for bit that of
    the loop alone.

    Args:
        loops: any number, each as for `solve_plateau`, except curves given by formulas and sequences of curves.
        model: as for `solve_plateau`.
        tolerance: as for `solve_plateau`.
        max_iterations: limit on the steps of each.
        unstable: as for `solve_plateau`.
        between: as for `solve_plateau`.
        time_limit: seconds for each loop, after which the best surface so far is yielded, or `OutOfTimeError` without
            one. A loop may exceed it by one step.
        device: as for `solve_plateau`.

    Yields:
        For each loop in order its solution, or the error that `solve_plateau` raises for it.

    Raises:
        OptionError: an unknown model or a value out of range, or a single curve instead of several.
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
        place=usable_place(device),
    )
    require_positive("time_limit", time_limit, finite=False)
    return _side_by_side(iter(loops), options, time_limit)


def _side_by_side(
    loops: Iterator[BoundaryLoop], options: Options, seconds: float
) -> Iterator[PlateauSolution | SpinorGeomError]:
    while chunk := list(itertools.islice(loops, BATCH_NODES // FEWEST_NODES)):
        start = perf_counter()
        with one_thread():
            planned = [_planned(problem) for problem in PlateauProblem.each(chunk, options)]
            _begin_together(planned, seconds / 2)
        left = seconds - (perf_counter() - start) / len(chunk)
        for one in planned:
            yield one if isinstance(one, SpinorGeomError) else _solved(*one, left)


def _planned(problem: PlateauProblem | SpinorGeomError) -> _Planned | SpinorGeomError:
    try:
        with typed_failures():
            return problem if isinstance(problem, SpinorGeomError) else (problem, plan(problem))
    except SpinorGeomError as error:
        return error


def _begin_together(planned: list[_Planned | SpinorGeomError], seconds: float) -> None:
    """Computes fits on the unit disk in batches, and puts them into `planned`."""
    smooth = [
        (place, *one)
        for place, one in enumerate(planned)
        if not isinstance(one, SpinorGeomError) and one[1][0] is UNIT_DISK
    ]
    with deadline.time_limit(seconds * len(smooth)):
        begun = begun_on_unit_disk([problem for _, problem, _ in smooth])
    for (place, problem, routes), route in zip(smooth, begun, strict=True):
        planned[place] = problem, (route, *routes[1:])


def _solved(problem: PlateauProblem, routes: tuple[Route, ...], seconds: float) -> PlateauSolution | SpinorGeomError:
    with one_thread(), deadline.time_limit(seconds):
        try:
            with typed_failures():
                return minimal_disk(problem, routes)
        except SpinorGeomError as error:
            return error
