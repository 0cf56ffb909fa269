"""Outlines of strips: on the surfaces they are named after, as long and as wide as stated, with the stated areas."""

import itertools

import numpy as np
import pytest

from spinor_geom import gallery

DENSE = np.arange(20001) / 20000


def length(curve, start, end):
    """Arc length between two parameters."""
    points = curve.point(start + (end - start - 1e-12) * DENSE)
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


@pytest.mark.parametrize("turns", [0.4, 1.3, 3.0])
def test_ramp_is_bounded_by_two_helices_on_one_helicoid(turns):
    known = gallery.helical_ramp(turns, radius=2.0, half_width=0.5, pitch=1.5)
    x, y, z = known.point(DENSE[:-1]).T
    rho, angle = np.hypot(x, y), 2 * np.pi * z / 1.5
    np.testing.assert_allclose(x + 1j * y, rho * np.exp(1j * angle), atol=1e-12)
    assert z.max() == pytest.approx(1.5 * turns, abs=1e-12)
    on_helix = np.isclose(rho, 1.5, atol=1e-12) | np.isclose(rho, 2.5, atol=1e-12)
    sides = np.append(known.corners, 1.0)
    assert on_helix.mean() == pytest.approx(sides[1] - sides[0] + sides[3] - sides[2], abs=1e-3)


def test_bent_slit_is_the_plane_one_rolled_on_a_cylinder():
    plane, bent = gallery.slit(), gallery.slit(bend=np.pi / 2)
    # both sides in one order: long, short, long, short
    for curve in (plane, bent):
        corners = np.append(curve.corners, 1.0)
        sides = [length(curve, a, b) for a, b in itertools.pairwise(corners)]
        # chords of an arc are shorter by the square of their angle over 24
        np.testing.assert_allclose(sides, [50, np.sqrt(0.75), 50, np.sqrt(0.75)], rtol=1e-8)
    x, y, _ = bent.point(DENSE).T
    np.testing.assert_allclose(np.hypot(x, y), 50 / (np.pi / 2), rtol=1e-13)
    assert plane.disks[0].area == 50 * np.sqrt(0.75)


@pytest.mark.parametrize("curve", [gallery.horseshoe(), gallery.helical_ramp(2.0)], ids=lambda curve: curve.name)
def test_samples_of_a_strip_have_about_equal_edges(curve):
    edges = curve.sample(160).edge_lengths
    assert edges.max() < 2.5 * edges.min()
