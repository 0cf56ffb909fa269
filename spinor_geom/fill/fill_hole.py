"""Fills the holes of a mesh with minimal surfaces."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, TypeVar, overload

from spinor_geom.adapters import MeshFile, read_mesh, to_mesh
from spinor_geom.errors import ImperfectFillWarning
from spinor_geom.fill.fill_options import (
    TIME_LIMIT,
    Bridge,
    Choice,
    ContinuityName,
    FillOptions,
    Islands,
    LoopContinuity,
    untold,
)
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.filling import Filling
from spinor_geom.fill.loop_choice import LoopChoice
from spinor_geom.fill.merging import merged
from spinor_geom.fill.solved_loops import solved_loops
from spinor_geom.mesh.triangle_mesh import require_faces
from spinor_geom.plateau.options import Model
from spinor_geom.plateau.steps import Clock
from spinor_geom.plateau.threads import one_thread

if TYPE_CHECKING:
    from typing_extensions import Unpack

MeshT = TypeVar("MeshT")
_Path: TypeAlias = str | os.PathLike[str]
_MOST_WARNED = 5  # shortcomings listed in one warning


class _Rest(TypedDict, total=False):
    """The options of `fill_hole` that its return type does not depend on."""

    bridge: Bridge | None
    islands: Islands
    continuity: ContinuityName | LoopContinuity
    merge: bool | float
    keep_largest: bool
    max_perimeter: float | None
    target_edge_length: float | Literal["auto"]
    model: Model
    tolerance: float
    time_limit: float
    on_loop: Callable[[LoopOutcome, int], None] | None
    on_stage: Callable[[int, str], None] | None


@overload
def fill_hole(
    mesh: _Path, loop: LoopChoice = "all", *, return_report: Literal[False] = False, **options: Unpack[_Rest]
) -> MeshFile: ...
@overload
def fill_hole(
    mesh: _Path, loop: LoopChoice = "all", *, return_report: Literal[True], **options: Unpack[_Rest]
) -> tuple[MeshFile, FillResult]: ...
@overload
def fill_hole(
    mesh: MeshT, loop: LoopChoice = "all", *, return_report: Literal[False] = False, **options: Unpack[_Rest]
) -> MeshT: ...
@overload
def fill_hole(
    mesh: MeshT, loop: LoopChoice = "all", *, return_report: Literal[True], **options: Unpack[_Rest]
) -> tuple[MeshT, FillResult]: ...
def fill_hole(
    mesh: Any,
    loop: LoopChoice = "all",
    *,
    bridge: Bridge | None = None,
    islands: Islands = "ignore",
    continuity: ContinuityName | LoopContinuity = "C0",
    merge: bool | float = False,
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    model: Model = "auto",
    tolerance: float = 1e-3,
    time_limit: float = TIME_LIMIT,
    return_report: bool = False,
    on_loop: Callable[[LoopOutcome, int], None] | None = None,
    on_stage: Callable[[int, str], None] | None = None,
) -> Any:
    """Fills holes of a mesh with minimal surfaces bounded by their loops.

    The input is not changed. Its vertices, faces and attributes come first in the result, unchanged. The patches
    follow loop by loop, share the loop's vertices and are oriented like their neighbours. Vertex attributes are
    interpolated harmonically. Integer ones are taken from the nearest rim vertex, normals from the surface.

    If no exact surface is found for a loop within the time limit, the loop is closed by a discrete minimal surface.
    Loops that are not holes are left open: slits of zero width, outlines of single faces, loops with non-manifold
    edges. Seams (loops with edges on those of another loop) and borders of sheets (over which a patch would lie on the
    mesh) are left open unless `loop` names them. A patch that intersects itself (as every disk over a knotted loop),
    the mesh or another patch is kept. The report contains all of this. Without a report, a warning is issued.

    The rims of a bridge may have different numbers of points. Rims too far from each other bound no connected surface
    and stay open, as do rims of pieces with opposite orientations.

    Args:
        mesh: a path, a (vertices, faces) pair of arrays or tensors, or any mesh type that has an adapter.
        loop: which holes: "all", an index of `boundary_loops(mesh)`, several indices, or one of those loops.
        bridge: two or more indices of loops to be joined by one minimal surface, or several such groups, as in
            `[(0, 1), (2, 3)]`. Of the other loops only those that `loop` names are filled.
        islands: "join" joins a hole and the loose pieces in it by one surface, "ignore" fills them separately. The
            report lists the loose pieces in each hole.
        continuity: "C0" or "film" for the minimal surface over each rim. "C1" or "smooth" for a patch that continues
            the tangents and the curvature of the mesh around it, as the top of a sphere or, between two rims, as a
            tube. "auto" for the film where it meets the mesh at more than 65° (RMS), as at the end of a pipe, and the
            smooth patch elsewhere. A smooth patch that is not good is replaced by the film, with a remark. Or one for
            each loop, by index, and one for the others ("C0" if it is not given): `{4: "film", "default": "smooth"}`.
            A bridge has that of the first of its loops that is named there.
        merge: merges vertices first: with True those of equal position up to rounding to single precision, with a
            number those up to that distance, in mesh units. The first of merged vertices is kept, with its attributes.
            The result is the merged mesh with the patches. Not available for trimesh's scenes.
        keep_largest: leaves the loop of longest perimeter open, such as the outer border of a scan.
        max_perimeter: leaves loops longer than this open, in mesh units.
        target_edge_length: of the patches, in mesh units. "auto" is the mean edge length of each loop. Edges of smooth
            continuations then grow inwards.
        model: the holomorphic model, as `solve_plateau` takes it.
        tolerance: root mean square distance between a patch's boundary and the curve through its loop, in mean edges of
            the loop. A patch that exceeds it is kept and reported as not converged. The same applies if the distance in
            any part of the loop exceeds 100 × tolerance × that part's mean edge.
        time_limit: seconds for each loop in all. Its exact surface gets half, and so does a continuation, which comes
            first. A loop may exceed it by up to a second, to be closed and checked for intersections. A stage that
            reaches the limit keeps its best result: a mesh with larger triangles, a discrete surface or the film.
            `reason` or `remarks` then say so.
        return_report: also returns a `FillResult`.
        on_loop: is called after each requested loop with its outcome and the number of requested loops.
        on_stage: is called before each stage of a loop with its index and the stage: "exact surface" (of small loops
            several at once), "mesh", "discrete surface" where there is no exact one, "crossings", "continuation".

    Returns:
        The filled mesh, of the type of the input, or a `MeshFile` for a path. With `return_report` a pair of it and the
        `FillResult`.

    Raises:
        UnknownMeshTypeError: no adapter supports the type.
        MeshFileError: the file is missing or malformed.
        MeshError: the mesh has no faces, or its faces do not share their vertices.
        LoopIndexError: an index in `loop` or `bridge` is out of range.
        ForeignLoopError: `loop` is not a loop of this mesh.
        OptionError: an option has a value that is not allowed.

    Warns:
        ImperfectFillWarning: without a report: a loop was left open, is closed by a discrete surface or not within the
            tolerance, or its patch intersects something.
    """
    choice = Choice(loop=loop, bridge=bridge, islands=islands, keep_largest=keep_largest, max_perimeter=max_perimeter)
    options = FillOptions(
        target_edge_length=target_edge_length,
        model=model,
        tolerance=tolerance,
        time_limit=time_limit,
        continuity=continuity,
        on_stage=on_stage or untold,
    )
    clock = Clock()
    source = merged(read_mesh(mesh) if isinstance(mesh, (str, os.PathLike)) else mesh, merge)
    triangles = to_mesh(source)
    require_faces(triangles)
    clock.lap("read")
    with one_thread():
        filling = Filling(triangles, choice, options)
        clock.lap("loops")
        outcomes, patches = filling.filled(solved_loops(filling.rims, options), on_loop)
    clock.lap("fill")
    result = filling.result(source, outcomes, patches, clock)
    if return_report:
        return result.mesh, result
    if found := result.shortcomings:
        more = f"; and {len(found) - _MOST_WARNED} more" if len(found) > _MOST_WARNED else ""
        message = f"fill_hole: {'; '.join(found[:_MOST_WARNED])}{more} (return_report=True lists all)"
        warnings.warn(message, ImperfectFillWarning, stacklevel=2)
    return result.mesh
