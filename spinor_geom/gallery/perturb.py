"""Loops as meshes have them: with edges of one length or of many, and with noise."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from spinor_geom.gallery.known import KnownSurface
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve

_DENSE = 1 << 14


def evenly_sampled(curve: ClosedCurve | KnownSurface, n: int) -> BoundaryLoop:
    """A loop of n points of a curve or a rim without corners, equally far apart along it; its corners are none."""
    return _at_shares(curve, np.arange(n) / n)


def unevenly_sampled(curve: ClosedCurve | KnownSurface, n: int, *, seed: int, spread: float = 0.8) -> BoundaryLoop:
    """A loop of n points of a curve or a rim without corners whose edges differ in length at random, without corners.

    Args:
        curve: without corners.
        n: number of points.
        seed: of numpy's default generator.
        spread: edges are in proportion to numbers uniform in [1 − spread, 1 + spread], below 1.
    """
    edges = np.random.default_rng(seed).uniform(1 - spread, 1 + spread, n)
    return _at_shares(curve, (np.cumsum(edges) - edges) / edges.sum())


def noisy_loop(loop: BoundaryLoop, share: float, *, seed: int) -> BoundaryLoop:
    """A loop whose points are moved by isotropic normal vectors, `share` of its mean edge in each coordinate.

    Corners are left to the rule that finds them, which must not take noise for corners.
    """
    moves = share * loop.mean_edge_length * np.random.default_rng(seed).normal(size=loop.points.shape)
    return BoundaryLoop.from_points(loop.points + moves)


def _at_shares(curve: ClosedCurve | KnownSurface, shares: np.ndarray) -> BoundaryLoop:
    t = np.arange(_DENSE + 1) / _DENSE
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(_point(curve, t), axis=0), axis=1)))
    parameters = CubicSpline(length / length[-1], t)(shares)
    return BoundaryLoop.from_points(_point(curve, parameters), corners=())


def _point(curve: ClosedCurve | KnownSurface, t: np.ndarray) -> np.ndarray:
    return curve.position(curve.surface.domain.boundary.point(t)) if isinstance(curve, KnownSurface) else curve.point(t)
