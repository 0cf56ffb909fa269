"""Plane rims with edges of very different lengths: their areas are known up to the bulges over short edges."""

import numpy as np


def arc(degrees, edges):
    """Points of a part of the unit circle, both ends included."""
    t = np.radians(degrees) * np.arange(edges + 1) / edges
    return np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)


def gaps(count, degrees, edges):
    """A circle with equal gaps between arcs."""
    own = 360 / count
    turns = np.radians(own * np.arange(count))
    part = arc(own - degrees, edges) @ [1, 1j, 0]
    z = (np.exp(1j * turns)[:, None] * part).ravel()
    return np.stack([z.real, z.imag, 0 * z.real], axis=1)


def sector(degrees, edges):
    """An arc and two straight sides to the centre."""
    return np.vstack([arc(degrees, edges), np.zeros((1, 3))])


def fine_side(edges):
    """A square with one side divided."""
    side = np.arange(edges)[:, None] / edges * [1, 0, 0]
    return np.vstack([side, [[1, 0, 0], [1, 1, 0], [0, 1, 0]]])


def stadium(length, edges):
    """Two half circles and two straight sides of a given length."""
    end = arc(180, edges) @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    return np.vstack([[length / 2, 0, 0] - end @ np.diag([1, 1, 0]), end - [length / 2, 0, 0]])


def rounded_corner(radius, edges):
    """A triangle with one corner rounded off: the arc goes over into the sides."""
    tip = radius * arc(120, edges) @ [[0.5, -(0.75**0.5), 0], [0.75**0.5, 0.5, 0], [0, 0, 1]]
    return np.vstack([tip, [[-3, 2 * radius + 3**0.5, 0], [-3, -2 * radius - 3**0.5, 0]]])


# ratios of the longest edge to the shortest from 5 to 2,000
FLAT = {
    **{f"half disk, {n} edges": arc(180, n) for n in (9, 17, 33, 65, 200, 1500)},
    **{f"{part}° of a circle, {n} edges": arc(part, n) for part in (120, 180, 240, 270) for n in (20, 40)},
    **{f"{k} gaps of 45°": gaps(k, 45, 12) for k in (1, 2, 3, 4)},
    **{f"sector of {part}°": sector(part, 15) for part in (60, 90, 200)},
    **{f"square with {n} edges on a side": fine_side(n) for n in (10, 30, 300)},
    **{f"stadium of length {length}": stadium(length, 12) for length in (4, 30, 300)},
    **{f"corner of radius {radius}": rounded_corner(radius, 12) for radius in (0.1, 0.01, 0.001)},
}


def polygon_area(points):
    """Area inside a plane polygon."""
    return float(np.linalg.norm(np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)) / 2)
