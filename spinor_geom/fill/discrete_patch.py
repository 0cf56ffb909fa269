"""Patches of loops without an exact surface, discrete minimal ones or triangles; and which loops are no holes."""

import math

import numpy as np
from jaxtyping import Int

from spinor_geom.deadline import time_limit
from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.errors import (
    LoneFaceError,
    NoAreaError,
    SeamError,
    SpinorGeomError,
    SurfaceError,
    TJunctionError,
    ZeroWidthSlitError,
    how_far_apart,
    merge_advice,
)
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas, graph_laplacian
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import require_few_points

MIN_WIDTH_PER_EDGE = 1e-6  # of a loop's mean edge: far above round-off, far below any hole that was meant


def discrete_patch(loop: BoundaryLoop, target: float, *, seconds: float) -> tuple[Patch, str]:
    """The discrete minimal surface over a loop, else a triangulation without inner vertices; and what it is, in words.

    Edges are at most `target` long, in mesh units, which a TooManyPointsError tells to ask for too many. After so many
    seconds the descent of the area ends where it is.
    """
    faces = disk_without_inner_points(loop.points)
    area = float(face_areas(loop.points, faces).sum())
    require_few_points(area, target)
    try:
        with time_limit(seconds):
            surface = discrete_minimal_surface(loop, target_edge_length=target)
        if not np.isfinite(surface.vertices).all():
            raise SurfaceError("the discrete minimal surface is not finite everywhere")
    except SpinorGeomError as error:
        return over_disk(loop.points, faces, len(loop)), f"a triangulation without inner vertices, as {error}"
    stopped = "" if surface.converged else ", whose area is not stationary yet"
    return over_disk(surface.vertices, surface.faces, len(loop)), f"a discrete minimal surface{stopped}"


def over_disk(vertices: np.ndarray, faces: Int[np.ndarray, "f 3"], rim: int) -> Patch:
    """A discrete disk as a patch over the unit disk; the first `rim` vertices are its boundary, in order.

    The rim lies on the circle by arc length, each other vertex in the middle of its neighbours.

    Source: Tutte, "How to draw a graph", Proc. London Math. Soc. 13 (1963).
    """
    lengths = np.linalg.norm(np.roll(vertices[:rim], -1, axis=0) - vertices[:rim], axis=1)
    angle = 2 * np.pi * np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = harmonic_extension(graph_laplacian(faces), circle) @ np.array([1.0, 1.0j])
    return Patch(vertices=vertices, faces=faces, boundary_size=rim, points=points)


def refuse_what_is_no_hole(loop: BoundaryLoop, surroundings: Surroundings) -> None:
    """Checks, before anything is solved, that a loop bounds a hole.

    A LoopError tells of a slit, the outline of one face, or points on a line, a NonManifoldEdgeError of an edge
    that has several faces already.
    """
    if loop.obstacle is not None:
        raise loop.obstacle
    distance = loop.seam_distance
    if math.isclose(loop.slit_fraction, 1.0):
        if len(loop.junctions):
            raise junction_error(loop)
        # the first edge of the loop stands for all of them
        raise ZeroWidthSlitError(
            fraction=loop.slit_fraction,
            vertices=loop.vertex_ids[:2].tolist(),
            apart=how_far_apart(distance),
            advice=merge_advice(distance),
        )
    face = surroundings.face_on(loop)
    if face is not None:
        raise LoneFaceError(face=face, vertices=[int(v) for v in loop.vertex_ids])
    refuse_empty(loop, loop.diagonal / loop.elongation)


def refuse_seams(loop: BoundaryLoop) -> None:
    """Raises a SeamError where edges of a loop lie on another loop, a TJunctionError where these are divided unlike."""
    if len(loop.seam_edges):
        raise SeamError(
            edge=loop.seam_edges[0].tolist(),
            count=len(loop.seam_edges),
            apart=how_far_apart(loop.seam_distance),
            advice=merge_advice(loop.seam_distance),
        )
    if len(loop.junctions):
        raise junction_error(loop)


def junction_error(loop: BoundaryLoop) -> TJunctionError:
    """The error that describes the T-junctions of a loop that has some."""
    vertex, *edge = loop.junctions[0].tolist()
    count, apart = len(np.unique(loop.junctions[:, 0])), how_far_apart(loop.seam_distance)
    return TJunctionError(vertex=vertex, edge=edge, count=count, apart=apart)


def refuse_empty(loop: BoundaryLoop, width: float) -> None:
    """Raises a `NoAreaError` where the width of a loop's hole, in mesh units, is below 1e-6 of its mean edge."""
    if width <= MIN_WIDTH_PER_EDGE * loop.mean_edge_length:
        raise NoAreaError(width=width, mean_edge=loop.mean_edge_length)
