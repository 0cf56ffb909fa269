"""What merging vertices keeps beyond what all types have in common (`tests/adapters/test_objects`), and refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import pyvista
import trimesh

from spinor_geom.adapters import merged, register, to_mesh
from spinor_geom.errors import OptionError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import soup, tube


def test_given_normals_of_a_trimesh_are_kept() -> None:
    vertices, faces = soup(tube())
    normals = np.tile([0.6, 0.0, 0.8], (len(vertices), 1))
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False)
    np.testing.assert_array_equal(to_mesh(merged(mesh, "rounding")).vertex_attributes["normal"], normals[:48])


def test_gradients_flow_to_the_vertices_that_stay() -> None:
    import torch

    vertices, faces = soup(tube())
    positions = torch.from_numpy(vertices).requires_grad_()
    (points, _) = merged((positions, torch.from_numpy(faces)), "rounding")
    points.sum().backward()
    assert int(positions.grad.any(dim=1).sum()) == 48


def test_quads_stay_quads() -> None:
    corners = pyvista.Cube().clean().extract_cells(range(5)).extract_surface(algorithm="dataset_surface")
    loose = corners.separate_cells().extract_surface(algorithm="dataset_surface")
    assert loose.n_points == 20
    made = merged(loose, "rounding")
    assert (made.n_points, made.n_cells) == (8, 5)
    assert made.regular_faces.shape == (5, 4)
    assert len(boundary_loops(made)) == 1


class Own:
    """A mesh type with an adapter that cannot merge."""


class OwnAdapter:
    name = "Own"
    types = ("tests.Own",)

    def to_mesh(self, obj: Own) -> TriangleMesh:
        return TriangleMesh(*soup(tube()))

    def extend(self, obj: Own, extension: Any) -> Own:
        return obj


def test_types_that_cannot_be_merged_are_refused() -> None:
    register(OwnAdapter())
    for mesh in (Own(), trimesh.Scene([trimesh.Trimesh(*soup(tube()), process=False)])):
        with pytest.raises(OptionError, match="cannot merge vertices"):
            fill_hole(mesh, merge=True)
