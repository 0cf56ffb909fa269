"""Remeshes the surroundings of thin triangles in a continued patch, where that adds no intersection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.collar import collar_of
from spinor_geom.fill.fairing import SMALLEST_ANGLE, free_angles
from spinor_geom.fill.new_patch import NewPatch
from spinor_geom.fill.patched_mesh import PatchedMesh, patch_chords
from spinor_geom.mesh.topology import face_components, referenced_vertices
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.remeshing import remesh_region

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
            except SpinorGeomError:  # no time, or triangles that form no surface: the piece stays
                continue
            chords = patch_chords(patch)
            least = free_angles(patch)[(numbers >= 0).sum() :].min()
            if least <= free_angles(new.patch)[piece].min() or patched.has_edges(new.rim[chords]).any():
                continue
            crossings = patched.crossings(patch, new.crossings, numbers)
            if len(crossings) > len(new.crossings):
                continue
            new = replace(new, patch=patch, crossings=crossings)
            pieces = [numbers[others] for others in pieces]
    return new


def _around_thin_triangles(patch: Patch, rings: int) -> list[Int[np.ndarray, " _"]]:
    """Connected regions that consist of the thin triangles and some rings of faces around."""
    faces = np.asarray(patch.faces)
    region: Bool[np.ndarray, " f"] = free_angles(patch) < SMALLEST_ANGLE
    if not region.any():
        return []
    for _ in range(rings):
        a, b, c = referenced_vertices(faces[region], vertices=len(patch.vertices))[faces.T]
        region = a | b | c
    component = face_components(faces[region])
    return [np.flatnonzero(region)[component == k] for k in range(component.max() + 1)]
