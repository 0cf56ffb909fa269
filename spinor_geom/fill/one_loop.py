"""Fills one loop, or the gap between two: refuses what is no hole, meshes its surface, interpolates the attributes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Int

from spinor_geom.deadline import time_limit
from spinor_geom.discrete.strip import ruled_annulus
from spinor_geom.errors import (
    NoAreaError,
    OptionError,
    OutOfTimeError,
    SheetBorderError,
    SingularMatrixError,
    SpinorGeomError,
    SurfaceError,
    TooManyPointsError,
    require_positive,
)
from spinor_geom.fill.attributes import patch_attributes
from spinor_geom.fill.clearance import cleared
from spinor_geom.fill.collar import bend_across, collar_of
from spinor_geom.fill.continuation import MOST_AREA, Continuation, Moved, Start, continue_patch
from spinor_geom.fill.discrete_patch import discrete_patch, refuse_empty
from spinor_geom.fill.options import CONTINUITY, Continuity
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.retriangulation import retriangulated
from spinor_geom.fill.surroundings import NOTHING, Crossings, LoopPatch, Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.meshing.embed import Patch, edge_length_over, mesh_patches
from spinor_geom.plateau.options import Model, require_model
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.spinor_surface import SpinorSurface

# RMS, of the mean edge: the patch of a surface that misses more is wrong beside its rim. Of 120 rough loops surfaces
# of 78 miss less than 0.01, those of 16 more than 0.2, and none lies between.
MAX_RESIDUAL_PER_EDGE = 0.1

Solved: TypeAlias = PlateauSolution | SpinorGeomError


@dataclass(frozen=True, kw_only=True, eq=False)
class MadePatch:
    """A patch on its way into the mesh: its loops, and what its `LoopOutcome` will tell of it."""

    patch: Patch
    rims: Sequence[BoundaryLoop]
    solution: PlateauSolution | None
    reason: str
    edges_split: int = 0
    displacement: float = 0.0
    faces_replaced: int = 0
    crossings: Crossings = NOTHING
    continuation: Continuation | None = None
    remarks: tuple[str, ...] = ()

    @property
    def start(self) -> Start:
        """What the patch is before its continuation."""
        if self.solution is not None:
            return "minimal"
        return "strip" if self.patch.hole_sizes else "discrete"

    @property
    def surface(self) -> SpinorSurface | None:
        """The exact surface that the patch is a mesh of."""
        return None if self.solution is None or self.continuation is not None else self.solution.surface

    @cached_property
    def rim(self) -> Int[np.ndarray, " m"]:
        """Mesh vertices of its boundary vertices."""
        return np.concatenate([loop.vertex_ids for loop in self.rims])

    @property
    def notes(self) -> tuple[str, ...]:
        """Which faces are no mesh of its surface, and what it crosses, a sentence each."""
        if not self.faces_replaced:
            return self.crossings.notes
        note = (
            f"{self.faces_replaced} faces of the patch are a triangulation of their outline without inner vertices, "
            "because the surface's own crossed something there"
        )
        return (note, *self.crossings.notes)

    def joinable(self, surroundings: Surroundings) -> MadePatch:
        """The patch with its edges split that the mesh or another patch has."""
        patch, split = surroundings.fitted(self.patch, self.rim, self.surface)
        return replace(self, patch=patch, edges_split=self.edges_split + split)

    def clear_of(self, surroundings: Surroundings) -> MadePatch:
        """The patch moved off the mesh where it crosses that, then triangulated anew where something still crosses."""
        if not len(self.crossings):
            return self
        clear = cleared(surroundings, self.rim, self.patch, self.crossings, self.surface)
        last = retriangulated(surroundings, self.rim, clear.patch, clear.crossings)
        return replace(
            self,
            patch=last.patch,
            crossings=last.crossings,
            edges_split=self.edges_split + clear.edges_split,
            displacement=clear.displacement,
            faces_replaced=last.faces,
        )


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
    A TooManyPointsError tells that the edge length asked for takes more vertices than anyone can use.
    """
    joined_to = next(iter(others), None)
    found, exact, seconds = answer
    clock = Clock(seconds)
    try:
        options.on_stage(place, "mesh")
        made = _patch_over(place, (loop, *others.values()), exact, options).joinable(surroundings)
        clock.lap("mesh")
        options.on_stage(place, "crossings")
        made = replace(made, crossings=surroundings.crossings(made.patch))
        clock.lap("crossings")
        if options.continuity == "C1":
            options.on_stage(place, "continuation")
            with time_limit(options.time_limit):
                smooth = continued(made, edge_length_over(made.rims, options.target_edge_length), surroundings)
            clock.lap("continuation")
            made = _clearer(smooth, made, surroundings)
        else:
            made = made.clear_of(surroundings)
        clock.lap("clearance")
    except SpinorGeomError as error:
        if isinstance(error, TooManyPointsError) and options.target_edge_length != "auto":
            raise
        clock.lap("failed")
        solution = found if isinstance(found, PlateauSolution) else None
        return unfilled(place, loop, error, solution=solution, joined_to=joined_to, timings=clock.laps()), None
    patch, is_planned = made.patch, made.solution is not None and not made.faces_replaced
    attributes = patch_attributes(surroundings.mesh, made.rim, patch, made.surface, is_planned=is_planned)
    clock.lap("attributes")
    first_face = surroundings.join(patch, made.rim)
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
        first_face=first_face,
        edges_split=made.edges_split,
        displacement=made.displacement,
        faces_replaced=made.faces_replaced,
        self_intersections=len(made.crossings.own),
        mesh_intersections=len(made.crossings.mesh),
        patch_intersections=len(made.crossings.patches),
        remarks=(*loop.remarks, *made.remarks, *made.notes, *_without_area(patch)),
        timings=clock.laps(),
    )
    return outcome, LoopPatch(place=place, rim=made.rim, patch=patch, attributes=attributes)


