"""NURBS of known surfaces: exact areas, equal sides, rims on the given curves."""

import pickle
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import spinor_geom
from spinor_geom import gallery
from spinor_geom.deadline import seconds_left
from spinor_geom.errors import CadFileError, DomainError, OptionError, OutOfTimeError
from spinor_geom.gallery import curves, surfaces
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.rational_splines import NurbsPatch
from spinor_geom.nurbs.nurbs_surface import NurbsSurface, nurbs_surface
from spinor_geom.plateau.solution import PlateauSolution
from tests.fill.shapes import circle
from tests.open_cascade import area_of, count, distances, free_boundary, free_wires, is_valid
from tests.plateau.rims import polygon, ring, sampled

SEAM_AREA = 4.36461878664500


def circles(*heights: float, radius: float = 1.0) -> PlateauSolution:
    rims = [radius * circle(64, height=h / radius) for h in heights]
    return spinor_geom.solve_plateau([BoundaryLoop.from_points(rim, corners=()) for rim in rims])


def three_circles() -> PlateauSolution:
    angle, rims = 2 * np.pi * np.arange(64) / 64, []
    for turn in 2 * np.pi * np.arange(3) / 3:
        along, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
        circle = along + np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * [0, 0, 1]
        rims.append(BoundaryLoop.from_points(circle, corners=()))
    return spinor_geom.solve_plateau(rims)


SMOOTH: dict[str, Callable[[], PlateauSolution]] = {
    "seam": cache(lambda: spinor_geom.solve_plateau(gallery.tennis_seam(0.8))),
    "enneper": cache(lambda: spinor_geom.solve_plateau(surfaces.enneper().rim(96))),
    "twisted": cache(lambda: spinor_geom.solve_plateau(gallery.twisted_circle())),
    "catenoid": cache(lambda: circles(-0.4, 0.4)),
}


@cache
def raised_l() -> NurbsSurface:
    """Patches of an L, as near as its residual allows."""
    solution = spinor_geom.solve_plateau(curves.l_shape(0.5))
    assert solution.converged
    return replace(solution, solved_to=None).to_nurbs(tolerance=1e-6)


def sides_agree(surface: NurbsSurface) -> bool:
    """Whether the control points along all seams are equal, bit for bit."""
    for seam in surface.seams:
        one, two = (surface.patches[patch].side(side) for patch, side in (seam.first, seam.second))
        if not np.array_equal(one.control_points, two.control_points[:: -1 if seam.reversed else 1]):
            return False
        if not np.array_equal(one.knots, 1 - two.knots[::-1] if seam.reversed else two.knots):
            return False
    return True


