"""Loops with long edges, whose chords cross in Ω: the patch's boundary is still the loop."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import self_intersections
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.embed import mesh_over_points, mesh_patch
from spinor_geom.meshing.split_edges import edges_far_from_arcs
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from tests.fill.shapes import circle

POINTS = 48


@cache
def annulus() -> PlateauSolution:
    """Between a circle and a smaller one over it."""
    return solve_plateau([circle(POINTS), circle(POINTS, 0.6, 0.3)])


def through_some(solution: PlateauSolution, kept: list[np.ndarray]) -> PlateauSolution:
    """The same surface over loops of some of its loops' points: edges are long where points are left out."""
    rims = []
    for rim, some in zip(solution.rims, kept, strict=True):
        loop = BoundaryLoop.from_points(rim.loop.points[some])
        curve = replace(rim.curve, at_points=some)
        rims.append(RimMatch(loop=loop, curve=curve, boundary=rim.boundary, matching=rim.matching))
    return replace(solution, rims=tuple(rims))


def with_gap(seed: int) -> np.ndarray:
    """Which points are kept, every one, or every second or third, but for a long gap."""
    rng = np.random.default_rng(seed)
    kept = np.arange(POINTS) % rng.integers(1, 4) == 0
    kept[: rng.integers(POINTS // 4, 3 * POINTS // 4)] = False
    return np.roll(kept, rng.integers(POINTS))


@pytest.mark.parametrize("seed", range(12))
def test_boundary_is_the_loop_s_where_chords_cross(seed: int) -> None:
    solution = through_some(annulus(), [with_gap(2 * seed), with_gap(2 * seed + 1)])
    patch = mesh_over_points(solution, 0.2)
    points = np.concatenate([rim.loop.points for rim in solution.rims])
    assert patch.vertices[: len(points)].tobytes() == points.tobytes()
    half_edges = HalfEdges.of(patch.faces)
    assert (half_edges.counts <= 2).all()
    alone = half_edges.twin < 0
    rim = np.arange(len(points))
    after = np.concatenate([np.roll(part, -1) for part in np.split(rim, [patch.rims[0]])])
    ends = np.stack([half_edges.origin, half_edges.target], axis=1)[alone]
    assert np.array_equal(ends[np.argsort(ends[:, 0])], np.column_stack([rim, after]))
    # an annulus
    assert len(patch.vertices) - len(half_edges.counts) + len(patch.faces) == 0
    # no face lies on an edge of the rim: the height of those is an eighth of half an edge at least
    assert face_areas(patch.vertices, patch.faces).min() > 1e-3
    assert len(self_intersections(patch.vertices, patch.faces)) == 0
    # Γ is the circles, so the triangles beside a long edge cover a part of the circle's disk; poles in the hole would
    # make the patch larger by orders of magnitude
    assert patch.area < solution.area + np.pi * (1 + 0.6**2)


def test_signed_distances_are_computed_beside_the_rim_only(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = []
    exact = PlaneDomain.distance_outside

    def counted(self: PlaneDomain, z: np.ndarray) -> np.ndarray:
        counts.append(len(z))
        return exact(self, z)

    monkeypatch.setattr(PlaneDomain, "distance_outside", counted)
    patch = mesh_over_points(annulus(), 0.02)
    assert sum(counts) < len(patch.vertices) / 4


def test_no_chord_is_far_from_a_polygon_s_own_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ω of a rough loop is a polygon, whose patch needs no distances from ∂Ω."""
    rim = circle(40, bend=0.2)
    solution = solve_plateau(rim + 0.05 * np.random.default_rng(0).uniform(-1, 1, rim.shape))
    assert solution.route == "vertices"
    plane = PlaneTriangulation(points=mesh_patch(solution).points, faces=mesh_patch(solution).faces, boundary_size=40)
    # the general test finds none either
    assert (solution.domain.distance_outside(plane.points[40:]) <= 1e-9).all()
    monkeypatch.setattr(PlaneDomain, "distance_outside", lambda *_: pytest.fail("distances were computed"))
    assert len(edges_far_from_arcs(solution.domain, plane)) == 0


def test_matched_parameters_are_interpolated_to_themselves() -> None:
    (rim, _) = annulus().rims
    t, s = rim.matching.T
    assert np.array_equal(rim.parameters(s), t)
    # as next to them, by interpolation. Steps of 1e-9 change parameters by about as much
    assert rim.parameters(s + 1e-9) == pytest.approx(t, abs=1e-7)
