"""`meshio.Mesh`, and so every file format that meshio reads and writes."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.extending import (
    grown,
    grown_attributes,
    most_frequent_row,
    padded,
    real_attributes,
    triangles_of,
)
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh

if TYPE_CHECKING:
    import meshio

FACES = ("triangle", "quad", "polygon")
NO_FACES = ("vertex", "line")  # kept as they are


class MeshioAdapter:
    """`meshio.Mesh` of triangles, quads and polygons, with its point data under their own names."""

    name = "meshio.Mesh"
    types = ("meshio.Mesh",)

    def to_mesh(self, obj: meshio.Mesh) -> TriangleMesh:
        """The triangles, quads and polygons split, block after block.

        A MeshShapeError tells that the mesh is plane (two coordinates a point), or has cells that are neither faces nor
        points nor lines.
        """
        vertices = _points(obj).astype(np.float64)
        return triangles_of(vertices, _polygons(obj).triangulated(vertices)[0], real_attributes(obj.point_data))

    def extend(self, obj: meshio.Mesh, extension: MeshExtension) -> meshio.Mesh:
        """A new mesh with the extension appended: its faces are a block of triangles of their own.

        Point sets, cell sets and field data are copied. New cells get the cell data that occur most often among faces;
        point data that are no real numbers get zeros or empty entries at new points.
        """
        import meshio

        _polygons(obj)
        points = _points(obj)
        attributes = grown_attributes(real_attributes(obj.point_data), extension, vertices=len(points))
        count = len(extension.faces)
        blocks = [(block.type, block.data) for block in obj.cells]
        of_faces = [number for number, block in enumerate(obj.cells) if block.type in FACES]

        def likeliest(values: list[Any]) -> np.ndarray:
            among_faces = np.concatenate([np.asarray(values[number]) for number in of_faces])
            return np.repeat(most_frequent_row(among_faces), count, axis=0)

        return meshio.Mesh(
            points=grown(points, extension.vertices),
            cells=[*blocks, ("triangle", extension.faces)],
            point_data={
                name: attributes[name] if name in attributes else padded(values, len(extension.vertices))
                for name, values in obj.point_data.items()
            },
            cell_data={name: [*values, likeliest(values)] for name, values in obj.cell_data.items()},
            field_data=deepcopy(obj.field_data),
            point_sets=deepcopy(obj.point_sets),
            cell_sets={name: [*own, np.zeros(0, dtype=np.int64)] for name, own in obj.cell_sets.items()},
            gmsh_periodic=deepcopy(obj.gmsh_periodic),
            info=deepcopy(obj.info),
        )


def _points(mesh: meshio.Mesh) -> np.ndarray:
    points = np.asarray(mesh.points)
    if points.shape[1:] != (3,):
        raise MeshShapeError("the points of the mesh have no third coordinate; append one, of zeros for a plane mesh")
    return points


def _polygons(mesh: meshio.Mesh) -> Polygons:
    others = sorted({block.type for block in mesh.cells} - {*FACES, *NO_FACES})
    if others:
        raise MeshShapeError(f"the mesh has cells that are no faces ({', '.join(others)}); give its surface alone")
    blocks = [np.asarray(block.data) for block in mesh.cells if block.type in FACES]
    sizes = [np.full(len(data), data.shape[1]) for data in blocks]
    none = np.zeros(0, dtype=np.int64)
    return Polygons.of_sizes(
        np.concatenate([none, *(data.reshape(-1) for data in blocks)]), np.concatenate([none, *sizes])
    )
