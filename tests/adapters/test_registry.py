from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import pyvista
import torch
import trimesh

from spinor_geom.adapters import extend, known_types, register, to_mesh
from spinor_geom.errors import UnknownMeshTypeError
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.adapters.shapes import lid, open_cube

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        (3.5, "float is not a supported mesh type"),
        (None, "NoneType is not"),
        ((np.zeros((3, 3)), np.zeros((1, 3)), 1), r"tuple of 3 \(numpy.ndarray, numpy.ndarray, int\)"),
        (["a.obj", 3], r"list of 2 \(str, int\)"),
        ((), r"tuple of 0 \(\)"),
        ((np.zeros((3, 3)), torch.zeros((1, 3))), r"tuple of 2 \(numpy.ndarray, torch.Tensor\)"),
    ],
)
def test_unknown_type_error_lists_the_known_ones(thing, message):
    with pytest.raises(UnknownMeshTypeError, match=message) as caught:
        to_mesh(thing)
    assert all(name in str(caught.value) for name in ("trimesh.Scene", "numpy", "torch", ".obj"))
    assert caught.value.fields["known"] == known_types()
    with pytest.raises(UnknownMeshTypeError):
        extend(thing, lid())


@pytest.mark.parametrize(
    ("thing", "cure"),
    [
        (pyvista.MultiBlock([pyvista.Sphere()]), r"combine\(\).extract_surface\(\)"),
        (import_module(pyvista.vtk_backend()).vtkPolyData(), r"pyvista.wrap\(mesh\)"),
        (trimesh.PointCloud(np.eye(3)), "reconstruct faces first"),
    ],
)
def test_errors_name_the_cure_for_types_that_are_nearly_supported(thing, cure):
    with pytest.raises(UnknownMeshTypeError, match=cure):
        to_mesh(thing)


def test_registered_adapter_serves_its_type_and_subclasses():
    @dataclass
    class Cloth:
        points: np.ndarray
        triangles: np.ndarray

    class Silk(Cloth):
        pass

    class ClothAdapter:
        name = "Cloth"
        types = (f"{Cloth.__module__.partition('.')[0]}.{Cloth.__qualname__}",)

        def to_mesh(self, obj):
            return TriangleMesh(obj.points, obj.triangles)

        def extend(self, obj, extension):
            points = np.concatenate([obj.points, extension.vertices])
            return type(obj)(points, np.concatenate([obj.triangles, extension.faces]))

    with pytest.raises(UnknownMeshTypeError):
        to_mesh(Cloth(*open_cube()))
    register(ClothAdapter())
    assert len(to_mesh(Cloth(*open_cube())).faces) == 10
    assert isinstance(extend(Silk(*open_cube()), lid()), Silk)
    assert "Cloth" in known_types()


def test_import_and_lookup_import_no_optional_library():
    program = (
        "import conftest, sys, numpy as np\n"
        "from spinor_geom.adapters import read_mesh, to_mesh, to_rims\n"
        "from spinor_geom.errors import UnknownMeshTypeError\n"
        "to_mesh((np.eye(3), np.array([[0, 1, 2]])))\n"
        "try:\n"
        "    to_mesh(object())\n"
        "except UnknownMeshTypeError:\n"
        "    pass\n"
        "assert len(read_mesh('data/trimesh_reference.obj').mesh.faces) == 1610\n"
        "heavy = {'trimesh', 'torch', 'pymeshlab', 'PIL', 'igl', 'pyvista', 'vtkmodules', 'open3d', 'meshio'}\n"
        "heavy |= {'OCP', 'build123d', 'compas'}\n"
        "found = sorted(heavy & set(sys.modules))\n"
        "assert not found, found\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True, timeout=60)
