import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.domain.sizes import SizeField
from spinor_geom.domain.triangulation import PlaneTriangulation, Seeds, triangulate_polygon
from spinor_geom.errors import DomainError, OptionError
from tests.sizes import constant_size


def polygon(corners, n):
    """The polygon with these corners, its sides divided evenly into about n edges in all."""
    c = np.asarray(corners, dtype=complex)
    side = np.abs(np.roll(c, -1) - c)
    count = np.maximum(1, np.round(n * side / side.sum())).astype(int)
    return np.concatenate([a + (b - a) * np.arange(k) / k for a, b, k in zip(c, np.roll(c, -1), count, strict=True)])


def ellipse(n, a):
    t = 2 * np.pi * np.linspace(0, 1, 20001)
    z = a * np.cos(t) + 1j * np.sin(t)
    length = np.append(0, np.cumsum(np.abs(np.diff(z))))
    return np.interp(np.arange(n) / n * length[-1], length, z)


def comb(n):
    teeth = [9 - 2 * k + d for k in range(5) for d in (4j, 4j - 1, 1j - 1, 1j - 2)][:-2]
    return polygon([0, 9, *teeth], n)


def noisy(n, a, amount):
    z, rng = ellipse(n, a), np.random.default_rng(0)
    return z + amount * np.abs(z[1] - z[0]) * (rng.normal(size=n) + 1j * rng.normal(size=n))


SQUARE = [0, 1, 1 + 1j, 1j]
POLYGONS = {
    "square 8": polygon(SQUARE, 8),
    "square 200": polygon(SQUARE, 200),
    "turned square 80": polygon(SQUARE, 80) * np.exp(0.3j),
    "hexagon": np.exp(2j * np.pi * np.arange(6) / 6),
    "circle 230": np.exp(2j * np.pi * np.arange(230) / 230),
    "ellipse 16": ellipse(200, 16),
    "strip": polygon([0, 45, 45 + 0.87j, 0.87j], 92),
    "L": polygon([0, 2, 2 + 1j, 1 + 1j, 1 + 2j, 2j], 120),
    "comb": comb(230),
    "noisy 4": noisy(100, 4, 0.2),
    "noisy 8": noisy(200, 8, 0.2),
    "triangle 48": polygon([0, 1, np.exp(1j * np.pi / 3)], 48),
}


def signed_area(z):
    return 0.5 * (np.conj(z) * np.roll(z, -1)).imag.sum()


def check_is_a_triangulation(result: PlaneTriangulation, boundary):
    """Disk topology, boundary bit-equal and unsplit, every face counter-clockwise, faces fill the polygon once."""
    m, n = len(boundary), len(result.points)
    assert result.boundary_size == m
    assert np.array_equal(result.points[:m], boundary)
    p = result.points[result.faces]
    area = 0.5 * (np.conj(p[:, 1] - p[:, 0]) * (p[:, 2] - p[:, 0])).imag
    assert (area > 0).all()
    assert area.sum() == pytest.approx(signed_area(boundary), rel=1e-12)
    assert len(result.faces) == 2 * n - 2 - m
    assert len(result.edges) == 3 * n - 3 - m
    half = result.faces.ravel() * n + np.roll(result.faces, -1, axis=1).ravel()
    assert len(np.unique(half)) == len(half)
    assert np.isin(np.arange(m) * n + (np.arange(m) + 1) % m, half).all()
    assert np.array_equal(np.unique(result.faces), np.arange(n))


@pytest.mark.parametrize("boundary", POLYGONS.values(), ids=POLYGONS)
def test_polygon_is_filled_with_good_triangles(boundary):
    result = triangulate_polygon(boundary)
    check_is_a_triangulation(result, boundary)
    assert np.percentile(result.angles.min(axis=1), 1) > 25
    assert result.angles.min() > 20


def test_edges_follow_the_size_function():
    boundary = np.exp(2j * np.pi * np.arange(200) / 200)
    samples = (np.linspace(0, 1, 60)[:, None] * np.exp(2j * np.pi * np.arange(120) / 120)).ravel()
    size = SizeField(growth=1e9, samples=samples, lengths=0.03 + 0.1 * np.abs(samples - 1), neighbours=4)
    result = triangulate_polygon(boundary, size)
    a, b = result.points[result.edges].T
    ratio = np.abs(b - a) / (0.03 + 0.1 * np.abs(0.5 * (a + b) - 1))
    inner = (result.edges >= 200).all(axis=1)
    # circumradii up to 0.75 h allow edges up to 1.5 h; refinement stops where they are about h
    assert 0.7 < np.median(ratio[inner]) < 1.1
    assert np.percentile(ratio[inner], 99) < 1.5


