"""Loops sampled from exact curves as meshes have them: with edges of one length, and with noise."""

from __future__ import annotations

import numpy as np

from spinor_geom import BoundaryLoop, gallery

DENSE = 1 << 14


def evenly_sampled(curve: gallery.KnownCurve, n: int) -> BoundaryLoop:
    """A loop of n points of a curve without corners, equally far apart along it; its corners are none."""
    t = np.arange(DENSE + 1) / DENSE
    speed = np.linalg.norm(curve.derivative(t), axis=1)
    length = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2))
    even = np.interp(np.arange(n) / n * length[-1], length, t)
    return BoundaryLoop.from_points(curve.point(even), corners=())


def noisy_loop(loop: BoundaryLoop, share: float, *, seed: int) -> BoundaryLoop:
    """A loop whose points are moved by isotropic normal vectors, `share` of its mean edge in each coordinate.

    Corners are left to the rule that finds them, which must not take noise for corners.
    """
    moves = share * loop.mean_edge_length * np.random.default_rng(seed).normal(size=loop.points.shape)
    return BoundaryLoop.from_points(loop.points + moves)
