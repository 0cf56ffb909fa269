"""Nearest points of minimal surfaces, against closed forms and dense meshes."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from scipy.optimize import brentq

from spinor_geom import gallery
from spinor_geom.gradients.nearest_points import nearest
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.plateau import solve_plateau
from tests.gradients.cases import LIFT, QUADRILATERAL, RING, wavy


def test_nearest_points_of_a_catenoid_from_near_its_axis():
    solution = solve_plateau([RING - LIFT, RING + LIFT])
    height = LIFT[2]
    waist = brentq(lambda c: c * np.cosh(height / c) - 1, 0.6, 1.0)
    radii, heights = waist * np.array([0.01, 0.1, 0.3, 0.5, 0.9, 1.1]), height * np.array([0.0, 0.2, 0.4])
    places = np.array([[r, 0, h] for r in radii for h in heights])
    found = solution.array_surface.position(nearest(solution, places))
    z = np.linspace(-height, height, 20001)
    for place, point in zip(places, found, strict=True):
        exact = np.hypot(waist * np.cosh(z / waist) - place[0], z - place[2]).min()
        # the spacing of the samples is 5e-5 of the height
        assert np.linalg.norm(point - place) == pytest.approx(exact, abs=1e-7)


SEAM = pytest.param(gallery.tennis_seam(0.75).sample(100), marks=pytest.mark.slow)


@pytest.mark.parametrize("points", [QUADRILATERAL, wavy(48), SEAM], ids=["corners", "wavy", "seam"])
def test_no_point_of_a_dense_mesh_is_nearer(points):
    solution = solve_plateau(points)
    dense, size = mesh_surface(solution.array_surface, vertices=20000), solution.loop.diagonal
    rng = np.random.default_rng(0)
    inner = dense.vertices[rng.integers(dense.boundary_size, len(dense.vertices), size=60)]
    places = inner + rng.normal(size=inner.shape) * size * np.repeat([[0.01], [0.1], [0.3]], 20, axis=0)
    squared, _, foot = igl.point_mesh_squared_distance(places, dense.vertices, np.array(dense.faces))
    rim = solution.curve.point(solution.curve.nearest(np.asarray(foot)))
    is_inner = np.linalg.norm(rim - foot, axis=1) > 0.02 * size
    assert is_inner.sum() > 20
    found = solution.array_surface.position(nearest(solution, places[is_inner]))
    # the error of the dense mesh
    excess = np.linalg.norm(found - places[is_inner], axis=1) - np.sqrt(np.ravel(squared)[is_inner])
    assert np.abs(excess).max() < 1e-4 * size
