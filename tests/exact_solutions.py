"""Solved Plateau problems whose surface is known: polynomial spinors on a disk, with their own rim as the loop."""

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
from spinor_geom.surface.array_surface import ArraySurface

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
    surface = ArraySurface(series, domain).transform(scale=scale)
    loop = BoundaryLoop.from_points(surface.position(radius * np.exp(2j * np.pi * t)), corners=())
    curve = BoundaryCurve.from_loop(loop)
    return PlateauSolution(
        rims=(
            RimMatch(
                loop=loop, curve=curve, boundary=domain.boundary, matching=np.stack([t, curve.breaks[:-1]], axis=1)
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


def with_stability(solution, stability):
    """A solution with a verdict that is given and not computed."""
    evidence = Evidence(make=lambda: solution.surface)
    evidence.__dict__["stability"] = stability
    return replace(solution, evidence=evidence)