def _without_area(patch: Patch) -> tuple[str, ...]:
    """What is to be said of faces without area: the rim leaves no room for others, or the surface is flat there."""
    count = int((face_areas(patch.vertices, patch.faces) <= 0).sum())
    return (f"faces of the patch without area: {count} of {len(patch.faces)}",) if count else ()


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
    place: int, rims: Sequence[BoundaryLoop], exact: MadePatch | SpinorGeomError, options: FillOptions
) -> MadePatch:
    """The mesh of an exact surface; without one a discrete patch, or between two loops a strip to be continued."""
    if isinstance(exact, MadePatch):
        return exact
    can_be_strip = options.continuity == "C1" and len(rims) == 2 and isinstance(exact, SurfaceError)
    if isinstance(exact, (NoAreaError, TooManyPointsError)) or (len(rims) > 1 and not can_be_strip):
        raise exact
    reason, target = str(exact), edge_length_over(rims, options.target_edge_length)
    if can_be_strip:
        # straight lines, a start for a surface that is not minimal
        patch = Patch.over(*ruled_annulus(rims[0].points, rims[1].points, target))
    else:
        options.on_stage(place, "discrete surface")
        patch, what = discrete_patch(rims[0], target, seconds=options.time_limit)
        reason = f"{what}, because: {reason}"
    return MadePatch(patch=patch, rims=rims, solution=None, reason=reason)


def exact_patches(found: Sequence[tuple[BoundaryLoop, Solved, float]], options: FillOptions) -> list[Answer]:
    """What `fill_loop` takes, for loops with what was found and the seconds until it was there: all meshed together."""
    begin = perf_counter()
    usable = [_usable(loop, one) for loop, one, _ in found]
    meshed = iter(_meshed([one for one in usable if isinstance(one, PlateauSolution)], options))
    made = [_made(one, next(meshed)) if isinstance(one, PlateauSolution) else one for one in usable]
    share = (perf_counter() - begin) / max(1, len(found))
    answers = []
    for (_, one, waited), patch in zip(found, made, strict=True):
        # a solution knows its own share of what was solved with others
        seconds = sum(one.timings.values()) if isinstance(one, PlateauSolution) else waited
        answers.append(Answer(one, patch, {"solve": seconds, "mesh": share}))
    return answers


