"""Rims whose minimal surfaces are known, and rims for comparisons between routes."""

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
    return (ring(1.0, -0.3, stretch=1.5, waves=2, amount=0.15), ring(0.8, 0.3, centre=(0.3, 0.1), waves=3, amount=0.1))


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


def polygon(corners, parts) -> BoundaryLoop:
    """A polygon with its sides divided evenly."""
    corners = np.asarray(corners, dtype=np.float64)
    share = np.arange(parts)[:, None] / parts
    points = corners[:, None] + share * (np.roll(corners, -1, axis=0) - corners)[:, None]
    return BoundaryLoop.from_points(points.reshape(-1, 3), corners=parts * np.arange(len(corners)))


# k, ρ: area of the piece of a k-noid, and the index of that
KNOIDS = {
    (3, 0.55): (0.9705042212833, 0),
    (3, 0.5): (1.1079936408877, 0),
    (3, 0.35): (1.7862959993414, 3),
    (4, 0.35): (1.2718794760813, 1),
    (5, 0.3): (1.2396261121060, 1),
}


def knoid_curves(k, rho, steps=512) -> tuple[ClosedCurve, ...]:
    """The rims of Jorge and Meeks's k-noid on the sphere less the disks |z − ω| < ρ about the k-th roots of unity.

    φ = (½(1 − g²), ½i(1 + g²), g) dz/(z^k − 1)², g = z^(k−1), integrated from 0 to 1 − ρ and then around one disk, as a
    Fourier series. The other rims are turned.
    """

    def phi(z):
        g = z ** (k - 1)
        return np.stack([0.5 * (1 - g * g), 0.5j * (1 + g * g), g], axis=-1) / ((z**k - 1) ** 2)[..., None]

    nodes, weights = np.polynomial.legendre.leggauss(200)
    first = (phi((1 - rho) * (nodes + 1) / 2) * (1 - rho) / 2).T @ weights
    turn = np.exp(2j * np.pi * np.arange(steps) / steps)
    slope = np.fft.fft(phi(1 - rho * turn) * (-2j * np.pi * rho * turn)[:, None], axis=0) / steps
    each = 2j * np.pi * np.fft.fftfreq(steps, 1 / steps)[:, None]
    large = np.abs(slope).max(axis=1) > 1e-17 * np.abs(slope).max()
    slope, each = slope[large], each[large]
    place = np.divide(slope, each, out=np.zeros_like(slope), where=each != 0)
    start = first - place.sum(axis=0)

    def series(coefficients, matrix, constant=0.0):
        return lambda s: (np.exp(np.asarray(s)[..., None] * each[:, 0]) @ coefficients + constant).real @ matrix

    angles = 2 * np.pi * np.arange(k) / k
    # r(ω z) is r(z) turned by −2π/k
    turns = [np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in angles]
    return tuple(
        ClosedCurve(
            point=series(place, matrix, start),
            derivative=series(slope, matrix),
            second_derivative=series(slope * each, matrix),
        )
        for matrix in turns
    )


def knoid(k, rho, count=64) -> tuple[BoundaryLoop, ...]:
    """Equal steps of the parameters of those rims."""
    return tuple(sampled(curve, count) for curve in knoid_curves(k, rho))


def circle(centre, normal, radius, count=64) -> BoundaryLoop:
    """Equal steps of a circle."""
    across = np.linalg.svd(np.asarray(normal, dtype=np.float64)[None])[2][1:]
    angle = 2 * np.pi * np.arange(count) / count
    around = np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
    return BoundaryLoop.from_points(np.asarray(centre) + radius * around, corners=())


TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
CUBE = np.concatenate([np.eye(3), -np.eye(3)])


def facing(directions, *, away=0.6, radius=0.5, count=64) -> tuple[BoundaryLoop, ...]:
    """Circles that face 0 from given directions."""
    return tuple(circle(away * direction, direction, radius, count) for direction in directions)
