"""Any mesh in, the same type out: arrays, tensors, trimesh, PyVista, Open3D, meshio, pymeshlab and files.

`to_mesh` gives the triangles of any mesh object that is known, `extend` appends new vertices and faces to it and
returns an object of the same type whose original part is unchanged, `merged` one with vertices merged. An adapter for a
further type is a class with `name`, `types`, `to_mesh` and `extend` (see `Adapter`), and `merged` if it can
(`MergingAdapter`), made known by `register`. Nothing here imports one of these libraries before an object of theirs has
to be built.

    >>> import numpy as np
    >>> from spinor_geom.adapters import to_mesh
    >>> mesh = to_mesh((np.eye(3), np.array([[0, 1, 2]])))
    >>> mesh.faces
    array([[0, 1, 2]])
"""

from spinor_geom.adapters.array_pairs import PairAdapter, TriangleMeshAdapter
from spinor_geom.adapters.mesh_files import MeshFile, MeshFileAdapter, read_mesh
from spinor_geom.adapters.mesh_objects import MeshioAdapter, MeshSetAdapter, Open3DAdapter
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.pyvista_mesh import PyVistaAdapter
from spinor_geom.adapters.registry import Adapter, MergingAdapter, extend, known_types, merged, register, to_mesh
from spinor_geom.adapters.rim_arguments import Rim, is_mesh, to_rims
from spinor_geom.adapters.trimesh_mesh import SceneAdapter, TrimeshAdapter

for _adapter in (
    PairAdapter(),
    TrimeshAdapter(),
    SceneAdapter(),
    PyVistaAdapter(),
    Open3DAdapter(),
    MeshioAdapter(),
    MeshSetAdapter(),
    TriangleMeshAdapter(),
    MeshFileAdapter(),
):
    register(_adapter)

__all__ = [
    "Adapter",
    "MergingAdapter",
    "MeshFile",
    "Polygons",
    "Rim",
    "extend",
    "is_mesh",
    "known_types",
    "merged",
    "read_mesh",
    "register",
    "to_mesh",
    "to_rims",
]
