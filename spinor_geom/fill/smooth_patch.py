"""The smooth continuation of a film, or the film where that is not good, or is the better choice."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np

from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.errors import OutOfTimeError, SingularMatrixError, SurfaceError, TooManyPointsError, in_mesh_units
from spinor_geom.fill.collar import Bend, Collar, bend_across, bend_inside, collar_of
from spinor_geom.fill.continuation import Continuation, continue_patch
from spinor_geom.fill.fairing import SMALLEST_ANGLE, smallest_angles
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.fill.retriangulation import without_intersections
from spinor_geom.fill.thin_triangles import without_thin_triangles

# Degrees (RMS) between film and mesh above which "auto" takes the film. On the meshes in `data` films of holes in a
# shape meet the mesh at 56° or less, those at its end, as under a bust, at 87° or more.
FILM_FROM = 65.0
NO_TIME = "there was no time for it; raise time_limit (--time-limit)"
_NOT_CONTINUED = "the patch was not continued smoothly"
_MOST_REPLACED = 0.03  # share of the faces that clearing may replace
# A continuation may have this many times the area of a spherical cap that meets the mesh smoothly: for a plane rim with
# the angle θ between film and mesh, that is 2/(1 + cos θ) times the film's area. θ is at most the second value.
_MOST_CAPS, _LARGEST_CAP = 2.0, np.radians(150)


def smooth_patch(
    patched: PatchedMesh, film: NewPatch, lengths: EdgeLengths, unit: float, *, is_choice: bool
) -> NewPatch:
    """The continuation of a film without intersections that can be avoided; or the film, with the reason.

    The continuation is kept if it has converged without folds, has no more intersections than the film, angles of at
    least 10° except between edges of the rim, few replaced faces, and not far more area than a spherical cap. It is
    also kept, as not converged, if the film has more intersections. With `is_choice` the film is taken where it meets
    the mesh at more than 65° (RMS), unless it intersects something.

    Args:
        patched: the mesh.
        film: the patch before the continuation: a minimal or discrete surface, or a strip, which cannot be kept.
        lengths: of edges of new meshes.
        unit: that of the coordinates, in mesh units.
        is_choice: whether the film may be the better choice.

    Raises:
        SurfaceError: a strip has no good continuation.
    """
    is_strip, collar = film.kind == "strip", collar_of(patched, film.rim, film.patch)
    cleared_film = cache(lambda: without_intersections(patched, film.fitted(patched)))
    before = bend_across(collar, film.patch)
    met = f"meet at {before.rms:.0f}° (RMS), {'more than' if before.rms > FILM_FROM else 'at most'} {FILM_FROM:.0f}°"
    if is_choice and before.rms > FILM_FROM and not is_strip:
        kept = cleared_film()
        if not len(kept.crossings) and not kept.faces_replaced:
            return replace(kept, choice=f"the film was chosen, because film and mesh {met}")
    try:
        smooth = _continued(film, collar, before, lengths)
        reason = _defect(smooth)
        if reason and not len(cleared_film().crossings):
            raise SurfaceError(reason)
        smooth = _cleared(patched, smooth, lengths)
        reason = reason or _defect(smooth) or _defect_of_clearing(smooth)
        why = f"film and mesh {met}"
        if reason or len(smooth.crossings):
            most, films = len(smooth.crossings) + bool(reason), len(cleared_film().crossings)
            why = f"it has {len(smooth.crossings)} pairs of intersecting faces, the film {films}"
            if films < most:
                raise SurfaceError(reason or why)
        return replace(smooth, choice=f"the continuation was chosen, because {why}" if is_choice else "", reason=reason)
    except OutOfTimeError:
        reason = NO_TIME
    except (SingularMatrixError, SurfaceError, TooManyPointsError) as error:
        reason = str(in_mesh_units(error, unit))
    if is_choice and not is_strip:
        return replace(cleared_film(), choice=f"the film was chosen, because {_NOT_CONTINUED}: {reason}")
    return not_continued(cleared_film(), reason)


def not_continued(film: NewPatch, reason: str) -> NewPatch:
    """The film with a remark; raises a SurfaceError for a strip, which cannot be kept."""
    if film.kind == "strip":
        raise SurfaceError(f"{film.reason}; {_NOT_CONTINUED}: {reason}")
    return replace(film, remarks=(*film.remarks, f"{_NOT_CONTINUED}: {reason}"))


def _continued(film: NewPatch, collar: Collar, before: Bend, lengths: EdgeLengths) -> NewPatch:
    """The continuation of a film; raises as `continue_patch`, or a SurfaceError if nothing can move."""
    if len(film.patch.vertices) == len(film.rim):
        raise SurfaceError("it has no inner vertices; a shorter target_edge_length (--edge-length) makes some")
    faired = continue_patch(film.patch, collar, lengths)
    continuation = Continuation.of(
        faired,
        collar,
        start=film.kind,
        before=before,
        after=bend_across(collar, faired.patch),
        area_ratio=faired.patch.area / film.patch.area,
    )
    return replace(film, patch=faired.patch, reason="", continuation=continuation)


def _cleared(patched: PatchedMesh, smooth: NewPatch, lengths: EdgeLengths) -> NewPatch:
    """A continuation without intersections and thin triangles that can be avoided."""
    continuation, area = smooth.continuation, smooth.patch.area
    assert continuation is not None
    smooth = without_intersections(patched, smooth.fitted(patched))
    with suppress(OutOfTimeError):
        smooth = without_thin_triangles(patched, smooth, lengths)
    ratio = continuation.area_ratio * smooth.patch.area / area
    return replace(smooth, continuation=replace(continuation.with_angles_of(smooth.patch), area_ratio=ratio))


def _defect(smooth: NewPatch) -> str:
    """Why the shape of a continuation is not good; empty if it is."""
    continuation = smooth.continuation
    assert continuation is not None
    if not continuation.converged:
        return continuation.reason
    if bend_inside(smooth.patch).largest > 90:  # teeth of the rim may fold the faces beside them
        return "it is folded"
    cap = 2 / (1 + np.cos(min(np.radians(continuation.before.rms), _LARGEST_CAP)))
    if continuation.area_ratio > _MOST_CAPS * cap:
        return f"it has {continuation.area_ratio:.2g} times the area of the film, a spherical cap {cap:.2g} times"
    return ""


def _defect_of_clearing(smooth: NewPatch) -> str:
    """Why the triangles of a cleared continuation are not good; empty if they are."""
    faces = len(smooth.patch.faces)
    if smooth.faces_replaced > _MOST_REPLACED * faces:
        return f"to avoid intersections, {smooth.faces_replaced} of its {faces} faces would be replaced"
    smallest = smallest_angles(smooth.patch)[1]
    return f"it has a triangle with an angle of {smallest:.2g}°" if smallest < SMALLEST_ANGLE else ""
