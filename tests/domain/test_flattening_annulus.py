"""Discrete annuli laid out in the plane: similar to themselves where they are plane, and with simple boundaries."""

import numpy as np
import pytest

from spinor_geom.discrete.strip import discrete_annulus, triangulated_annulus
from spinor_geom.domain.flattening import is_simple
from spinor_geom.domain.flattening_annulus import flatten_annulus
from tests.plateau.rims import ring


def ellipse(a, b, centre, count):
    turn = 2 * np.pi * np.arange(count) / count
    return centre + a * np.cos(turn) + 1j * b * np.sin(turn)


@pytest.mark.parametrize("hole", [(0.3, 0.3, 0.6 + 0.1j), (0.9, 0.05, 0.0), (0.2, 0.25, -1.5)])
def test_plane_annulus_is_laid_out_as_it_is(hole):
    outer, inner = ellipse(2.0, 1.0, 0.0, 60), ellipse(*hole, 40)[::-1]
    plane = triangulated_annulus(outer, inner)
    turned = plane.points * np.exp(0.7j)
    vertices = np.column_stack([turned.real, turned.imag, np.full(len(turned), 2.0)])
    flat = flatten_annulus(vertices, plane.faces, (60, 40))
    # the first vertex of the outer rim lies at 0, and its first edge is turned back to the real axis
    both = np.concatenate([flat.outer, flat.inner])
    expected = plane.points[:100] - outer[0]
    scale = both[1] / expected[1]
    assert abs(abs(scale) - 1) < 1e-10
    np.testing.assert_allclose(both, scale * expected, atol=1e-9)
    assert flat.distortion < 1e-9


def test_strip_around_a_tube_becomes_a_ring():
    turn = np.arange(48) / 48
    top, bottom = ring(1.0, 0.3, stretch=3.0).point(turn), ring(1.0, -0.3, stretch=3.0).point(turn)[::-1]
    plane, descent = discrete_annulus(top, bottom, relative_change=1e-3)
    flat = flatten_annulus(descent.vertices, plane.faces, (48, 48))
    assert is_simple(flat.outer)
    assert is_simple(flat.inner[::-1])
    away = flat.outer - flat.inner.mean()
    assert abs(np.angle(np.roll(away, -1) / away).sum() - 2 * np.pi) < 1e-9
