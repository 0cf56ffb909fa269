"""Harmonic interpolation into a patch, on triangulations of Ω where harmonic functions are known."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.domain.sizes import SizeField
from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.fill.attributes import patch_attributes
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch


def patch_of(plane: PlaneTriangulation) -> Patch:
    return Patch(vertices=flat(plane.points), faces=plane.faces, boundary_size=plane.boundary_size, points=plane.points)


def flat(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points.real, points.imag, np.zeros(len(points))])


@pytest.fixture(scope="module")
def disk() -> Patch:
    rim = np.exp(2j * np.pi * np.arange(60) / 60) * (1 + 0.2 * np.cos(6 * np.pi * np.arange(60) / 60))
    return patch_of(triangulate_polygon(rim, SizeField(samples=np.zeros(1, dtype=complex), lengths=np.full(1, 0.12))))


class FlatSurface:
    """Stands for a surface in the plane z = 0."""

    def normal(self, points: np.ndarray) -> np.ndarray:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def inner_values(
    attributes: dict[str, np.ndarray], rim: np.ndarray, patch: Patch, *, labels: tuple[str, ...] = (), flat: bool = True
) -> dict[str, np.ndarray]:
    count = len(next(iter(attributes.values())))
    mesh = TriangleMesh(np.zeros((count, 3)), [], vertex_attributes=attributes, labels=labels)
    return patch_attributes(mesh, rim, patch, FlatSurface() if flat else None, by="domain" if flat else "edges")


def harmonic_values(disk: Patch, rim_values: np.ndarray) -> np.ndarray:
    return inner_values({"value": rim_values}, np.arange(disk.boundary_size), disk)["value"]


def test_linear_functions_are_reproduced_exactly(disk: Patch) -> None:
    rim = disk.boundary_size
    values = harmonic_values(disk, np.column_stack([disk.points[:rim].real, 3 - 2 * disk.points[:rim].imag]))
    expected = np.column_stack([disk.points[rim:].real, 3 - 2 * disk.points[rim:].imag])
    np.testing.assert_allclose(values, expected, atol=1e-12)  # linear precision of cotangent weights: round-off


def test_every_attribute_is_carried_and_normals_are_the_surface_s(disk: Patch) -> None:
    rim = disk.boundary_size
    ids, none = np.arange(rim)[::-1] + 5, np.zeros(rim, dtype=bool)
    loop = BoundaryLoop(points=disk.vertices[:rim], vertex_ids=ids, corners=none)
    color = np.zeros((rim + 5, 4))
    color[loop.vertex_ids] = np.column_stack([disk.points[:rim].real] * 4)
    attributes = {"color": color, "normal": np.ones((rim + 5, 3)), "weight": np.full((rim + 5, 1), 7.0)}
    inner = inner_values(attributes, loop.vertex_ids, disk)
    assert set(inner) == set(attributes)
    np.testing.assert_allclose(inner["color"][:, 0], disk.points[rim:].real, atol=1e-12)
    np.testing.assert_allclose(inner["weight"], 7.0, rtol=1e-12)
    np.testing.assert_array_equal(inner["normal"], np.tile([0.0, 0.0, 1.0], (len(disk.points) - rim, 1)))


def test_labels_are_those_of_the_nearest_rim_vertex_and_never_averaged(disk: Patch) -> None:
    rim = disk.boundary_size
    label = np.where(disk.points[:rim].real > 0, 10.0, 7.0)[:, None]
    attributes = {"label": label, "weight": label}
    inner = inner_values(attributes, np.arange(rim), disk, labels=("label",))
    assert set(np.unique(inner["label"])) == {7.0, 10.0}
    distance = np.abs(disk.points[rim:, None] - disk.points[:rim])
    nearest = distance < distance.min(axis=1, keepdims=True) + 1e-9  # several in the middle
    assert ((inner["label"] == label[:, 0]) & nearest).any(axis=1).all()
    assert len(np.unique(inner["weight"])) > 2


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_not_finite_spoils_no_other(disk: Patch, bad: float) -> None:
    rim = disk.boundary_size
    values = np.column_stack([disk.points[:rim].real, disk.points[:rim].imag])
    spoilt = values.copy()
    spoilt[7, 0] = bad
    inner = harmonic_values(disk, spoilt)
    # the neighbour's value in its place, an edge away
    assert np.abs(inner - harmonic_values(disk, values)).max() < 0.15
    assert np.isnan(harmonic_values(disk, np.full((rim, 1), np.nan))).all()


def test_a_discrete_patch_has_the_normals_of_its_faces_and_harmonic_values(disk: Patch) -> None:
    rim = disk.boundary_size
    attributes = {"normal": np.ones((rim, 3)), "value": disk.points[:rim].real[:, None]}
    inner = inner_values(attributes, np.arange(rim), disk, flat=False)
    np.testing.assert_allclose(inner["normal"], np.tile([0.0, 0.0, 1.0], (len(disk.points) - rim, 1)), atol=1e-12)
    assert (np.abs(inner["value"]) < attributes["value"].max()).all()
    assert np.corrcoef(inner["value"][:, 0], disk.points[rim:].real)[0, 1] > 0.99
