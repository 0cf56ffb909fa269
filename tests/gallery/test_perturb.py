"""Loops sampled evenly, unevenly and with noise."""

import numpy as np

from spinor_geom import gallery


def test_even_samples_lie_on_the_curve_with_equal_edges():
    loop = gallery.evenly_sampled(gallery.ellipse(8.0), 400)
    x, y, _ = loop.points.T
    np.testing.assert_allclose((x / 8) ** 2 + y**2, 1, atol=1e-13)
    # at the ends of the long axis, radius of curvature 1/8, a chord of 0.08 is shorter than its arc by 1.7 %
    assert loop.edge_lengths.min() > 0.975 * loop.edge_lengths.max()
    assert not loop.corners.any()


def test_noise_is_isotropic_repeatable_and_as_large_as_stated():
    loop = gallery.twisted_circle().sample(2000)
    moved = gallery.noisy_loop(loop, 0.15, seed=3)
    moves = (moved.points - loop.points) / loop.mean_edge_length
    # 2000 numbers: the standard error of their deviation is 1.6 %
    np.testing.assert_allclose(moves.std(axis=0), 0.15, rtol=0.06)
    assert np.abs(np.corrcoef(moves.T) - np.eye(3)).max() < 0.1
    np.testing.assert_array_equal(moved.points, gallery.noisy_loop(loop, 0.15, seed=3).points)
    assert (gallery.noisy_loop(loop, 0.15, seed=4).points != moved.points).all()
