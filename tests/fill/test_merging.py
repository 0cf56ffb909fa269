"""Merged vertices: meshes of all types whose vertices differ by rounding, or by a distance, are closed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import meshio
import numpy as np
import pymeshlab
import pytest
import pyvista
import torch
import trimesh

from spinor_geom.adapters import merged, register, to_mesh
from spinor_geom.errors import OptionError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.bench.test_holes import require_peer
from tests.fill.shapes import tube

LABELS = np.arange(3 * 64)  # one for each corner of the soup, all different


def soup(error: float) -> tuple[np.ndarray, np.ndarray]:
    """The tube's 64 faces with corners of their own, which differ by an error: 192 vertices, 48 positions."""
    vertices, faces = tube()
    corners = vertices[faces].reshape(-1, 3)
    shift = np.random.default_rng(5).uniform(-1, 1, size=corners.shape) * error / 4
    return corners + shift, np.arange(len(corners)).reshape(-1, 3)


def as_trimesh(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(vertices, faces, process=False, vertex_attributes={"label": LABELS})
    mesh.face_attributes["number"] = np.arange(len(faces))
    mesh.visual.vertex_colors = np.column_stack([LABELS, LABELS, LABELS, LABELS]).astype(np.uint8)
    mesh.metadata["name"] = "soup"
    return mesh


def as_poly_data(vertices: np.ndarray, faces: np.ndarray) -> pyvista.PolyData:
    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    mesh.point_data["label"] = LABELS
    mesh.point_data["other"] = LABELS
    mesh.point_data.active_scalars_name = "label"
    mesh.cell_data["number"] = np.arange(len(faces))
    return mesh


def as_grid(vertices: np.ndarray, faces: np.ndarray) -> pyvista.UnstructuredGrid:
    grid = as_poly_data(vertices, faces).cast_to_unstructured_grid()
    grid.field_data["name"] = ["soup"]
    return grid


def as_meshio(vertices: np.ndarray, faces: np.ndarray) -> meshio.Mesh:
    return meshio.Mesh(
        vertices,
        [("line", np.array([[0, 1]])), ("triangle", faces)],
        point_data={"label": LABELS},
        cell_data={"number": [np.zeros(1), np.arange(len(faces))]},
        point_sets={"first": np.arange(6)},
    )


def as_mesh_set(vertices: np.ndarray, faces: np.ndarray) -> pymeshlab.MeshSet:
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32), v_scalar_array=LABELS.astype(float)), "soup")
    return meshes


def as_open3d(vertices: np.ndarray, faces: np.ndarray) -> Any:
    require_peer("open3d")
    from open3d import geometry, utility

    mesh = geometry.TriangleMesh(utility.Vector3dVector(vertices), utility.Vector3iVector(faces.astype(np.int32)))
    mesh.vertex_colors = utility.Vector3dVector(np.repeat(LABELS[:, None] / 255, 3, axis=1))
    return mesh


TYPES: dict[str, Callable[[np.ndarray, np.ndarray], Any]] = {
    "arrays": lambda v, f: (v, f),
    "list of arrays": lambda v, f: [v, f.astype(np.uint8)],
    "tensors": lambda v, f: (torch.from_numpy(v), torch.from_numpy(f).int()),
    "TriangleMesh": lambda v, f: TriangleMesh(v, f, vertex_attributes={"label": LABELS}),
    "trimesh": as_trimesh,
    "PolyData": as_poly_data,
    "UnstructuredGrid": as_grid,
    "meshio": as_meshio,
    "pymeshlab": as_mesh_set,
    "open3d": as_open3d,
}


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize(("error", "merge"), [(0.0, True), (1e-9, True), (1e-4, 2e-4)])
def test_vertices_are_merged_and_holes_filled(kind: str, error: float, merge: bool | float) -> None:
    vertices, faces = soup(error)
    given = TYPES[kind](vertices, faces)
    filled, report = fill_hole(given, merge=merge, return_report=True)
    assert type(filled) is type(given)
    assert len(report.loops) == 2
    assert report.watertight
    mesh = to_mesh(filled)
    assert is_watertight(mesh.faces)
    # of each place the first vertex stays, as it was, and all faces do
    _, first, place = np.unique(tube()[1], return_index=True, return_inverse=True)
    kept = np.sort(first)
    np.testing.assert_allclose(mesh.vertices[:48], vertices[kept], atol=0)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[:64]], vertices[first][place.reshape(-1, 3)])
    name, scale = {"open3d": ("color", 255), "pymeshlab": ("scalar", 1)}.get(kind, ("label", 1))
    if name in mesh.vertex_attributes:
        np.testing.assert_allclose(mesh.vertex_attributes[name][:48, 0] * scale, LABELS[kept], atol=1e-9)
    # the input is as it was
    np.testing.assert_array_equal(to_mesh(given).vertices, vertices)
    assert len(to_mesh(given).faces) == 64


def test_data_of_cells_and_sets_are_kept() -> None:
    vertices, faces = soup(0.0)
    mesh = merged(as_trimesh(vertices, faces), "rounding")
    np.testing.assert_array_equal(mesh.face_attributes["number"], np.arange(64))
    assert mesh.metadata["name"] == "soup"
    for made in (merged(as_poly_data(vertices, faces), "rounding"), merged(as_grid(vertices, faces), "rounding")):
        np.testing.assert_array_equal(made.cell_data["number"], np.arange(64))
        assert made.point_data.active_scalars_name == "label"
    assert list(made.field_data["name"]) == ["soup"]
    held = merged(as_meshio(vertices, faces), "rounding")
    np.testing.assert_array_equal(held.cell_data["number"][1], np.arange(64))
    assert held.points[held.cells[0].data].shape == (1, 2, 3)
    np.testing.assert_array_equal(held.points[held.cells[0].data[0]], vertices[:2])
    places = {tuple(row) for row in vertices[:6].tolist()}
    assert {tuple(row) for row in held.points[held.point_sets["first"]].tolist()} == places


def test_given_normals_of_a_trimesh_are_kept() -> None:
    vertices, faces = soup(0.0)
    normals = np.tile([0.6, 0.0, 0.8], (len(vertices), 1))
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False)
    np.testing.assert_array_equal(to_mesh(merged(mesh, "rounding")).vertex_attributes["normal"], normals[:48])


def test_gradients_flow_to_the_vertices_that_stay() -> None:
    vertices, faces = soup(0.0)
    positions = torch.from_numpy(vertices).requires_grad_()
    (points, _) = merged((positions, torch.from_numpy(faces)), "rounding")
    points.sum().backward()
    assert positions.grad is not None
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
        return TriangleMesh(*soup(0.0))

    def extend(self, obj: Own, extension: Any) -> Own:
        return obj


def test_types_that_cannot_be_merged_are_refused() -> None:
    register(OwnAdapter())
    for mesh in (Own(), trimesh.Scene([as_trimesh(*soup(0.0))])):
        with pytest.raises(OptionError, match="cannot merge vertices"):
            fill_hole(mesh, merge=True)


def test_merging_what_fits_changes_nothing() -> None:
    vertices, faces = tube()
    made = merged((vertices, faces), 0.0)
    np.testing.assert_array_equal(made[0], vertices)
    np.testing.assert_array_equal(made[1], faces)
