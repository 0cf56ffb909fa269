"""Checks of a solution that were not used to find it."""

import numpy as np
import pytest

from spinor_geom import BoundaryLoop, gallery
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.evidence import area_in_domain, crossing_faces
from spinor_geom.surface.array_surface import ArraySurface


@pytest.mark.parametrize("radius", [0.5, 1.0, 1.5])
def test_area_of_ennepers_disk(radius):
    known = gallery.enneper(radius)
    assert area_in_domain(known.surface) == pytest.approx(known.area, rel=1e-9)


def test_area_of_a_domain_with_corners():
    known = gallery.helicoid(1.0, 1.0)
    assert area_in_domain(known.surface) == pytest.approx(known.area, rel=1e-6)


def test_both_areas_of_a_solution_agree():
    solution = solve_plateau(gallery.ellipse(8.0, 0.3).sample(100), tolerance=1e-6)
    assert solution.area_in_domain == pytest.approx(solution.area, rel=1e-7)
    assert solution.self_intersections == 0


def test_an_area_is_not_negative_where_the_rim_is_not_resolved(monkeypatch):
    square = np.array([[0.0, 0, 0], [1, 0, 1], [1, 1, 0], [0, 1, 1]])
    monkeypatch.setattr(ArraySurface, "area", lambda self: -1e-6)
    solution = solve_plateau(square, model="cauchy")
    assert solution.area == solution.area_in_domain > 1


def test_disk_over_a_knot_crosses_itself():
    t = 2 * np.pi * np.arange(60) / 60
    knot = np.column_stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)])
    found = solve_plateau(BoundaryLoop.from_points(knot, corners=()), tolerance=1e-2, model="cauchy", unstable="keep")
    assert found.self_intersections > 0
    assert found.to_dict()["self_intersections"] == found.self_intersections


def test_plane_triangles_do_not_cross():
    assert crossing_faces(gallery.plane_disk().surface) == 0


def test_nothing_is_known_of_crossings_where_positions_are_not_finite():
    surface = gallery.plane_disk().surface
    assert crossing_faces(surface.placed(1.0, [np.nan] * 3)) is None
