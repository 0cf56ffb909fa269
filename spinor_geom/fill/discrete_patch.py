"""Patches over loops without an exact surface."""

import numpy as np

from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import on_circle, surface_over_plane
from spinor_geom.errors import SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import require_few_points


def discrete_patch(loop: BoundaryLoop, target: float) -> tuple[Patch, str]:
    """The discrete minimal surface over a loop, or a triangulation without inner vertices if there is none.

    Edges are at most `target` long, in mesh units, or longer if the time limit needs that; raises a TooManyPointsError
    if `target` is too short. The second value describes the result.
    """
    faces = disk_without_inner_points(loop.points)
    require_few_points(float(face_areas(loop.points, faces).sum()), target)
    try:
        surface, plane = surface_over_plane(loop, target)
        if not np.isfinite(surface.vertices).all():
            raise SurfaceError("the discrete minimal surface is not finite everywhere")
    except SpinorGeomError as error:
        patch = Patch(vertices=loop.points, faces=faces, boundary_size=len(loop), points=on_circle(loop.points))
        return patch, f"a triangulation without inner vertices ({error})"
    stopped = "" if surface.converged else ", whose area is not stationary yet"
    coarse = "" if surface.is_complete else ", with triangles larger than asked for (the limit on time or on vertices)"
    return Patch.over(plane, surface.vertices), f"a discrete minimal surface{stopped}{coarse}"
