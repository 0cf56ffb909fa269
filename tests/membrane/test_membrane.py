"""Films with cables and rings: arcs of circles, a saddle against discrete minima, catenoids, forces and refusals."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from spinor_geom import Cable, Membrane, OpenCurve, Ring, Stay, SymmetryPlane, solve_membrane
from spinor_geom.errors import ArgumentTypeError, LoopError, MeshExtentError, MeshShapeError, OptionError, SurfaceError
from spinor_geom.membrane.frame import with_images

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
SADDLE = np.array([[1, 1, 0.5], [-1, 1, -0.5], [-1, -1, 0.5], [1, -1, -0.5]])
ALONG = np.linspace(0.05, 0.95, 19)
TENSION = 3.0


def ring(corners: np.ndarray, **given: float) -> list[Cable]:
    return [Cable(start=tuple(a), end=tuple(b), **given) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]


def sides(corners: np.ndarray) -> list[np.ndarray]:
    return [corners[[k, (k + 1) % len(corners)]] for k in range(len(corners))]


def circle(radius: float, height: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    t = 2 * np.pi * np.arange(40) / 40
    return np.column_stack([x + radius * np.cos(t), y + radius * np.sin(t), np.full(40, height)])


@cache
def saddle() -> Membrane:
    return solve_membrane(ring(SADDLE, tension=TENSION))


def test_a_cable_at_one_side_of_a_square_is_an_arc_of_a_circle() -> None:
    sides = [SQUARE[[k, (k + 1) % 4]] for k in (1, 2, 3)]
    membrane = solve_membrane([*ring(SQUARE, tension=1.5)[:1], *sides])
    radius, half = 1.5, np.arcsin(1 / 3)
    # the cable is bent into the square
    centre = np.array([0.5, -np.sqrt(radius**2 - 0.25), 0])
    distances = np.linalg.norm(membrane.cables[0].point(ALONG) - centre, axis=1)
    np.testing.assert_allclose(distances, radius, atol=1e-8)
    assert membrane.film.area == pytest.approx(1 - radius**2 * (half - np.sin(half) * np.cos(half)), abs=1e-9)
    assert membrane.cables[0].length == pytest.approx(2 * radius * half, abs=1e-9)


def test_four_equal_cables_of_a_square_are_arcs_by_tension_and_by_length_in_any_order() -> None:
    half = np.arcsin(0.5)
    one, two, three, four = ring(SQUARE, tension=1.0)
    turned = [Cable(start=each.end, end=each.start, tension=1.0) for each in (two, four)]
    # single precision overflows in comparisons with the largest double
    for edges in (
        ring(SQUARE, tension=np.float32(1.0)),
        ring(SQUARE, length=2 * half),
        [three, turned[1], one, turned[0]],
    ):
        membrane = solve_membrane(edges)
        for cable in membrane.cables:
            assert cable.tension == pytest.approx(1, abs=1e-8)
            assert cable.length == pytest.approx(2 * half, abs=1e-9)
            np.testing.assert_allclose(np.linalg.norm(cable.curvature(ALONG), axis=1), 1, atol=1e-7)
        assert membrane.film.area == pytest.approx(1 - 4 * (half - np.sin(half) * np.cos(half)), abs=1e-8)


def test_cables_around_a_reentrant_corner_are_arcs() -> None:
    # the middle of its edges lies on the lines of two of them
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]], dtype=float)
    for cable in solve_membrane(ring(corners, tension=6.0)).cables:
        np.testing.assert_allclose(np.linalg.norm(cable.curvature(ALONG), axis=1), 1 / 6, atol=1e-8)


def test_a_cable_opposite_a_curved_edge_has_its_length() -> None:
    t = np.linspace(np.pi / 2, 3 * np.pi / 2, 41)
    arc = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    membrane = solve_membrane([OpenCurve(arc, corners=()), Cable(start=arc[-1], end=arc[0], length=2.1)])
    (cable,) = membrane.cables
    half = brentq(lambda angle: angle / np.sin(angle) - 1.05, 0.1, 1.5)
    assert cable.tension == pytest.approx(1 / np.sin(half), abs=1e-6)


def test_cables_of_a_saddle_have_curvature_vectors_along_the_conormal() -> None:
    membrane = saddle()
    for cable in membrane.cables:
        curvature = cable.curvature(ALONG)
        np.testing.assert_allclose(np.linalg.norm(curvature, axis=1), 1 / TENSION, rtol=1e-5)
        # the edges are equal, and passed in one direction or the other
        (rim,) = membrane.film.rims
        places = [(number + ALONG) / 4 for number in range(4)]
        s = min(places, key=lambda s: np.abs(rim.curve.point(s) - cable.point(ALONG)).max())
        np.testing.assert_allclose(rim.curve.point(s), cable.point(ALONG), atol=1e-12)
        normals = membrane.film.array_surface.normal(rim.boundary.point(rim.parameters(s)))
        assert np.abs((normals * curvature).sum(axis=1)).max() < 1e-5


def test_the_saddle_is_the_limit_of_discrete_minima() -> None:
    coarse, fine = (_discrete(n) for n in (3, 6))
    assert saddle().energy == pytest.approx((4 * fine - coarse) / 3, rel=1e-5)


def _discrete(n: int) -> float:
    """Least area + tension · length of a mesh of n × n squares of four triangles each."""
    u, v = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n, indexing="ij")
    shares = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=-1)
    grid, i = shares @ SADDLE, np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    corners = [i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()]
    points = np.concatenate([grid.reshape(-1, 3), grid.reshape(-1, 3)[corners].mean(axis=0)])
    middle = (n + 1) ** 2 + np.arange(n * n)
    faces = np.concatenate([np.stack([corners[k], corners[(k + 1) % 4], middle], axis=1) for k in range(4)])
    edges = np.concatenate([np.stack([side[:-1], side[1:]], axis=1) for side in (i[0], i[-1], i[:, 0], i[:, -1])])
    free = np.ones(len(points), dtype=bool)
    free[i[[0, 0, -1, -1], [0, -1, 0, -1]]] = False

    def energy(moved: np.ndarray) -> tuple[float, np.ndarray]:
        now = points.copy()
        now[free] = moved.reshape(-1, 3)
        a, b, c = now[faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        unit, along = normals / areas[:, None], now[edges[:, 1]] - now[edges[:, 0]]
        lengths = np.linalg.norm(along, axis=1)
        gradient, pull = np.zeros_like(now), TENSION * along / lengths[:, None]
        for k, side in enumerate((c - b, a - c, b - a)):
            np.add.at(gradient, faces[:, k], np.cross(unit, side) / 2)
        np.add.at(gradient, edges[:, 1], pull)
        np.add.at(gradient, edges[:, 0], -pull)
        return areas.sum() / 2 + TENSION * lengths.sum(), gradient[free].ravel()

    options = {"maxiter": 20000, "maxfun": 40000, "ftol": 1e-15, "gtol": 1e-7, "maxcor": 30}
    return float(minimize(energy, points[free].ravel(), jac=True, method="L-BFGS-B", options=options).fun)


def test_the_forces_of_the_supports_balance_and_are_derivatives_of_the_energy() -> None:
    membrane = saddle()
    np.testing.assert_allclose(membrane.total_force, 0, atol=1e-8)
    # by symmetry all corners are pulled alike, and the moments vanish
    np.testing.assert_allclose(np.linalg.norm(membrane.forces, axis=1), np.linalg.norm(membrane.forces[0]), rtol=1e-6)
    np.testing.assert_allclose(np.cross(membrane.supports, membrane.forces).sum(axis=0), 0, atol=1e-6)
    # a similarity changes area by the square, length by the first power
    power = 2 * membrane.film.area + sum(one.tension * one.length for one in membrane.cables)
    assert (membrane.forces * membrane.supports).sum() == pytest.approx(power, rel=1e-7)


def test_newtons_steps_of_weak_cables_are_each_a_fiftieth_of_the_one_before() -> None:
    corners = np.array([[1.33, 0.3, 0.6], [0.1, 1.18, -0.62], [-1.11, -0.26, 0.53], [-0.19, -1.38, -0.65]])
    steps = np.array(solve_membrane(ring(corners, tension=2.68)).steps)
    # finite elements on the triangulation of the film leave a tenth, and need two more steps
    assert len(steps) <= 2
    assert (steps[1:] < steps[:-1] / 50).all()


def test_corners_that_hang_by_stays_are_where_forces_balance() -> None:
    outside = SQUARE + 0.2 * (2 * SQUARE - [1, 1, 0])
    stays = [Stay(start=a, end=b, tension=1.8) for a, b in zip(SQUARE, outside, strict=True)]
    membrane = solve_membrane([*ring(SQUARE, tension=1.0), *stays])
    np.testing.assert_allclose(membrane.forces[membrane.is_free], 0, atol=1e-8)
    # cables of tension 1 that meet at the angle a pull as one of 2 cos(a/2); arcs turn by what a lacks to a right angle
    turn = np.pi / 2 - 2 * np.arccos(0.9)
    chords = np.linalg.norm(np.diff(membrane.supports[:4], axis=0), axis=1)
    np.testing.assert_allclose(chords, 2 * np.sin(turn / 2), atol=1e-8)
    assert [one.tension for one in membrane.cables[4:]] == [1.8] * 4
    # of twice the given length, the same stays have the same tension
    lengths = [one.length for one in membrane.cables[4:]]
    given = [Stay(start=a, end=b, length=one) for a, b, one in zip(SQUARE, outside, lengths, strict=True)]
    same = solve_membrane([*ring(SQUARE, tension=1.0), *given])
    assert [one.tension for one in same.cables[4:]] == pytest.approx([1.8] * 4, abs=1e-7)


def test_a_stay_may_hang_by_two_others() -> None:
    outside = SQUARE + 0.2 * (2 * SQUARE - [1, 1, 0])
    single = [Stay(start=a, end=b, tension=1.8) for a, b in zip(SQUARE[1:], outside[1:], strict=True)]
    node = outside[0] + [0.02, 0.01, 0.0]
    across = np.array([-np.sqrt(0.5), np.sqrt(0.5), 0])
    # three equal tensions balance at 120 degrees
    ends = [outside[0] - np.array([0.5, 0.5, 0]) * np.sqrt(0.5) * 0.2 + side * across for side in (-0.6, 0.6)]
    forks = [Stay(start=node, end=end, tension=1.8) for end in ends]
    membrane = solve_membrane(
        [*ring(SQUARE, tension=1.0), *single, Stay(start=SQUARE[0], end=node, tension=1.8), *forks]
    )
    np.testing.assert_allclose(membrane.forces[membrane.is_free], 0, atol=1e-8)
    at = membrane.supports[np.linalg.norm(membrane.supports - node, axis=1).argmin()]
    first, second = (end - at for end in ends)
    assert first @ second == pytest.approx(-0.5 * np.linalg.norm(first) * np.linalg.norm(second), abs=1e-8)


def test_a_ring_hangs_at_the_height_where_a_catenoid_pulls_with_its_force() -> None:
    for waist, begin in ((0.4, 0.3), (0.1, 0.6)):
        force, height = 2 * np.pi * waist, waist * (np.arccosh(1 / waist) - np.arccosh(0.5 / waist))
        membrane = solve_membrane([Ring(points=circle(1, 0)), Ring(points=circle(0.5, begin), force=force)])
        assert begin + membrane.heights[1] == pytest.approx(height, abs=1e-8)
        np.testing.assert_allclose(membrane.edge_forces, [[0, 0, -force], [0, 0, force]], atol=1e-8)
    with pytest.raises(SurfaceError, match="or move rings together"):
        solve_membrane([Ring(points=circle(1, 0)), Ring(points=circle(0.5, 0.6), force=3.2)])


def test_a_square_ring_of_three_points_a_side_has_corners() -> None:
    corners = SQUARE - [0.5, 0.5, 0]
    points = [a + (b - a) * k / 3 for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True) for k in range(3)]
    membrane = solve_membrane([*sides(4 * corners), Ring(points=points)])
    assert membrane.film.area == pytest.approx(16 - 1, abs=1e-9)


def test_planes_of_symmetry_leave_a_part_of_the_whole() -> None:
    one = ring(SADDLE, tension=TENSION)[1]
    halves = [SymmetryPlane(point=(0, 0, 0), normal=normal) for normal in ((1, -1, 0), (1, 1, 0))]
    assert solve_membrane([halves[0], one, halves[1]]).energy == pytest.approx(saddle().energy, abs=1e-9)


@pytest.mark.slow
def test_the_forces_of_four_masts_under_a_square_roof_are_derivatives_of_the_area() -> None:
    corners = np.array([[3, 3, 0], [-3, 3, 0], [-3, -3, 0], [3, -3, 0]], dtype=float)
    planes = [SymmetryPlane(point=(0, 0, 0), normal=normal) for normal in ((1, 0, 0), (0, 1, 0))]

    def roof(height: float) -> Membrane:
        masts = [Ring(points=circle(0.4, height, *at)) for at in ((1.3, 1.3),)]
        return solve_membrane([*sides(corners), *planes, *masts], tolerance=1e-6, time_limit=np.inf)

    low, high, membrane = roof(0.58), roof(0.62), roof(0.6)
    np.testing.assert_allclose(membrane.total_force, 0, atol=1e-8)
    lifts = membrane.edge_forces[4:, 2]
    np.testing.assert_allclose(lifts, lifts[0], rtol=1e-6)
    # a central difference, whose error is of the square of its step
    assert 4 * lifts[0] == pytest.approx((high.film.area - low.film.area) / 0.04, rel=1e-3)


def test_frames_that_collapse_are_refused() -> None:
    # at tensions below 1/√2 the arcs of neighbouring sides of a square cross
    for given in ({"tension": 0.65}, {"tension": 0.705}, {"length": 1.4}):
        with pytest.raises(SurfaceError, match="its edges would cross at"):
            solve_membrane(ring(SQUARE, **given))
    with pytest.raises(SurfaceError, match="its edges would cross at"):
        solve_membrane(ring(SADDLE, tension=0.69 * np.sqrt(5)))
    # by the theorem of Gauss and Bonnet, below 2/π of the chords
    for share in (1e-9, 0.36, 0.63):
        with pytest.raises(SurfaceError, match="its cables would turn by more"):
            solve_membrane(ring(SADDLE, tension=share * np.sqrt(5)))
    with pytest.raises(SurfaceError, match="its cables would turn by more"):
        solve_membrane([Cable(start=SQUARE[0], end=SQUARE[1], tension=tension) for tension in (3.0, 4.0)])


@pytest.mark.parametrize(
    ("edges", "message"),
    [
        (lambda: ring(SQUARE, length=0.9), "too short"),
        (lambda: ring(SQUARE, tension=-1.0), "tension"),
        (lambda: [Cable(start=(0, 0, 0), end=(1, 0, 0))], "exactly one"),
        (lambda: ring(SQUARE, tension=1.0)[:3], "edge 2 ends 1"),
        (lambda: [*ring(SQUARE, tension=1.0), Stay(start=SQUARE[0], end=(-1, -1, 0), tension=2.1)], "cannot balance"),
        (lambda: [*ring(SQUARE, tension=1.0), Stay(start=(-2, 0, 0), end=(-1, -1, 0), tension=1)], "three cables"),
        (lambda: [*sides(SQUARE), Stay(start=SQUARE[0], end=(-1, -1, 0), tension=1)], "no fixed edge"),
        (lambda: [Ring(points=circle(1, 0), force=np.nan)], "must be a finite number"),
        (lambda: [Ring(points=circle(1, 0), force="1")], "must be a finite number"),
        (lambda: [], "two edges or more"),
        (lambda: [Ring(points=circle(1, 0), force=0.0)], "nothing holds the film"),
        (
            lambda: [*ring(SQUARE, tension=1.0), SymmetryPlane(point=(0.3, 0, 0), normal=(1, 0, 0))],
            "edge 0 crosses a plane",
        ),
        (lambda: [*ring(SQUARE, tension=1.0), *[SymmetryPlane(point=(0, 0, 0), normal=(1, 0, 0))] * 4], "one to three"),
        (lambda: [*ring(SQUARE, tension=1.0)[:1], OpenCurve(SQUARE[[1, 2, 3, 0]], corners=[1, 2])], "has corners"),
    ],
)
def test_edges_that_are_no_frame_are_refused(edges: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        solve_membrane(edges())


def test_what_is_no_edge_is_refused_by_its_type() -> None:
    for start in (("a", 0, 0), ((0, 0), 0, 0), (0, 0), None):
        with pytest.raises(MeshShapeError, match="both ends of a cable must be real numbers"):
            Cable(start=start, end=(1, 0, 0), tension=1.0)
    with pytest.raises(ArgumentTypeError, match="a sequence of edges"):
        solve_membrane(5)


def test_what_is_wrong_with_fixed_edges_and_sizes_is_said_alone() -> None:
    crossed = SQUARE[[0, 2, 1, 3]]
    with pytest.raises(LoopError, match=r"^the curve crosses"):
        solve_membrane(sides(crossed))
    with pytest.raises(LoopError, match=r"^edge"):
        solve_membrane([*sides(3 * SQUARE), *[Ring(points=circle(0.4, 0.6, 1.5, 1.5))] * 2])
    for scale in (1e-120, 1e90):
        with pytest.raises(MeshExtentError, match="scale the mesh"):
            solve_membrane(ring(scale * SQUARE, tension=scale))


def test_reflections_of_rings_have_names_and_heights_beside_them() -> None:
    plane = SymmetryPlane(point=(0, 0, 0), normal=(1, 0, 0))
    heads = [Ring(points=circle(0.3, z, 0.8, y), force=force) for z, y, force in ((0.1, 0.7, 0.2), (0.2, -0.7, 0.4))]
    membrane = solve_membrane([heads[0], plane, Ring(points=circle(2, 0)), heads[1]])
    assert membrane.edge_names == ("0", "0.1", "2", "3", "3.1")
    np.testing.assert_allclose(membrane.edge_forces[[0, 1, 3, 4], 2], [0.2, 0.2, 0.4, 0.4], atol=1e-7)
    # the heights of two reflections are equal, those of the two rings are not
    first, image, outer, second, other = membrane.heights
    assert [first, second, outer] == pytest.approx([image, other, 0], abs=1e-6)
    assert abs(first - second) > 0.01


def test_a_free_ring_is_reflected_in_planes_that_are_vertical_up_to_rounding() -> None:
    plane = SymmetryPlane(point=(2, 0, 0), normal=(1, 0, 1e-17))
    assert len(with_images([Ring(points=circle(0.5, 5.0), force=1.0), plane])) == 2
