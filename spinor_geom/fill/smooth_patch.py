"""A patch on its way into the mesh, and its smooth continuation, unless that crosses what it does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.errors import SingularMatrixError, SurfaceError
from spinor_geom.fill.collar import bend_across, collar_of
from spinor_geom.fill.continuation import Continuation, Start, continue_patch
from spinor_geom.fill.stitch import fit_to_rim
from spinor_geom.fill.surroundings import NOTHING, Crossings, Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau.solution import PlateauSolution


@dataclass(frozen=True, kw_only=True, eq=False)
class MadePatch:
    """A patch, and what it was made of.

    Attributes:
        patch: the patch.
        rims: its loops, in the order of its boundary.
        solution: the surface that it is a mesh of, or was before its continuation; None for another.
        reason: why it is not what was asked for; empty where it is.
        edges_split: edges that would have lain on an edge of the mesh and got a vertex in their middle instead.
        crossings: what it crosses.
        continuation: how it became smooth; None where it did not.
        remarks: why it did not though that was asked for.
    """

    patch: Patch
    rims: Sequence[BoundaryLoop]
    solution: PlateauSolution | None
    reason: str
    edges_split: int = 0
    crossings: Crossings = NOTHING
    continuation: Continuation | None = None
    remarks: tuple[str, ...] = ()

    @property
    def start(self) -> Start:
        """What the patch is before its continuation."""
        if self.solution is not None:
            return "minimal"
        return "strip" if self.patch.hole_sizes else "discrete"

    @cached_property
    def rim(self) -> Int[np.ndarray, " m"]:
        """Mesh vertices of its boundary vertices."""
        return np.concatenate([loop.vertex_ids for loop in self.rims])

    def joinable(self, surroundings: Surroundings) -> MadePatch:
        """The patch with its edges split that the mesh or another patch has."""
        patch, split = fit_to_rim(self.rim, self.patch, surroundings.taken, self._middles)
        return replace(self, patch=patch, edges_split=self.edges_split + split)

    def _middles(self, patch: Patch, chords: Int[np.ndarray, "c 2"]) -> Float[np.ndarray, "c 3"]:
        """Positions halfway along chords: on the surface, halfway in Ω, where the patch is a mesh of one."""
        if self.solution is None or self.continuation is not None:
            return np.asarray(patch.vertices[chords].mean(axis=1))
        return np.asarray(self.solution.surface.position(patch.points[chords].mean(axis=1)), dtype=np.float64)


def continued(first: MadePatch, target: float, surroundings: Surroundings) -> MadePatch:
    """The smooth continuation of the mesh around a patch, or the patch itself with the reason why it stays.

    A patch without inner vertices has nothing that could move, and stays without a word.

    Args:
        first: a minimal surface, exact or discrete, or a strip between two loops.
        target: edge length, should it be meshed anew, in mesh units.
        surroundings: the mesh.

    Raises:
        SurfaceError: a strip stays, which is no surface to be kept.
        TooManyPointsError: the edge length asks for more vertices than anyone can use.
    """
    if len(first.patch.vertices) == len(first.rim):
        return _staying(first)
    collar = collar_of(surroundings.faces_around, first.rim, first.patch)
    try:
        moved = continue_patch(first.patch, collar, target, is_conformal=first.start != "discrete")
    except SingularMatrixError as error:
        return _staying(first, str(error))
    before, after = bend_across(collar, first.patch), bend_across(collar, moved.patch)
    if not moved.converged and after.rms >= before.rms:
        steps = f"{moved.steps} steps left a bend of {after.rms:.3g}° (RMS)"
        return _staying(first, f"{steps} across the rim, where it has {before.rms:.3g}°")
    continuation = Continuation(
        started_from=first.start,
        before=before,
        after=after,
        steps=moved.steps,
        remeshed=moved.remeshed,
        converged=moved.converged,
        correlation_length=collar.length,
        roughness=collar.roughness,
        creased=collar.creased,
    )
    smooth = replace(first, patch=moved.patch, reason=continuation.reason, continuation=continuation)
    smooth = smooth.joinable(surroundings)
    crossings = surroundings.crossings(smooth.patch)
    if len(crossings) > len(first.crossings):
        return _staying(first, ", ".join(crossings.notes), link=", as then")
    return replace(smooth, crossings=crossings)


def _staying(first: MadePatch, why: str = "", *, link: str = ":") -> MadePatch:
    remarks = (f"the patch was not continued smoothly{link} {why}",) if why else ()
    if first.start == "strip":
        raise SurfaceError("; ".join([first.reason, *remarks]))
    return replace(first, remarks=remarks)
