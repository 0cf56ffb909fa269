"""Changes a patch in the frame of its loop, so that the result does not depend on how the mesh is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import NO_CROSSINGS, PatchedMesh
from spinor_geom.mesh.loop_frame import LoopFrame

# the mesh around a patch, the patch, and the unit of their coordinates
Change: TypeAlias = Callable[[PatchedMesh, NewPatch, float], NewPatch]


def in_own_frame(patched: PatchedMesh, new: NewPatch, change: Change) -> tuple[NewPatch, bool]:
    """A patch over one loop after a change made in the loop's frame; between several loops in the mesh's coordinates.

    Vertices and faces of the mesh around the patch are numbered by their positions in the frame. The patch comes
    without its intersections there.

    Returns:
        The patch in the mesh's coordinates, and whether it has more intersections there than in the frame: by rounding,
        or beyond the surroundings.
    """
    if len(new.rims) > 1:
        return change(patched, new, 1.0), False
    (loop,) = new.rims
    frame = LoopFrame.of(loop)
    rim = replace(frame.loop(loop), vertex_ids=np.arange(len(loop)))
    patch = new.patch.placed_by(frame.inverse, rim.points)
    patch = replace(patch, vertices=frame.rounded(patch.vertices))
    low, high = new.patch.vertices.min(axis=0), new.patch.vertices.max(axis=0)
    margin = float(np.linalg.norm(high - low))
    near = patched.near((low - margin, high + margin), loop, frame)
    start = replace(
        new,
        patch=patch,
        rims=(rim,),
        solution=None if new.solution is None else new.solution.placed_by(frame.inverse, rim),
        crossings=NO_CROSSINGS,
    )
    changed = change(near, start, frame.size)
    patch = changed.patch.placed_by(frame, loop.points)
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
