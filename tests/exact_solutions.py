"""Solved Plateau problems whose surface is known: polynomial spinors on a disk, with their own rim as the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.misfit import BoundaryResidual
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.stability import Stability
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients of z⁰, z¹, … as pairs (p, q)
PLANE = ((1, 0),)
ENNEPER = ((1, 0), (0, 1))


def exact_solution(coefficients, vertices, radius=1.0, scale=1.0):
    """The solution that a solver without error would return for the surface's own rim.

    Args:
        coefficients: Of p and q.
        vertices: Number of loop points at equal angles, or their parameters in [0, 1), ascending.
        radius: Of the disk Ω.
        scale: Of the surface.
    """
    t = np.arange(vertices) / vertices if np.isscalar(vertices) else np.asarray(vertices)
    domain = PlaneDomain.disk(radius, max(len(t), 16))
    series = PowerSeries(np.array(coefficients, dtype=np.complex128))
    surface = SpinorSurface(series, domain).transform(scale=scale)
    loop = BoundaryLoop.from_points(surface.position(radius * np.exp(2j * np.pi * t)), corners=())
    curve = BoundaryCurve.from_loop(loop)
    return PlateauSolution(
        rims=(
            RimMatch(
                loop=loop,
                curve=curve,
                boundary=domain.boundary,
                matching=np.stack([t, curve.breaks[:-1]], axis=1),
            ),
        ),
        domain=domain,
        boundary_residual=BoundaryResidual(
            rms=0.0, max=0.0, max_per_local_edge=0.0, mean_edge=loop.mean_edge_length, diagonal=loop.diagonal
        ),
        area=surface.area(),
        route="disk",
        history=(),
        solve_timings={"fit": 0.25},
        tolerance=1e-3,
        converged=True,
        reason="",
        evidence=Evidence(make=lambda: surface),
    )


def with_stability(solution: PlateauSolution, stability: Stability) -> PlateauSolution:
    """A solution with a verdict that is given and not computed."""
    evidence = Evidence(make=lambda: solution.surface)
    evidence.__dict__["stability"] = stability
    return replace(solution, evidence=evidence)


def k_noid(k: int, radius: float, points: int = 64) -> tuple[list[BoundaryLoop], float]:
    """Rims of a piece of the Jorge-Meeks surface with k ends, and its area.

    The piece is the sphere without disks of a given radius about the roots of zᵏ = 1; g = zᵏ⁻¹, f = 1/(zᵏ − 1)².
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)
    nodes, weights = (nodes + 1) / 2, weights / 2

    def phi(z):
        f, g = 1 / (z**k - 1) ** 2, z ** (k - 1)
        return np.stack([f * (1 - g * g) / 2, 1j * f * (1 + g * g) / 2, f * g], axis=-1)

    def position(z, root):
        # along two segments that pass by the roots
        between = root * np.exp(1j * np.pi / k * np.where((z / root).imag >= 0, 1, -1))
        first = np.einsum("g,ngk->nk", weights, phi(between[:, None] * nodes) * between[:, None, None])
        step = (z - between)[:, None]
        return (first + np.einsum("g,ngk->nk", weights, phi(between[:, None] + step * nodes) * step[..., None])).real

    rims, area, fine = [], 0.0, np.exp(-2j * np.pi * np.arange(512) / 512)
    for root in np.exp(2j * np.pi * np.arange(k) / k):
        z = root * (1 + radius * fine)
        velocity = phi(z) * (-2j * np.pi * root * radius * fine)[:, None]
        area += 0.5 * float((position(z, root) * velocity.imag).sum(axis=1).mean())
        turns = np.exp(-2j * np.pi * np.arange(points) / points)
        rims.append(BoundaryLoop.from_points(position(root * (1 + radius * turns), root), corners=()))
    return rims, area
