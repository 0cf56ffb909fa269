"""Patches over ragged rims of steep walls do not touch the walls."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import numpy as np
import pytest

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.ragged import BALLS, bowl, cut_tube, reported_bowl
from spinor_geom.fill.fairing import SMALLEST_ANGLE
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.topology import HalfEdges
from tests.fill.shapes import circle, tube
from tests.fill.sheets import round_sheet
from tests.fill.test_border_families import VESSELS
from tests.systems import every_second

STEEP = [
    *(bowl(opening, ball, seed=seed) for seed, (opening, ball) in enumerate(zip((50, 60, 70, 80), BALLS, strict=True))),
    bowl(80, "icosphere-4", noise=0.005, seed=4),
    bowl(60, "uv-sphere-32", noise=0.01, seed=5),
    cut_tube(0.0, 16),
    cut_tube(18, 32, seed=10),
]
# noise folds the short edges at the poles of UV spheres; moved alone, patches over these rims cross the mesh
NOISY = [reported_bowl(k) for k in (14, 23, 34)]
# bowls whose continuations had angles of less than 10°
THIN = [reported_bowl(k) for k in (0, 7)]


@cache
def filled(hole: Hole, continuity: Literal["C0", "C1"]) -> Any:
    every = list(range(len(hole.loops)))
    return fill_hole((hole.vertices, hole.faces), every, continuity=continuity, return_report=True)


@pytest.mark.parametrize("continuity", ["C0", "C1"])
@pytest.mark.parametrize("hole", [*every_second(STEEP), *every_second(NOISY)], ids=lambda hole: hole.name)
def test_no_patch_crosses_a_steep_or_noisy_wall(hole: Hole, continuity: Literal["C0", "C1"]) -> None:
    (vertices, faces), report = filled(hole, continuity)
    assert report.watertight
    assert report.intersection_free
    np.testing.assert_array_equal(vertices[: len(hole.vertices)], hole.vertices)
    np.testing.assert_array_equal(faces[: len(hole.faces)], hole.faces)
    # counted anew, not as reported
    patches = faces[len(hole.faces) :]
    assert not len(self_intersections(vertices, patches))
    assert not len(intersections_between(vertices, patches, hole.vertices, hole.faces))
    assert (HalfEdges.of(faces).counts == 2).all()
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)


@pytest.mark.parametrize("hole", THIN, ids=lambda hole: hole.name)
def test_angles_are_increased_without_new_intersections(hole: Hole) -> None:
    (outcome,) = filled(hole, "C1")[1].loops
    assert outcome.intersections == 0
    angles = outcome.patch.angles
    assert angles.smallest_free >= SMALLEST_ANGLE
    assert outcome.continuation.smallest_angle == pytest.approx(min(angles.at_rim, angles.smallest_free), rel=1e-8)


@pytest.mark.parametrize("hole", every_second(STEEP), ids=lambda hole: hole.name)
def test_the_report_has_the_distance_from_the_exact_surface(hole: Hole) -> None:
    _, report = filled(hole, "C0")
    for outcome in report.loops:
        assert outcome.to_dict()["displacement"] == outcome.displacement
        assert 0 <= outcome.displacement <= outcome.loop.mean_edge_length
        # moves alone are enough beside these rims
        assert outcome.faces_replaced == 0


@pytest.mark.parametrize("number", [19, 43])
def test_no_vertex_is_moved_farther_than_an_edge(number: int) -> None:
    # the mesh crosses itself at these rims, so that no number of moves is enough; they led 2 and 9 edges away
    hole = reported_bowl(number)
    _, report = fill_hole((hole.vertices, hole.faces), 0, return_report=True)
    (outcome,) = report.loops
    assert outcome.intersections > 0
    assert outcome.displacement <= outcome.loop.mean_edge_length


@pytest.mark.parametrize("name", ["oval ellipsoid", "oblique paraboloid"])
def test_a_patch_that_crosses_nothing_is_not_moved(name: str) -> None:
    _, report = fill_hole(round_sheet(VESSELS[name], ragged=False), 0, return_report=True)
    outcome = report.loops[0]
    assert outcome.intersections == 0
    assert outcome.displacement == 0
    surface, patch = outcome.solution.surface, outcome.patch
    inner = patch.points[patch.boundary_size :]
    # the accuracy of Cauchy's formula in `positions_inside`
    np.testing.assert_allclose(patch.vertices[patch.boundary_size :], surface.positions_inside(inner)[0], atol=1e-10)


def test_where_the_moves_change_the_area_the_note_says_so() -> None:
    # over the outer border of a wavy sheet, whose inner one is a zigzag, the film passes through the sheet
    rings = [circle(40, radius, -0.2 * radius, bend=0.3 * radius) for radius in np.linspace(1, 1.45, 4)]
    rings[0][:, 2] += np.tile([0.1, -0.1], 20)
    _, report = fill_hole((np.concatenate(rings), tube(40, 4)[1]), 1, return_report=True)
    (note,) = (note for note in report.loops[1].notes if "the area of the surface is" in note)
    assert "vertices were moved off the surface" in note
