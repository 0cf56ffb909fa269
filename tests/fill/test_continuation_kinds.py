"""Continuations over generated holes: convergence, no thin triangles, no new crossings, the reported area."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from spinor_geom.bench.cut_outs import named_cut_out
from spinor_geom.bench.holes import lattice
from spinor_geom.bench.ragged import reported_bowl
from spinor_geom.fill import fairing
from spinor_geom.fill.collar import Bend, bend_across, collar_of
from spinor_geom.fill.fairing import Faired
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.measures import distances_to_mesh, mesh_samples
from spinor_geom.mesh.operators import internal_angles
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from tests.fill.shapes import bowl_below, cylinder, icosphere, rounds_and_rows, without
from tests.systems import every_second

Mesh = tuple[np.ndarray, np.ndarray]


def jittered(mesh: Mesh, amount: float, rng: np.random.Generator) -> Mesh:
    """A mesh whose vertices are off by a share of the mean edge, as a standard deviation."""
    edge = trimesh.Trimesh(*mesh, process=False).edges_unique_length.mean()
    return mesh[0] + amount * edge * rng.normal(size=mesh[0].shape), mesh[1]


def bowl(noise: float, rng: np.random.Generator) -> Mesh:
    """A sphere with a hole of less than its equator, cut along its triangles in a random place."""
    vertices, faces = icosphere(3)
    turn = trimesh.transformations.random_rotation_matrix(rng.uniform(size=3))[:3, :3]
    vertices, _ = jittered((vertices @ turn.T, faces), noise, rng)
    return without((vertices, faces), vertices[faces][:, :, 2].mean(axis=1) > -np.cos(np.radians(rng.uniform(45, 85))))


def sheet(rng: np.random.Generator, *, waves: bool) -> Mesh:
    (y, x), faces = lattice(40, 40)
    x, y = x / 20 - 1, y / 20 - 1
    wide, high = rng.uniform(3, 7), rng.uniform(0.05, 0.15)
    z = high * np.sin(wide * x) * np.cos(wide * y) if waves else rng.uniform(0.3, 1.2) * (x * x - y * y)
    vertices, faces = jittered((np.stack([x, y, z], 1), faces[:, ::-1]), rng.uniform(0, 0.05), rng)
    return without((vertices, faces), np.hypot(*vertices[faces].mean(axis=1).T[:2]) < rng.uniform(0.2, 0.5))


def finger(rng: np.random.Generator) -> Mesh:
    """A stem that widens into two bulbs with a narrow neck between them, cut off beyond the neck."""
    rows = np.linspace(0.2, rng.uniform(1.7, 2.5), 40)

    def bulbs(a: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
        width = 0.8 * np.sin(t) * (1 + 0.4 * np.cos(3 * t))
        return width * np.cos(a), width * np.sin(a), -3 * np.cos(t)

    vertices, faces = rounds_and_rows(bulbs, 36, rows)
    return jittered((vertices, faces), rng.uniform(0, 0.05), rng)


def creased_box(rng: np.random.Generator) -> Mesh:
    box = trimesh.creation.box()
    for _ in range(4):
        box = box.subdivide()
    middle = rng.choice([[0.5, 0.5, 0.0], [0.5, 0.5, 0.5], [0.5, 0.0, 0.0]])
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)
    away = np.linalg.norm(vertices[faces].mean(axis=1) - middle, axis=1)
    return without((vertices, faces), away < rng.uniform(0.15, 0.4))


def capless_tube(rng: np.random.Generator) -> Mesh:
    return jittered(cylinder(40, int(rng.integers(25, 45))), rng.uniform(0, 0.1), rng)


KINDS = {
    "bowl": lambda rng: bowl(0.0, rng),
    "noisy bowl": lambda rng: bowl(rng.uniform(0, 0.1), rng),
    "saddle": lambda rng: sheet(rng, waves=False),
    "wavy sheet": lambda rng: sheet(rng, waves=True),
    "finger": finger,
    "box": creased_box,
    "tube": capless_tube,
}


def patched(mesh: Mesh, **options: float) -> tuple[LoopOutcome, LoopOutcome]:
    """The outcomes of the hole nearest to the top of a mesh, or in the middle of a sheet: continued, and a film."""
    loops = boundary_loops(mesh)
    sheets = abs(mesh[0][:, 2]).max() < 1.5 and len(loops) == 2
    place = 1 if sheets else max(range(len(loops)), key=lambda k: loops[k].centroid[2])
    smooth, film = (
        fill_hole(mesh, place, continuity=continuity, return_report=True, **options)[1].loops[place]
        for continuity in ("C1", "C0")
    )
    return smooth, film


@pytest.mark.parametrize("seed", every_second(range(2)))
@pytest.mark.parametrize("kind", KINDS)
def test_continuations_come_to_rest_without_thin_triangles(kind: str, seed: int) -> None:
    smooth, film = patched(KINDS[kind](np.random.default_rng([seed, 7])))
    continuation = smooth.continuation
    assert (smooth.kind, smooth.converged, smooth.reason) == ("smooth", True, "")
    assert continuation.next_step <= 0.01
    assert smooth.intersections <= film.intersections
    faces = np.asarray(smooth.patch.faces)
    inner = faces[(faces >= smooth.patch.boundary_size).all(axis=1)]
    assert np.degrees(internal_angles(smooth.patch.vertices, inner)).min() >= 10
    # the film's vertices may have been moved off a steep wall since, beside its rim
    assert continuation.area_ratio == pytest.approx(smooth.patch.area / film.patch.area, rel=1e-2)
    assert (continuation.area_ratio > 2) == any("times the area" in remark for remark in smooth.remarks)


@pytest.mark.parametrize("opening", [80, 60, 45])
def test_steep_bowls_are_closed_as_spheres_and_their_area_is_reported(opening: float) -> None:
    height = -np.cos(np.radians(opening))
    smooth, _ = patched(bowl_below(height))
    assert smooth.converged
    # the whole sphere's triangles and the rim's teeth: the hole has 2π(1 − height)
    # and the steepest continuations are the least exact
    assert smooth.patch.area == pytest.approx(2 * np.pi * (1 - height), rel=0.05)
    new = smooth.patch.vertices[smooth.patch.boundary_size :]
    # new triangles are as large as the rim's edges: a vertex is off by a small share of one of 0.15
    assert np.sqrt(np.mean((np.linalg.norm(new, axis=1) - 1) ** 2)) < 0.02
    assert any("times the area of the surface it started from" in shortcoming for shortcoming in smooth.shortcomings)


def test_what_does_not_come_to_rest_is_a_thin_plate_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fairing._Equations, "solved", lambda self: (self._start, 3, 0.2))
    smooth, _ = patched(bowl_below(0.7))
    continuation = smooth.continuation
    assert (continuation.order, smooth.converged) == ("thin plate", True)
    assert "0.2 of an edge" in continuation.lowered
    assert any("the patch is a thin plate, because" in shortcoming for shortcoming in smooth.shortcomings)
    entry = json.loads(json.dumps(smooth.to_dict()))["continuation"]
    assert (entry["order"], entry["lowered"]) == ("thin plate", continuation.lowered)
    assert entry["smallest_angle"] > 10
    assert entry["area_ratio"] > 1


@pytest.mark.parametrize(("angle", "is_thin"), [(7.0, True), (14.0, False)])
def test_angles_below_ten_degrees_are_reported_and_those_of_the_rim_separately(angle: float, is_thin: bool) -> None:
    # a thin triangle from a rim of four points to an inner one, and a thinner one that fills a corner of the rim
    tip = [0.5, 0.5 * np.tan(np.radians(angle)), 0.0]
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0.01, 0], [1, 0.02, 0], tip])
    points = vertices @ [1, 1j, 0]
    patch = Patch(vertices=vertices, faces=np.array([[0, 1, 4], [1, 2, 3]]), boundary_size=4, points=points)
    corner = patch.angles.at_rim
    assert patch.angles.smallest_free == pytest.approx(angle)
    assert corner == pytest.approx(np.degrees(internal_angles(vertices, np.array([[1, 2, 3]]))[0, 1]))
    assert corner < 2
    assert Faired(patch=patch, steps=0, next_step=0.0, stretch=1.0).is_thin == is_thin
    (smooth, _) = patched(KINDS["saddle"](np.random.default_rng(0)))
    continuation = smooth.continuation.with_angles_of(patch)
    assert continuation.smallest_angle == continuation.smallest_rim_angle == corner
    assert any("between two edges of the rim" in remark for remark in continuation.remarks)
    continuation = replace(continuation, smallest_angle=patch.angles.smallest_free)
    assert any("smallest angle" in remark for remark in continuation.remarks) == is_thin


@pytest.mark.parametrize(("bend", "is_reported"), [(1.1, True), (0.9, False)])
def test_a_patch_that_bends_more_than_the_mesh_around_reports_it(bend: float, is_reported: bool) -> None:
    (smooth, _) = patched(KINDS["saddle"](np.random.default_rng(0)))
    continuation = smooth.continuation
    # a smooth saddle bends in the hole as around it
    inside, around = continuation.inside, continuation.around
    assert 0.5 * around.rms < inside.rms * around.edge / inside.edge < 1.5 * around.rms
    bent = replace(continuation, inside=Bend(largest=90.0, rms=bend * (2 * around.rms + 1), edge=around.edge))
    assert any("from face to face" in remark for remark in bent.remarks) == is_reported


def test_a_wide_band_between_two_rims_has_no_slivers() -> None:
    band = named_cut_out("cylinder-band-wide")
    mesh, places = (band.hole.vertices, band.hole.faces), band.hole.rim_indices
    report = fill_hole(mesh, bridge=places, continuity="C1", return_report=True)[1]
    (smooth,) = (outcome for outcome in report.loops if outcome.patch is not None)
    assert (smooth.kind, smooth.converged, smooth.intersections) == ("smooth", True, 0)
    assert smooth.continuation.started_from == "strip"
    assert smooth.continuation.smallest_angle > 25
    # slivers were off by 0.0017, edges of up to a fifth of the radius of curvature by 3e-4
    assert np.sqrt(np.mean(band.distances(smooth.patch.vertices) ** 2)) < 2e-4 * band.diameter


@pytest.mark.parametrize("number", [30, *(pytest.param(k, marks=pytest.mark.slow) for k in (7, 20))])
def test_steep_ragged_bowls_have_no_smaller_angles_than_their_rims(number: int) -> None:
    # no flattening of these shapes without turned triangles is found
    hole = reported_bowl(number)
    report = fill_hole((hole.vertices, hole.faces), continuity="C1", return_report=True)[1]
    (smooth,) = (outcome for outcome in report.loops if outcome.filled)
    continuation = smooth.continuation
    assert continuation.converged
    # measured in the frame of the loop
    angles = smooth.patch.angles
    assert min(angles.at_rim, angles.smallest_free) == pytest.approx(continuation.smallest_angle, rel=1e-8)
    assert continuation.smallest_angle >= min(10, continuation.smallest_rim_angle or np.inf)


@pytest.mark.parametrize("number", [10, 15])
def test_the_bend_across_the_rim_is_that_of_a_patch_moved_off_the_mesh(number: int) -> None:
    hole = reported_bowl(number)
    mesh = hole.vertices, hole.faces
    (smooth,) = (outcome for outcome in fill_hole(mesh, continuity="C1", return_report=True)[1].loops if outcome.filled)
    assert smooth.displacement
    collar = collar_of(PatchedMesh(TriangleMesh(*mesh)), smooth.loop.vertex_ids, smooth.patch)
    assert smooth.continuation.after.rms == pytest.approx(bend_across(collar, smooth.patch).rms, rel=1e-6)


@pytest.mark.parametrize("subdivisions", [1, 2, 3])
def test_a_repeated_position_on_the_rim_raises_no_untyped_error(subdivisions: int) -> None:
    mesh = bowl_below(0.2, subdivisions)
    rim = boundary_loops(mesh)[0].vertex_ids
    # a triangle without area lies at the rim: its angles are no numbers
    mesh[0][rim[0]] = mesh[0][rim[1]]
    (outcome,) = fill_hole(mesh, continuity="C1", return_report=True)[1].loops
    assert outcome.filled


def mirrored_sheet(rng: np.random.Generator) -> Mesh:
    """A wavy sheet with noise and a hole, symmetric in x with its triangles."""
    n = 16
    (y, x), faces = lattice(2 * n, n)
    x, y = x / n, y / n - 1
    wave = rng.uniform(0, 0.3) * np.cos(5 * x) * np.sin(3 * y + 1)
    half = np.stack([x, y, wave + 0.5 * x**2 + rng.uniform(0, 0.003) * rng.normal(size=len(x))], axis=1)
    image = np.where(x == 0, np.arange(len(x)), len(x) + np.arange(len(x)))
    both = np.concatenate([half, half * [-1, 1, 1]]), np.concatenate([faces[:, ::-1], image[faces]])
    wide, high = rng.uniform(0.2, 0.6, 2)
    centres = both[0][both[1]].mean(axis=1)
    return without(both, np.hypot(centres[:, 0] / wide, centres[:, 1] / high) < 1)


@pytest.mark.parametrize("seed", every_second([0, 1, 178, 58, 75, 140, 1018, 12]))
def test_mirror_symmetric_rims_get_symmetric_patches(seed: int) -> None:
    mesh = mirrored_sheet(np.random.default_rng([seed, 3]))
    outcome = fill_hole(mesh, 1, continuity="C1", return_report=True)[1].loops[1]
    assert (outcome.kind, outcome.converged) == ("smooth", True)
    patch = outcome.patch
    samples = mesh_samples(patch.vertices, np.asarray(patch.faces), 2000)
    away = distances_to_mesh(samples.points * [-1, 1, 1], patch.vertices, np.asarray(patch.faces))
    # the triangles are not symmetric: where the surface is curved, their middles are off it
    assert np.sqrt(np.average(away**2, weights=samples.areas)) < 1e-3 * outcome.loop.diagonal
