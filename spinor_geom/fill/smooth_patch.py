"""From a patch over a hole to the smooth continuation of the mesh around it, unless that crosses what it does not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.errors import SingularMatrixError
from spinor_geom.fill.collar import bend_across, collar_of
from spinor_geom.fill.continuation import Continuation, Start, continue_patch
from spinor_geom.fill.stitch import RimEdges, fit_to_rim
from spinor_geom.fill.surroundings import Crossings, Surroundings
from spinor_geom.meshing.embed import Patch


@dataclass(frozen=True, kw_only=True, eq=False)
class Finished:
    """A patch that can be joined to the mesh.

    Attributes:
        patch: the patch.
        edges_split: edges that would have lain on an edge of the mesh and got a vertex in their middle instead.
        crossings: what it crosses.
        continuation: how it became smooth; None where it did not.
        remarks: why it did not though that was asked for.
    """

    patch: Patch
    edges_split: int
    crossings: Crossings
    continuation: Continuation | None = None
    remarks: tuple[str, ...] = ()


def continued(
    first: Finished,
    rim: Int[np.ndarray, " m"],
    target: float,
    taken: RimEdges,
    surroundings: Surroundings,
    *,
    started_from: Start,
) -> Finished:
    """The smooth continuation of the mesh around a patch, or the patch itself with the reason why it stays.

    A patch without inner vertices has nothing that could move, and stays without a word.

    Args:
        first: a minimal surface, exact or discrete, or a strip between two loops.
        rim: mesh vertices of its boundary vertices.
        target: edge length, should it be meshed anew, in mesh units.
        taken: edges that it must not have.
        surroundings: what it may cross.
        started_from: what the patch is.

    Raises:
        TooManyPointsError: the edge length asks for more vertices than anyone can use.
    """
    if len(first.patch.vertices) == len(rim):
        return first
    collar = collar_of(surroundings.faces_around, rim, first.patch)
    try:
        moved = continue_patch(first.patch, collar, target, is_conformal=started_from != "discrete")
    except SingularMatrixError as error:
        return replace(first, remarks=(f"the patch was not continued smoothly: {error}",))
    before, after = bend_across(collar, first.patch), bend_across(collar, moved.patch)
    if not moved.converged and after.rms >= before.rms:
        return replace(
            first,
            remarks=(
                f"the patch was not continued smoothly: {moved.steps} steps left a bend of {after.rms:.3g}° (RMS) "
                f"across the rim, where it has {before.rms:.3g}°",
            ),
        )
    patch, split = fit_to_rim(rim, moved.patch, taken, _halfway)
    crossings = surroundings.crossings(patch)
    if len(crossings) > len(first.crossings):
        return replace(first, remarks=(f"the patch was not continued smoothly, as then {', '.join(crossings.notes)}",))
    return Finished(
        patch=patch,
        edges_split=first.edges_split + split,
        crossings=crossings,
        continuation=Continuation(
            started_from=started_from,
            before=before,
            after=after,
            steps=moved.steps,
            remeshed=moved.remeshed,
            converged=moved.converged,
            correlation_length=collar.length,
            roughness=collar.roughness,
            creased=collar.creased,
        ),
    )


def _halfway(patch: Patch, chords: Int[np.ndarray, "c 2"]) -> Float[np.ndarray, "c 3"]:
    return np.asarray(patch.vertices[chords].mean(axis=1))
