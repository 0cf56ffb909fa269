"""Plane loops: the minimal disk is the plane region inside, whatever the loop's shape, corners and length."""

from __future__ import annotations

import numpy as np
import torch

from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.surface.frames import spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Loops that leave a plane by less than this share of their diagonal lie in it.
_PLANE = 1e-12
# Points on each piece of Γ for the residual, between its vertices.
_PER_PIECE = 4


def plane_disk(loop: BoundaryLoop, curve: BoundaryCurve, device: torch.device, clock: Clock) -> Found | None:
    """The region that a plane loop bounds, with itself as Ω and constant p and q; it is the only minimal disk over it.

    Args:
        loop: at unit size.
        curve: Γ.
        device: of the surface.
        clock: of the stages.

    Returns:
        The disk; None where the loop does not lie in a plane to round-off, or Γ crosses itself between the points.

    Source: the convex hull property of minimal surfaces (Osserman, "A Survey of Minimal Surfaces" (1986), section 7).
    """
    plane = loop.plane
    if plane.rms_distance > _PLANE * loop.diagonal:
        return None
    with clock.stage("surface"):
        u, v = (direction[0] for direction in normals_of(torch.tensor(plane.normal)[None]))
        frame = torch.stack([u, v]).numpy()
        coefficients = curve.coefficients.copy()
        coefficients[-1] -= plane.centroid
        boundary = SplineBoundary(curve.breaks, coefficients @ (frame[0] + 1j * frame[1]), loop.corners)
        t = boundary.parameters[:-1, None] + np.diff(boundary.parameters)[:, None] * np.arange(_PER_PIECE) / _PER_PIECE
        if len(loop_crossings(curve.point(t.ravel()))):
            return None
        spinors = torch.stack(spinors_from_phi(torch.complex(u, -v)[None]), dim=-1)
        surface = SpinorSurface(PowerSeries(spinors), PlaneDomain.inside(boundary), plane.centroid)
        with torch.no_grad():
            root = np.array([surface.root.real, surface.root.imag])
            surface.constant.add_(torch.tensor(root @ frame))
        between = t[:, 1:].ravel()
        distance = np.linalg.norm(surface.position(boundary.point(between)) - curve.point(between), axis=1)
        return Found(
            surface=surface.to(device),
            matching=np.repeat(curve.breaks[:-1, None], 2, axis=1),
            rms=float(np.sqrt(np.mean(distance**2))),
            max=float(distance.max()),
            area=float(surface.area()),
            route="plane",
            history=(),
            limit="it is at rounding error",
        )
