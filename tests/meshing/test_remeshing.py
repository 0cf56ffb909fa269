"""Remeshed patches: the same rims and shape, edges of the requested lengths, no thin triangles except at the rim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from spinor_geom.discrete.strip import ruled_annulus
from spinor_geom.domain.delaunay import unique_edges
from spinor_geom.domain.sizes import GRADED, EdgeLengths
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import TooManyPointsError
from spinor_geom.mesh.operators import internal_angles
from spinor_geom.mesh.topology import HalfEdges, boundary_edges
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.remeshing import remesh, remesh_region
from tests.sizes import constant_size

NONE = np.zeros((0, 2), dtype=np.int64)


def disk(count: int = 60) -> Patch:
    plane = triangulate_polygon(np.exp(2j * np.pi * np.arange(count) / count), constant_size(0.1))
    vertices = np.column_stack([plane.points.real, plane.points.imag, np.zeros(len(plane.points))])
    return Patch(vertices=vertices, faces=plane.faces, boundary_size=count, points=plane.points)


def lengths(patch: Patch) -> np.ndarray:
    edges = np.asarray(patch.faces)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = edges[(edges >= patch.boundary_size).all(axis=1)]
    return np.asarray(np.linalg.norm(patch.vertices[edges[:, 0]] - patch.vertices[edges[:, 1]], axis=1))


def test_edges_grow_with_the_distance_from_the_rim() -> None:
    fine = disk(100)
    new = remesh(fine, GRADED, NONE)
    require_same_rims(new, fine)
    edges = unique_edges(np.asarray(new.faces), len(new.vertices))
    ends = new.vertices[edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    wanted = 2 * np.pi / 100 + GRADED.growth * (1 - np.linalg.norm(ends.mean(axis=1), axis=1))
    inner = (edges >= 100).all(axis=1)
    # between those that are collapsed and those that are split
    assert np.quantile((length / wanted)[inner], [0.05, 0.95]) == pytest.approx([0.9, 1.1], abs=0.4)
    assert smallest_angle(new) > 20


@pytest.mark.parametrize("change", ["renumbered", "turned"])
def test_remeshing_does_not_depend_on_numbers_and_axes(change: str) -> None:
    rng, patch, m = np.random.default_rng(5), disk(60), 60
    height = rng.normal(scale=0.02, size=len(patch.vertices))
    vertices = np.column_stack([patch.vertices[:, :2], height])
    faces, turn = np.asarray(patch.faces), np.eye(3)
    if change == "renumbered":
        order = np.concatenate([np.arange(m), m + rng.permutation(len(vertices) - m)])
        place = np.argsort(order)
        same = replace(patch, vertices=vertices[order], faces=rng.permutation(place[faces]), points=patch.points[order])
    else:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        same = replace(patch, vertices=vertices @ turn)
    new, again = (remesh(each, GRADED, NONE) for each in (replace(patch, vertices=vertices), same))
    assert len(new.vertices) == len(again.vertices)
    distance, _ = cKDTree(new.vertices @ turn).query(again.vertices)
    assert distance.max() < 1e-9


def test_a_tiny_edge_length_is_refused() -> None:
    with pytest.raises(TooManyPointsError):
        remesh(disk(), EdgeLengths(1e-6), NONE)


def over(polygon: np.ndarray, height: float = 0.0) -> Patch:
    """A patch without inner vertices over a plane polygon, bent over a cylinder of radius 1/height."""
    plane = triangulate_polygon(polygon, constant_size(100.0))
    x = polygon.real
    z = np.cos(height * x) / height if height else 0 * x
    inner = plane.points[len(polygon) :]
    vertices = np.column_stack([plane.points.real, plane.points.imag, np.append(z, np.zeros(len(inner)))])
    return Patch.over(plane, vertices)


def smallest_angle(patch: Patch) -> float:
    return float(np.degrees(internal_angles(patch.vertices, np.asarray(patch.faces)).min()))


def require_same_rims(new: Patch, old: Patch) -> None:
    m = old.boundary_size
    assert (new.boundary_size, new.rims) == (m, old.rims)
    assert (new.vertices[:m] == old.vertices[:m]).all()
    sides = [boundary_edges(np.asarray(patch.faces)) for patch in (new, old)]
    np.testing.assert_array_equal(*(each[np.lexsort(each.T)] for each in sides))
    counts = HalfEdges.of(np.asarray(new.faces)).counts
    assert counts.max() == 2
    assert len(new.points) == len(new.vertices) == len(np.unique(new.faces))


def zigzag_tube(around: int = 32, height: float = 1.5) -> Patch:
    """Straight lines between the rims of a tube that was cut along triangles: half of its triangles have no area."""
    step = 2 * np.pi / around
    turn = step * np.repeat(np.arange(around), 2)
    # each tooth has one edge along the axis
    level = np.tile([0.0, step], around)
    low = np.column_stack([np.cos(turn), np.sin(turn), level])
    high = np.flipud(low) + np.array([0, 0, height])
    return Patch.over(*ruled_annulus(low, high, step))


def test_slivers_between_two_rims_are_replaced() -> None:
    tube = zigzag_tube()
    assert smallest_angle(tube) < 0.1
    new = remesh(tube, EdgeLengths(2 * np.pi / 32), NONE)
    require_same_rims(new, tube)
    assert smallest_angle(new) > 25
    # the chords of 32 sides are 1 − cos(π/32) = 0.005 inside the cylinder; flat triangles over several of them more
    assert np.abs(np.hypot(new.vertices[:, 0], new.vertices[:, 1]) - 1).max() < 0.02
    lengths_there = lengths(new)
    assert 0.4 < lengths_there.min() * 32 / (2 * np.pi) < lengths_there.max() * 32 / (2 * np.pi) < 1.5


def test_a_sharp_corner_of_the_rim_keeps_its_angle_and_no_other_is_small() -> None:
    # a spike of 6° on a square
    tip = np.exp(1j * np.radians([-3.0, 3.0]))
    polygon = np.array([0, tip[0], 1 - 0.3j, 1.6 - 0.3j, 1.6 + 0.3j, 1 + 0.3j, tip[1]])
    spiked = over(polygon)
    new = remesh(spiked, EdgeLengths(0.2), NONE)
    require_same_rims(new, spiked)
    faces = np.asarray(new.faces)
    angles = np.degrees(internal_angles(new.vertices, faces))
    assert angles[faces == 0] == pytest.approx(6)
    assert np.sort(angles.ravel())[1] > 10


def test_a_short_edge_of_the_rim_beside_a_long_one_leaves_no_small_angle() -> None:
    # the triangle over an edge and one of a seventh has an angle of 8°. It is cut off from the rest by a chord
    polygon = np.array([0, 1, 1 + 1j, 1j, -0.14 + 1j, -0.14]) * 1.0
    patch = over(polygon)
    assert smallest_angle(patch) < 8.1
    assert smallest_angle(remesh(patch, EdgeLengths(0.5), NONE)) > 10


@pytest.mark.parametrize("below", [0.06, 0.1, 0.15, 0.25])
@pytest.mark.parametrize("inner", [0.12 + 0.05j, 0.125 + 0.15j, 0.125 - 0.03j])
def test_a_narrow_tooth_of_the_rim_is_not_divided(inner: complex, below: float) -> None:
    # a tooth of 14°. Its halves have 7°
    points = np.array([-1j * below, 0.25 - 1j * below, 0.25, 0.1 + 1j, 0, inner])
    faces = np.array([[k, (k + 1) % 5, 5] for k in range(5)])
    vertices = np.column_stack([points.real, points.imag, 0 * points.real])
    tooth = Patch(vertices=vertices, faces=faces, boundary_size=5, points=points)
    assert smallest_angle(tooth) < 7.2
    new = remesh(tooth, GRADED, NONE)
    require_same_rims(new, tooth)
    assert smallest_angle(new) > 13


def test_taken_pairs_are_not_joined() -> None:
    square = over(np.array([0, 1, 1 + 1j, 1j]))
    chord = np.asarray(square.faces)
    (both,) = {tuple(sorted(set(chord[0]) & set(chord[1])))}
    new = remesh(square, EdgeLengths(10.0), np.array([both]))
    edges = {tuple(sorted(pair)) for face in np.asarray(new.faces) for pair in zip(face, np.roll(face, 1), strict=True)}
    assert both not in edges
    require_same_rims(new, square)


@pytest.mark.parametrize("enough", [11.0, 25.0])
def test_a_region_is_remeshed_within_its_outline(enough: float) -> None:
    flat = disk()
    faces, m = np.asarray(flat.faces), flat.boundary_size
    # one inner vertex almost on a neighbour
    inner = m + np.abs(flat.points[m:]).argmin()
    ring = faces[(faces == inner).any(axis=1)]
    vertices = flat.vertices.copy()
    vertices[inner] += 0.95 * (vertices[ring[ring != inner][0]] - vertices[inner])
    thin = replace(flat, vertices=vertices)
    assert smallest_angle(thin) < 5
    region = np.isin(faces, ring).any(axis=1)
    new, places = remesh_region(thin, region, EdgeLengths(0.1), NONE, np.radians(enough))
    require_same_rims(new, thin)
    assert smallest_angle(new) > 10
    # outside nothing is changed
    kept = np.asarray(new.faces)[places[~region]]
    np.testing.assert_array_equal(new.vertices[kept], vertices[faces[~region]])
    assert (places[region] == -1).all()
    assert new.area == pytest.approx(thin.area)  # no triangle is turned over
    np.testing.assert_allclose(new.points[m:].real, new.vertices[m:, 0], atol=0.1)


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), count=st.integers(5, 12))
def test_stars_keep_rims_area_and_scale(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.6, 1.2, count)
    turns = np.cumsum(rng.uniform(0.5, 1.5, count))
    star = over(radius * np.exp(2j * np.pi * turns / turns[-1]), height=rng.uniform(0, 1))
    new = remesh(star, EdgeLengths(0.4), NONE)
    require_same_rims(new, star)
    if not star.vertices[:, 2].any():
        assert new.area == pytest.approx(star.area)  # no triangle is turned over
    # a power of two changes no rounding
    larger = remesh(replace(star, vertices=1024 * star.vertices), EdgeLengths(1024 * 0.4), NONE)
    assert np.array_equal(larger.faces, new.faces)
    assert np.array_equal(larger.vertices, 1024 * new.vertices)
