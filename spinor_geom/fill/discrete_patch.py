"""Patches over loops without an exact surface."""

import numpy as np
from jaxtyping import Int

from spinor_geom.deadline import time_limit
from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.errors import SpinorGeomError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas, graph_laplacian
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import require_few_points


def discrete_patch(loop: BoundaryLoop, target: float, *, seconds: float) -> tuple[Patch, str]:
    """The discrete minimal surface over a loop, or a triangulation without inner vertices if there is none.

    Edges are at most `target` long, in mesh units; raises a TooManyPointsError if that is too short. The minimisation
    of the area stops after `seconds`. The second value describes the result.
    """
    faces = disk_without_inner_points(loop.points)
    require_few_points(float(face_areas(loop.points, faces).sum()), target)
    try:
        with time_limit(seconds):
            surface = discrete_minimal_surface(loop, target_edge_length=target)
        if not np.isfinite(surface.vertices).all():
            raise SurfaceError("the discrete minimal surface is not finite everywhere")
    except SpinorGeomError as error:
        return _over_disk(loop.points, faces, len(loop)), f"a triangulation without inner vertices ({error})"
    stopped = "" if surface.converged else ", whose area is not stationary yet"
    return _over_disk(surface.vertices, surface.faces, len(loop)), f"a discrete minimal surface{stopped}"


def _over_disk(vertices: np.ndarray, faces: Int[np.ndarray, "f 3"], rim: int) -> Patch:
    """A patch over the unit disk; the first `rim` vertices are its boundary, in order.

    The boundary lies on the circle by arc length, each other vertex at the mean of its neighbours.

    Source: Tutte, "How to draw a graph", Proc. London Math. Soc. 13 (1963).
    """
    lengths = np.linalg.norm(np.roll(vertices[:rim], -1, axis=0) - vertices[:rim], axis=1)
    angle = 2 * np.pi * np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = harmonic_extension(graph_laplacian(faces), circle) @ np.array([1.0, 1.0j])
    return Patch(vertices=vertices, faces=faces, boundary_size=rim, points=points)
