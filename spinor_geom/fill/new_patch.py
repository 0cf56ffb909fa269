"""A patch before it is joined to the mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from jaxtyping import Int

from spinor_geom.fill.continuation import Continuation, Start
from spinor_geom.fill.patched_mesh import NO_CROSSINGS, Crossings, PatchedMesh, numbered, split_chords
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface


@dataclass(frozen=True, kw_only=True, eq=False)
class NewPatch:
    """A patch and its loops. The other fields are those of `LoopOutcome`."""

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
        new = self.split(patched)
        return replace(new, crossings=patched.crossings(new.patch))

    def split(self, patched: PatchedMesh) -> NewPatch:
        """Splits inner edges that are edges of the mesh or of another patch. The vertices get their final positions."""
        taken, patch = patched.taken_chords(self.patch, self.rim), self.patch
        if len(taken):
            patch = split_chords(patch, taken, self.surface)
        return replace(self, patch=patched.as_stored(patch, self.rim), edges_split=self.edges_split + len(taken))


_MARGIN = 0.5  # of the box in which a patch may grow, per diagonal of the patch

# the mesh around a patch, the patch, and the unit of their coordinates
Change: TypeAlias = Callable[[PatchedMesh, NewPatch, float], NewPatch]


def in_own_frame(patched: PatchedMesh, new: NewPatch, change: Change) -> tuple[NewPatch, bool]:
    """A patch after a change made in the frame of its loops.

    Vertices and faces of the mesh around the patch are numbered by their positions in the frame. The patch comes
    without its intersections there.

    Returns:
        The patch in the mesh's coordinates, and whether it has more intersections there than in the frame: by rounding,
        or beyond the surroundings.
    """
    frame = LoopFrame.of(*new.rims)
    rims = numbered(map(frame.loop, new.rims))
    patch = new.patch.placed_by(frame.inverse, np.concatenate([rim.points for rim in rims]))
    patch = replace(patch, vertices=frame.rounded(patch.vertices))
    low, high = new.patch.vertices.min(axis=0), new.patch.vertices.max(axis=0)
    margin = _MARGIN * float(np.linalg.norm(high - low))
    near = patched.near((low - margin, high + margin), new.rims, frame)
    start = replace(
        new,
        patch=patch,
        rims=rims,
        solution=None if new.solution is None else new.solution.placed_by(frame.inverse, *rims),
        crossings=NO_CROSSINGS,
    )
    changed = change(near, start, frame.size)
    outside = np.concatenate([loop.points for loop in new.rims])
    patch = patched.as_stored(changed.patch.placed_by(frame, outside), new.rim)
    continuation = changed.continuation
    placed = replace(
        changed,
        patch=patch,
        rims=new.rims,
        solution=new.solution,
        displacement=changed.displacement * frame.size,
        crossings=patched.crossings(patch),
        continuation=None if continuation is None else continuation.enlarged(frame.size),
    )
    return placed, len(placed.crossings) > len(changed.crossings)
