"""Films that meet planes of symmetry at right angles."""

import pickle

import numpy as np
import pytest

from spinor_geom import OpenCurve, PlateauSolution, gallery, mesh_patch, solve_plateau
from spinor_geom.errors import MeshShapeError, OptionError

ORIGIN, X, Y, Z = np.zeros(3), (1, 0, 0), (0, 1, 0), (0, 0, 1)


def saddle(first: float, last: float, count: int = 21) -> np.ndarray:
    """Part of a closed curve that is symmetric in the planes x = 0 and y = 0."""
    t = np.linspace(first, last, count)
    points = np.column_stack([np.cos(t), np.sin(t), 0.3 * np.cos(2 * t)])
    points[np.abs(points) < 1e-15] = 0
    return points


def mirrored(curves: object, *planes: tuple[int, int, int]) -> PlateauSolution:
    found = solve_plateau(curves, mirror=[(ORIGIN, plane) for plane in planes])
    assert isinstance(found, PlateauSolution)
    return found


def test_parts_have_their_share_of_the_area() -> None:
    whole = solve_plateau(saddle(0, 2 * np.pi, 81)[:-1]).area
    half, quarter = mirrored(saddle(-np.pi / 2, np.pi / 2, 41), X), mirrored(saddle(0, np.pi / 2), X, Y)
    for part, share in ((half, 2), (quarter, 4)):
        assert part.area == pytest.approx(whole / share, rel=1e-9)
        assert part.array_surface.area() == pytest.approx(part.area, rel=1e-9)
        assert len(part.free_edges) == share / 2
        assert part.converged
        assert part.stability.verdict == "stable"


def test_a_part_is_found_wherever_the_curve_and_its_planes_lie() -> None:
    # an edge of a tetrahedron between two planes, of Schwarz's D surface: its ends are on the planes up to rounding
    edge, planes = np.array([[1, 1, 1], [1, -1, -1]]) / 8**0.5, np.array([[1, 0, 1], [1, 0, -1]])
    area = mirrored(edge, *map(tuple, planes)).area
    for seed in range(6):
        random = np.random.default_rng(seed)
        turn, shift = np.linalg.qr(random.normal(size=(3, 3)))[0], random.normal(size=3)
        part = solve_plateau(edge @ turn.T + shift, mirror=[(shift, normal) for normal in planes @ turn.T])
        assert part.area == pytest.approx(area, rel=1e-9)


def test_the_film_meets_the_planes_at_right_angles_along_its_free_edges() -> None:
    part = mirrored(saddle(0, np.pi / 2), X, Y)
    (rim,) = part.rims
    for (start, end), normal in zip(part.free_edges, (X, Y), strict=True):
        s = np.linspace(start, end, 40)[1:-1]
        z = rim.boundary.point(rim.parameters(s))
        np.testing.assert_allclose(part.curve.point(s) @ normal, 0, atol=1e-15)
        np.testing.assert_allclose(part.array_surface.position(z), part.curve.point(s), atol=1e-8)
        np.testing.assert_allclose(part.array_surface.normal(z) @ normal, 0, atol=1e-6)


def test_a_mirrored_film_is_meshed_pickled_and_made_of_patches() -> None:
    part = pickle.loads(pickle.dumps(mirrored(saddle(0, np.pi / 2), X, Y)))
    assert mesh_patch(part, 0.05).area == pytest.approx(part.area, rel=1e-3)
    assert part.to_nurbs().area == pytest.approx(part.area, rel=1e-6)


def test_curves_between_planes_without_a_common_corner_bound_a_part() -> None:
    # a ring around the z axis, a quarter of it: the third plane is met by the film only
    t = np.linspace(0, np.pi / 2, 17)
    arc = np.column_stack([np.cos(t), np.sin(t), 0.5 + 0 * t])
    arc[0, 1] = arc[-1, 0] = 0
    part = mirrored(arc, X, Y, Z)
    # the catenoid between unit circles at heights ±0.5
    assert part.area == pytest.approx(5.99179697580228191 / 8, rel=1e-9)
    assert len(part.free_edges) == 3
    assert part.array_surface.area() == pytest.approx(part.area, rel=1e-8)


def test_a_straight_edge_at_an_angle_to_its_planes_makes_corners() -> None:
    # a side of a skew quadrilateral with angles of 60°, of which the planes cut half
    part = mirrored(OpenCurve([(2, 0, 2**0.5), (0, 2, -(2**0.5))]), X, Y)
    ends = part.curve.breaks[:-1][part.curve.corners]
    ahead, back = part.curve.derivative(ends), part.curve.derivative(np.nextafter(ends + 1, 0))
    cosines = -(ahead * back).sum(axis=1) / np.linalg.norm(ahead, axis=1) / np.linalg.norm(back, axis=1)
    angles = np.degrees(np.arccos(cosines))
    np.testing.assert_allclose(np.sort(angles), [30, 30, 90], atol=0.05)


@pytest.mark.parametrize(
    ("curve", "planes", "message"),
    [
        (saddle(0.1, np.pi / 2), (X, Y), "the start of curve 0 lies on no plane"),
        (saddle(0, np.pi), (X, Y), "lie on both sides of plane 0"),
        (saddle(0, np.pi / 2), (X, (1, 1, 0)), "not mutually orthogonal"),
        (saddle(0, np.pi / 2), ((0, 0, 0),), "normal of plane 0 is 0"),
        (np.array([[0, 0, 0], [1, 0, 0.0]]), (X, Y), "lies on 2 planes"),
        ([], (X,), "at least one"),
        (np.ones((2, 2, 2, 2)).tolist(), (X,), "must be real numbers"),
        (gallery.tennis_seam(0.8).sample(32), (X,), "not BoundaryLoop"),
        (saddle(0, np.pi / 2), ("x",), "pairs"),
    ],
)
def test_curves_and_planes_that_do_not_fit_are_refused(curve: object, planes: tuple[object, ...], message: str) -> None:
    with pytest.raises((OptionError, MeshShapeError), match=message):
        solve_plateau(curve, mirror=[(ORIGIN, plane) for plane in planes])


def test_a_curve_may_be_a_list_of_points() -> None:
    curve, planes = [[1, 0, 0], [1, 1, 0.5], [0, 1, 0]], [(ORIGIN, X), (ORIGIN, Y)]
    area = solve_plateau(np.array(curve), mirror=planes).area
    assert solve_plateau(curve, mirror=planes).area == solve_plateau([curve], mirror=planes).area == area


def test_open_curves_are_checked() -> None:
    for points, corners in (([[0, 0, 0]], ()), ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], (0,))):
        with pytest.raises(OptionError, match="open curve"):
            OpenCurve(points, corners=corners)
