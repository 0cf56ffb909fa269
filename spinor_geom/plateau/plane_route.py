"""Plane loops: the minimal surface is the plane region inside or between them, whatever their shape and corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Complex, Float

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.intersections import crossings_between, loop_crossings
from spinor_geom.mesh.operators import winding_numbers
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Between, Found
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.surface.frames import spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Loops that leave a plane by less than this share of their diagonal lie in it: rounding errors, and where so much is
# allowed what float32 rounds points by.
_PLANE, _PLANE_IN_FLOAT32 = 1e-12, 2.0**-24
# Points on each piece of Γ for the residual, between its vertices.
_PER_PIECE = 4


def lie_in_plane(loops: Sequence[BoundaryLoop], *, allowed: float) -> bool:
    """Whether loops lie in one plane, but for rounding errors.

    Args:
        loops: of any common size.
        allowed: RMS distance from Γ, in their common diagonal: loops that were rounded to float32 lie in a plane if it
            is not less than that.
    """
    points = np.concatenate([loop.points for loop in loops])
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    return _distance_from(loops[0], points) <= max(_PLANE, min(_PLANE_IN_FLOAT32, allowed)) * diagonal


def plane_region(
    loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve], device: torch.device, clock: Clock
) -> Found:
    """The region inside one of some loops of one plane and outside the others, itself as Ω and constant p and q.

    It is the only minimal surface over them, and lies on the left of the first loop.

    Args:
        loops: at unit size, in one plane: see `lie_in_plane`.
        curves: Γ through each.
        device: of the surface.
        clock: of the stages.

    Raises:
        DomainError: a curve crosses itself or another one between the points, or they bound no such region.

    Source: the convex hull property of minimal surfaces (Osserman, "A Survey of Minimal Surfaces" (1986), section 7).
    """
    with clock.stage("surface"):
        frame = _frame_of(curves, loops[0])
        outer = None if frame is None else _outermost(curves, frame)
        if frame is None or outer is None:
            raise DomainError(
                "the curves through plane loops cross between the points, or none has all others inside",
                vertices=sum(map(len, loops)),
            )
        turning = [bool(loop.area_vector @ frame.normal > 0) for loop in loops]
        # the first loop has the surface on its left from one side
        if turning[0] != (outer == 0):
            frame = _PlaneFrame.across(-frame.normal, frame.origin)
            turning = [not left for left in turning]
        order = (outer, *(number for number in range(len(curves)) if number != outer))
        back = tuple(turning[number] != (number == outer) for number in order)
        rims = tuple(curves[k].reversed() if way else curves[k] for k, way in zip(order, back, strict=True))
        boundaries = [frame.boundary(curve) for curve in rims]
        surface = frame.surface(PlaneDomain.inside(boundaries[0], holes=tuple(boundaries[1:])))
        pairs = zip(boundaries, rims, strict=True)
        between = None
        if len(curves) > 1:
            between = Between(
                order=order,
                back=back,
                modulus=None,
                antiperiodic=(False,) * (len(rims) - 1),
                period=float(np.linalg.norm(surface.periods().real, axis=1).max()),
            )
        return Found(
            surface=surface.to(device),
            curves=rims,
            matchings=tuple(np.repeat(curve.breaks[:-1, None], 2, axis=1) for curve in rims),
            misfit=Misfit.together([_misfit(surface, boundary, curve) for boundary, curve in pairs]),
            area=float(surface.area()),
            route="plane",
            limit="it is at rounding error",
            between=between,
        )


def lie_beside(loops: Sequence[BoundaryLoop], curves: Sequence[BoundaryCurve]) -> bool:
    """Whether loops lie in one plane, and are not one with the others inside it, beside each other.

    Then no minimal surface of one piece spans them: it would lie in that plane.
    """
    if not lie_in_plane(loops, allowed=_PLANE_IN_FLOAT32):
        return False
    frame = _frame_of(curves, loops[0])
    return frame is not None and _outermost(curves, frame) is None


def _outermost(curves: Sequence[BoundaryCurve], frame: _PlaneFrame) -> int | None:
    """The curve that has all others inside, where these lie beside each other."""
    inside = np.array([[a is not b and _is_inside(a, b, frame) for b in curves] for a in curves])
    outer = int(inside.sum(axis=0).argmax())
    is_region = inside[:, outer].sum() == len(curves) - 1 and inside.sum() == len(curves) - 1
    return outer if is_region else None


def _distance_from(loop: BoundaryLoop, points: Float[np.ndarray, "n 3"]) -> float:
    """RMS distance of points from the plane of a loop."""
    return float(np.sqrt(np.mean(((points - loop.plane.centroid) @ loop.plane.normal) ** 2)))


def _frame_of(curves: Sequence[BoundaryCurve], loop: BoundaryLoop) -> _PlaneFrame | None:
    """Coordinates in the plane of a loop; None where curves in it cross between their points."""
    fine = [_between(curve, _PER_PIECE) for curve in curves]
    if any(len(loop_crossings(points)) for points in fine):
        return None
    if any(len(crossings_between(*pair)) for pair in combinations(fine, 2)):
        return None
    return _PlaneFrame.across(loop.plane.normal, loop.plane.centroid)


def _is_inside(inner: BoundaryCurve, outer: BoundaryCurve, frame: _PlaneFrame) -> bool:
    points = frame.coordinates(_between(outer, _PER_PIECE))
    inside = frame.coordinates(inner.coefficients[-1][:1])
    return bool(np.rint(winding_numbers(plane_coordinates(points), plane_coordinates(inside)))[0] != 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _PlaneFrame:
    """Coordinates x + iy in a plane, counter-clockwise about its normal."""

    normal: Float[np.ndarray, "3"]
    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "2 3"]

    @classmethod
    def across(cls, normal: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"]) -> _PlaneFrame:
        axes = torch.cat(normals_of(torch.tensor(normal)[None])).numpy()
        return cls(normal=normal, origin=origin, axes=axes)

    def coordinates(self, points: Float[np.ndarray, "*pts 3"]) -> Complex[np.ndarray, "*pts"]:
        return np.asarray((points - self.origin) @ (self.axes[0] + 1j * self.axes[1]))

    def boundary(self, curve: BoundaryCurve) -> SplineBoundary:
        coefficients = curve.coefficients.copy()
        coefficients[-1] -= self.origin
        return SplineBoundary(curve.breaks, coefficients @ (self.axes[0] + 1j * self.axes[1]), curve.corners)

    def surface(self, domain: PlaneDomain) -> SpinorSurface:
        u, v = torch.tensor(self.axes)
        spinors = torch.stack(spinors_from_phi(torch.complex(u, -v)[None]), dim=-1)
        surface = SpinorSurface(PowerSeries(spinors), domain, self.origin)
        with torch.no_grad():
            root = np.array([surface.root.real, surface.root.imag])
            surface.constant.add_(torch.tensor(root @ self.axes))
        return surface


def _between(curve: BoundaryCurve, each: int) -> Float[np.ndarray, "n 3"]:
    """Points of a curve, `each` from every vertex to the next."""
    return curve.point(_parameters(curve, each).ravel())


def _parameters(curve: BoundaryCurve, each: int) -> Float[np.ndarray, "m each"]:
    return np.asarray(curve.breaks[:-1, None] + np.diff(curve.breaks)[:, None] * np.arange(each) / each)


def _misfit(surface: SpinorSurface, boundary: SplineBoundary, curve: BoundaryCurve) -> Misfit:
    """Distance between a part of the surface's boundary and its curve, between the vertices."""
    t = _parameters(curve, _PER_PIECE)[:, 1:]
    arcs = np.linalg.norm(curve.derivative(t), axis=-1) * np.diff(curve.breaks)[:, None] / t.shape[1]
    distance = np.linalg.norm(surface.position(boundary.point(t.ravel())) - curve.point(t.ravel()), axis=1)
    away, slide, weights = (torch.as_tensor(part.ravel()) for part in (distance, t, arcs))
    tensors = CurveTensors.of(curve, torch.device("cpu"))
    return Misfit.from_distances(away, slide, weights, tensors, length=float(arcs.sum()))
