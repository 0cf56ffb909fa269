"""Plane loops of any shape, with or without corners: the minimal surface is the plane region inside or between them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import NUMPY
from spinor_geom.domain.plane_domain import PARTS, PlaneDomain, SplineBoundary
from spinor_geom.domain.polygons import bound_domain
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop, Plane, diagonals
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.intersections import MEETING_PER_DIAGONAL
from spinor_geom.plateau.curve_tensors import CurveTensors, normals_of
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import PlateauProblem, Route
from spinor_geom.plateau.roughness import has_stray_corners, shows_no_curve
from spinor_geom.plateau.route_result import RimsResult, RouteResult
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.frames import spinors_from_phi


def lie_in_plane(loops: Sequence[BoundaryLoop], *, allowed: float) -> bool:
    """Whether loops are coplanar to rounding error.

    That of float32 counts if it is at most `allowed`, the allowed distance in diagonals.
    """
    first, *others = loops
    diagonal, away = first.diagonal, [first.height]
    if others:
        plane = first.plane
        diagonal = float(diagonals(np.concatenate([loop.points for loop in loops])))
        away += [np.sqrt(np.mean(((loop.points - plane.centroid) @ plane.normal) ** 2)) for loop in others]
    return bool(max(away) <= max(MEETING_PER_DIAGONAL, min(np.finfo(np.float32).epsneg, allowed)) * diagonal)


def plane_region(problem: PlateauProblem) -> RouteResult:
    """The plane region inside one loop and outside the others: p and q are constant, the region itself is Ω.

    It is the only minimal surface over the loops. It lies on the left of the first one. Of free loops whose points show
    no curve, and of all where the curves cross between the points, the polygons through the points are used.

    Raises:
        DomainError: the curves cross between the points, or bound no such region.

    Source: the convex hull property of minimal surfaces (Osserman, "A Survey of Minimal Surfaces" (1986), section 7).
    """
    loops, curves = problem.units, problem.curves
    if problem.options.between != "free" or any(curve.is_formula for curve in curves):
        return _region(problem, curves)
    polygons = BoundaryCurve.from_loops([replace(loop, corners=np.ones(len(loop), dtype=bool)) for loop in loops])
    chosen = [
        polygon if _is_polygon(loop, curve) else curve
        for loop, curve, polygon in zip(loops, curves, polygons, strict=True)
    ]
    try:
        return _region(problem, chosen)
    except DomainError:
        if any(loop.corners_given for loop in loops):
            raise
        return _region(problem, polygons)


def _is_polygon(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether only the points of a loop are prescribed, and not a curve through them."""
    return not loop.corners_given and (has_stray_corners(loop) if loop.corners.any() else shows_no_curve(loop, curve))


def _region(problem: PlateauProblem, curves: Sequence[BoundaryCurve]) -> RouteResult:
    """`plane_region` for given curves through the points."""
    loops = problem.units
    with problem.clock.stage("surface"):
        plane = loops[0].plane
        outer = _outermost([curve.point(_parameters(curve)) for curve in curves], plane)
        if outer is None:
            raise DomainError(
                "the curves through plane loops cross between the points, or none encloses all others",
                vertices=sum(map(len, loops)),
            )
        # the surface lies on the left of the first loop, seen from the tip of this normal
        normal = -plane.normal if outer else plane.normal
        axis = _axis(normal)
        order = (outer, *(number for number in range(len(curves)) if number != outer))
        backward = tuple(bool(loops[k].area_vector @ normal > 0) != (k == outer) for k in order)
        rims = tuple(curves[k].reversed() if flip else curves[k] for k, flip in zip(order, backward, strict=True))
        boundaries = []
        for curve in rims:
            coefficients = curve.coefficients.copy()
            coefficients[-1] -= plane.centroid
            boundaries.append(SplineBoundary(curve.breaks, coefficients @ axis, curve.corners))
        domain = PlaneDomain.inside(boundaries[0], holes=tuple(boundaries[1:]))
        spinors = np.stack(spinors_from_phi(axis.conj()[None]), axis=-1)
        constant = plane.centroid + (domain.triangulation.points[domain.root] * axis.conj()).real
        surface = ArraySurface(PowerSeries(spinors), domain, constant)
        misfits = []
        for boundary, curve in zip(boundaries, rims, strict=True):
            t = _parameters(curve)
            away = np.linalg.norm(surface.position(boundary.point(t)) - curve.point(t), axis=1)
            arcs = np.linalg.norm(curve.derivative(t), axis=1) * np.repeat(np.diff(curve.breaks), PARTS) / PARTS
            local = float((away / CurveTensors.of(curve, NUMPY).local_edge(t)).max())
            rms = float(np.average(away**2, weights=arcs)) ** 0.5
            misfits.append(Misfit(rms=rms, max=float(away.max()), max_per_local_edge=local, length=float(arcs.sum())))
        rims_result = None
        if len(curves) > 1:
            rims_result = RimsResult(
                order=order, backward=backward, antiperiodic=(False,) * (len(rims) - 1), period=surface.largest_period()
            )
        return RouteResult(
            domain=domain,
            surface_at=surface.at(problem.options.place).placed,
            curves=rims,
            matchings=tuple(np.repeat(curve.breaks[:-1, None], 2, axis=1) for curve in rims),
            misfit=Misfit.together(misfits),
            area=float(surface.area()),
            route="plane",
            limit="the distance is rounding error",
            rims_result=rims_result,
        )


PLANE = Route("plane", plane_region)


def lie_beside(loops: Sequence[BoundaryLoop]) -> bool:
    """Whether loops are coplanar, but do not bound a plane region: one loop that encloses all others, side by side.

    Such loops bound no connected minimal surface, because it would lie in their plane.
    """
    return lie_in_plane(loops, allowed=np.inf) and _outermost([loop.points for loop in loops], loops[0].plane) is None


def _outermost(rims: Sequence[Float[np.ndarray, "_ 3"]], plane: Plane) -> int | None:
    """Index of the coplanar polygon that encloses all others, or None. The others must not enclose each other."""
    axis = _axis(plane.normal)
    flat = [(points - plane.centroid) @ axis for points in rims]
    areas = [np.imag(np.conj(z) * np.roll(z, -1)).sum() for z in flat]
    first = int(np.abs(areas).argmax())
    turned = [z if (area > 0) == (k == first) else z[::-1] for k, (z, area) in enumerate(zip(flat, areas, strict=True))]
    return first if bound_domain((turned.pop(first), *turned)) else None


def _axis(normal: Float[np.ndarray, "3"]) -> Complex[np.ndarray, "3"]:
    """Complex vector u + iv of an orthonormal basis (u, v) of a plane, counter-clockwise about its normal."""
    u, v = normals_of(normal)
    return np.asarray(u + 1j * v)


def _parameters(curve: BoundaryCurve) -> Float[np.ndarray, " n"]:
    """`PARTS` parameters on each piece of a curve."""
    return (curve.breaks[:-1, None] + np.diff(curve.breaks)[:, None] * np.arange(PARTS) / PARTS).ravel()
