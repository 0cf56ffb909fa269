"""Raises errors for boundary loops that are not holes: slits, single faces, lines and seams. See also `borders`."""

import math

from spinor_geom.errors import (
    LoneFaceError,
    NoAreaError,
    SeamError,
    TJunctionError,
    ZeroWidthSlitError,
    how_far_apart,
    merge_advice,
)
from spinor_geom.fill.mesh_notes import Merging
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop

MIN_WIDTH_PER_EDGE = 1e-6  # in mean edges of the loop: far above round-off, far below real holes


def require_hole(loop: BoundaryLoop, patched: PatchedMesh, merging: Merging | None = None) -> None:
    """Raises a LoopError for a slit, the outline of one face or points on a line.

    `merging` would close loops of the mesh. It is the advice on single faces.
    Raises the loop's `obstacle`, such as a NonManifoldEdgeError, if it has one.
    """
    if loop.obstacle is not None:
        raise loop.obstacle
    if math.isclose(loop.slit_fraction, 1.0):
        if len(loop.junctions):
            raise _junction_error(loop)
        raise ZeroWidthSlitError(
            fraction=loop.slit_fraction,
            vertices=loop.vertex_ids[:2].tolist(),
            apart=how_far_apart(loop.seam_distance),
            advice=merge_advice(loop.seam_distance),
        )
    face = patched.face_on(loop)
    if face is not None:
        advice = "remove the face" if merging is None else f"merge vertices first ({merge_advice(merging.distance)})"
        raise LoneFaceError(face=face, vertices=loop.vertex_ids.tolist(), advice=advice)
    require_area(loop, loop.diagonal / loop.elongation)


def require_no_seams(loop: BoundaryLoop) -> None:
    """Raises a SeamError where edges of a loop lie on another loop, a TJunctionError where vertices lie on edges."""
    if len(loop.seam_edges):
        raise SeamError(
            edge=loop.seam_edges[0].tolist(),
            count=len(loop.seam_edges),
            apart=how_far_apart(loop.seam_distance),
            advice=merge_advice(loop.seam_distance),
        )
    if len(loop.junctions):
        raise _junction_error(loop)


def require_area(loop: BoundaryLoop, width: float) -> None:
    """Raises a NoAreaError where the width of a loop's hole, in mesh units, is below 1e-6 of its mean edge."""
    if width <= MIN_WIDTH_PER_EDGE * loop.mean_edge_length:
        raise NoAreaError(width=width, mean_edge=loop.mean_edge_length)


def _junction_error(loop: BoundaryLoop) -> TJunctionError:
    vertex, *edge = loop.junctions[0].tolist()
    count = len(set(loop.junctions[:, 0].tolist()))
    return TJunctionError(vertex=vertex, edge=edge, count=count, apart=how_far_apart(loop.seam_distance))