def test_fine_size_on_a_coarse_boundary_and_coarse_size_on_a_fine_one():
    boundary = polygon(SQUARE, 40)
    fine = triangulate_polygon(boundary, constant_size(0.01))
    check_is_a_triangulation(fine, boundary)
    coarse = triangulate_polygon(boundary, constant_size(100.0))
    check_is_a_triangulation(coarse, boundary)
    assert coarse.angles.min() > 20
    assert len(fine.points) > 5000 > 100 > len(coarse.points)


def test_number_of_points_is_limited():
    boundary = polygon(SQUARE, 40)
    result = triangulate_polygon(boundary, constant_size(1e-3), max_points=260)
    check_is_a_triangulation(result, boundary)
    assert len(result.points) <= 320
    assert not result.is_complete
    assert triangulate_polygon(boundary, constant_size(0.1), max_points=260).is_complete
    assert triangulate_polygon(np.array([0, 1, 1j]), constant_size(0.01)).is_complete  # triangles are not refined


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scale_and_place_do_not_matter(scale):
    boundary = POLYGONS["noisy 4"]
    moved = scale * (boundary + 3 - 2j)
    reference = triangulate_polygon(boundary, SizeField(growth=0.3))
    result = triangulate_polygon(moved, SizeField(growth=0.3))
    check_is_a_triangulation(result, moved)
    assert len(result.points) == pytest.approx(len(reference.points), rel=0.05)


def test_size_is_the_local_edge_at_the_boundary_and_grows():
    boundary = np.exp(2j * np.pi * np.arange(60) / 60)
    edge = abs(boundary[1] - boundary[0])
    sizes = SizeField(growth=0.5).over(boundary).sizes
    assert sizes(boundary) == pytest.approx(np.full(60, edge))
    assert sizes(np.array([0j])) == pytest.approx([edge + 0.5])


NOT_SIMPLE = [[], [0, 1], [0, 1j, 1 + 1j, 1], [0, 1 + 1j, 1, 1j, -1 + 2j], [0, 1, 1 + 1j, 0], [0, 2, 2 + 2j, 1, 2j]]
NOT_SIMPLE += [[0, 1, np.nan, 1j], [0, 1, np.inf], [0, 1, 2], np.exp(4j * np.pi * np.arange(5) / 5)]


@pytest.mark.parametrize("boundary", NOT_SIMPLE)
def test_polygon_that_is_not_simple_is_refused(boundary):
    with pytest.raises(DomainError):
        triangulate_polygon(np.array(boundary, dtype=complex), constant_size(10.0))


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf])
def test_size_that_is_not_positive_and_finite_is_refused(length):
    with pytest.raises(OptionError, match="wanted edge lengths must be"):
        constant_size(length)


def test_time_limit_ends_a_refinement():
    boundary = polygon(SQUARE, 40)
    result = triangulate_polygon(boundary, constant_size(1e-3), max_points=10**6, seconds=0.0)
    check_is_a_triangulation(result, boundary)
    assert len(result.points) < 10**5
    assert not result.is_complete


@given(st.integers(3, 30), st.integers(0, 10**6), st.floats(0.5, 3), st.floats(0.02, 0.3))
def test_seeds_outside_the_polygon_are_left_out(n, seed, reach, spacing):
    """Seeds are made for the surface's domain: chords of few points leave much of that outside."""
    rng = np.random.default_rng(seed)
    boundary = rng.uniform(0.2, 1.0, n) * np.exp(2j * np.pi * (np.arange(n) + rng.uniform(0, 0.9, n)) / n)
    across = np.arange(-reach, reach, spacing)
    seeds = (across[:, None] + 1j * across).ravel()
    result = triangulate_polygon(boundary, seeds=Seeds(seeds, np.full(len(seeds), spacing)))
    check_is_a_triangulation(result, boundary)
