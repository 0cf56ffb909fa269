"""Whether the faces of a mesh fit together."""

import numpy as np

from spinor_geom.mesh.find_loops import repeated_faces, repeats_a_vertex
from spinor_geom.mesh.topology import HalfEdges


def validate(mesh):
    """No face uses a vertex twice, no two have the same ones, and neighbours are oriented alike."""
    half_edges = HalfEdges.of(mesh.faces)
    assert not repeats_a_vertex(mesh.faces).any()
    assert not len(repeated_faces(half_edges))
    assert (half_edges.counts <= 2).all()
    a, b = half_edges.pairs.T
    np.testing.assert_array_equal(half_edges.origin[a], half_edges.target[b])
