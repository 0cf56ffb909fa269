"""Reads meshes of any type, and returns them extended in the same type.

Types: arrays, tensors, objects of trimesh, PyVista, Open3D, meshio, pymeshlab, COMPAS and Blender, and files.
`to_mesh` returns the triangles, `extend` a new object of the same type with vertices and faces appended, `merged` one
with vertices merged. `register` adds an adapter for a further type, see `Adapter`. A library is imported only when one
of its objects is built.

    >>> import numpy as np
    >>> from spinor_geom.adapters import to_mesh
    >>> mesh = to_mesh((np.eye(3), np.array([[0, 1, 2]])))
    >>> mesh.faces
    array([[0, 1, 2]])
"""

from spinor_geom.adapters.array_pairs import PairAdapter, TriangleMeshAdapter
from spinor_geom.adapters.blender_mesh import BlenderMeshAdapter, BlenderObjectAdapter
from spinor_geom.adapters.cad_curves import CadCurve
from spinor_geom.adapters.compas_mesh import CompasAdapter
from spinor_geom.adapters.mesh_files import MeshFile, MeshFileAdapter, read_mesh
from spinor_geom.adapters.mesh_objects import MeshioAdapter, MeshSetAdapter, Open3DAdapter
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.pyvista_mesh import PyVistaAdapter
from spinor_geom.adapters.registry import Adapter, extend, known_types, merged, register, textured, to_mesh
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
    CompasAdapter(),
    BlenderMeshAdapter(),
    BlenderObjectAdapter(),
    TriangleMeshAdapter(),
    MeshFileAdapter(),
):
    register(_adapter)

__all__ = [
    "Adapter",
    "CadCurve",
    "MeshFile",
    "Polygons",
    "Rim",
    "extend",
    "is_mesh",
    "known_types",
    "merged",
    "read_mesh",
    "register",
    "textured",
    "to_mesh",
    "to_rims",
]
