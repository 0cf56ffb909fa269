"""Powers that open reentrant corners, by the angles of the image and by conformality."""

import numpy as np

from spinor_geom.domain.opening import Opening
from spinor_geom.domain.plane_domain import SplineBoundary

L = np.array([0, 2, 2 + 1j, 1 + 1j, 1 + 2j, 2j])
RIGHT = np.full(6, np.pi / 2)


def outline(corners: np.ndarray, parts: int = 8) -> SplineBoundary:
    """A polygon with each side in equal parts."""
    vertices = (corners[:, None] + (np.roll(corners, -1) - corners)[:, None] * np.arange(parts) / parts).ravel()
    flags = np.zeros(len(vertices), dtype=bool)
    flags[::parts] = True
    return SplineBoundary.through(vertices, flags)


def angles(boundary: SplineBoundary) -> np.ndarray:
    """Between the chords at the corners."""
    w = boundary.vertices
    ahead, back = np.roll(w, -1) - w, np.roll(w, 1) - w
    return np.angle(back / ahead)[boundary.corners] % (2 * np.pi)


def test_the_reentrant_corner_of_an_l_gets_the_wanted_angle_and_others_keep_theirs() -> None:
    opening = Opening.of(outline(L, 64), RIGHT)
    # chords of 1/64 of a side turn by about a hundredth
    assert np.abs(angles(opening.boundary) - RIGHT).max() < 0.02
    steps = np.abs(np.diff(opening.boundary.vertices))[2 * 64 : 3 * 64]
    assert steps.max() / steps.min() < 1.05  # the image's length is that of 128 chords


def test_phi_dz_is_kept() -> None:
    given = outline(L, 64)
    opening = Opening.of(given, RIGHT)
    ends = opening.boundary.parameters
    t = (ends[1:] + ends[:-1])[40::96] / 2
    before, after = (opening.given_parameters(t + side) for side in (-1e-8, 1e-8))
    step = given.point(after) - given.point(before)
    ratio = opening.factor(t) ** 2 * opening.boundary.derivative(t) / step
    # the scale is free. Parameters are linear between vertices
    assert np.abs(ratio / ratio.mean() - 1).max() < 0.02


def test_domains_without_reentrant_corners_are_not_opened() -> None:
    assert Opening.of(outline(np.array([0, 1, 1 + 1j, 1j])), RIGHT[:4]) is None
    # the curve itself turns by more than π there
    assert Opening.of(outline(L), np.array([0.5, 0.5, 0.5, 1.5, 0.5, 0.5]) * np.pi) is None


def test_corners_of_curves_that_turn_back_are_not_opened() -> None:
    """The image of the opposite sides would have no length."""
    assert Opening.of(outline(L), np.where(np.arange(6) == 3, 1e-11, RIGHT)) is None
