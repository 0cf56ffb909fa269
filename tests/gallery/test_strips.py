"""Outlines of strips: on the surfaces they are named after, as long and as wide as stated, with the stated areas."""

import itertools

import numpy as np

from spinor_geom import gallery

DENSE = np.arange(20001) / 20000


def length(curve, start, end):
    """Arc length between two parameters."""
    points = curve.point(start + (end - start - 1e-12) * DENSE)
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


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


def test_samples_of_a_strip_have_about_equal_edges():
    edges = gallery.horseshoe().sample(160).edge_lengths
    assert edges.max() < 2.5 * edges.min()
