"""A patch before it is joined to the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Int

from spinor_geom.fill.continuation import Continuation, Start
from spinor_geom.fill.patched_mesh import NO_CROSSINGS, Crossings, PatchedMesh, split_chords
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface


@dataclass(frozen=True, kw_only=True, eq=False)
class NewPatch:
    """A patch and its loops; the other fields are those of `LoopOutcome`."""

    patch: Patch
    rims: Sequence[BoundaryLoop]
    reason: str
    solution: PlateauSolution | None = None
    edges_split: int = 0
    displacement: float = 0.0
    faces_replaced: int = 0
    crossings: Crossings = NO_CROSSINGS
    continuation: Continuation | None = None
    choice: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def kind(self) -> Start:
        """The kind of the patch, before its continuation if it was continued."""
        if self.solution is not None:
            return "minimal"
        return "strip" if self.patch.hole_sizes else "discrete"

    @property
    def surface(self) -> ArraySurface | None:
        """The exact surface that the patch is a mesh of."""
        return None if self.solution is None or self.continuation is not None else self.solution.array_surface

    @cached_property
    def rim(self) -> Int[np.ndarray, " m"]:
        """Mesh vertices of the patch's boundary vertices."""
        return np.concatenate([loop.vertex_ids for loop in self.rims])

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the continuation, replaced faces and intersections."""
        remarks = () if self.continuation is None else self.continuation.remarks
        if not self.faces_replaced:
            return (*remarks, *self.crossings.notes)
        note = (
            f"{self.faces_replaced} faces of the patch triangulate their outline without inner vertices, because the "
            "faces before intersected something"
        )
        return (*remarks, note, *self.crossings.notes)

    def fitted(self, patched: PatchedMesh) -> NewPatch:
        """Splits inner edges that are edges of the mesh or of another patch, then finds intersections."""
        taken = patched.taken_chords(self.patch, self.rim)
        patch = split_chords(self.patch, taken, self.surface) if len(taken) else self.patch
        crossings = patched.crossings(patch)
        return replace(self, patch=patch, edges_split=self.edges_split + len(taken), crossings=crossings)
