"""Plane loops: the minimal surface is the plane region inside or between them, whatever their shape and corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Complex, Float

from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.intersections import crossings_between, loop_crossings
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found, FoundBetween
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
_LIMIT = "it is at rounding error"


def plane_disk(loop: BoundaryLoop, curve: BoundaryCurve, device: torch.device, clock: Clock) -> Found:
    """The region that a plane loop bounds, with itself as Ω and constant p and q; it is the only minimal disk over it.

    Args:
        loop: at unit size, in a plane: see `is_plane`.
        curve: Γ.
        device: of the surface.
        clock: of the stages.

    Raises:
        DomainError: Γ crosses itself between the points.

    Source: the convex hull property of minimal surfaces (Osserman, "A Survey of Minimal Surfaces" (1986), section 7).
    """
    with clock.stage("surface"):
        if len(loop_crossings(_between(curve, _PER_PIECE))):
            raise DomainError("the curve through a plane loop crosses itself between the points", vertices=len(loop))
        frame = _PlaneFrame.across(loop.plane.normal, loop.plane.centroid)
        boundary = frame.boundary(curve)
        surface = frame.surface(PlaneDomain.inside(boundary))
        return Found(
            curve=curve,
            surface=surface.to(device),
            matching=_identity(curve),
            misfit=_misfit(surface, boundary, curve),
            area=float(surface.area()),
            route="plane",
            history=(),
            limit=_LIMIT,
        )


def is_plane(loop: BoundaryLoop, *, allowed: float) -> bool:
    """Whether a loop lies in a plane, but for rounding errors.

    Args:
        loop: of any size.
        allowed: RMS distance from Γ, in diagonals: loops that were rounded to float32 lie in a plane if it is not less
            than that.
    """
    return bool(loop.plane.rms_distance <= _round_off(allowed) * loop.diagonal)


def plane_between(
    curves: Sequence[tuple[BoundaryCurve, BoundaryCurve]], device: torch.device, *, allowed: float
) -> FoundBetween | None:
    """The region inside one of several loops of one plane and outside the others, itself as Ω and constant p and q.

    It lies on the left of the first loop.

    Args:
        curves: at unit size, each as it was given and reversed.
        device: of the surface.
        allowed: RMS distance from them, as for `is_plane`.

    Returns:
        The surface; None where the loops do not lie in one plane to round-off, or bound no such region.

    Source: as `plane_disk`; Ω is the only minimal surface over its boundary.
    """
    given = [curve for curve, _ in curves]
    frame = _common_plane(given, _round_off(allowed))
    outer = None if frame is None else _outermost(given, frame)
    if frame is None or outer is None:
        return None
    turning = [_turns_left(curve, frame) for curve in given]
    # the first loop has the surface on its left from one side
    if turning[0] != (outer == 0):
        frame = _PlaneFrame.across(-frame.normal, frame.origin)
        turning = [not left for left in turning]
    order = (outer, *(number for number in range(len(given)) if number != outer))
    back = tuple(turning[number] != (number == outer) for number in order)
    rims = [curves[number][way] for number, way in zip(order, back, strict=True)]
    boundaries = [frame.boundary(curve) for curve in rims]
    surface = frame.surface(PlaneDomain.inside(boundaries[0], holes=tuple(boundaries[1:])))
    pairs = zip(boundaries, rims, strict=True)
    return FoundBetween(
        surface=surface.to(device),
        order=order,
        back=back,
        matchings=tuple(map(_identity, rims)),
        misfit=Misfit.together([_misfit(surface, boundary, curve) for boundary, curve in pairs]),
        area=float(surface.area()),
        modulus=None,
        antiperiodic=(False,) * (len(rims) - 1),
        period=float(np.linalg.norm(surface.periods().real, axis=1).max()),
        route="plane",
        limit=_LIMIT,
    )


def beside_in_plane(curves: Sequence[BoundaryCurve]) -> bool:
    """Whether curves at unit size lie in one plane, and are not one with the others inside it, beside each other.

    Then no minimal surface of one piece spans them: it would lie in that plane.
    """
    frame = _common_plane(curves, _PLANE_IN_FLOAT32)
    return frame is not None and _outermost(curves, frame) is None


def _outermost(curves: Sequence[BoundaryCurve], frame: _PlaneFrame) -> int | None:
    """The curve that has all others inside, where these lie beside each other."""
    inside = np.array([[a is not b and _is_inside(a, b, frame) for b in curves] for a in curves])
    outer = int(inside.sum(axis=0).argmax())
    is_region = inside[:, outer].sum() == len(curves) - 1 and inside.sum() == len(curves) - 1
    return outer if is_region else None


def _turns_left(curve: BoundaryCurve, frame: _PlaneFrame) -> bool:
    loop = BoundaryLoop.from_points(curve.coefficients[-1], corners=())
    return bool(loop.area_vector @ frame.normal > 0)


def _round_off(allowed: float) -> float:
    """Distance of a loop from its plane, in diagonals, that is rounding error."""
    return max(_PLANE, min(_PLANE_IN_FLOAT32, allowed))


def _common_plane(curves: Sequence[BoundaryCurve], round_off: float) -> _PlaneFrame | None:
    """Coordinates in the plane of curves; None where there is none, or they cross between their points."""
    loop = BoundaryLoop.from_points(curves[0].coefficients[-1], corners=())
    normal = loop.plane.normal
    offset = np.concatenate([curve.coefficients[-1] for curve in curves]) - loop.centroid
    if np.sqrt(np.mean((offset @ normal) ** 2)) > round_off:
        return None
    fine = [_between(curve, _PER_PIECE) for curve in curves]
    if any(len(loop_crossings(points)) for points in fine):
        return None
    if any(len(crossings_between(*pair)) for pair in combinations(fine, 2)):
        return None
    return _PlaneFrame.across(normal, loop.centroid)


def _is_inside(inner: BoundaryCurve, outer: BoundaryCurve, frame: _PlaneFrame) -> bool:
    points = frame.coordinates(_between(outer, _PER_PIECE))
    return _winding(points, complex(frame.coordinates(inner.coefficients[-1][0]))) != 0


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


def _identity(curve: BoundaryCurve) -> Float[np.ndarray, "m 2"]:
    return np.repeat(curve.breaks[:-1, None], 2, axis=1)


def _winding(polygon: Complex[np.ndarray, " m"], z: complex) -> int:
    """How often a closed polygon runs around a point."""
    away = polygon - z
    return round(float(np.angle(np.roll(away, -1) / away).sum()) / (2 * np.pi))
