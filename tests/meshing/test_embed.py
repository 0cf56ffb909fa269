from pathlib import Path

import numpy as np
import pytest

from spinor_geom import gallery, read_mesh, solve_plateau
from spinor_geom.deadline import time_limit
from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import CadFileError, DomainError, OptionError
from spinor_geom.measures import discrete_mean_curvature, smallest_angles
from spinor_geom.mesh.intersections import self_intersections
from spinor_geom.meshing.embed import Patch, mesh_over_points, mesh_patch, over_domain_of_angles
from tests.exact_solutions import ENNEPER, PLANE, exact_solution
from tests.sizes import constant_size


def check_is_a_patch(patch, solution):
    """A disk over the loop: boundary bit-equal and in order, every face once and on the surface's own side."""
    m, n, loop = patch.boundary_size, len(patch.vertices), solution.loop
    assert m == len(loop)
    assert np.array_equal(patch.vertices[:m], loop.points)
    assert len(patch.faces) == 2 * n - 2 - m
    half = patch.faces.ravel() * n + np.roll(patch.faces, -1, axis=1).ravel()
    assert len(np.unique(half)) == len(half)
    boundary = np.setdiff1d(half, (half % n) * n + half // n)
    assert np.array_equal(np.sort(boundary), np.sort(np.arange(m) * n + (np.arange(m) + 1) % m))
    corners = patch.vertices[patch.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    exact = solution.surface.normal(patch.points[patch.faces].mean(axis=1))
    assert ((normal * exact).sum(axis=1) > 0).all()


def test_refinement_leaves_time_for_the_positions_of_its_points(monkeypatch):
    given = []

    def kept(*arguments, seconds, **more):
        given.append(seconds)
        return triangulate_polygon(*arguments, seconds=seconds, **more)

    monkeypatch.setattr("spinor_geom.meshing.triangulate.triangulate_polygon", kept)
    with time_limit(1000):
        mesh_patch(exact_solution(ENNEPER, 33))
    assert 0 < given[0] < 500


@pytest.mark.parametrize("vertices", [8, 33, 100, 230])
def test_enneper_patch_is_a_good_mesh_on_the_surface(vertices):
    solution = exact_solution(ENNEPER, vertices)
    patch = mesh_patch(solution)
    check_is_a_patch(patch, solution)
    # 1e-12: round-off of an integral over up to a hundred edges
    inner = patch.vertices[vertices:]
    assert inner == pytest.approx(solution.surface.position(patch.points[vertices:]).reshape(-1, 3), abs=1e-12)
    smallest = smallest_angles(patch.vertices, patch.faces)
    assert smallest.min() > 20
    assert np.percentile(smallest, 1) > 30
    assert len(self_intersections(patch.vertices, patch.faces)) == 0


def test_relaxed_mesh_has_no_discrete_mean_curvature_and_stays_by_the_surface():
    solution = exact_solution(ENNEPER, 64, radius=0.8)
    patch = mesh_patch(solution)
    relaxed = patch.relaxed()
    assert relaxed.converged
    assert np.array_equal(relaxed.faces, patch.faces)
    assert relaxed.vertices[:64].tobytes() == solution.loop.points.tobytes()
    before, after = (discrete_mean_curvature(mesh.vertices, mesh.faces) for mesh in (patch, relaxed))
    assert after.rms < 1e-4 * before.rms
    # 2.5 % was measured: the chords of the rim move the discrete surface, and not the exact one
    moved = np.linalg.norm(relaxed.vertices - patch.vertices, axis=1)
    assert moved.max() < 0.05 * solution.loop.mean_edge_length
    angles = [smallest_angles(mesh.vertices, mesh.faces).min() for mesh in (patch, relaxed)]
    assert angles[1] == pytest.approx(angles[0], abs=1)


def test_patch_area_converges_to_the_exact_area_at_order_two():
    counts = np.array([30, 60, 120])
    error = []
    for count in counts:
        solution = exact_solution(ENNEPER, int(count))
        error.append(1 - mesh_patch(solution).area / (7 * np.pi / 3))
    assert np.polyfit(np.log(counts), np.log(error), 1)[0] == pytest.approx(-2, abs=0.3)


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0])
def test_inner_edges_are_as_long_as_asked_for(share):
    solution = exact_solution(ENNEPER, 80)
    target = share * solution.loop.mean_edge_length
    patch = mesh_over_points(solution, target)
    check_is_a_patch(patch, solution)
    faces = patch.faces[(patch.faces >= 80).all(axis=1)]
    # well away from the rim, where the edges are the loop's own
    faces = faces[np.abs(patch.points[faces]).max(axis=1) < 0.6]
    corners = patch.vertices[faces]
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.median(length) == pytest.approx(target, rel=0.2)
    assert length.max() < 1.7 * target


