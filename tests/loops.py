"""Loops whose minimal surfaces are known, for tests of the discrete and the exact solver."""

import numpy as np

from spinor_geom.mesh.boundary_loop import BoundaryLoop

CONVEX = ((0, 0), (2, 0), (2.5, 1), (1.2, 2.2), (-0.3, 1.1))
L_SHAPE = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
# A ramp around an axis: middle radius, half the width, rise per turn.
RAMP = (3.0, 0.35, 2.0)


def polygon_area(corners):
    """Area of a plane polygon."""
    x, y = np.transpose(corners)
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def planar(corners, edges):
    """A polygon in the plane z = 0, its sides divided into about so many edges of one length, its corners marked."""
    c = np.column_stack([corners, np.zeros(len(corners))])
    side = np.linalg.norm(np.roll(c, -1, axis=0) - c, axis=1)
    count = np.maximum(1, np.round(edges * side / side.sum())).astype(int)
    points = [a + (b - a) * np.arange(k)[:, None] / k for a, b, k in zip(c, np.roll(c, -1, axis=0), count, strict=True)]
    return BoundaryLoop.from_points(np.concatenate(points), corners=np.cumsum(count) - count)


def slit():
    """A rectangle one triangle wide and 45 long."""
    return planar([(0, 0), (45, 0), (45, 0.87), (0, 0.87)], 92)


def ramp(turns, points=160):
    """The rim of a helicoidal ramp. Its helicoid has the area `ramp_area`."""
    radius, half, pitch = RAMP
    a = 2 * np.pi * turns * np.arange(points // 2) / (points // 2)
    middle = np.stack([radius * np.cos(a), radius * np.sin(a), pitch * a / (2 * np.pi)], axis=1)
    across = half * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    return BoundaryLoop.from_points(np.concatenate([middle + across, (middle - across)[::-1]]))


def noisy_ellipse(points=100, ratio=2.0, amount=0.2, seed=0):
    """A saddle-shaped ellipse whose points are moved by a share of the edge length: a ragged rim."""
    t = 2 * np.pi * np.arange(4000) / 4000
    fine = np.stack([ratio * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)], axis=1)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    even = np.arange(points) / points * (length[-1] + np.linalg.norm(fine[-1] - fine[0]))
    smooth = np.stack([np.interp(even, length, fine[:, k]) for k in range(3)], axis=1)
    edge = np.linalg.norm(smooth[1] - smooth[0])
    return BoundaryLoop.from_points(smooth + amount * edge * np.random.default_rng(seed).normal(size=smooth.shape))


def uneven(points, seed=0, amount=0.3):
    """Points of a smooth curve of four harmonics, at steps of its parameter that vary by a share of their mean."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * (np.arange(points) + amount * rng.uniform(-1, 1, points)) / points
    return BoundaryLoop.from_points(_of_harmonics(seed, t))


def _of_harmonics(seed, t):
    rng = np.random.default_rng([seed, 1])
    curve = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    for k in range(2, 5):
        cosine, sine = 0.25 / k * rng.normal(size=(2, 3))
        curve += np.outer(np.cos(k * t), cosine) + np.outer(np.sin(k * t), sine)
    return curve


def evenly(points, seed=0):
    """The curve of `uneven` at equal steps of its parameter."""
    return BoundaryLoop.from_points(_of_harmonics(seed, 2 * np.pi * np.arange(points) / points))


def is_disk_on(loop, vertices, faces):
    """Whether faces are one disk on all the vertices whose boundary runs along the loop, in its direction."""
    m = len(loop)
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    codes = directed @ [len(vertices), 1]
    lone = directed[~np.isin(codes, directed[:, ::-1] @ [len(vertices), 1])]
    edges = np.unique(np.sort(directed, axis=1), axis=0)
    return bool(
        len(np.unique(codes)) == len(codes)
        and len(np.unique(faces)) == len(vertices)
        and len(vertices) - len(edges) + len(faces) == 1
        and sorted(map(tuple, lone.tolist())) == sorted((i, (i + 1) % m) for i in range(m))
    )


def figure_eight():
    """A plane curve of complex numbers that crosses itself once, between its points."""
    t = 2 * np.pi * (np.arange(80) + 0.3) / 80
    return np.sin(t) + 1j * np.sin(2 * t)
