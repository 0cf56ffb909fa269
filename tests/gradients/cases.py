"""Loops for every route and every kind of curve, and smooth displacements of their points."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import PlateauSolution, solve_plateau

QUADRILATERAL = np.array([[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0.5]])
TURN = 2 * np.pi * np.arange(64) / 64
RING = np.stack([np.cos(TURN), np.sin(TURN), 0 * TURN], axis=1)
LIFT = np.array([0, 0, 0.4])


def wavy(n: int, *, uneven: float = 0.0, seed: int = 0) -> np.ndarray:
    """Points of a smooth closed curve, at uneven steps of its parameter."""
    t = 2 * np.pi * (np.arange(n) + uneven * np.random.default_rng(seed).uniform(-0.3, 0.3, n)) / n
    return np.stack([np.cos(t), 1.1 * np.sin(t), 0.3 * np.cos(2 * t) + 0.1 * np.sin(3 * t)], axis=1)


def enneper_boundary(radius: float) -> np.ndarray:
    z = radius * np.exp(1j * TURN)
    return np.stack([(z - z**3 / 3).real, (z + z**3 / 3).imag, (z**2).real], axis=1)


def arched(each: int) -> np.ndarray:
    """A closed curve with four corners, and so many points on each of its curved sides."""
    u = np.linspace(0, 1, each, endpoint=False)[:, None]
    bend = np.concatenate([0.1 * u * (1 - u) * np.cos(3 * u), 0 * u, 0.1 * np.sin(np.pi * u)], axis=1)
    ends = zip(QUADRILATERAL, np.roll(QUADRILATERAL, -1, axis=0), strict=True)
    return np.concatenate([a + u * (b - a) + bend for a, b in ends])


def displaced(points: np.ndarray) -> np.ndarray:
    """A smooth displacement of points, not a rigid motion."""
    return np.sin(3 * points[:, [1, 2, 0]] + 1) + points[:, :1] ** 2


ROUTES = {
    "disk": [wavy(64)],
    "disk, Poisson kernels": [wavy(40, uneven=1)],
    "disk, spline of degree 7": [wavy(300, uneven=1)],
    "flattened": [wavy(96) * [5, 1, 1]],
    "flattened, rough": [wavy(24) + 0.03 * np.random.default_rng(0).normal(size=(24, 3))],
    "plane": [RING * [2, 1, 1]],
    "network": [QUADRILATERAL],
    "network, curved sides": [arched(8)],
    "annulus": [RING + LIFT, 0.9 * RING[::-1] - LIFT],
    "annular network": [3 * RING, 0.6 * RING + [1, 0, 0.3]],
    "circles": [3 * RING, 0.6 * RING[::2] + [1, 0, 0.3], 0.6 * RING[::-1] + [-1, 0, 0.3]],
}
# p and q change their sign around the hole; small displacements lead to the other of two annuli
LINKED = {"annulus, linked": [RING, RING[:, [0, 2, 1]] + [1, 0, 0]]}


def names(*slow: str) -> list[Any]:
    """The routes as parameters of a test. Those whose solve takes a second, and some others, are slow."""
    slow = (*slow, "annular network", "circles", "network, curved sides", "flattened, rough")
    return [pytest.param(name, marks=pytest.mark.slow if name in slow else ()) for name in ROUTES]


def solved(name: str, rims: list[np.ndarray] | None = None) -> PlateauSolution:
    """The solution over the rims of a route, or over the given rims."""
    return _at_rest(name) if rims is None else _solved(name, rims)


@cache
def _at_rest(name: str) -> PlateauSolution:
    return _solved(name, (ROUTES | LINKED)[name])


def _solved(name: str, loops: list[np.ndarray]) -> PlateauSolution:
    kind = name.split(",")[0]
    corners = "auto" if kind != "network" else np.arange(4) * (len(loops[0]) // 4)
    solution = solve_plateau(
        [BoundaryLoop.from_points(points, corners=corners) for points in loops],
        model="cauchy" if kind == "annular network" else "auto",
        # networks take seconds for higher accuracy. Rough rims stop at 8e-8 of an edge
        tolerance=1e-5 if "network" in kind else 1e-7 if "rough" in name else 1e-9,
        between="smooth",
    )
    assert isinstance(solution, PlateauSolution)
    assert solution.route == kind
    return solution


def moves_of(name: str) -> list[np.ndarray]:
    """Displacements of the points of a route, within the plane of plane rims."""
    if name == "plane":
        return [np.sin(points[:, [1, 0, 2]]) * [1, 1, 0] + points**2 for points in ROUTES[name]]
    size = 0.3 if name == "flattened" else 1.0  # a large displacement bends this long loop
    return [size * displaced(points) for points in (ROUTES | LINKED)[name]]


def moved(rims: list[np.ndarray], moves: list[np.ndarray], size: float) -> list[np.ndarray]:
    """The rims after a multiple of displacements."""
    return [points + size * move for points, move in zip(rims, moves, strict=True)]


def difference(function: Callable[[float], float], step: float = 2e-3) -> float:
    """Derivative of a function at 0 by central differences of order four."""
    one, two = (function(size) - function(-size) for size in (step, 2 * step))
    return (8 * one - two) / (12 * step)


def order_of(remainder: Callable[[float], float]) -> float:
    """The power of the step with which a remainder falls."""
    steps = 0.01 / 2 ** np.arange(3)
    return float(np.polyfit(np.log(steps), np.log([remainder(step) for step in steps]), 1)[0])
