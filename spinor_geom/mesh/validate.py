"""Checks of how the faces of a mesh fit together; each failure is an error that names the element."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from spinor_geom.errors import (
    DegenerateFaceError,
    DuplicateFaceError,
    InconsistentOrientationError,
    MeshExtentError,
    NoFacesError,
    NonManifoldEdgeError,
)
from spinor_geom.mesh.sheets import repeated_faces, repeats_a_vertex
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.mesh.triangle_mesh import TriangleMesh

# Fourth powers of lengths have to be numbers.
SMALLEST_EXTENT, LARGEST_EXTENT = 1e-70, 1e70


def validate(mesh: TriangleMesh) -> None:
    """Checks that the faces of a mesh fit together, and everywhere: `find_boundary_loops` takes less.

    Allowed are vertices that no face uses, faces of area 0 with three different vertices, bow-tie vertices, and edges
    with three or more faces away from the boundary loops.

    Raises:
        DegenerateFaceError: a face uses a vertex twice.
        DuplicateFaceError: two faces have the same three vertices.
        InconsistentOrientationError: the two faces of an edge run through it in the same direction.
        NonManifoldEdgeError: an edge with three or more faces ends at a vertex of a boundary loop, where it is not
            defined how the loop goes on.
    """
    require_proper_faces(mesh.faces)
    half_edges = HalfEdges.of(mesh.faces)
    require_distinct_faces(mesh.faces, half_edges)
    require_consistent_orientation(half_edges)
    require_manifold_boundary(half_edges)


def require_faces(mesh: TriangleMesh) -> None:
    """Checks that vertices are no bare points, and as far from each other as numbers can tell.

    Raises:
        NoFacesError: there are vertices and no faces.
        MeshExtentError: areas would under- or overflow.
    """
    if not len(mesh.vertices):
        return
    if not len(mesh.faces):
        raise NoFacesError(vertices=len(mesh.vertices))
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    if extent and not SMALLEST_EXTENT < extent < LARGEST_EXTENT:
        raise MeshExtentError(extent=extent)


def require_proper_faces(faces: Int[np.ndarray, "f 3"]) -> None:
    """Checks that every face has three different vertices.

    Raises:
        DegenerateFaceError: a face uses a vertex twice.
    """
    degenerate = repeats_a_vertex(faces)
    if degenerate.any():
        face = int(np.argmax(degenerate))
        raise DegenerateFaceError(face=face, vertices=faces[face].tolist())


def require_distinct_faces(faces: Int[np.ndarray, "f 3"], half_edges: HalfEdges) -> None:
    """Checks that no two faces have the same three vertices, in whatever order.

    Raises:
        DuplicateFaceError: two faces do.
    """
    copies = repeated_faces(half_edges)
    if len(copies):
        raise DuplicateFaceError(faces=copies[0].tolist(), vertices=faces[copies[0, 0]].tolist())


def require_consistent_orientation(half_edges: HalfEdges) -> None:
    """Checks that the two faces of every edge that has two run through it in opposite directions.

    Raises:
        InconsistentOrientationError: two faces do not.
    """
    a, b = half_edges.pairs.T
    wrong = half_edges.origin[a] == half_edges.origin[b]
    if wrong.any():
        at = int(np.argmax(wrong))
        edge = (int(half_edges.origin[a[at]]), int(half_edges.target[a[at]]))
        raise InconsistentOrientationError(edge=edge, faces=(int(a[at]) // 3, int(b[at]) // 3))


def require_manifold_boundary(half_edges: HalfEdges) -> None:
    """Checks that no edge with three or more faces ends at a vertex of a boundary edge.

    Raises:
        NonManifoldEdgeError: one does.
    """
    crowded = np.flatnonzero(half_edges.counts > 2)
    if not len(crowded):
        return
    on_boundary = np.zeros(int(half_edges.origin.max()) + 1, dtype=bool)
    on_boundary[half_edges.origin[half_edges.boundary]] = True
    on_boundary[half_edges.target[half_edges.boundary]] = True
    first = half_edges.order[half_edges.starts[crowded]]
    touching = on_boundary[half_edges.origin[first]] | on_boundary[half_edges.target[first]]
    if touching.any():
        edge = crowded[np.argmax(touching)]
        members = half_edges.order[half_edges.starts[edge] : half_edges.starts[edge + 1]]
        ends = (int(half_edges.origin[members[0]]), int(half_edges.target[members[0]]))
        raise NonManifoldEdgeError(edge=ends, faces=(members // 3).tolist())