def test_plane_patch_has_the_polygon_s_area():
    patch = mesh_patch(exact_solution(PLANE, 40))
    assert patch.area == pytest.approx(20 * np.sin(2 * np.pi / 40), rel=1e-13)


def test_loop_points_that_cross_in_the_domain_are_refused():
    solution = exact_solution(PLANE, 8)
    crossed = np.exp(2j * np.pi * np.array([0, 2, 1, 3, 4, 5, 6, 7]) / 8)
    object.__setattr__(solution.rims[0], "points_in_domain", lambda: crossed)
    with pytest.raises(DomainError):
        mesh_patch(solution)


def test_a_domain_has_the_given_angles() -> None:
    # a square's rim over a domain whose corners are its own, though the patch is bent
    side = np.arange(8) / 8
    square = np.concatenate([side, 1 + 1j * side, 1 + 1j - side, 1j - 1j * side])
    plane = triangulate_polygon(square, constant_size(0.12))
    height = 0.3 * plane.points.real * (1 - plane.points.real)
    vertices = np.column_stack([plane.points.real, plane.points.imag, height])
    patch = Patch(vertices=vertices, faces=plane.faces, boundary_size=32, points=plane.points)
    angles = np.full(32, np.pi)
    angles[::8] = np.pi / 2
    new = over_domain_of_angles(patch, angles, EdgeLengths(0.12))
    assert (new.vertices[:32] == vertices[:32]).all()
    ring = new.points[:32]
    turn = np.angle((np.roll(ring, -1) - ring) / (ring - np.roll(ring, 1)))
    np.testing.assert_allclose(np.pi - turn, angles, atol=1e-9)
    assert (new.vertices[32:, 2] < 0.08).all()


@pytest.mark.parametrize("is_formula", [True, False])
def test_rims_of_known_curves_are_divided(is_formula: bool) -> None:
    curve = gallery.tennis_seam(0.75)
    known = solve_plateau(curve if is_formula else curve.sample(64))
    auto, fine = (mesh_patch(known, length) for length in ("auto", 0.05))
    assert auto.boundary_size == len(known.loop) < fine.boundary_size
    # the error of an inscribed mesh is quadratic in its edges, and the rim's edges are halved twice at least
    assert abs(fine.area - known.area) < abs(auto.area - known.area) / 8
    at = {tuple(point) for point in fine.vertices[: fine.boundary_size].tolist()}
    assert {tuple(point) for point in known.loop.points.tolist()} <= at


def test_a_patch_is_written_in_every_format(tmp_path: Path) -> None:
    solution = solve_plateau(gallery.tennis_seam(0.75))
    patch = mesh_patch(solution)
    for suffix in (".obj", ".ply", ".stl", ".glb"):
        patch.write(tmp_path / f"patch{suffix}")
        saved = solution.save(tmp_path / f"saved{suffix}")
        assert isinstance(saved, Patch)
        for name in ("patch", "saved"):
            read = read_mesh(tmp_path / f"{name}{suffix}").mesh
            assert (len(read.vertices), len(read.faces)) == (len(patch.vertices), len(patch.faces))
    for path, options in (("a.stl", {"unit": "cm"}), ("a.step", {"target_edge_length": 0.1})):
        with pytest.raises(OptionError, match="remove"):
            solution.save(tmp_path / path, **options)
    with pytest.raises(CadFileError, match="stl"):
        solution.save(tmp_path / "a.txt")
