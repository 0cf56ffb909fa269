"""Fills one loop, or the gap between two: refuses what is no hole, solves, meshes, interpolates the attributes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.errors import (
    LoneFaceError,
    NoAreaError,
    OptionError,
    SeamError,
    SpinorGeomError,
    SurfaceError,
    ZeroWidthSlitError,
)
from spinor_geom.fill.attributes import patch_attributes
from spinor_geom.fill.clock import Clock
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.stitch import LoopPatch, RimEdges, fit_to_rim
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.task import Model, require_model

# A patch whose surface misses the loop by more, as RMS share of the mean edge, would be wrong beside its rim.
MAX_RESIDUAL_PER_EDGE = 0.1
MIN_WIDTH_PER_EDGE = 1e-6  # of a loop's mean edge: far above round-off, far below any hole that was meant


@dataclass(frozen=True, kw_only=True, eq=False)
class FillOptions:
    """What every loop of one call is filled with.

    Attributes:
        target_edge_length: of the patches, in mesh units, or "auto" for each loop's mean edge length.
        model: the holomorphic model, as `solve_plateau` takes it.
        tolerance: RMS boundary residual per mean loop edge.

    Raises:
        OptionError: a length or the tolerance is not a positive number, or the model is unknown.
    """

    target_edge_length: float | Literal["auto"]
    model: Model
    tolerance: float

    def __post_init__(self) -> None:
        # here once, so that what goes wrong later is one loop's own
        require_model(self.model)
        require_positive("tolerance", self.tolerance)
        if isinstance(self.target_edge_length, str):
            if self.target_edge_length != "auto":
                raise OptionError(
                    f"target_edge_length must be 'auto' or a positive number, not {self.target_edge_length!r}"
                )
        else:
            require_positive("target_edge_length", self.target_edge_length)


def require_positive(name: str, value: float) -> None:
    """Checks an option.

    Raises:
        OptionError: the value is not a positive finite number.
    """
    if not 0 < value < np.inf:
        raise OptionError(f"{name} must be a positive number, not {value!r}")


def fill_loop(
    mesh: TriangleMesh,
    place: int,
    loop: BoundaryLoop,
    solve: Callable[[], PlateauSolution],
    taken: RimEdges,
    surroundings: Surroundings,
    options: FillOptions,
) -> tuple[LoopOutcome, LoopPatch | None]:
    """The patch of one loop, or from it to another, or the reason why it has none.

    A patch joins what is taken and the surroundings.

    Args:
        mesh: the mesh.
        place: the loop's.
        loop: the loop.
        solve: gives the loop's minimal surface, or raises the reason why it has none.
        taken: edges that the patch must not have.
        surroundings: what the patch may cross.
        options: of the call.
    """
    clock = Clock()
    solution: PlateauSolution | None = None
    try:
        solution = solve()
        refuse_empty(loop, 2 * solution.area / loop.perimeter)
        if not solution.boundary_residual.rms_per_edge <= MAX_RESIDUAL_PER_EDGE:
            raise SurfaceError(f"no surface was found that follows the loop; the best: {solution.reason}")
        clock.lap("solve")
        surface = solution.surface

        def position(points: Complex[np.ndarray, " c"]) -> Float[np.ndarray, "c 3"]:
            return np.asarray(surface.position(points), dtype=np.float64)

        rim = np.concatenate([match.loop.vertex_ids for match in solution.rims])
        patch, split = fit_to_rim(rim, mesh_patch(solution, options.target_edge_length), taken, position)
        if not np.isfinite(patch.vertices).all():
            raise SurfaceError("the surface that was found is not finite everywhere; no patch was made")
        clock.lap("mesh")
        attributes = patch_attributes(mesh.vertex_attributes, rim, patch, surface)
        clock.lap("attributes")
        crossings = surroundings.join(patch)
        clock.lap("crossings")
    except SpinorGeomError as error:
        clock.lap("failed")
        outcome = LoopOutcome(
            index=place,
            loop=loop,
            requested=True,
            filled=False,
            reason=str(error),
            solution=solution,
            timings=clock.laps(),
        )
        return outcome, None
    outcome = LoopOutcome(
        index=place,
        loop=loop,
        requested=True,
        filled=True,
        reason="" if solution.converged else solution.reason,
        solution=solution,
        patch=patch,
        vertices_added=len(patch.vertices) - patch.boundary_size,
        faces_added=len(patch.faces),
        edges_split=split,
        self_intersections=len(crossings.own),
        mesh_intersections=len(crossings.mesh),
        patch_intersections=len(crossings.patches),
        remarks=crossings.notes,
        timings=clock.laps(),
    )
    return outcome, LoopPatch(place=place, rim=rim, patch=patch, attributes=attributes)


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
        RepeatedPointError: two neighbouring vertices lie in one place.
        ZeroWidthSlitError: edges of it lie on the loop's own other side.
        SeamError: edges of it lie on edges of another loop.
        LoneFaceError: it is the outline of a single face.
        NoAreaError: its points lie on a line.
    """
    require_distinct_neighbours(loop.points)
    if loop.slit_fraction:
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
