"""Which loops are rough: those whose points are not predicted by their neighbours."""

import pytest

import spinor_geom
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.roughness import is_rough
from tests.loops import evenly, noisy_ellipse, uneven


def seems_rough(loop: BoundaryLoop) -> bool:
    return is_rough(loop, BoundaryCurve.from_loop(loop))


@pytest.mark.parametrize("points", [32, 48, 64, 96, 256])
def test_points_of_smooth_curves_are_not_rough(points):
    assert not any(seems_rough(uneven(points, seed)) for seed in range(20))


@pytest.mark.parametrize("amount", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("points", [64, 250])
def test_noise_makes_loops_rough(points, amount):
    assert all(seems_rough(noisy_ellipse(points, amount=amount, seed=seed)) for seed in range(5))


def test_rims_along_triangles_are_rough():
    assert all(map(seems_rough, spinor_geom.boundary_loops("data/demosthenes_low_res.obj")))


def test_free_curves_are_smooth_where_points_are():
    seed = 3
    # the area through the points alone would be off by 1e-3 to 3e-3, that over cubic splines by 1e-5
    loop, true = uneven(64, seed), solve_plateau(evenly(256, seed)).area
    assert solve_plateau(loop).area == pytest.approx(true, rel=2e-4)
    assert solve_plateau(loop).area == solve_plateau(loop, between="smooth").area
