"""Pairs of rims whose annuli are known, and annuli that are compared."""

from __future__ import annotations

import numpy as np

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve

# unit circles at heights ±h: areas of the stable and the unstable catenoid
CATENOIDS = {
    0.25: (3.10811242123163774, 6.385153731),
    0.5: (5.99179697580228191, 6.845655394),
    0.6: (6.99964256762198862, None),
}
# by Fourier solves with 128 and 256 nodes that agree
SKEW_AREA = 5.0319512970202


def ring(radius, height, *, centre=(0.0, 0.0), stretch=1.0, waves=0, amount=0.0, phase=0.0) -> ClosedCurve:
    """An ellipse in a horizontal plane, waved up and down."""
    turn = 2 * np.pi

    def curve(horizontal, vertical):
        def function(s):
            a = turn * np.asarray(s) + phase
            x, y = horizontal(a)
            return np.stack([stretch * x, y, vertical(a) + 0 * a], axis=-1)

        return function

    n, b = waves, amount
    return ClosedCurve(
        point=curve(
            lambda a: (centre[0] / stretch + radius * np.cos(a), centre[1] + radius * np.sin(a)),
            lambda a: height + b * np.cos(n * a),
        ),
        derivative=curve(
            lambda a: (-turn * radius * np.sin(a), turn * radius * np.cos(a)), lambda a: -turn * b * n * np.sin(n * a)
        ),
        second_derivative=curve(
            lambda a: (-(turn**2) * radius * np.cos(a), -(turn**2) * radius * np.sin(a)),
            lambda a: -(turn**2) * b * n * n * np.cos(n * a),
        ),
    )


def coaxial(h, *, phase=0.0) -> tuple[ClosedCurve, ClosedCurve]:
    """Two unit circles at heights ±h that run the same way."""
    return ring(1.0, h, phase=phase), ring(1.0, -h)


def skew() -> tuple[ClosedCurve, ClosedCurve]:
    """Wavy rims of different sizes, off each other's axis: area SKEW_AREA."""
    return (
        ring(1.0, -0.3, stretch=1.5, waves=2, amount=0.15),
        ring(0.8, 0.3, centre=(0.3, 0.1), waves=3, amount=0.1),
    )


def linked() -> tuple[ClosedCurve, ClosedCurve]:
    """Two circles through each other: between them the frame of an annulus makes a full turn."""
    other = ring(1.0, 0.0)

    def upright(function, offset):
        return lambda s: function(s)[..., [0, 2, 1]] + np.array([offset, 0.0, 0.0])

    return ring(1.0, 0.0), ClosedCurve(
        point=upright(other.point, 1.0),
        derivative=upright(other.derivative, 0.0),
        second_derivative=upright(other.second_derivative, 0.0),
    )


def sampled(curve: ClosedCurve, count: int, *, shift=0) -> BoundaryLoop:
    """Points at equal steps of the parameter, from any of them on."""
    return BoundaryLoop.from_points(np.roll(curve.point(np.arange(count) / count), shift, axis=0), corners=())
