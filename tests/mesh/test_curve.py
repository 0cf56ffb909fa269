"""BoundaryCurve: interpolation, smoothness, choice of degree, convergence, corners, means, nearest point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly
from scipy.spatial import cKDTree

from spinor_geom import gallery
from spinor_geom.errors import RepeatedPointError
from spinor_geom.mesh import interpolation as rules
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from tests.fill.shapes import circle
from tests.strategies import SEEDS, RigidMotion, rigid_motions, rough_loops, smooth_loops

L_SHAPE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]])


def curve_of(points: np.ndarray, corners: list[int] | None = None) -> BoundaryCurve:
    return BoundaryCurve.from_loop(BoundaryLoop.from_points(points, corners="auto" if corners is None else corners))


def wave(count: int, uneven: float = 0.0) -> np.ndarray:
    """Points of a curve without symmetry. `uneven` is the relative change of their distances."""
    t = 2 * np.pi * np.arange(count) / count
    return wave_point(t + uneven * np.sin(t + 1))


def circle_at(t: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=-1)


def wave_point(t: np.ndarray) -> np.ndarray:
    return np.stack([2 * np.cos(t), np.sin(t) + 0.2 * np.cos(2 * t), 0.4 * np.sin(2 * t + 1)], axis=-1)


def distance_to_wave(points: np.ndarray) -> np.ndarray:
    """Distance from the curve of `wave`, by Newton's method from the nearest of many of its points."""
    many = 2 * np.pi * np.arange(5000) / 5000
    t = many[cKDTree(wave_point(many)).query(points)[1]]
    for _ in range(4):
        slope = np.stack([-2 * np.sin(t), np.cos(t) - 0.4 * np.sin(2 * t), 0.8 * np.cos(2 * t + 1)], axis=-1)
        t = t + ((points - wave_point(t)) * slope).sum(axis=1) / (slope**2).sum(axis=1)
    return np.linalg.norm(points - wave_point(t), axis=1)


