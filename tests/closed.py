"""Closed meshes."""

from spinor_geom.mesh.topology import HalfEdges


def is_watertight(faces):
    """Whether there are faces and every edge has exactly two, of opposite directions."""
    return HalfEdges.of(faces).is_closed