def _meshed(solutions: Sequence[PlateauSolution], options: FillOptions) -> list[Patch | SpinorGeomError]:
    """The meshes of surfaces, each within its time limit; what is not finished together is tried alone."""
    if not solutions:
        return []
    with time_limit(options.time_limit * len(solutions)):
        patches = mesh_patches(solutions, options.target_edge_length)
    if len(solutions) == 1:
        return patches
    return [
        _meshed([solution], options)[0] if isinstance(patch, OutOfTimeError) else patch
        for solution, patch in zip(solutions, patches, strict=True)
    ]


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


def continued(first: MadePatch, target: float, surroundings: Surroundings) -> MadePatch:
    """The smooth continuation of the mesh around a patch, or the patch itself with the reason why it stays.

    A patch without inner vertices has nothing that could move, and stays without a remark. `target` is the edge length,
    should it be meshed anew. A strip that stays is no surface to be kept, and a SurfaceError.
    """
    if len(first.patch.vertices) == len(first.rim):
        return _staying(first)
    collar = collar_of(surroundings, first.rim, first.patch)
    try:
        moved = continue_patch(first.patch, collar, target, is_conformal=first.start != "discrete")
    except (SingularMatrixError, TooManyPointsError) as error:
        return _staying(first, str(error))
    before, after = bend_across(collar, first.patch), bend_across(collar, moved.patch)
    ratio = moved.patch.area / first.patch.area
    no_continuation = (
        f"{moved.steps} steps left a bend of {after.rms:.3g}° (RMS) across the rim, where it has {before.rms:.3g}°, "
        f"and {ratio:.2g} times its area"
    )
    is_second_best = bool(moved.lowered) or not moved.converged
    if is_second_best and (after.rms >= before.rms or ratio > MOST_AREA):
        return _staying(first, no_continuation)
    continuation = Continuation(
        started_from=first.start,
        before=before,
        after=after,
        order=moved.order,
        lowered=moved.lowered,
        steps=moved.steps,
        remeshed=moved.remeshed,
        converged=moved.converged,
        next_step=moved.next_step,
        area_ratio=ratio,
        smallest_angle=moved.smallest_angles[0],
        smallest_rim_angle=moved.smallest_angles[1],
        correlation_length=collar.length,
        roughness=collar.roughness,
        creased=collar.creased,
    )
    smooth = replace(first, patch=moved.patch, reason=continuation.reason, continuation=continuation)
    smooth = replace(smooth, remarks=continuation.remarks)
    smooth = smooth.joinable(surroundings)
    crossings = surroundings.crossings(smooth.patch)
    # a patch that turns back over the mesh, as a mean, or over itself is better only than another that crosses more
    if is_second_best and (after.rms >= 90 or moved.folds):
        was = Moved(patch=first.patch, steps=0, next_step=0.0, stretch=1.0)
        if len(crossings) == len(first.crossings) or not (before.rms >= 90 or was.folds):
            return _staying(first, no_continuation)
        remark = (
            "the patch is folded or turns back over the mesh, and so is the surface it started from, which crosses "
            f"{len(first.crossings)} pairs of faces, and the patch {len(crossings)}"
        )
        smooth = replace(smooth, remarks=(*smooth.remarks, remark))
    return replace(smooth, crossings=crossings)


def _clearer(smooth: MadePatch, first: MadePatch, surroundings: Surroundings) -> MadePatch:
    """A continued patch, or the one that it started from where that crosses less; both after they were cleared.

    Of two that cross as much, one whose parts had to be triangulated anew is worse.
    """
    crossings = smooth.crossings
    smooth = smooth.clear_of(surroundings)
    if smooth.continuation is None or not (len(smooth.crossings) or smooth.faces_replaced):
        return smooth
    first = first.clear_of(surroundings)
    mine, other = ((len(made.crossings), bool(made.faces_replaced)) for made in (smooth, first))
    if mine <= other:
        return smooth
    return _staying(first, ", ".join(crossings.notes), link=", as then")


def _staying(first: MadePatch, why: str = "", *, link: str = ":") -> MadePatch:
    remarks = (f"the patch was not continued smoothly{link} {why}",) if why else ()
    if first.start == "strip":
        raise SurfaceError("; ".join([first.reason, *remarks]))
    return replace(first, remarks=remarks)