def force_degree(degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the curve of any points a spline of a given degree."""
    splines_only(monkeypatch)
    monkeypatch.setattr(rules, "DEGREES", tuple(range(3, degree + 1, 2)))
    monkeypatch.setattr(rules, "GAIN_PER_DEGREE", 1e-12)


def splines_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "MOST_UNEVEN", 0.0)


def jump(curve: BoundaryCurve, order: int, at: np.ndarray) -> np.ndarray:
    """Change of a derivative across the breaks at given indices, from the polynomial pieces themselves."""
    coefficients = PPoly(curve.coefficients, curve.breaks).derivative(order).c
    width = np.diff(curve.breaks)[:, None]
    end = np.zeros_like(coefficients[0])
    for row in coefficients:
        end = end * width + row
    return np.linalg.norm(coefficients[-1][at] - end[at - 1], axis=1)


class TestInterpolation:
    @given(points=rough_loops(), corners=st.lists(st.integers(0, 23), max_size=5))
    def test_passes_through_the_vertices_to_the_last_bit(self, points: np.ndarray, corners: list[int]) -> None:
        curve = curve_of(points, corners)
        np.testing.assert_array_equal(curve.point(curve.breaks[:-1]), points)
        np.testing.assert_allclose(curve.point(np.nextafter(curve.breaks[1:], 0)), np.roll(points, -1, 0), atol=1e-12)

    @pytest.mark.parametrize("degree", [3, 5, 7])
    def test_derivatives_below_the_degree_are_continuous(self, degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
        force_degree(degree, monkeypatch)
        curve = curve_of(wave(60, 0.3), [])
        assert curve.degree == degree
        for order in range(1, degree):
            # each derivative costs the digits of one division by the width of a piece, 1/60 and less
            size = np.abs(PPoly(curve.coefficients, curve.breaks).derivative(order).c[-1]).max()
            assert jump(curve, order, np.arange(60)).max() < 1e-12 * 10**order * size
        size = np.abs(PPoly(curve.coefficients, curve.breaks).derivative(degree).c[-1]).max()
        assert jump(curve, degree, np.arange(60)).max() > 1e-3 * size

    def test_curves_made_together_are_those_of_their_loops_to_the_last_bit(self) -> None:
        # analytic, splines of each degree, corners
        points = [wave(60, 0.3), *(folded(seed, np.arange(24) / 24) for seed in range(4)), L_SHAPE, circle(7)]
        points += [part + np.random.default_rng(0).normal(size=part.shape, scale=1e-2) for part in points]
        loops = [BoundaryLoop.from_points(part) for part in points]
        for loop, curve in zip(loops, BoundaryCurve.from_loops(loops), strict=True):
            alone = BoundaryCurve.from_loop(loop)
            np.testing.assert_array_equal(curve.breaks, alone.breaks)
            np.testing.assert_array_equal(curve.coefficients, alone.coefficients)

    def test_equal_neighbours_are_refused(self) -> None:
        points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]])
        loop = BoundaryLoop(points=points, vertex_ids=np.arange(4), corners=np.zeros(4, bool))
        with pytest.raises(RepeatedPointError) as caught:
            BoundaryCurve.from_loop(loop)
        assert caught.value.fields == {"index": 1}


class TestDegree:
    @pytest.mark.parametrize(
        ("points", "degree"),
        [
            (circle(15), 3),  # too few to show how smooth they are
            (circle(16), 7),
            (wave(32), 3),  # its bends take 10 points each
            (wave(96), 5),
            (wave(97), 5),
            (wave(256), 7),
            (wave(256, 0.3), 7),
            (wave(1000), 7),
        ],
        ids=lambda value: str(value if isinstance(value, int) else len(value)),
    )
    def test_smooth_samplings_get_high_degrees_once_they_are_resolved(
        self, points: np.ndarray, degree: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        splines_only(monkeypatch)
        assert curve_of(points, []).degree == degree

    @pytest.mark.parametrize("noise", [1e-4, 1e-2, 0.15])
    def test_little_noise_is_enough(self, noise: float) -> None:
        points = wave(256)
        edge = np.linalg.norm(points[1] - points[0])
        moved = points + noise * edge * np.random.default_rng(0).normal(size=points.shape)
        assert curve_of(moved, []).kind == "cubic"

    @pytest.mark.parametrize("shift", [0, 7])
    def test_smooth_sides_between_corners_get_high_degrees(self, shift: int) -> None:
        # two arcs of 24 edges, and straight edges between them
        t = np.pi * np.arange(25) / 24
        arc = np.stack([np.cos(t), 1 + np.sin(t), 0.2 * np.sin(t)], axis=1)
        points, corners = np.concatenate([arc, -arc]), np.array([0, 24, 25, 49])
        curve = curve_of(np.roll(points, -shift, axis=0), sorted((corners - shift) % 50))
        assert (curve.kind, curve.degree) == ("spline", 7)
        assert curve.breaks[0] == 0
        assert (np.diff(curve.breaks) > 0).all()
        x, y, _ = curve.point(np.linspace(0, 1, 1000)).T
        on_arc = np.abs(y) > 1
        # by cubics 7e-6
        assert np.abs(np.hypot(x, np.abs(y) - 1) - 1)[on_arc].max() < 1e-7
        assert jump(curve, 1, np.delete(np.arange(50), (corners - shift) % 50)).max() < 1e-9

    @pytest.mark.parametrize("shift", [0, 3, 15])
    def test_straight_lines_between_arcs_stay_straight(self, shift: int) -> None:
        z = np.concatenate([np.exp(1j * np.pi * (np.arange(12) / 12 - 0.5)) + 2, 2 - np.arange(4) + 1j])
        points = np.stack([z.real, z.imag, 0 * z.real], axis=1)
        curve = curve_of(np.roll(np.concatenate([points, -points]), -shift, axis=0), [])
        x, y, _ = np.abs(curve.point(np.linspace(0, 1, 1000))).T
        # as far as cubics miss arcs. The spline through all points was 1e-2 from them
        assert np.where(x < 2, np.abs(y - 1), np.abs(np.hypot(x - 2, y) - 1)).max() < 4e-5
        assert jump(curve, 1, np.arange(32)).max() < 1e-12

    def test_rough_or_short_sides_keep_the_cubic(self) -> None:
        assert curve_of(circle(28), [0, 14]).kind == "cubic"
        noisy = circle(200) + 0.01 * np.random.default_rng(0).normal(size=(200, 3))
        assert curve_of(noisy, [0, 50]).kind == "cubic"

    @pytest.mark.parametrize("degree", [5, 7])
    def test_breaks_are_arc_lengths_for_high_degrees(self, degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
        force_degree(degree, monkeypatch)
        curve = curve_of(wave(200, 0.3), [])
        speed = np.linalg.norm(curve.derivative(np.linspace(0, 1, 1000)), axis=1)
        # |Γ′| is the length, up to what the cubic spline misses of it
        np.testing.assert_allclose(speed, curve.length(), rtol=1e-5)

    @given(points=smooth_loops(min_points=60), motion=rigid_motions())
    def test_degree_does_not_depend_on_position_or_scale(self, points: np.ndarray, motion: RigidMotion) -> None:
        curve, moved = curve_of(points, []), curve_of(1e3 * motion(points), [])
        assert moved.degree == curve.degree
        s = np.linspace(0, 1, 50)
        np.testing.assert_allclose(moved.point(s), 1e3 * motion(curve.point(s)), atol=1e-7)


class TestTrigonometric:
    @pytest.mark.parametrize(("count", "uneven"), [(17, 0.0), (32, 0.0), (33, 0.0), (64, 0.3), (301, 0.3)])
    def test_equal_steps_of_a_parameter_give_the_curve_itself(self, count: int, uneven: float) -> None:
        curve = curve_of(wave(count, uneven), [])
        assert curve.kind == "analytic"
        np.testing.assert_array_equal(curve.breaks, np.arange(count + 1) / count)
        error = distance_to_wave(curve.point(np.linspace(0, 1, 997, endpoint=False))).max()
        # the parameter t + 0.3·sin(t + 1) has all frequencies, the wave itself two
        assert error < (1e-13 if uneven == 0 or count > 300 else 1e-9)

    def test_derivatives_are_those_of_the_curve(self) -> None:
        curve, s = curve_of(circle(40)), np.linspace(0, 1, 333)
        np.testing.assert_allclose(np.linalg.norm(curve.derivative(s), axis=1), 2 * np.pi, rtol=1e-12)
        np.testing.assert_allclose(curve.second_derivative(s), -((2 * np.pi) ** 2) * curve.point(s), atol=1e-8)

    @pytest.mark.parametrize("count", [40, 41])
    def test_does_not_depend_on_the_start_or_the_direction(self, count: int) -> None:
        points, s = wave(count, 0.3), np.linspace(0, 1, 100)
        curve = curve_of(points, [])
        np.testing.assert_allclose(curve_of(np.roll(points, 7, 0), []).point(s + 7 / count), curve.point(s), atol=1e-13)
        np.testing.assert_allclose(curve_of(points[::-1], []).point(-s - 1 / count), curve.point(s), atol=1e-13)

    @pytest.mark.parametrize("count", [64, 65])
    def test_noisy_or_very_uneven_points_are_left_to_splines(self, count: int) -> None:
        # a hundredth of an edge; what is less than the points leave unknown anyhow is not seen
        noisy = wave(count) + 1e-3 * np.random.default_rng(0).normal(size=(count, 3))
        assert curve_of(noisy, []).kind != "analytic"
        # steps that vary by a factor of 199
        t = 2 * np.pi * np.arange(count) / count
        assert curve_of(circle_at(t + 0.99 * np.sin(t)), []).kind != "analytic"

    def test_share_of_the_length_is_that_of_the_arcs(self) -> None:
        t = 2 * np.pi * np.arange(60) / 60
        curve = curve_of(circle_at(t + 0.6 * np.sin(t)), [])
        assert curve.kind == "analytic"
        s = np.linspace(-1, 2, 50)
        # a circle's length is its angle
        np.testing.assert_allclose(curve.length_share(s), s + 0.6 * np.sin(2 * np.pi * s) / (2 * np.pi), atol=1e-6)
        spline = curve_of(np.random.default_rng(0).normal(size=(20, 3)), [])
        np.testing.assert_array_equal(spline.length_share(s), s)


def folded(seed: int, t: np.ndarray) -> np.ndarray:
    """Points of a random closed curve of four harmonics."""
    amplitudes = 0.2 * np.random.default_rng(seed).normal(size=(2, 4, 3)) / np.arange(1, 5)[:, None]
    amplitudes[0, 0, 0] += 1
    amplitudes[1, 0, 1] += 1
    turns = 2 * np.pi * np.arange(1, 5) * t[..., None]
    return np.cos(turns) @ amplitudes[0] + np.sin(turns) @ amplitudes[1]


def folded_at(seed: int, shares: np.ndarray) -> np.ndarray:
    """Points of that curve at shares of its length, to 1e-8."""
    many = np.arange(20_001) / 20_000
    arcs = np.append(0, np.cumsum(np.linalg.norm(np.diff(folded(seed, many), axis=0), axis=1)))
    return folded(seed, CubicSpline(arcs / arcs[-1], many)(shares))


def distance_to_folded(seed: int, curve: BoundaryCurve) -> float:
    """RMS distance of a curve's points from the random curve."""
    dense = BoundaryCurve.from_loop(BoundaryLoop.from_points(folded(seed, np.arange(1000) / 1000), corners=()))
    points = curve.point(np.arange(700) / 700)
    return float(np.sqrt(np.mean((points - dense.point(dense.nearest(points))) ** 2)))


def jittered_shares(count: int) -> np.ndarray:
    return (np.arange(count) + np.random.default_rng(count).uniform(-0.3, 0.3, count)) / count


class TestSamplings:
    def test_even_points_lose_nothing_beside_their_polynomial(self, monkeypatch: pytest.MonkeyPatch) -> None:
        errors, count = [], 64
        for seed in range(12):
            points = folded_at(seed, np.arange(count) / count)
            limit = BoundaryCurve(
                kind="analytic",
                breaks=np.arange(count + 1) / count,
                coefficients=rules.trigonometric_coefficients(points),
                corners=np.zeros(count, bool),
            )
            mine = curve_of(points, [])
            with monkeypatch.context() as patch:
                splines_only(patch)
                spline = curve_of(points, [])
            errors.append([distance_to_folded(seed, c) for c in (limit, mine, spline)])
        limit, mine, spline = np.median(errors, axis=0)
        assert mine < 2 * limit
        assert mine < spline

    def test_jittered_points_converge_faster_than_splines_of_degree_seven(self) -> None:
        errors = [
            np.median(
                [distance_to_folded(seed, curve_of(folded_at(seed, jittered_shares(n)), [])) for seed in range(12)]
            )
            for n in (128, 256)
        ]
        assert np.log2(errors[0] / errors[1]) > 8


class TestConvergence:
    @pytest.mark.parametrize("uneven", [0.0, 0.3])
    @pytest.mark.parametrize(("degree", "error"), [(3, 6e-7), (5, 6e-9), (7, 2e-10)])
    def test_curve_is_approximated_at_order_degree_plus_one(
        self, degree: int, error: float, uneven: float, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        force_degree(degree, monkeypatch)
        counts, s = [96, 128, 192], np.linspace(0, 1, 2000, endpoint=False)
        errors = [distance_to_wave(curve_of(wave(count, uneven), []).point(s)).max() for count in counts]
        # the smooth change of parameter gains a little on the way to the limit
        assert -degree - 5 < np.polyfit(np.log(counts), np.log(errors), 1)[0] < -degree - 1
        assert errors[-1] < error

    def test_length_of_a_circle(self) -> None:
        assert curve_of(circle(256)).length() == pytest.approx(2 * np.pi, rel=1e-14)
        # a cubic's error (2π/256)⁴/384 is 1e-9
        assert curve_of(circle(256), [0, 128]).length() == pytest.approx(2 * np.pi, rel=1e-8)


class TestCorners:
    def test_straight_sides_stay_straight(self) -> None:
        curve = curve_of(L_SHAPE, list(range(6)))
        assert curve.length() == pytest.approx(8, rel=1e-14)
        middle = curve.point((curve.breaks[:-1] + curve.breaks[1:]) / 2)
        np.testing.assert_allclose(middle, (L_SHAPE + np.roll(L_SHAPE, -1, axis=0)) / 2, atol=1e-14)

    @pytest.mark.parametrize("corners", [[0], [7], [3, 20], [0, 1, 2, 12], [39]])
    def test_tangent_jumps_at_corners_only(self, corners: list[int]) -> None:
        points = circle(40) + 0.05 * np.random.default_rng(1).normal(size=(40, 3))
        curve = curve_of(points, corners)
        others = np.delete(np.arange(40), corners)
        assert jump(curve, 1, np.array(corners)).min() > 0.1
        assert jump(curve, 1, others).max() < 1e-11
        assert jump(curve, 2, others).max() < 1e-8

    def test_sides_are_not_a_knot_splines(self) -> None:
        points = circle(40) + 0.05 * np.random.default_rng(2).normal(size=(40, 3))
        curve = curve_of(points, [5, 25])
        # the third derivative does not jump at the first and last inner vertex of a side
        quiet, loud = np.array([6, 24, 26, 4]), np.array([10, 15, 30])
        scale = np.abs(curve.coefficients[0]).max()
        assert jump(curve, 3, quiet).max() < 1e-9 * scale
        assert jump(curve, 3, loud).min() > 1e-3 * scale


class TestAverages:
    def test_harmonics_of_a_circle_fall_by_the_gaussian_s_transform(self) -> None:
        width = 0.03
        smooth = curve_of(circle(200, bend=0.1, waves=5), []).smoothed(width)
        assert smooth.kind == "cubic"
        assert not smooth.corners.any()
        radius = np.linalg.norm(smooth.point(smooth.breaks[:-1])[:, :2], axis=1)
        # the parameter is arc length, not the angle: harmonics of the circle mix by squares of the wave's slope
        np.testing.assert_allclose(radius, np.exp(-0.5 * (2 * np.pi * width) ** 2), rtol=0.02)
        height = np.ptp(smooth.point(smooth.breaks[:-1])[:, 2]) / 2
        assert height == pytest.approx(0.1 * np.exp(-0.5 * (10 * np.pi * width) ** 2), rel=0.05)

    @given(points=rough_loops(), width=st.floats(1e-3, 0.2))
    def test_averages_keep_the_breaks_and_are_shorter(self, points: np.ndarray, width: float) -> None:
        curve = curve_of(points, [])
        smooth = curve.smoothed(width)
        np.testing.assert_array_equal(smooth.breaks, curve.breaks)
        # in its own parameter; at its vertices, between which the spline may swing where breaks are uneven
        perimeter = np.linalg.norm(np.diff(smooth.point(curve.breaks), axis=0), axis=1).sum()
        assert perimeter < curve.length()


class TestNearest:
    @given(points=rough_loops(), seed=SEEDS)
    def test_no_denser_sampling_finds_a_nearer_point(self, points: np.ndarray, seed: int) -> None:
        curve = curve_of(points)
        queries = points[:20] + 0.1 * np.random.default_rng(seed).normal(size=(20, 3))
        found = np.linalg.norm(curve.point(curve.nearest(queries)) - queries, axis=1)
        dense = curve.point(np.linspace(0, 1, 40 * len(points), endpoint=False))
        best = np.linalg.norm(dense[:, None] - queries, axis=-1).min(axis=0)
        # two parts of the curve equally near within their distance from their chords may be swapped
        assert (found <= best + 2 * curve.bulge()).all()
        assert (found <= best + 1e-9).mean() >= 0.8

    def test_points_beside_a_long_side_are_nearest_to_it(self) -> None:
        """Eight samples of the long side are farther from some points than those of the divided one."""
        points = np.array([[0, 0, 0], [1, 0, 0], [0.6, 0.8, 0], *np.linspace([0.4, 0.4, 0], [0, 0, 0], 40)[:-1]])
        queries = np.array([[0.06, 2e-5, 0], [0.3, -1e-3, 0], [0.94, 1e-9, 0]])
        curve = curve_of(points, [0, 1, 2, 3])
        np.testing.assert_allclose(curve.point(curve.nearest(queries)), queries * [1, 0, 1], atol=1e-15)

    def test_offset_is_perpendicular_to_the_curve(self) -> None:
        curve = curve_of(circle(50) * [2, 1, 1])
        queries = circle(37) * [2.2, 1.1, 0] + [0, 0, 0.1]
        s = curve.nearest(queries)
        tangent = curve.derivative(s) / np.linalg.norm(curve.derivative(s), axis=1, keepdims=True)
        # parameters to rounding, times a speed of 12 and a distance of 2
        np.testing.assert_allclose(((queries - curve.point(s)) * tangent).sum(axis=1), 0, atol=1e-12)

    def test_outside_a_corner_the_corner_is_nearest(self) -> None:
        curve = curve_of(L_SHAPE, list(range(6)))
        found = curve.nearest(np.array([[-1.0, -0.5, 0], [2.5, -0.1, 1], [0.9, 0.9, 0]]))
        np.testing.assert_allclose(found[:2], [0, 2 / 8], atol=1e-15)
        np.testing.assert_allclose(curve.point(found[2:]), [[1, 1, 0]], atol=0.1 + 1e-12)


@pytest.mark.parametrize("formula", [False, True])
def test_reversed_curve_is_the_same_set_of_points(formula):
    known = gallery.tennis_seam(0.8)
    curve = BoundaryCurve.from_formula(known) if formula else BoundaryCurve.from_loop(known.sample(50))
    back, s = curve.reversed(), np.linspace(0.01, 0.99, 77)
    np.testing.assert_allclose(back.point(s), curve.point(1 - s), atol=1e-14)
    # moving a polynomial of degree d to its other end adds up binomials, 2ᵈ in all, of rounding errors
    rounding = 2.0 ** (len(curve.coefficients) - 1) * np.finfo(np.float64).eps
    slopes = curve.derivative(1 - s)
    np.testing.assert_allclose(back.derivative(s), -slopes, atol=rounding * np.abs(slopes).max())
    np.testing.assert_array_equal(back.point(back.breaks[:-1])[1:], curve.point(curve.breaks[:-1])[:0:-1])
