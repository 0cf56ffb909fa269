import numpy as np
import pytest

from spinor_geom.bench.holes import lattice
from spinor_geom.measures import discrete_mean_curvature, smallest_angles
from spinor_geom.meshing.embed import mesh_patch
from tests.exact_solutions import ENNEPER, PLANE, exact_solution
from tests.measures.test_hausdorff import sphere


@pytest.mark.parametrize("radius", [0.01, 1.0, 20.0])
def test_mean_curvature_of_a_sphere_is_one_over_its_radius(radius):
    curvature = discrete_mean_curvature(*sphere(4, radius))
    # the six vertices of degree four are the worst
    assert curvature.values == pytest.approx(np.full(len(curvature.values), 1 / radius), rel=0.02)
    assert curvature.rms == pytest.approx(1 / radius, rel=0.01)
    assert curvature.areas.sum() == pytest.approx(4 * np.pi * radius**2, rel=0.02)


def test_mean_curvature_of_a_cylinder_is_half_of_one_over_its_radius():
    (u, v), faces = lattice(60, 11, wrap_x=True)
    angle, height = 2 * np.pi * (u - 0.5 * v) / 60, v * 2 * 2 * np.pi / 60  # the triangles are isosceles
    vertices = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), height])
    curvature = discrete_mean_curvature(vertices, faces)
    assert len(curvature.values) == 60 * 10
    assert curvature.values == pytest.approx(np.full(600, 0.25), rel=5e-3)
    # all vertices are alike: nothing pulls them along the surface
    assert curvature.tangential_rms < 1e-10


def test_uneven_triangles_pull_along_a_surface_and_do_not_bend_it():
    """A plane mesh with one vertex out of the middle has the least area already. A sphere's is pulled to and fro."""
    vertices, faces = sphere(4, 1.0)
    moved = vertices + 0.02 * np.random.default_rng(0).normal(size=vertices.shape)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    even, uneven = discrete_mean_curvature(vertices, faces), discrete_mean_curvature(moved, faces)
    assert uneven.tangential_rms > 5 * even.tangential_rms
    assert uneven.rms == pytest.approx(1.0, rel=0.05)
    hexagon = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(6) * np.pi / 3] + [[0.3, 0.2, 0.0]])
    flat = discrete_mean_curvature(hexagon, np.array([[k, (k + 1) % 6, 6] for k in range(6)]))
    assert flat.max < 1e-12
    assert flat.tangential_rms < 1e-12


def test_mean_curvature_of_a_plane_is_zero_and_its_boundary_is_left_out():
    patch = mesh_patch(exact_solution(PLANE, 40))
    curvature = discrete_mean_curvature(patch.vertices, patch.faces)
    assert np.array_equal(curvature.vertices, np.arange(40, len(patch.vertices)))
    assert curvature.max < 1e-11


def test_mesh_without_inner_vertices_has_no_curvature():
    curvature = discrete_mean_curvature(np.eye(3), np.array([[0, 1, 2]]))
    assert len(curvature.values) == 0
    assert curvature.max == curvature.rms == 0


def test_mean_curvature_of_a_minimal_patch_falls_with_its_edges():
    # slowly: on unstructured triangles the discrete curvature does not converge vertex by vertex
    patches = [mesh_patch(exact_solution(ENNEPER, n)) for n in (30, 240)]
    rms = [discrete_mean_curvature(patch.vertices, patch.faces).rms for patch in patches]
    assert rms[1] < 0.8 * rms[0]


def test_quality_of_known_triangles():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [1, 1, 0], [2, 0, 0]])
    smallest = smallest_angles(vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    assert smallest == pytest.approx([60, 45, 0], abs=1e-6)
