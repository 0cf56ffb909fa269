"""A round mesh with holes, as the command prepares it for the window."""

import numpy as np

from spinor_geom.fill.fill_options import Choice, FillOptions
from spinor_geom.fill.filling import Filling
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import icosphere

# the centres of the holes and their sizes: the first is loop 0 and faces the eye, the last is not seen from there
HOLES = ((0.0, 0.0, 1.0, 0.45), (0.8, 0.0, 0.6, 0.33), (-0.7, 0.5, 0.5, 0.3), (0.0, -1.0, -0.4, 0.25))


def ball(shift=0.0, holes=HOLES):
    """A unit sphere with holes, moved along all axes."""
    vertices, faces = icosphere(4)
    places = vertices[faces].mean(axis=1)
    for *centre, radius in holes:
        is_out = np.linalg.norm(places - np.array(centre) / np.linalg.norm(centre), axis=1) < radius
        faces, places = faces[~is_out], places[~is_out]
    return vertices + shift, faces


def prepared(mesh):
    """The loops of a mesh."""
    return Filling(TriangleMesh(*mesh), Choice(), FillOptions())
