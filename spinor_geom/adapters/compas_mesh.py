"""`compas.datastructures.Mesh`, with triangles, quads and polygons."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np

from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_existing_vertices


class CompasAdapter:
    """`compas.datastructures.Mesh`. Its vertices are numbered in their order, whatever their keys."""

    name = "compas.datastructures.Mesh"
    types = ("compas.Mesh",)

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles, quads and polygons split."""
        points, faces = obj.to_vertices_and_faces()
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
        sizes = np.array([len(face) for face in faces], dtype=np.int64)
        polygons = Polygons.of_sizes(np.array([*chain(*faces)], dtype=np.int64), sizes)
        return TriangleMesh(vertices, polygons.triangulated(vertices)[0])

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A copy with the extension appended. Attributes of new vertices and faces have their default values."""
        made = obj.copy()
        keys = list(made.vertices())
        require_existing_vertices(extension.faces, vertices=len(keys) + len(extension.vertices))
        keys += [made.add_vertex(x=x, y=y, z=z) for x, y, z in extension.vertices.tolist()]
        for face in extension.faces.tolist():
            made.add_face([keys[corner] for corner in face])
        return made