def fourier_points(seed: int) -> np.ndarray:
    """Points of a stretched Fourier curve, at steps that vary by 30 %."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, 1 + rng.integers(3, 9))
    stretch = np.array([10 ** rng.uniform(), 1, 1])
    waves = 0.8 * rng.normal(size=(2, len(k), 3)) / k[:, None] ** 2
    waves[:, 0] = np.eye(3)[:2]
    count = int(rng.integers(64, 301))
    angle = 2 * np.pi * ((np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count)[:, None] * k
    return np.asarray((np.cos(angle) @ waves[0] + np.sin(angle) @ waves[1]) * stretch)


# cubic splines through 77 points take 33,000 control points; Ω of the others has a bump far shorter than the side of
# a patch there
@pytest.mark.parametrize("seed", [5000, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (6000, 7008))])
def test_patches_over_points_of_smooth_curves_converge(seed: int) -> None:
    solution = spinor_geom.solve_plateau(fourier_points(seed), tolerance=1e-5)
    surface = solution.to_nurbs()
    assert surface.converged
    assert abs(surface.area / solution.area - 1) < 1e-6  # the tolerance


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_films_have_the_area_of_the_surface(name: str) -> None:
    solution = SMOOTH[name]()
    surface = solution.to_nurbs()
    assert surface.converged
    assert sides_agree(surface)
    assert len(surface.patches) <= 30
    assert abs(surface.area / solution.area - 1) < 1e-7
    assert surface.deviations.surface < 2e-6 * surface.deviations.diagonal  # the sum of errors in both directions
    assert surface.deviations.rim < 1e-7 * surface.deviations.diagonal
    assert surface.deviations.normals < 1e-2  # degrees: derivatives of an error of 1e-6 over a tenth of the film


def test_area_converges_with_the_tolerance() -> None:
    solution = spinor_geom.solve_plateau(gallery.tennis_seam(0.8), tolerance=1e-9)
    errors = [abs(solution.to_nurbs(tolerance=each).area / SEAM_AREA - 1) for each in (1e-3, 1e-5, 1e-7)]
    assert errors[2] < errors[1] < errors[0] < 1e-3
    assert errors[2] < 1e-9


def test_boundary_curves_are_closed_and_pass_through_the_corners() -> None:
    curve = curves.l_shape(0.5)
    (rim,) = raised_l().boundary_curves
    ends = np.array([[side.control_points[0], side.control_points[-1]] for side in rim])
    assert np.array_equal(ends[:, 1], np.roll(ends[:, 0], -1, axis=0))
    corners = curve.point(np.array(curve.corners))
    assert np.abs(ends[:, 0][:, None] - corners).max(axis=2).min(axis=0).max() < 1e-12
    # straight edges are straight
    assert all(np.linalg.matrix_rank(side.control_points - side.control_points[0], tol=1e-12) == 1 for side in rim)


def test_the_area_of_a_large_patch_takes_a_bounded_memory() -> None:
    count = 400
    x = np.linspace(0, 1, count)
    net = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((count, count))], axis=-1)
    patch = NurbsPatch(control_points=net, weights=np.ones((count, count)), knots=(np.r_[0, x, 1],) * 2)
    tracemalloc.start()
    area = patch.area
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert abs(area - 1) < 1e-13
    assert peak < 256 << 20  # 428 MB if all points are evaluated together


def test_plane_polygons_are_exact_with_patches_of_degree_1() -> None:
    surface = spinor_geom.solve_plateau(curves.l_shape()).to_nurbs()
    assert {patch.degrees for patch in surface.patches} == {(1, 1)}
    assert abs(surface.area - 3) < 1e-14
    assert surface.deviations.surface < 1e-14


def test_rigid_motion_and_scale_move_the_control_points() -> None:
    rng, loop = np.random.default_rng(5), surfaces.enneper().rim(48)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = BoundaryLoop.from_points(30 * loop.points @ rotation.T + [1, 2, 3], corners=())
    one, other = (spinor_geom.solve_plateau(each).to_nurbs(tolerance=1e-4) for each in (loop, moved))
    assert len(one.patches) == len(other.patches)
    # the knots may differ. The error of the area is of second order in that of positions
    assert abs(other.area / (900 * one.area) - 1) < 1e-6


def test_normals_are_those_of_the_surface() -> None:
    solution = SMOOTH["enneper"]()
    surface = solution.to_nurbs()
    half = np.array([0.5])
    point = surface.patches[-1].grid(half, half)[0, 0]
    along, across = (surface.patches[-1].grid(half, half, derivatives=each)[0, 0] for each in ((1, 0), (0, 1)))
    z = solution.domain.triangulation.points
    nearest = z[np.linalg.norm(solution.surface.position(z) - point, axis=1).argmin()]
    normal = solution.surface.normal(np.array([nearest]))[0]
    assert np.cross(along, across) @ normal > 0


def test_refinement_ends_at_the_residual_of_the_solution() -> None:
    surface = raised_l()
    assert not surface.converged
    assert "moved by the boundary residual" in surface.reason
    assert "solve with a smaller tolerance" in surface.reason
    assert surface.size < 10_000  # 11,677 without the end


def test_no_smaller_tolerance_is_advised_where_one_was_tried_in_vain() -> None:
    solution = spinor_geom.solve_plateau(curves.l_shape(0.5))
    surface = replace(solution, solved_to=lambda tolerance: solution).to_nurbs(tolerance=1e-6)
    assert "no solve in the given time was near enough" in surface.reason


def test_a_solve_that_missed_its_tolerance_is_used_and_ends_the_search() -> None:
    solution = spinor_geom.solve_plateau(curves.l_shape(0.5))
    tried = []

    def solved_to(tolerance: float) -> PlateauSolution:
        tried.append(tolerance)
        nearer = spinor_geom.solve_plateau(curves.l_shape(0.5), tolerance=1e-4)  # and no nearer than this
        return replace(nearer, solved_to=None, converged=False)

    surface = replace(solution, solved_to=solved_to).to_nurbs()
    assert len(tried) == 1
    assert "no solve in the given time was near enough" in surface.reason


def test_a_solve_is_continued_where_the_largest_distance_grows_first() -> None:
    solution = SMOOTH["seam"]()
    first, farther = (
        replace(solution, boundary_residual=replace(solution.boundary_residual, max=largest, rms=rms))
        for largest, rms in ((1e-5, 1e-5), (2e-5, 1e-6))
    )
    rest = iter([farther, solution])
    replace(first, solved_to=lambda _: next(rest)).to_nurbs()
    assert next(rest, None) is None  # both were tried


def test_a_solve_is_continued_to_the_tolerance_of_patches() -> None:
    solution = spinor_geom.solve_plateau(gallery.random_curve(26))
    missed = solution.boundary_residual
    assert missed.max > 1e-6 * missed.diagonal
    assert pickle.loads(pickle.dumps(solution)).to_nurbs(tolerance=1e-6).converged


def test_a_solve_that_is_continued_leaves_half_of_the_time_for_the_patches() -> None:
    left = []

    def solved_to(tolerance: float) -> PlateauSolution:
        left.append(seconds_left())
        raise OutOfTimeError

    solution = replace(spinor_geom.solve_plateau(gallery.random_curve(26)), solved_to=solved_to)
    surface = solution.to_nurbs(time_limit=1000)
    assert 400 < left[0] <= 500
    assert "the rims are moved by the boundary residual" in surface.reason


def test_surfaces_far_from_their_curve_are_reported() -> None:
    loop = BoundaryLoop.from_points(gallery.random_curve(0).sample(60).points, corners=())
    solution = spinor_geom.solve_plateau(loop, max_iterations=1)  # 2e-3 of the diagonal from its curve
    assert not solution.converged
    surface = solution.to_nurbs(tolerance=1e-3)
    assert not surface.converged
    assert "the rims are moved by the boundary residual" in surface.reason
    assert solution.to_nurbs(tolerance=1e-2).converged


@pytest.mark.parametrize("points", [4, 30])
def test_refinement_ends_at_the_rounding_of_coordinates(points: int) -> None:
    solution = spinor_geom.solve_plateau(circle(points, bend=0.3) + 5e11)
    nurbs = solution.to_nurbs(tolerance=1e-4)
    assert not nurbs.converged
    assert "coordinates of 5e+11 are rounded" in nurbs.reason
    assert nurbs.size < 5000


def test_surfaces_an_edge_off_their_curve_are_refused_at_once() -> None:
    solution = SMOOTH["seam"]()
    far = replace(solution.boundary_residual, rms=solution.loop.mean_edge_length)
    solution = replace(solution, boundary_residual=far, solved_to=None)
    with pytest.raises(DomainError, match="smooth the curve"):
        solution.to_nurbs(tolerance=1e-4)


def test_bad_tolerances_and_suffixes_are_errors(tmp_path: Path) -> None:
    solution = SMOOTH["enneper"]()
    with pytest.raises(OptionError, match="tolerance"):
        nurbs_surface(solution, 0.0)
    with pytest.raises(CadFileError, match=r"\.dxf"):
        solution.save(tmp_path / "film.dxf")


@pytest.mark.parametrize("suffix", [".step", ".igs", ".brep"])
def test_files_are_valid_shells_with_free_edges_at_the_rim(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("OCP")
    from spinor_geom.adapters.open_cascade import read_shape

    solution = SMOOTH["seam"]()
    surface = solution.save(tmp_path / f"film{suffix}")
    shape = read_shape(tmp_path / f"film{suffix}")
    assert is_valid(shape)
    assert (count(shape, "shell"), count(shape, "face")) == (1, len(surface.patches))
    assert free_wires(shape) == (1, 0, 4)
    assert abs(area_of(shape) / SEAM_AREA - 1) < 1e-7
    diagonal = surface.deviations.diagonal
    given = gallery.tennis_seam(0.8).point(np.arange(40) / 40)
    assert distances(free_boundary(shape), given).max() < 1e-7 * diagonal
    inside = solution.surface.position(0.8 * np.exp(2j * np.pi * np.arange(12) / 12))
    assert distances(shape, inside).max() < 1e-6 * diagonal


def test_films_between_rims_are_closed_along_their_seams(tmp_path: Path) -> None:
    pytest.importorskip("OCP")
    from spinor_geom.adapters.open_cascade import read_shape

    for solution, rims in ((SMOOTH["catenoid"](), 2), (three_circles(), 3)):
        surface = solution.save(tmp_path / "film.step")
        shape = read_shape(tmp_path / "film.step")
        assert is_valid(shape)
        assert count(shape, "shell") == 1
        assert free_wires(shape) == (rims, 0, sum(map(len, surface.rims)))
        assert abs(area_of(shape) / solution.area - 1) < 1e-7


@pytest.mark.slow
def test_a_frame_over_masts_keeps_its_corners() -> None:
    square, places = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]), ((5, 5), (-5, 5))
    rims = [polygon(10 * square, 8), *(sampled(ring(2.5, 2.0, centre=place), 32) for place in places)]
    solution = spinor_geom.solve_plateau(rims, tolerance=1e-6)
    assert solution.converged
    surface = solution.to_nurbs()
    assert surface.converged
    assert len(surface.patches) < 50  # not the hundreds of an Ω that is divided into triangles first
    assert surface.deviations.surface < 1e-6 * surface.deviations.diagonal
    assert surface.deviations.normals < 0.1


def test_units_scale_the_file(tmp_path: Path) -> None:
    pytest.importorskip("OCP")
    from spinor_geom.adapters.open_cascade import read_shape

    surface = spinor_geom.solve_plateau(curves.l_shape()).to_nurbs()
    surface.save(tmp_path / "film.step", unit="in", name="skin")
    assert abs(area_of(read_shape(tmp_path / "film.step")) - 3 * 25.4**2) < 1e-9
    assert "skin" in (tmp_path / "film.step").read_text()


def test_derivatives_of_rational_patches_are_limits_of_differences() -> None:
    rng, knots = np.random.default_rng(2), np.repeat([0.0, 1.0], 4)
    net, weights = rng.normal(size=(4, 4, 3)), 1 + rng.random((4, 4))
    patch = NurbsPatch(control_points=net, weights=weights, knots=(knots, knots))
    at, h = np.array([0.3, 0.6]), 1e-5
    for orders, lower, axis in (((1, 0), (0, 0), 0), ((0, 1), (0, 0), 1), ((2, 0), (1, 0), 0), ((1, 1), (1, 0), 1)):
        ahead, back = ([at + sign * h if axis == k else at for k in (0, 1)] for sign in (1, -1))
        difference = (patch.grid(*ahead, derivatives=lower) - patch.grid(*back, derivatives=lower)) / (2 * h)
        found = patch.grid(at, at, derivatives=orders)
        assert np.abs(found - difference).max() < 1e-7 * np.abs(found).max()  # of second order in h, and rounding
