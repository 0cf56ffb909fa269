"""Loops with known disks, solved once for all tests of the solver, and distances between points and surfaces."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from spinor_geom import gallery
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import PlateauSolution, solve_plateau
from spinor_geom.surface.array_surface import ArraySurface

SURFACES = {
    "Enneper": gallery.enneper(0.8),
    "polynomial": gallery.polynomial([1, 0, 0.25], [0.2, 0.4]),
    "half catenoid": gallery.catenoid(0.5, turn=np.pi),
    "half helicoid": gallery.helicoid(1.0, 1.0, turn=np.pi),
}
CURVES = {
    "tennis seam": gallery.tennis_seam(0.8),
    "twisted circle": gallery.twisted_circle(),
    "ellipse 2:1": gallery.ellipse(2.0),
    "ellipse 8:1": gallery.ellipse(8.0),
    "saddle 8:1": gallery.ellipse(8.0, 0.3),
}


@cache
def recovered(name: str) -> PlateauSolution:
    """The solution for a known surface's own rim of 96 points."""
    return solve_plateau(SURFACES[name].rim(96), tolerance=1e-4)


@cache
def spanned(name: str, points: int = 128, tolerance: float = 1e-3) -> PlateauSolution:
    """The solution for a known curve."""
    return solve_plateau(CURVES[name].sample(points), tolerance=tolerance)


def distance_to_surface(points: np.ndarray, surface: ArraySurface) -> np.ndarray:
    """Distance of each point (n, 3) from a surface, by Newton's method from its nearest mesh vertex."""
    vertices = surface.domain.triangulation.points
    z = vertices[cKDTree(surface.position(vertices)).query(points)[1]].copy()
    for _ in range(6):
        p, q = np.moveaxis(surface.spinors(z), -1, 0)
        phi = np.stack([p**2 - q**2, -1j * (p**2 + q**2), 2 * p * q], axis=-1)
        # r_x = Re φ and r_y = −Im φ are orthogonal and of length λ
        away = ((surface.position(z) - points) * phi).sum(axis=-1)
        z -= np.conj(away) / (np.abs(p) ** 2 + np.abs(q) ** 2) ** 2
    assert surface.domain.contains(z).all()
    return np.linalg.norm(surface.position(z) - points, axis=1)


def measured(surface: ArraySurface, curve: BoundaryCurve, samples: int = 2000) -> tuple[float, float]:
    """RMS and largest distance of a surface's boundary from Γ, by arc length of ∂Ω, from public methods alone."""
    boundary = surface.domain.boundary
    # midpoints: no sample of any Gauss rule, and none on a vertex
    t = (np.arange(samples) + 0.5) / samples
    r = surface.position(boundary.point(t))
    distance = np.linalg.norm(r - curve.point(curve.nearest(r)), axis=1)
    weight = np.abs(boundary.derivative(t))
    return float(np.sqrt((weight * distance**2).sum() / weight.sum())), float(distance.max())
