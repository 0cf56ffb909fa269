"""Fills one loop, or the gap between two: refuses what is no hole, meshes its surface, interpolates the attributes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from spinor_geom.deadline import time_limit
from spinor_geom.discrete.strip import ruled_annulus
from spinor_geom.errors import (
    LoneFaceError,
    NoAreaError,
    OptionError,
    SeamError,
    SheetBorderError,
    SpinorGeomError,
    SurfaceError,
    TooManyPointsError,
    ZeroWidthSlitError,
)
from spinor_geom.fill.attributes import patch_attributes
from spinor_geom.fill.continuation import MadePatch, continued
from spinor_geom.fill.discrete_patch import discrete_patch, refuse_border
from spinor_geom.fill.options import CONTINUITY, Continuity, require_positive
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.stitch import LoopPatch, RimEdges
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.meshing.embed import Patch, mesh_patches
from spinor_geom.plateau.options import Model, require_model
from spinor_geom.plateau.solution import PlateauSolution

# A patch whose surface misses the loop by more, as RMS share of the mean edge, would be wrong beside its rim.
MAX_RESIDUAL_PER_EDGE = 0.1
MIN_WIDTH_PER_EDGE = 1e-6  # of a loop's mean edge: far above round-off, far below any hole that was meant
_WHOLE_SLIT = 1 - 1e-9

Solved: TypeAlias = PlateauSolution | SpinorGeomError


class Answer(NamedTuple):
    """What is known of a loop before it is filled: its surface and the mesh of that, or why it has none; seconds."""

    found: Solved
    made: MadePatch | SpinorGeomError
    seconds: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class FillOptions:
    """What every loop of one call is filled with: options of `fill_hole`, with an OptionError for what is none."""

    target_edge_length: float | Literal["auto"]
    model: Model
    tolerance: float
    time_limit: float = math.inf
    continuity: Continuity = "C0"
    fills_borders: bool = True  # whether a loop is filled whose patch lies on the mesh
    on_stage: Callable[[int, str], None] = lambda place, stage: None

    def __post_init__(self) -> None:
        # here once, so that what goes wrong later is one loop's own
        require_model(self.model)
        require_positive("tolerance", self.tolerance)
        require_positive("time_limit", self.time_limit, finite=False)
        if self.continuity not in CONTINUITY:
            raise OptionError(f"continuity must be 'C0' or 'C1', not {self.continuity!r}")
        if not (isinstance(self.target_edge_length, str) and self.target_edge_length == "auto"):
            require_positive("target_edge_length", self.target_edge_length, instead="'auto' or ")


class Clock:
    """A stop watch with named laps, which starts with those that were run before."""

    def __init__(self, before: Mapping[str, float] | None = None) -> None:
        self._last = perf_counter()
        self._laps = defaultdict(float, before or {})

    def lap(self, name: str) -> None:
        """Ends the lap that has run since the last call, under a name."""
        now = perf_counter()
        self._laps[name] += now - self._last
        self._last = now

    def laps(self) -> Mapping[str, float]:
        """Seconds by name, and "total" of all laps."""
        return {**self._laps, "total": sum(self._laps.values())}


def fill_loop(
    surroundings: Surroundings,
    place: int,
    loop: BoundaryLoop,
    answer: Answer,
    options: FillOptions,
    *,
    others: Mapping[int, BoundaryLoop] = MappingProxyType({}),
) -> tuple[LoopOutcome, LoopPatch | None]:
    """The patch of one loop, or from it to the others of a bridge, or the reason why it has none.

    Where one loop has no exact surface, or none that follows it, its patch is discrete. A patch joins the surroundings.
    A TooManyPointsError tells that the edge length asks for more vertices than anyone can use.
    """
    joined_to = next(iter(others), None)
    found, exact, seconds = answer
    clock = Clock(seconds)
    try:
        options.on_stage(place, "mesh")
        made = _patch_over(place, loop, exact, options, tuple(others.values())).joinable(surroundings)
        clock.lap("mesh")
        options.on_stage(place, "crossings")
        made = replace(made, crossings=surroundings.crossings(made.patch))
        clock.lap("crossings")
        if not options.fills_borders and len(made.crossings.mesh):
            refuse_border(surroundings, made.rim, made.patch)
        if options.continuity == "C1":
            options.on_stage(place, "continuation")
            with time_limit(options.time_limit):
                made = continued(made, target_length(made.rims, options), surroundings)
            clock.lap("continuation")
    except TooManyPointsError:
        raise
    except SpinorGeomError as error:
        clock.lap("failed")
        solution = found if isinstance(found, PlateauSolution) else None
        return unfilled(place, loop, error, solution=solution, joined_to=joined_to, timings=clock.laps()), None
    patch = made.patch
    attributes = patch_attributes(
        surroundings.mesh.vertex_attributes,
        made.rim,
        patch,
        made.surface,
        is_planned=made.solution is not None,
        labels=surroundings.mesh.labels,
    )
    clock.lap("attributes")
    surroundings.join(patch, made.rim)
    outcome = LoopOutcome(
        index=place,
        loop=loop,
        requested=True,
        filled=True,
        reason=made.reason,
        solution=made.solution,
        patch=patch,
        continuation=made.continuation,
        joined_to=joined_to,
        vertices_added=len(patch.vertices) - patch.boundary_size,
        faces_added=len(patch.faces),
        edges_split=made.edges_split,
        self_intersections=len(made.crossings.own),
        mesh_intersections=len(made.crossings.mesh),
        patch_intersections=len(made.crossings.patches),
        remarks=(*loop.remarks, *made.remarks, *made.crossings.notes),
        timings=clock.laps(),
    )
    return outcome, LoopPatch(place=place, rim=made.rim, patch=patch, attributes=attributes)


def target_length(loops: Sequence[BoundaryLoop], options: FillOptions) -> float:
    """The edge length of the patch over some loops, in mesh units."""
    if isinstance(options.target_edge_length, str):
        return sum(loop.perimeter for loop in loops) / sum(map(len, loops))
    return float(options.target_edge_length)


def unfilled(
    place: int,
    loop: BoundaryLoop,
    why: str | SpinorGeomError,
    *,
    solution: PlateauSolution | None = None,
    joined_to: int | None = None,
    timings: Mapping[str, float] | None = None,
) -> LoopOutcome:
    """The outcome of a loop that is left open: an error says why, or in words the caller's wish."""
    is_refused, is_border = isinstance(why, SpinorGeomError), isinstance(why, SheetBorderError)
    return LoopOutcome(
        index=place,
        loop=loop,
        requested=is_refused and not is_border,
        filled=False,
        reason=str(why),
        is_border=is_border,
        solution=solution,
        joined_to=joined_to,
        remarks=loop.remarks if is_refused else (),
        timings=timings or {},
    )


