"""Triangle meshes, their boundary loops, and the smooth curves through them.

`TriangleMesh` holds a checked mesh, `find_boundary_loops` gives its holes as `BoundaryLoop` objects, `BoundaryCurve` is
the smooth curve through a loop, and `MeshExtension` is what a fill appends. numpy, scipy and libigl only.
"""

from spinor_geom.mesh.boundary_loop import BoundaryLoop, Plane, detect_corners, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.extension import MeshExtension
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas, internal_angles, mass_matrix
from spinor_geom.mesh.topology import (
    HalfEdges,
    boundary_edges,
    coincident_vertices,
    face_components,
    is_watertight,
    referenced_vertices,
)
from spinor_geom.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "BoundaryCurve",
    "BoundaryLoop",
    "ClosedCurve",
    "HalfEdges",
    "MeshExtension",
    "Plane",
    "TriangleMesh",
    "boundary_edges",
    "coincident_vertices",
    "cotangent_laplacian",
    "detect_corners",
    "face_areas",
    "face_components",
    "find_boundary_loops",
    "internal_angles",
    "is_watertight",
    "mass_matrix",
    "referenced_vertices",
    "turning_angles",
]
