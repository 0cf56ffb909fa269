"""Fills one loop, or the gap between two: refuses what is no hole, meshes its surface, interpolates the attributes."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.deadline import time_limit
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
from spinor_geom.fill.border import MOST_FOLDED_BACK
from spinor_geom.fill.clock import Clock
from spinor_geom.fill.continuation import Start
from spinor_geom.fill.continuity import CONTINUITY, Continuity
from spinor_geom.fill.discrete_patch import discrete_patch, strip_patch
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.smooth_patch import Finished, continued
from spinor_geom.fill.stitch import LoopPatch, RimEdges, fit_to_rim, patch_chords
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.options import Model, require_model
from spinor_geom.plateau.solution import PlateauSolution

# A patch whose surface misses the loop by more, as RMS share of the mean edge, would be wrong beside its rim.
MAX_RESIDUAL_PER_EDGE = 0.1
MIN_WIDTH_PER_EDGE = 1e-6  # of a loop's mean edge: far above round-off, far below any hole that was meant
_WHOLE_SLIT = 1 - 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class FillOptions:
    """What every loop of one call is filled with.

    Attributes:
        target_edge_length: of the patches, in mesh units, or "auto" for each loop's mean edge length.
        model: the holomorphic model, as `solve_plateau` takes it.
        tolerance: RMS boundary residual per mean loop edge.
        time_limit: seconds for the exact surface of a loop, for its discrete one, and for its continuation.
        continuity: "C0" for minimal surfaces, "C1" for their continuations.
        fills_borders: whether a loop is filled whose patch lies on the mesh.
        on_stage: is called with a loop's place and what comes next for it, as "exact surface".

    Raises:
        OptionError: a number is not positive, or the model or the continuity is unknown.
    """

    target_edge_length: float | Literal["auto"]
    model: Model
    tolerance: float
    time_limit: float = math.inf
    continuity: Continuity = "C0"
    fills_borders: bool = True
    on_stage: Callable[[int, str], None] = lambda place, stage: None

    def __post_init__(self) -> None:
        # here once, so that what goes wrong later is one loop's own
        require_model(self.model)
        require_positive("tolerance", self.tolerance)
        require_positive("time_limit", self.time_limit, finite=False)
        if self.continuity not in CONTINUITY:
            raise OptionError(f"continuity must be 'C0' or 'C1', not {self.continuity!r}")
        if not isinstance(self.target_edge_length, str):
            require_positive("target_edge_length", self.target_edge_length, instead="'auto' or ")
        elif self.target_edge_length != "auto":
            raise OptionError(
                f"target_edge_length must be 'auto' or a positive number, not {self.target_edge_length!r}"
            )


def require_positive(name: str, value: Any, *, finite: bool = True, instead: str = "") -> None:
    """Checks an option.

    Args:
        name: of the option.
        value: what was given.
        finite: whether infinity is refused.
        instead: what else it may be, for the message.

    Raises:
        OptionError: the value is not a positive number.
    """
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value <= (sys.float_info.max if finite else math.inf):
        raise OptionError(f"{name} must be {instead}a positive number, not {value!r}")


def fill_loop(
    mesh: TriangleMesh,
    place: int,
    loop: BoundaryLoop,
    answer: Callable[[], PlateauSolution | SpinorGeomError],
    taken: RimEdges,
    surroundings: Surroundings,
    options: FillOptions,
    *,
    others: Mapping[int, BoundaryLoop] = MappingProxyType({}),
) -> tuple[LoopOutcome, LoopPatch | None]:
    """The patch of one loop, or from it to others, or the reason why it has none.

    Where one loop has no exact surface, or none that follows it, its patch is discrete. A patch joins what is taken and
    the surroundings.

    Args:
        mesh: the mesh.
        place: the loop's.
        loop: the loop.
        answer: gives the loop's minimal surface, or the reason why it has none.
        taken: edges that the patch must not have.
        surroundings: what the patch may cross.
        options: of the call.
        others: the other loops of a bridge, by their places.

    Raises:
        TooManyPointsError: the edge length asks for more vertices than anyone can use.
    """
    clock, joined_to = Clock(), next(iter(others), None)
    options.on_stage(place, "exact surface")
    found = answer()
    clock.lap("solve")
    solution = found if isinstance(found, PlateauSolution) else None
    try:
        options.on_stage(place, "mesh")
        made = _patch_over(place, loop, found, options, tuple(others.values()))
        rim = np.concatenate([one.vertex_ids for one in made.rims])
        patch, split = fit_to_rim(rim, made.patch, taken, made.middles)
        clock.lap("mesh")
        options.on_stage(place, "crossings")
        crossings = surroundings.crossings(patch)
        clock.lap("crossings")
    except TooManyPointsError:
        raise
    except SpinorGeomError as error:
        clock.lap("failed")
        return unfilled(place, loop, str(error), solution=solution, joined_to=joined_to, timings=clock.laps()), None
    if not options.fills_borders and len(crossings.mesh):
        folded = taken.share_folded_back(mesh, rim, patch)
        if folded > MOST_FOLDED_BACK:
            border = SheetBorderError(folded=folded, crossed=len(crossings.mesh))
            return (
                unfilled(place, loop, str(border), solution=solution, is_border=True, timings=clock.laps()),
                None,
            )
    last = Finished(patch=patch, edges_split=split, crossings=crossings)
    if options.continuity == "C1":
        options.on_stage(place, "continuation")
        with time_limit(options.time_limit):
            target = target_length(made.rims, options)
            last = continued(last, rim, target, taken, surroundings, started_from=made.kind)
        clock.lap("continuation")
        if made.kind == "strip" and last.continuation is None:
            reason = "; ".join([made.reason, *last.remarks])
            return unfilled(place, loop, reason, joined_to=joined_to, timings=clock.laps()), None
    attributes = patch_attributes(
        mesh.vertex_attributes,
        rim,
        last.patch,
        None if made.solution is None or last.continuation is not None else made.solution.surface,
        is_planned=made.solution is not None,
        labels=mesh.labels,
    )
    clock.lap("attributes")
    surroundings.join(last.patch)
    taken.take(rim[patch_chords(last.patch)])
    outcome = LoopOutcome(
        index=place,
        loop=loop,
        requested=True,
        filled=True,
        reason=made.reason if last.continuation is None else last.continuation.reason,
        solution=made.solution,
        patch=last.patch,
        continuation=last.continuation,
        joined_to=joined_to,
        vertices_added=len(last.patch.vertices) - last.patch.boundary_size,
        faces_added=len(last.patch.faces),
        edges_split=last.edges_split,
        self_intersections=len(last.crossings.own),
        mesh_intersections=len(last.crossings.mesh),
        patch_intersections=len(last.crossings.patches),
        remarks=(*loop.remarks, *last.remarks, *last.crossings.notes),
        timings=clock.laps(),
    )
    return outcome, LoopPatch(place=place, rim=rim, patch=last.patch, attributes=attributes)


def target_length(loops: Sequence[BoundaryLoop], options: FillOptions) -> float:
    """The edge length of the patch over some loops, in mesh units."""
    if isinstance(options.target_edge_length, str):
        return sum(loop.perimeter for loop in loops) / sum(map(len, loops))
    return float(options.target_edge_length)


def unfilled(
    place: int,
    loop: BoundaryLoop,
    reason: str,
    *,
    requested: bool = True,
    is_border: bool = False,
    solution: PlateauSolution | None = None,
    joined_to: int | None = None,
    timings: Mapping[str, float] | None = None,
) -> LoopOutcome:
    """The outcome of a loop that is left open."""
    return LoopOutcome(
        index=place,
        loop=loop,
        requested=requested and not is_border,
        filled=False,
        reason=reason,
        is_border=is_border,
        solution=solution,
        joined_to=joined_to,
        remarks=loop.remarks if requested else (),
        timings=timings or {},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Made:
    """A patch, its loops, the surface that it is a mesh of, and why it is not what was asked for."""

    patch: Patch
    rims: Sequence[BoundaryLoop]
    solution: PlateauSolution | None
    reason: str

    @property
    def kind(self) -> Start:
        """What the patch is."""
        if self.solution is not None:
            return "minimal"
        return "strip" if self.patch.hole_sizes else "discrete"

    def middles(self, patch: Patch, chords: Int[np.ndarray, "c 2"]) -> Float[np.ndarray, "c 3"]:
        """Positions halfway along chords: on the surface, halfway in Ω, where there is one."""
        if self.solution is None:
            return np.asarray(patch.vertices[chords].mean(axis=1))
        return np.asarray(self.solution.surface.position(patch.points[chords].mean(axis=1)), dtype=np.float64)


def _patch_over(
    place: int,
    loop: BoundaryLoop,
    found: PlateauSolution | SpinorGeomError,
    options: FillOptions,
    others: tuple[BoundaryLoop, ...],
) -> _Made:
    """The mesh of an exact surface; without one a discrete patch, or between two loops a strip to be continued."""
    try:
        if isinstance(found, SpinorGeomError):
            raise found
        return _exact_patch(loop, found, options)
    except (NoAreaError, TooManyPointsError):
        raise
    except SpinorGeomError as error:
        if others and (options.continuity == "C0" or len(others) > 1 or not isinstance(error, SurfaceError)):
            raise
        reason = error
    rims = (loop, *others)
    target = target_length(rims, options)
    if others:
        return _Made(patch=strip_patch(loop, others[0], target), rims=rims, solution=None, reason=str(reason))
    options.on_stage(place, "discrete surface")
    patch, what = discrete_patch(loop, target, seconds=options.time_limit)
    return _Made(patch=patch, rims=rims, solution=None, reason=f"{what}, because: {reason}")


def _exact_patch(loop: BoundaryLoop, solution: PlateauSolution, options: FillOptions) -> _Made:
    if not solution.boundary_residual.rms_per_edge <= MAX_RESIDUAL_PER_EDGE:
        raise SurfaceError(f"no surface was found that follows the loop; the best: {solution.reason}")
    refuse_empty(loop, 2 * solution.area / loop.perimeter)
    patch = mesh_patch(solution, options.target_edge_length)
    if not np.isfinite(patch.vertices).all():
        raise SurfaceError("the surface that was found is not finite everywhere")
    rims = [match.loop for match in solution.rims]
    return _Made(patch=patch, rims=rims, solution=solution, reason="" if solution.converged else solution.reason)


def refusal(loop: BoundaryLoop, taken: RimEdges) -> SpinorGeomError | None:
    """Why a loop bounds no hole, or None; see `refuse_what_is_no_hole`."""
    try:
        refuse_what_is_no_hole(loop, taken)
    except SpinorGeomError as error:
        return error
    return None


def refuse_what_is_no_hole(loop: BoundaryLoop, taken: RimEdges) -> None:
    """Checks that a loop bounds a hole, before anything is solved.

    Raises:
        NonManifoldEdgeError: one of its edges has several faces already.
        ZeroWidthSlitError: all of it lies on the loop's own other side.
        SeamError: edges of it lie on edges of another loop.
        LoneFaceError: it is the outline of a single face.
        NoAreaError: its points lie on a line.
    """
    if loop.obstacle is not None:
        raise loop.obstacle
    if loop.slit_fraction > _WHOLE_SLIT:
        raise ZeroWidthSlitError(fraction=loop.slit_fraction, vertices=first_slit_edge(loop))
    if len(loop.seam_edges):
        raise SeamError(edge=[int(v) for v in loop.seam_edges[0]], count=len(loop.seam_edges))
    face = taken.face_on(loop)
    if face is not None:
        raise LoneFaceError(face=face, vertices=[int(v) for v in loop.vertex_ids])
    refuse_empty(loop, loop.diagonal / loop.elongation)


def first_slit_edge(loop: BoundaryLoop) -> list[int]:
    """The vertices of the first edge of a loop that lies on another of its edges, run the other way."""
    ends = np.roll(loop.points, -1, axis=0)
    first, second = loop_crossings(loop.points).T
    opposite = (loop.points[first] == ends[second]).all(axis=1) & (ends[first] == loop.points[second]).all(axis=1)
    edge = first[np.argmax(opposite)]
    return [int(loop.vertex_ids[edge]), int(loop.vertex_ids[(edge + 1) % len(loop)])]


def refuse_empty(loop: BoundaryLoop, width: float) -> None:
    """Checks that a loop is wider than nothing.

    Args:
        loop: the loop.
        width: of its hole, in mesh units.

    Raises:
        NoAreaError: the width is below 1e-6 of the loop's mean edge.
    """
    if width <= MIN_WIDTH_PER_EDGE * loop.mean_edge_length:
        raise NoAreaError(width=width, mean_edge=loop.mean_edge_length)
