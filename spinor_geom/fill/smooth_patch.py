"""The smooth continuation of a mesh by a patch, or why a film is used instead."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.errors import (
    NotContinuedError,
    OutOfTimeError,
    SingularMatrixError,
    SpinorGeomError,
    SurfaceError,
    TooManyPointsError,
    in_mesh_units,
)
from spinor_geom.fill.collar import Bend, Collar, bend_across, collar_of
from spinor_geom.fill.continuation import Continuation, continue_patch
from spinor_geom.fill.creased import continue_across_crease
from spinor_geom.fill.fairing import SMALLEST_ANGLE
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh, patch_chords
from spinor_geom.fill.retriangulation import without_intersections
from spinor_geom.mesh.topology import face_components, referenced_vertices
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.remeshing import remesh_region

# Degrees (RMS) between film and mesh above which "auto" takes the film. On the meshes in `data` films of holes in a
# shape meet the mesh at 56° or less, those at its end, as under a bust, at 87° or more.
FILM_FROM = 65.0
NO_TIME = "there was no time for it; raise time_limit (--time-limit)"
NOT_CONTINUED = "the patch was not continued smoothly"
_NOT_GOOD = "its shape is that of the smooth continuation, which is not good here"
_MOST_REPLACED = 0.03  # share of the faces that clearing may replace
# A continuation may have this many times the area of a spherical cap that meets the mesh smoothly: for a plane rim with
# the angle θ between film and mesh, that is 2/(1 + cos θ) times the film's area. θ is at most the second value.
_MOST_CAPS, _LARGEST_CAP = 2.0, np.radians(150)


def smooth_patch(
    patched: PatchedMesh,
    start: NewPatch,
    lengths: EdgeLengths,
    unit: float,
    film: Callable[[], NewPatch],
    *,
    is_choice: bool,
) -> NewPatch:
    """The continuation of a mesh by a patch, without intersections that can be avoided.

    A single crease of the mesh goes on through the patch (`continue_across_crease`).

    The continuation is good if it has converged without folds and without a kink of more than 65° at the rim, and has
    no intersections, few replaced faces, and not far more area than a spherical cap. Its angles must be at least 10°,
    except between edges of the rim. If it is not good but the film has more intersections, it is kept as a discrete
    patch, without the measures of a continuation and with the reason.
    A patch with intersections and another defect is never kept. With `is_choice` the film is taken where it meets the
    mesh at more than 65° (RMS), unless it intersects something.

    Args:
        patched: the mesh.
        start: the patch before the continuation: a minimal or discrete surface, or a strip.
        lengths: of edges of new meshes.
        unit: that of the coordinates, in mesh units.
        film: computes the patch that is used instead. It is called only if that may be better.
        is_choice: whether the film may be the better choice.

    Raises:
        NotContinuedError: the film is to be used.
    """
    collar = collar_of(patched, start.rim, start.patch)
    before = bend_across(collar, start.patch)
    met = f"meet at {before.rms:.0f}° (RMS), {'more than' if before.rms > FILM_FROM else 'at most'} {FILM_FROM:.0f}°"
    is_end = is_choice and before.rms > FILM_FROM and start.kind != "strip"
    if is_end and not len(film().crossings) and not film().faces_replaced:
        raise NotContinuedError(f"film and mesh {met}")
    try:
        smooth, crease = _continued(patched, start, collar, before, lengths)
        reason = _defect(smooth)
        if reason and not len(film().crossings):
            raise SurfaceError(reason)
        smooth = smooth.fitted(patched) if reason else _cleared(patched, smooth, collar, crease, lengths)
        reason, own = reason or _defect(smooth) or _defect_of_clearing(smooth), len(smooth.crossings)
        if reason and own:
            raise SurfaceError(reason)
        if not reason and not own:
            choice = f"the continuation was chosen, because film and mesh {met}" if is_choice else ""
            return replace(smooth, choice=choice)
        films = len(film().crossings)
        counts = f"it has {own} pairs of intersecting faces, the film {films}"
        if films < own or (reason and films == own):
            raise SurfaceError(reason or counts)
    except OutOfTimeError as error:
        raise NotContinuedError(f"{NOT_CONTINUED}: {NO_TIME}") from error
    except (SingularMatrixError, SurfaceError, TooManyPointsError) as error:
        raise NotContinuedError(f"{NOT_CONTINUED}: {in_mesh_units(error, unit)}") from error
    reason = f"{_NOT_GOOD}: {'; '.join(filter(None, [reason, counts]))}"
    choice = f"a discrete patch was chosen, because {counts}" if is_choice else ""
    return replace(smooth, continuation=None, solution=None, choice=choice, reason=reason)


def _continued(
    patched: PatchedMesh, start: NewPatch, collar: Collar, before: Bend, lengths: EdgeLengths
) -> tuple[NewPatch, Int[np.ndarray, " k"] | None]:
    """The continuation from a patch, and `Faired.crease`.

    Raises as `continue_patch`, or a SurfaceError if nothing can move.
    """
    if len(start.patch.vertices) == len(start.rim):
        raise SurfaceError("it has no inner vertices; a shorter target_edge_length (--edge-length) makes some")
    faired = continue_across_crease(patched, start.rim, start.patch, collar, lengths)
    faired = faired or continue_patch(start.patch, collar, lengths)
    faired = replace(faired, patch=patched.as_stored(faired.patch, start.rim))
    continuation = Continuation.of(
        faired,
        collar,
        start=start.kind,
        before=before,
        after=bend_across(collar, faired.patch, faired.crease),
        area_ratio=faired.patch.area / start.patch.area,
        crease=float(np.degrees(collar.crease_angles.max())) if faired.crease is not None else 0.0,
    )
    return replace(start, patch=faired.patch, reason="", continuation=continuation), faired.crease


def _cleared(
    patched: PatchedMesh, smooth: NewPatch, collar: Collar, crease: Int[np.ndarray, " k"] | None, lengths: EdgeLengths
) -> NewPatch:
    """A continuation without intersections and thin triangles that can be avoided."""
    continuation, area = smooth.continuation, smooth.patch.area
    assert continuation is not None
    smooth = without_intersections(patched, smooth.fitted(patched))
    with suppress(OutOfTimeError):
        smooth = without_thin_triangles(patched, smooth, lengths)
    ratio = continuation.area_ratio * smooth.patch.area / area
    after = bend_across(collar, smooth.patch, crease)
    return replace(
        smooth, continuation=replace(continuation.with_angles_of(smooth.patch), after=after, area_ratio=ratio)
    )


def _defect(smooth: NewPatch) -> str:
    """Why the shape of a continuation is not good, or empty if it is."""
    continuation = smooth.continuation
    assert continuation is not None
    if not continuation.converged:
        return continuation.reason
    if smooth.patch.angles.largest_bend > 90 + continuation.crease:  # teeth of the rim may fold the faces beside them
        return "it is folded"
    if continuation.has_kink and continuation.after.rms > FILM_FROM:
        return f"it meets the mesh at {continuation.after.rms:.0f}° (RMS)"
    cap = 2 / (1 + np.cos(min(np.radians(continuation.before.rms), _LARGEST_CAP)))
    if continuation.area_ratio > _MOST_CAPS * cap:
        return f"it has {continuation.area_ratio:.2g} times the area of the film, a spherical cap {cap:.2g} times"
    return ""


def _defect_of_clearing(smooth: NewPatch) -> str:
    """Why the triangles of a cleared continuation are not good, or empty if they are."""
    faces = len(smooth.patch.faces)
    if smooth.faces_replaced > _MOST_REPLACED * faces:
        return f"to avoid intersections, {smooth.faces_replaced} of its {faces} faces would be replaced"
    smallest = smooth.patch.angles.smallest_free
    return f"it has a triangle with an angle of {smallest:.2g}°" if smallest < SMALLEST_ANGLE else ""


# Numbers of rings of faces around thin ones, and sufficient angles, in the order in which they are tried. Smaller
# changes cause fewer intersections: they increase the angles of two of 14 bowls to 10°, which larger ones do not. A
# third ring has no effect.
_TRIES = [(rings, np.radians(enough)) for enough in (25.0, 11.0) for rings in (2, 1)]


def without_thin_triangles(patched: PatchedMesh, new: NewPatch, lengths: EdgeLengths) -> NewPatch:
    """Remeshes around triangles with angles below 10°, where that increases angles and adds no intersection.

    The steps before move vertices and replace triangles without regard to angles. Angles between two edges of the rim
    cannot be increased. `lengths` are those of new edges, in mesh units.
    """
    if not _around_thin_triangles(new.patch, 0):
        return new
    taken = collar_of(patched, new.rim, new.patch).rim_edges
    for rings, enough in _TRIES:
        pieces = _around_thin_triangles(new.patch, rings)
        while pieces and not is_out_of_time():
            piece = pieces.pop()
            region = np.isin(np.arange(len(new.patch.faces)), piece)
            try:
                patch, numbers = remesh_region(new.patch, region, lengths, taken, enough)
                patch = patched.as_stored(patch, new.rim)
                chords = patch_chords(patch)
                least = patch.angles.free[(numbers >= 0).sum() :].min()
                if least <= new.patch.angles.free[piece].min() or patched.has_edges(new.rim[chords]).any():
                    continue
                crossings = patched.crossings(patch, new.crossings, numbers)
            except SpinorGeomError:  # no time, or triangles that form no surface: the piece stays
                continue
            if len(crossings) > len(new.crossings):
                continue
            new = replace(new, patch=patch, crossings=crossings)
            pieces = [numbers[others] for others in pieces]
    return new


def _around_thin_triangles(patch: Patch, rings: int) -> list[Int[np.ndarray, " _"]]:
    """Connected regions that consist of the thin triangles and some rings of faces around."""
    faces = np.asarray(patch.faces)
    region: Bool[np.ndarray, " f"] = patch.angles.free < SMALLEST_ANGLE
    if not region.any():
        return []
    for _ in range(rings):
        a, b, c = referenced_vertices(faces[region], vertices=len(patch.vertices))[faces.T]
        region = a | b | c
    component = face_components(faces[region])
    return [np.flatnonzero(region)[component == k] for k in range(component.max() + 1)]
