"""Long edges: their detection, smooth curves that do not oscillate over them, and the points inserted on them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.spacing import are_long, edge_lengths, graded_spacing, with_long_edges_divided
from tests.long_edges import FLAT, polygon_area
from tests.strategies import SEEDS


def circle_of(edges: np.ndarray) -> np.ndarray:
    """Points of the unit circle whose arcs have given proportions."""
    t = 2 * np.pi * np.cumsum(edges) / edges.sum()
    return np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)


def area_within(curve: BoundaryCurve) -> float:
    """Area inside a plane curve, by many points."""
    share = np.arange(32) / 32
    return polygon_area(curve.point((curve.breaks[:-1, None] + np.diff(curve.breaks)[:, None] * share).ravel()))


@pytest.mark.parametrize("name", FLAT)
def test_curves_hardly_leave_long_edges(name: str) -> None:
    """The polygon is what is known; between short edges a curve may gain some per cent."""
    points = FLAT[name]
    curve = BoundaryCurve.from_loop(BoundaryLoop.from_points(points))
    assert 0.98 < area_within(curve) / polygon_area(points) < 1.05


@pytest.mark.parametrize("name", [name for name in FLAT if "half disk" in name or "stadium" in name])
def test_curves_without_corners_do_not_swing_over_long_edges(name: str) -> None:
    """Without corners, by option, the curve is the cubic spline, which bends least."""
    points = FLAT[name]
    curve = BoundaryCurve.from_loop(BoundaryLoop.from_points(points, corners=()))
    # a half circle's tangents at the ends of a side stand across it: that swings out by half of its length
    assert curve.bulge() < 0.6 * edge_lengths(points).max()


@given(seed=SEEDS, n=st.integers(16, 200))
def test_jittered_and_graded_curves_have_no_long_edges(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    jittered = random.uniform(0.5, 1.5, n)
    # from 1 to 1,000 and back
    ratio = 1000 ** (2 / n)
    graded = ratio ** np.minimum(np.arange(n), np.arange(n)[::-1]) * random.uniform(0.95, 1.05, n)
    for edges in (jittered, graded) if ratio < 1.7 else (jittered,):
        assert not are_long(circle_of(edges)).any()
    # few edges that are short do not make the others long
    slivers = np.ones(n)
    slivers[random.integers(n)] = 1e-6
    slivers[: n // 3] = 1e-3
    assert not are_long(circle_of(slivers)).any()


@given(seed=SEEDS)
def test_unevenly_sampled_smooth_curves_keep_their_order(seed: int) -> None:
    """Their edges differ by up to nine times: 200 points show a curve of length to 1e-6, as cubic splines do not."""
    known = gallery.tennis_seam(0.4)
    curve = BoundaryCurve.from_loop(gallery.unevenly_sampled(known, 200, seed=seed))
    assert curve.kind != "cubic"
    assert abs(curve.length() / BoundaryCurve.from_formula(known).length() - 1) < 1e-6


@given(seed=SEEDS, scale=st.sampled_from([1e-6, 1.0, 1e6]))
def test_spacing_scales_with_size_and_ignores_start_and_direction(seed: int, scale: float) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(size=(30, 3)) * 10 ** random.uniform(-3, 0, (30, 1))
    spacing = graded_spacing(edge_lengths(points))
    length = edge_lengths(points)
    longest_of_three = np.max([np.roll(length, k) for k in (-1, 0, 1)], axis=0)
    assert (spacing <= np.maximum(longest_of_three, 2 * np.median(length))).all()
    # it may double from an edge to the next
    assert (spacing <= 2 * np.roll(spacing, 1) * (1 + 1e-15)).all()
    # rounding of coordinates of size 1
    np.testing.assert_allclose(graded_spacing(edge_lengths(scale * points)), scale * spacing, rtol=1e-9)
    np.testing.assert_array_equal(graded_spacing(edge_lengths(np.roll(points, 7, axis=0))), np.roll(spacing, 7))
    np.testing.assert_allclose(graded_spacing(edge_lengths(points[::-1])), np.roll(spacing[::-1], -1), rtol=1e-9)


@pytest.mark.parametrize("name", FLAT)
def test_points_on_long_edges_leave_the_loop_as_it_is(name: str) -> None:
    points = FLAT[name]
    divided, are_own = with_long_edges_divided(points)
    np.testing.assert_array_equal(divided[are_own], points)
    assert abs(edge_lengths(divided).sum() / edge_lengths(points).sum() - 1) < 1e-12
    assert abs(polygon_area(divided) / polygon_area(points) - 1) < 1e-9
    assert edge_lengths(divided).min() > 0.5 * edge_lengths(points).min()
    long = are_long(points)
    parts = np.diff(np.append(np.flatnonzero(are_own), len(divided)))
    assert (parts[~long] == 1).all()
    # but for those that have long ones at both ends
    assert (parts[long & ~(np.roll(long, 1) & np.roll(long, -1))] > 1).all()
    # a number of parts that grows with the logarithm of the ratio: three for each doubling at both ends
    assert parts.max() <= 3 * np.log2(edge_lengths(points).max() / edge_lengths(points).min())


@given(seed=SEEDS, spread=st.sampled_from([0.1, 0.6, 2.0]), several=st.booleans())
def test_long_edges_are_those_that_exceed_their_graded_spacing(seed: int, spread: float, several: bool) -> None:
    """Polygons whose edges hardly differ are recognised without the spacing."""
    rng = np.random.default_rng(seed)
    points = np.stack([circle_of(np.exp(rng.normal(scale=spread, size=12))) for _ in range(1 + 2 * several)])
    assert np.array_equal(are_long(points), edge_lengths(points) > graded_spacing(edge_lengths(points)))
