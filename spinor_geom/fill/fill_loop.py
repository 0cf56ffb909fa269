"""Makes the patch over one loop, or between several loops, from the solution of Plateau's problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from time import perf_counter

import numpy as np
from jaxtyping import Float

from spinor_geom.deadline import time_limit
from spinor_geom.domain.sizes import GRADED, EdgeLengths
from spinor_geom.errors import (
    NoAreaError,
    NotContinuedError,
    OutOfTimeError,
    SheetBorderError,
    SpinorGeomError,
    SurfaceError,
    TooManyPointsError,
    in_mesh_units,
)
from spinor_geom.fill.attributes import NORMAL, patch_attributes
from spinor_geom.fill.discrete_patch import discrete_patch, graded_patch, ruled_patch
from spinor_geom.fill.fill_options import LEAST_TIME, FillOptions
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.new_patch import Change, NewPatch, in_own_frame
from spinor_geom.fill.no_holes import require_area
from spinor_geom.fill.patched_mesh import NOT_SEARCHED, LoopPatch, PatchedMesh
from spinor_geom.fill.retriangulation import NOT_CLEARED, retriangulated, without_intersections
from spinor_geom.fill.smooth_patch import NO_TIME, NOT_CONTINUED, smooth_patch
from spinor_geom.fill.solved_loops import SolvedLoop, solved_loops
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.meshing.embed import Patch, edge_length_over, mesh_over_points
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Clock

# reason for a patch of an exact surface that `mesh_over_points` could not refine
_COARSE = (
    "its mesh of {} vertices has triangles larger than asked for, or less accurate vertices near the rim (the limit on "
    "time or on vertices)"
)
_SEARCHES = 2  # for intersections, before and after a patch is changed in its own frame
_SEARCH_SECONDS = 3e-5  # for each face of a patch whose intersections are searched: measured are 1e-5 to 3e-5


def _until(end: float) -> AbstractContextManager[None]:
    """A time limit at a time of `perf_counter`."""
    return time_limit(end - perf_counter())


def fill_loop(
    patched: PatchedMesh,
    index: int,
    loop: BoundaryLoop,
    solved: SolvedLoop | None,
    options: FillOptions,
    *,
    rims: Sequence[BoundaryLoop] = (),
    joined_to: int | None = None,
) -> tuple[LoopOutcome, LoopPatch | None]:
    """Makes the patch over a loop, or between the `rims` of a bridge from it to another loop, and joins it to the mesh.

    A loop that is to be continued may come without its exact surface, which is computed if it is used.

    Returns:
        The outcome, and the patch or None.

    Raises:
        TooManyPointsError: `target_edge_length` needs too many vertices.
    """
    seconds = 0.0 if solved is None else solved.seconds
    clock = Clock({"solve": seconds})
    try:
        end = perf_counter() + options.time_limit - seconds
        maker = _Maker(patched=patched, index=index, loops=rims or (loop,), options=options, clock=clock, end=end)
        new = maker.patch(solved)
        with _until(end):
            attributes, lowered = _attributes(patched, new)
    except SpinorGeomError as error:
        if isinstance(error, TooManyPointsError) and options.target_edge_length != "auto":
            raise
        clock.lap("failed")
        timings, solution = clock.with_total, None if solved is None else solved.solution
        return unfilled(index, loop, error, solution=solution, joined_to=joined_to, timings=timings), None
    patch = new.patch
    clock.lap("attributes")
    outcome = LoopOutcome(
        index=index,
        loop=loop,
        requested=True,
        filled=True,
        reason=new.reason,
        solution=new.solution,
        patch=patch,
        continuation=new.continuation,
        joined_to=joined_to,
        vertices_added=len(patch.vertices) - patch.boundary_size,
        faces_added=len(patch.faces),
        first_face=patched.join(patch, new.rim),
        edges_split=new.edges_split,
        displacement=new.displacement,
        faces_replaced=new.faces_replaced,
        self_intersections=len(new.crossings.own),
        mesh_intersections=len(new.crossings.mesh),
        patch_intersections=len(new.crossings.patches),
        is_searched=new.crossings.is_complete,
        choice=new.choice,
        remarks=(*loop.remarks, *new.remarks, *new.notes, *lowered, *_without_area(patch)),
        timings=clock.with_total,
    )
    return outcome, LoopPatch(index=index, rim=new.rim, patch=patch, attributes=attributes)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Maker:
    """Makes the patch over a loop, or between several."""

    patched: PatchedMesh
    index: int  # of the first loop
    loops: Sequence[BoundaryLoop]
    options: FillOptions
    clock: Clock
    end: float  # of the time limit, a time of `perf_counter`

    def patch(self, solved: SolvedLoop | None) -> NewPatch:
        """A patch to be joined to the mesh: a film or, unless `continuity` is "C0", a continuation if it is good."""

        @cache
        def film() -> NewPatch:
            exact = solved
            if exact is None:
                self.clock.lap("continuation")
                self.options.on_stage(self.index, "exact surface")
                left = max(self.end - perf_counter(), LEAST_TIME)
                exact = next(solved_loops(self.loops, replace(self.options, time_limit=left)))
                self.clock.lap("solve")
            return self._film(exact)

        continuity, end = self.options.continuity_of(self.index), self.end
        if continuity == "C0":
            return film()
        self.options.on_stage(self.index, "mesh")
        with _until((perf_counter() + end) / 2):
            start = _start(self.loops[0], self.options) if solved is None else self._first_patch(solved)
        self.clock.lap("mesh")
        start = start.split(self.patched)
        search = _SEARCH_SECONDS * len(start.patch.faces)
        self.options.on_stage(self.index, "continuation")
        # a film that is not solved yet needs half of the time
        end_of_continuation = (perf_counter() + end) / 2 if solved is None else end - search
        target = self.options.target_edge_length

        def continued(near: PatchedMesh, local: NewPatch, unit: float) -> NewPatch:
            with _until(end_of_continuation):
                lengths = GRADED if isinstance(target, str) else EdgeLengths(target / unit)
                return smooth_patch(near, local, lengths, unit, film, is_choice=continuity == "auto")

        try:
            if perf_counter() + _SEARCHES * search > end:
                raise NotContinuedError(f"{NOT_CONTINUED}: {NO_TIME}")
            new = self._changed(start, continued)
            if new.continuation is not None and len(new.crossings):
                raise NotContinuedError(f"{NOT_CONTINUED}: {new.crossings.notes[0]}")
        except NotContinuedError as error:
            new = film()
            if new.kind == "strip":
                raise SurfaceError(f"{new.reason}; {error}") from error
            if continuity == "auto":
                new = replace(new, choice=f"the film was chosen, because {error}")
            else:
                new = replace(new, remarks=(*new.remarks, str(error)))
        self.clock.lap("continuation")
        return new

    def _film(self, solved: SolvedLoop) -> NewPatch:
        """A minimal or discrete surface, or a strip, without intersections that can be avoided."""
        self.options.on_stage(self.index, "mesh")
        # the search for intersections needs time as well
        with _until(self.end - min(LEAST_TIME, self.options.time_limit / 10)):
            new = self._first_patch(solved)
        self.clock.lap("mesh")
        new, search = self._fitted(new)
        if not len(new.crossings):
            return new
        if perf_counter() + _SEARCHES * search > self.end:
            return replace(new, remarks=(*new.remarks, NOT_CLEARED))

        def cleared(near: PatchedMesh, local: NewPatch, _: float) -> NewPatch:
            with _until(self.end - search):  # of the patch without intersections
                return without_intersections(near, local.fitted(near))

        try:
            new = self._changed(new, cleared)
        except OutOfTimeError:
            new = replace(new, remarks=(*new.remarks, NOT_CLEARED))
        self.clock.lap("clearance")
        return new

    def _fitted(self, new: NewPatch) -> tuple[NewPatch, float]:
        """A patch fitted to the mesh, and the seconds of the search for its intersections."""
        self.options.on_stage(self.index, "crossings")
        begin = perf_counter()
        try:
            with _until(max(self.end, begin + LEAST_TIME)):
                new = new.fitted(self.patched)
        except OutOfTimeError:
            new = replace(new.split(self.patched), crossings=NOT_SEARCHED)
        search = perf_counter() - begin
        self.clock.lap("crossings")
        return new, search

    def _changed(self, new: NewPatch, change: Change) -> NewPatch:
        """A patch changed in its loop's frame, and cleared of intersections that only the mesh's coordinates have."""
        new, has_more = in_own_frame(self.patched, new, change)
        if has_more:
            with _until(self.end), suppress(OutOfTimeError):
                new = retriangulated(self.patched, new)
        return new

    def _first_patch(self, solved: SolvedLoop) -> NewPatch:
        """The mesh of the exact surface. Without one a discrete patch, or a strip between two loops to be continued."""
        solution, error, loops, options = solved.solution, solved.error, self.loops, self.options
        if solution is not None and error is None:
            try:
                return _exact_patch(solution, solved, options)
            except SpinorGeomError as problem:
                error = problem
        assert error is not None
        can_be_strip = options.continuity_of(self.index) != "C0" and len(loops) == 2 and isinstance(error, SurfaceError)
        if isinstance(error, (NoAreaError, TooManyPointsError)) or (len(loops) > 1 and not can_be_strip):
            raise error
        reason, target = str(error), edge_length_over(loops, options.target_edge_length)
        if can_be_strip:
            return NewPatch(patch=ruled_patch(loops, target), rims=loops, reason=reason)
        options.on_stage(self.index, "discrete surface")
        discrete, what = discrete_patch(loops[0], target)
        return NewPatch(patch=discrete, rims=loops, reason=f"{what}, because: {reason}")


def _start(loop: BoundaryLoop, options: FillOptions) -> NewPatch:
    """A discrete surface of about the least area, from which the mesh is continued. Raises as `discrete_patch`."""
    patch = graded_patch(loop, edge_length_over([loop], options.target_edge_length))
    require_area(loop, 2 * patch.area / loop.perimeter)
    return NewPatch(patch=patch, rims=[loop], reason="")


def _exact_patch(solution: PlateauSolution, solved: SolvedLoop, options: FillOptions) -> NewPatch:
    """The mesh of an exact surface. Raises as `mesh_patch`, or a SurfaceError for a surface that is not finite."""
    target = options.target_edge_length
    if solved.frame is None or solved.in_frame is None:
        patch = mesh_over_points(solution, target)
    else:
        try:
            patch = mesh_over_points(solved.in_frame, target if isinstance(target, str) else target / solved.frame.size)
        except TooManyPointsError as error:
            raise in_mesh_units(error, solved.frame.size) from error
        patch = patch.placed_by(solved.frame, np.concatenate([rim.loop.points for rim in solution.rims]))
    if not np.isfinite(patch.vertices).all():
        raise SurfaceError("the surface that was found is not finite everywhere")
    coarse = "" if patch.is_complete else _COARSE.format(len(patch.vertices))
    reason = "; ".join(filter(None, ["" if solution.converged else solution.reason, coarse]))
    return NewPatch(patch=patch, rims=[match.loop for match in solution.rims], solution=solution, reason=reason)


def _attributes(patched: PatchedMesh, new: NewPatch) -> tuple[dict[str, Float[np.ndarray, "n _"]], tuple[str, ...]]:
    """The attributes of the patch's inner vertices, and a remark if there was no time to interpolate them."""
    in_domain = new.solution is not None and not new.faces_replaced and new.continuation is None
    # a placed surface is made on use, and used for normals only
    surface = new.surface if NORMAL in patched.mesh.vertex_attributes else None
    own = partial(patch_attributes, patched.mesh, new.rim, new.patch, surface)
    try:
        return own(by="domain" if in_domain else "edges"), ()
    except OutOfTimeError:
        return own(by="nearest"), ("the attributes are those of the nearest rim vertices: the time limit was reached",)


def _without_area(patch: Patch) -> tuple[str, ...]:
    """A remark on degenerate faces, if there are any."""
    count = int((face_areas(patch.vertices, patch.faces) <= 0).sum())
    return (f"faces of the patch without area: {count} of {len(patch.faces)}",) if count else ()


def unfilled(
    index: int,
    loop: BoundaryLoop,
    reason: str | SpinorGeomError,
    *,
    solution: PlateauSolution | None = None,
    joined_to: int | None = None,
    timings: Mapping[str, float] | None = None,
) -> LoopOutcome:
    """The outcome of a loop that is left open because of an error or of the caller's options."""
    is_error, is_border = isinstance(reason, SpinorGeomError), isinstance(reason, SheetBorderError)
    return LoopOutcome(
        index=index,
        loop=loop,
        requested=is_error and not is_border,
        filled=False,
        reason=str(reason),
        is_border=is_border,
        solution=solution,
        joined_to=joined_to,
        remarks=loop.remarks if is_error else (),
        timings=timings or {},
    )
