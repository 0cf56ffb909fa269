"""The second variation against exact thresholds, on the gallery's own surfaces."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.deadline import time_limit
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import OutOfTimeError, SingularMatrixError, SurfaceError
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.stability import assess_stability, gauss_image_areas, lowest_modes
from spinor_geom.surface.array_surface import ArraySurface
from tests.fill.shapes import circle
from tests.loops import noisy_ellipse
from tests.sizes import constant_size


def test_gauss_image_of_ennepers_unit_disk_is_a_hemisphere():
    """Its smallest eigenvalue is 1: on the hemisphere it belongs to the height, for which −Δu = 2u there."""
    stability = assess_stability(gallery.enneper(1.0).surface)
    assert abs(stability.eigenvalue - 1) < 1e-3
    assert abs(stability.total_curvature / (2 * np.pi) - 1) < 1e-3
    # the disk with R = 1 is neither stable nor unstable
    assert stability.verdict == "undecided"
    assert stability.index is None


@pytest.mark.parametrize("radius", [0.5, 0.9])
def test_small_enneper_disks_are_stable_by_their_total_curvature(radius):
    stability = assess_stability(gallery.enneper(radius).surface)
    assert stability.verdict == "stable"
    assert stability.index == 0
    assert stability.eigenvalue is None
    # the image is a cap of the sphere. The integral along the circle has no error but that of 256 samples
    assert abs(stability.total_curvature / (4 * np.pi * radius**2 / (1 + radius**2)) - 1) < 1e-7


@pytest.mark.parametrize("radius", [1.05, 1.1, 1.5])
def test_large_enneper_disks_have_index_one(radius):
    stability = assess_stability(gallery.enneper(radius).surface)
    assert stability.verdict == "unstable"
    assert stability.index == 1
    assert stability.eigenvalue < 1


# half-width over pitch at which tanh U tanh kU = k, k = π/V, R/c = sinh U
THRESHOLDS = [(2 * np.pi, 3**0.5), (1.5 * np.pi, 2.0)]


@pytest.mark.parametrize(
    ("turn", "radius"), [THRESHOLDS[0], *(pytest.param(*case, marks=pytest.mark.slow) for case in THRESHOLDS[1:])]
)
def test_helicoid_strips_lose_stability_at_the_known_width(turn, radius):
    def strip(share):
        return assess_stability(gallery.helicoid(share * radius, 1.0, turn=turn, both_sides=True).surface)

    assert abs(strip(1.0).eigenvalue - 1) < 1e-3
    assert strip(0.97).verdict == "stable"
    assert strip(0.97).eigenvalue > 1
    assert strip(1.03).verdict == "unstable"
    assert strip(1.03).index == 1


def test_helicoid_strip_of_half_a_turn_is_always_stable():
    stability = assess_stability(gallery.helicoid(20.0, 1.0, turn=np.pi, both_sides=True).surface)
    assert stability.verdict == "stable"
    assert stability.total_curvature < 2 * np.pi


def test_plane_disk_has_no_curvature():
    stability = assess_stability(gallery.plane_disk().surface)
    assert stability.verdict == "stable"
    assert stability.total_curvature == 0


def test_associate_and_moved_surfaces_have_the_same_stability():
    surface = gallery.enneper(1.2).surface
    first = assess_stability(surface)
    for other in (surface.associate(0.7), surface.transform(scale=1e4, translation=(1, 2, 3))):
        second = assess_stability(other)
        assert abs(second.eigenvalue / first.eigenvalue - 1) < 1e-9
        assert second.index == first.index == 1


def test_index_counts_every_direction_of_descent():
    """p = 1, q = z³ over |z| < R covers the Gauss image three times: the index grows with R."""
    indices = [assess_stability(gallery.polynomial([1], [0, 0, 0, 1], radius=r).surface).index for r in (0.6, 1.1, 1.6)]
    assert indices[0] == 0
    assert indices[1] >= 1
    assert indices == sorted(indices)


def test_wrinkles_of_a_rough_rim_do_not_make_a_disk_unstable():
    solution = solve_plateau(noisy_ellipse(60, amount=0.2), tolerance=1e-2)
    assert solution.stability.total_curvature > 2 * np.pi
    assert solution.stability.verdict == "stable"


# --- the parts --------------------------------------------------------------------------------------------------------


def test_gauss_image_of_an_octant():
    """(p, q) whose normals are the axes: an eighth of the sphere, by its orientation."""
    spinors = np.array([[1, -1], [1j, -1j * 1j], [2, 0]], dtype=complex)
    p, q = spinors.T
    normals = np.stack([-2 * (p * q.conj()).real, -2 * (p * q.conj()).imag, abs(p) ** 2 - abs(q) ** 2], axis=1)
    assert np.allclose(np.abs(normals / np.linalg.norm(normals, axis=1)[:, None]).max(axis=1), 1)
    area = gauss_image_areas(spinors, np.array([[0, 1, 2], [0, 2, 1]]))
    assert np.allclose(np.abs(area), np.pi / 2, atol=1e-14)
    assert area[0] == -area[1]


def power(degree: int, factor: float) -> ArraySurface:
    """p = 1 and q a power of z on the unit disk: its normals cover a cap of the sphere as many times."""
    coefficients = np.zeros((degree + 1, 2), dtype=np.complex128)
    coefficients[0, 0], coefficients[degree, 1] = 1, factor
    return ArraySurface(PowerSeries(coefficients), PlaneDomain.disk())


@pytest.mark.parametrize("degree", [64, 256, *(pytest.param(n, marks=pytest.mark.slow) for n in (16, 63, 1000))])
@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_powers_that_meshes_do_not_resolve_are_not_stable(degree: int, factor: float) -> None:
    """Their normals cover a hemisphere or more; sampled at as many equal steps as the degree, they seem constant."""
    stability = assess_stability(power(degree, factor))
    assert stability.verdict != "stable"
    assert stability.index != 0
    assert stability.total_curvature is None or stability.total_curvature >= 2 * np.pi


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_spinors_that_are_not_finite_give_no_verdict(value: float) -> None:
    stability = assess_stability(power(1, value))
    assert (stability.verdict, stability.index, stability.eigenvalue) == ("undecided", None, None)


def test_a_solve_that_is_cut_short_is_stable_only_with_a_possible_curvature() -> None:
    """After few steps p and q of rough loops are far from those of a surface over them."""
    solved = 0
    for seed in range(4):
        points = circle(30, bend=0.5)
        points += 0.1 * np.random.default_rng(seed).normal(size=points.shape)
        with suppress(SurfaceError):  # two steps are not enough for some
            stability = solve_plateau(BoundaryLoop.from_points(points), max_iterations=2, unstable="keep").stability
            assert stability.verdict != "stable" or stability.total_curvature >= -1e-9
            solved += 1
    assert solved >= 3


def test_meshes_without_area_are_a_typed_error_of_modes() -> None:
    plane = gallery.plane_disk().surface
    mesh = triangulate_polygon(np.exp(2j * np.pi * np.arange(24) / 24), constant_size(0.3))
    flat = replace(mesh, points=np.where(np.arange(len(mesh.points)) < 24, mesh.points, 0))
    with pytest.raises(SingularMatrixError):
        lowest_modes(plane, flat, 1)


def test_an_assessment_that_time_cut_short_is_not_kept():
    solution = solve_plateau(gallery.enneper(1.3).rim(32), all_solutions=True)[-1]
    with time_limit(-1.0), pytest.raises(OutOfTimeError):
        assess_stability(solution.surface)
