"""A patch before it is joined to the mesh: chords split, moved off the mesh, or continued smoothly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Int

from spinor_geom.errors import SingularMatrixError, SurfaceError, TooManyPointsError
from spinor_geom.fill.clearance import cleared
from spinor_geom.fill.collar import bend_across, collar_of
from spinor_geom.fill.continuation import MOST_AREA, Continuation, Start, continue_patch
from spinor_geom.fill.fairing import folded_sides
from spinor_geom.fill.patched_mesh import NO_CROSSINGS, Crossings, PatchedMesh
from spinor_geom.fill.retriangulation import retriangulated
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.spinor_surface import SpinorSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class NewPatch:
    """A patch, its loops, and what `LoopOutcome` reports of it."""

    patch: Patch
    rims: Sequence[BoundaryLoop]
    reason: str
    solution: PlateauSolution | None = None
    edges_split: int = 0
    displacement: float = 0.0
    faces_replaced: int = 0
    crossings: Crossings = NO_CROSSINGS
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
        """Mesh vertices of the patch's boundary vertices."""
        return np.concatenate([loop.vertex_ids for loop in self.rims])

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on replaced faces and intersections."""
        if not self.faces_replaced:
            return self.crossings.notes
        note = (
            f"{self.faces_replaced} faces of the patch are a triangulation of their outline without inner vertices, "
            "because the surface's own crossed something there"
        )
        return (note, *self.crossings.notes)

    def fitted(self, patched: PatchedMesh) -> NewPatch:
        """Splits edges that the mesh or another patch has, then looks for intersections."""
        patch, split = patched.fitted(self.patch, self.rim, self.surface)
        crossings = patched.crossings(patch)
        return replace(self, patch=patch, edges_split=self.edges_split + split, crossings=crossings)

    def cleared(self, patched: PatchedMesh) -> NewPatch:
        """Moves a patch off the mesh that it intersects, and retriangulates what still intersects something."""
        if not len(self.crossings):
            return self
        clear = cleared(patched, self.rim, self.patch, self.crossings, self.surface)
        last = retriangulated(patched, self.rim, clear.patch, clear.crossings)
        return replace(
            self,
            patch=last.patch,
            crossings=last.crossings,
            edges_split=self.edges_split + clear.edges_split,
            displacement=clear.displacement,
            faces_replaced=last.faces,
        )

    def continued(self, patched: PatchedMesh, target: float) -> NewPatch:
        """The smooth continuation of the mesh over the same rim, or this patch with the reason against it.

        A patch without inner vertices stays as it is. `target` is the edge length for new meshes. A SurfaceError is
        raised for a strip that is not continued, as it is no surface to be kept.
        """
        if len(self.patch.vertices) == len(self.rim):
            return self.not_continued()
        collar = collar_of(patched, self.rim, self.patch)
        try:
            moved = continue_patch(self.patch, collar, target, is_conformal=self.start != "discrete")
        except (SingularMatrixError, TooManyPointsError) as error:
            return self.not_continued(f": {error}")
        before, after = bend_across(collar, self.patch), bend_across(collar, moved.patch)
        ratio = moved.patch.area / self.patch.area
        reason_against = (
            f": {moved.steps} steps left a bend of {after.rms:.3g}° (RMS) across the rim, where it has "
            f"{before.rms:.3g}°, and {ratio:.2g} times its area"
        )
        is_second_best = bool(moved.lowered) or not moved.converged
        if is_second_best and (after.rms >= before.rms or ratio > MOST_AREA):
            return self.not_continued(reason_against)
        continuation = Continuation.of(
            moved, collar, started_from=self.start, before=before, after=after, area_ratio=ratio
        )
        smooth = replace(
            self,
            patch=moved.patch,
            reason=continuation.reason,
            continuation=continuation,
            remarks=continuation.remarks,
        ).fitted(patched)
        if is_second_best and (after.rms >= 90 or moved.folds):
            # it is folded or turns back over the mesh, which only fewer intersections than before make up for
            if len(smooth.crossings) == len(self.crossings) or not (before.rms >= 90 or folded_sides(self.patch)):
                return self.not_continued(reason_against)
            remark = (
                "the patch is folded or turns back over the mesh, and so is the surface it started from, which crosses "
                f"{len(self.crossings)} pairs of faces, and the patch {len(smooth.crossings)}"
            )
            smooth = replace(smooth, remarks=(*smooth.remarks, remark))
        return smooth

    def not_continued(self, reason: str = "") -> NewPatch:
        """This patch with a remark on why it stays; a SurfaceError for a strip."""
        remarks = (f"the patch was not continued smoothly{reason}",) if reason else ()
        if self.start == "strip":
            raise SurfaceError("; ".join([self.reason, *remarks]))
        return replace(self, remarks=remarks)


def cleared_continuation(smooth: NewPatch, start: NewPatch, patched: PatchedMesh) -> NewPatch:
    """A continued patch or, where that has fewer intersections, the patch it started from; both cleared.

    Of two with as many, one with replaced faces is worse.
    """
    notes = smooth.crossings.notes
    smooth = smooth.cleared(patched)
    if smooth.continuation is None or not (len(smooth.crossings) or smooth.faces_replaced):
        return smooth
    start = start.cleared(patched)
    ranks = [(len(made.crossings), bool(made.faces_replaced)) for made in (smooth, start)]
    return smooth if ranks[0] <= ranks[1] else start.not_continued(f", as then {', '.join(notes)}")
