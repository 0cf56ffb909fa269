"""Patches over loops without an exact surface."""

from collections.abc import Callable, Sequence

import numpy as np

from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, graded_surface, on_circle, surface_over_plane
from spinor_geom.discrete.strip import ruled_annulus
from spinor_geom.domain.sizes import GRADED
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.mesh.operators import face_areas
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import require_few_points


def discrete_patch(loop: BoundaryLoop, target: float) -> tuple[Patch, str]:
    """The discrete minimal surface over a loop, or a triangulation without inner vertices if there is none.

    Edges are at most `target` long, in mesh units, or longer if the time limit needs that. Raises a TooManyPointsError
    if `target` is too short. The second value describes the result.
    """
    return _patch(loop, target, lambda local, length: surface_over_plane(local, length))


def graded_patch(loop: BoundaryLoop, target: float) -> Patch:
    """As `discrete_patch`, with the area only about stationary and edges that grow inwards beyond `target`."""
    return _patch(loop, target, lambda local, _: graded_surface(local, GRADED.growth))[0]


def ruled_patch(loops: Sequence[BoundaryLoop], target: float) -> Patch:
    """A strip of straight lines between two loops, with edges of length `target`, in mesh units."""
    frame = LoopFrame.of(*loops)
    first, second = (frame.loop(loop).points for loop in loops)
    strip = Patch.over(*ruled_annulus(first, second, target / frame.size))
    return strip.placed_by(frame, np.concatenate([loop.points for loop in loops]))


def _patch(
    loop: BoundaryLoop,
    target: float,
    surface_of: Callable[[BoundaryLoop, float], tuple[DiscreteMinimalSurface, PlaneTriangulation]],
) -> tuple[Patch, str]:
    frame = LoopFrame.of(loop)
    local = frame.loop(loop)
    faces = disk_without_inner_points(local.points)
    require_few_points(float(face_areas(local.points, faces).sum()) * frame.size**2, target)
    try:
        surface, plane = surface_of(local, target / frame.size)
        if not np.isfinite(surface.vertices).all():
            raise SurfaceError("the discrete minimal surface is not finite everywhere")
    except SpinorGeomError as error:
        flat = Patch(vertices=local.points, faces=faces, boundary_size=len(loop), points=on_circle(local.points))
        return flat.placed_by(frame, loop.points), f"a triangulation without inner vertices ({error})"
    stopped = "" if surface.converged else ", whose area is not stationary yet"
    coarse = "" if surface.is_complete else ", with triangles larger than asked for (the limit on time or on vertices)"
    patch = Patch.over(plane, surface.vertices).placed_by(frame, loop.points)
    return patch, f"a discrete minimal surface{stopped}{coarse}"