def _patch_over(
    place: int,
    loop: BoundaryLoop,
    exact: MadePatch | SpinorGeomError,
    options: FillOptions,
    others: tuple[BoundaryLoop, ...],
) -> MadePatch:
    """The mesh of an exact surface; without one a discrete patch, or between two loops a strip to be continued."""
    if isinstance(exact, MadePatch):
        return exact
    can_be_strip = options.continuity == "C1" and len(others) == 1 and isinstance(exact, SurfaceError)
    if isinstance(exact, (NoAreaError, TooManyPointsError)) or (others and not can_be_strip):
        raise exact
    reason, rims = str(exact), (loop, *others)
    target = target_length(rims, options)
    if others:
        # straight lines, a start for a surface that is not minimal
        patch = Patch.over(*ruled_annulus(loop.points, others[0].points, target))
    else:
        options.on_stage(place, "discrete surface")
        patch, what = discrete_patch(loop, target, seconds=options.time_limit)
        reason = f"{what}, because: {reason}"
    return MadePatch(patch=patch, rims=rims, solution=None, reason=reason)


def exact_patches(found: Sequence[tuple[BoundaryLoop, Solved, float]], options: FillOptions) -> list[Answer]:
    """What `fill_loop` takes, for loops with what was found and the seconds until it was there: all meshed together."""
    begin = perf_counter()
    usable = [_usable(loop, one) for loop, one, _ in found]
    meshed = iter(mesh_patches([one for one in usable if isinstance(one, PlateauSolution)], options.target_edge_length))
    made = [_made(one, next(meshed)) if isinstance(one, PlateauSolution) else one for one in usable]
    share = (perf_counter() - begin) / max(1, len(found))
    answers = []
    for (_, one, waited), patch in zip(found, made, strict=True):
        # a solution knows its own share of what was solved with others
        seconds = sum(one.timings.values()) if isinstance(one, PlateauSolution) else waited
        answers.append(Answer(one, patch, {"solve": seconds, "mesh": share}))
    return answers


def _usable(loop: BoundaryLoop, found: Solved) -> Solved:
    """A surface that can be meshed, or why it is not."""
    if isinstance(found, SpinorGeomError):
        return found
    if not found.boundary_residual.rms_per_edge <= MAX_RESIDUAL_PER_EDGE:
        return SurfaceError(f"no surface was found that follows the loop; the best: {found.reason}")
    try:
        refuse_empty(loop, 2 * found.area / loop.perimeter)
    except NoAreaError as error:
        return error
    return found


def _made(solution: PlateauSolution, patch: Patch | SpinorGeomError) -> MadePatch | SpinorGeomError:
    if isinstance(patch, SpinorGeomError):
        return patch
    if not np.isfinite(patch.vertices).all():
        return SurfaceError("the surface that was found is not finite everywhere")
    rims = [match.loop for match in solution.rims]
    return MadePatch(patch=patch, rims=rims, solution=solution, reason="" if solution.converged else solution.reason)


def refuse_what_is_no_hole(loop: BoundaryLoop, taken: RimEdges) -> None:
    """Checks, before anything is solved, that a loop bounds a hole.

    Raises:
        LoopError: it does not: a slit, a seam, the outline of one face, or points on a line.
        NonManifoldEdgeError: one of its edges has several faces already.
    """
    if loop.obstacle is not None:
        raise loop.obstacle
    if loop.slit_fraction > _WHOLE_SLIT:
        # the first edge that lies on another one, run the other way
        ends = np.roll(loop.points, -1, axis=0)
        one, other = loop_crossings(loop.points).T
        opposite = (loop.points[one] == ends[other]).all(axis=1) & (ends[one] == loop.points[other]).all(axis=1)
        edge = np.roll(loop.vertex_ids, -one[np.argmax(opposite)])[:2]
        raise ZeroWidthSlitError(fraction=loop.slit_fraction, vertices=edge.tolist())
    if len(loop.seam_edges):
        raise SeamError(edge=[int(v) for v in loop.seam_edges[0]], count=len(loop.seam_edges))
    face = taken.face_on(loop)
    if face is not None:
        raise LoneFaceError(face=face, vertices=[int(v) for v in loop.vertex_ids])
    refuse_empty(loop, loop.diagonal / loop.elongation)


def refuse_empty(loop: BoundaryLoop, width: float) -> None:
    """Raises a `NoAreaError` where the width of a loop's hole, in mesh units, is below 1e-6 of its mean edge."""
    if width <= MIN_WIDTH_PER_EDGE * loop.mean_edge_length:
        raise NoAreaError(width=width, mean_edge=loop.mean_edge_length)
