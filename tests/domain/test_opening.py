"""Maps that open reentrant corners, by the angles of the image and by conformality."""

import numpy as np
import pytest

from spinor_geom.domain.opening import Opening
from spinor_geom.domain.plane_domain import SplineBoundary

L = np.array([0, 2, 2 + 1j, 1 + 1j, 1 + 2j, 2j])
RIGHT = np.full(6, np.pi / 2)
REENTRANT = np.arange(6) == 3


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


@pytest.mark.parametrize("length", [0.3, 3e-3, 1e-5])
def test_the_reentrant_corner_of_an_l_gets_the_wanted_angle_and_others_keep_theirs(length: float) -> None:
    opening = Opening.of(outline(L, 64), RIGHT, length * REENTRANT)
    # chords of 1/64 of a side turn by about a hundredth
    assert np.abs(angles(opening.boundary) - RIGHT).max() < 0.02
    growth = np.diff(np.log(np.abs(np.diff(opening.boundary.vertices))))
    assert growth.max() < 0.75  # steps of the logarithm of the distance are 0.5, more at the corner


def test_phi_dz_is_kept() -> None:
    given = outline(L, 64)
    opening = Opening.of(given, RIGHT, 0.01 * REENTRANT)
    ends = opening.boundary.parameters
    t = (ends[1:] + ends[:-1])[40::80] / 2
    before, after = (opening.given_parameters(t + side) for side in (-1e-8, 1e-8))
    step = given.point(after) - given.point(before)
    factor, _ = opening.factor(opening.given_parameters(t))
    # parameters are linear between vertices, which are far from each other beside the spike
    assert np.abs(factor**2 * opening.boundary.derivative(t) * 2e-8 / step - 1).max() < 0.05


def test_a_spike_is_thinner_than_numbers_near_its_corner() -> None:
    """In the given domain its points are at distances of 1e-100 and below."""
    opening = Opening.of(outline(L, 64), np.full(6, 0.02), 0.01 * REENTRANT)
    assert angles(opening.boundary)[3] == pytest.approx(0.02, rel=1e-6)
    assert np.abs(np.diff(opening.boundary.vertices)).min() > 1e-4


def test_domains_are_not_opened_without_corners_to_open_or_room() -> None:
    assert Opening.of(outline(L), RIGHT, np.zeros(6)) is None
    turn = np.linspace(-1.5, 1.5, 65) * np.pi
    spiral = (1 + turn / 10) * np.exp(1j * turn)  # the corner at its inner end is surrounded
    around = outline(np.concatenate([1.05 * spiral, 0.95 * spiral[::-1]]), 1)
    assert Opening.of(around, np.full(130, 0.5), 0.01 * np.eye(130)[0]) is None
