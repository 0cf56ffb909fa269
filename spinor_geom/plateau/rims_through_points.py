"""The route for several rough rims: the minimal surface through their points that is nearest to a smooth one.

As for one rough rim (see `vertex_route`) Γ is the surface's own boundary between the points. The smooth surface lies
over averages of the rims, on a circular domain. Where it comes nearest to each point, along its tangent planes, is the
point's place, and the polygons through these places, circles with the rims' teeth, bound Ω. p and q are sums of Cauchy
units, beside each edge for the teeth, and deeper in each hole and as polynomials for what is smooth: places crowd where
a rim comes near to another one, and powers of the circles' coordinates would be as coarse there as elsewhere. What is
left is to move the points along the normals: three equations a point, and three a hole for Re ∮ φ dz = 0, for more
read-outs. Of their solutions the one nearest to the smooth surface is taken, in the H¹ norm on ∂Ω, by Newton's method.
Nothing slides, and no modulus changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.poles import Poles, polygon_poles
from spinor_geom.holomorphic.series import power_sums
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.lift import Lift
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.through_points import (
    DEGREE,
    NODES,
    Basis,
    Passing,
    curve_through,
    misfit_at_points,
    nearest_through,
    nodes_on_edges,
    polygon_through,
)
from spinor_geom.surface.formulas import null_vector, phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Newton steps to a point's place.
_PLACINGS = 3


def surface_through(
    smooth: Lift,
    starts: Sequence[Complex[Tensor, " _"]],
    points: Sequence[Float[np.ndarray, "_ 3"]],
    *,
    allowed: float,
    steps: Steps,
) -> Found:
    """The surface through points next to a smooth one over averages of the rims, as nearly as they can be met.

    The starts are points of each rim's circle that lie about where its points shall.

    Raises:
        DomainError: the rims' teeth cross in the smooth surface's tangent planes.
    """
    wanted = [torch.tensor(each, device=smooth.shift.device) for each in points]
    outer, *holes = (
        polygon_through(_nearest(smooth, z, each).cpu().numpy()) for z, each in zip(starts, wanted, strict=True)
    )
    domain = PlaneDomain.inside(outer, holes=tuple(holes))
    basis, start = _basis(domain, smooth.series)
    here = Passing(basis=basis, points=tuple(wanted), raw=basis.raw(start))
    readout = nearest_through(here, start, start=start, allowed=allowed, steps=steps)
    return _passed(here.at(here.at(readout).closed(readout)), domain)


def _nearest(smooth: Lift, start: Complex[Tensor, " n"], points: Float[Tensor, "n 3"]) -> Complex[Tensor, " n"]:
    """Where a surface comes nearest to points."""
    z = start
    with torch.no_grad():
        for _ in range(_PLACINGS):
            velocity = phi(*smooth.series.value(z).unbind(-1))
            away = points - smooth.shift - null_vector(*smooth.series.primitive(z).unbind(-1)).real
            z = z + 2 * (away * velocity.conj()).sum(-1) / velocity.abs().square().sum(-1)
    return z


def _basis(domain: PlaneDomain, smooth: LaurentSeries) -> tuple[Basis, Complex[Tensor, "k 2"]]:
    """The features on the rims of Ω, and their orthonormal read-outs for the smooth surface."""
    circles = smooth.circles
    device = circles.radii.device
    poles = [polygon_poles(boundary.vertices) for boundary in domain.boundaries]
    if domain.contains(circles.centres.cpu().numpy()).any():
        raise DomainError("a hole of Ω is too narrow for the teeth of its rim", vertices=len(domain.vertices))
    for number, centre in enumerate(circles.centres.tolist(), 1):
        poles[number] += _deep_poles(domain.boundaries[number].vertices, centre)
    basis = Basis.on(
        [torch.as_tensor(boundary.vertices, device=device) for boundary in domain.boundaries],
        poles,
        [_way(domain, number, device) for number in range(len(domain.boundaries))],
        circles.centres[torch.tensor(smooth.antiperiodic, device=device)],
        nodes=NODES,
    )
    parts = [_part(smooth, nodes_on_edges(rim.polygon, NODES), number) for number, rim in enumerate(basis.rims)]
    return basis, torch.cat([rim.nearest(part) for rim, part in zip(basis.rims, parts, strict=True)])


def _deep_poles(hole: Complex[np.ndarray, " n"], centre: complex) -> Poles:
    """Poles halfway to the middle of a hole, for what is smooth around it: as many as there are polynomials."""
    turn = np.exp(2j * np.pi * np.arange(DEGREE + 1) / (DEGREE + 1))
    radius = np.abs(hole - centre).min() / 2
    return Poles(positions=centre + radius * turn, scales=np.full(DEGREE + 1, radius))


def _part(smooth: LaurentSeries, z: Complex[Tensor, "*pts"], number: int) -> Complex[Tensor, "*pts 2"]:
    """What one circle's powers bring to p and q, without what changes sign."""
    zeta = smooth.circles.coordinates(z)[number]
    if number == 0:
        return power_sums(zeta, smooth.outward.detach())
    return zeta[..., None] * power_sums(zeta, smooth.inward[number - 1].detach())


def _way(domain: PlaneDomain, number: int, device: torch.device) -> tuple[Complex[Tensor, " w"], Complex[Tensor, " w"]]:
    """Quadrature nodes from the root of Ω to the first vertex of a rim, and dz times their weights."""
    way = [sum(len(boundary.vertices) for boundary in domain.boundaries[:number])]
    while way[-1] != domain.root:
        way.append(int(domain.paths.parent[way[-1]]))
    corners = torch.as_tensor(domain.triangulation.points[way[::-1]], device=device)
    nodes, weights = (torch.tensor(part, device=device) for part in rule("gauss", NODES))
    step = corners.diff()[:, None]
    return (corners[:-1, None] + nodes * step).flatten(), (weights * step).flatten()


def _passed(here: Passing, domain: PlaneDomain) -> Found:
    """The surface, its distances from the points told by integrals along ∂Ω with twice as many nodes."""
    surface = SpinorSurface(here.basis.network(here.raw), domain).to(here.raw.device)
    rims = surface.rim_primitives(2 * NODES)
    starts = surface.position(np.array([boundary.vertices[0] for boundary in domain.boundaries]))
    places = [start + rim.at_breaks.real for start, rim in zip(starts, rims, strict=True)]
    error = np.concatenate([place[:-1] for place in places]) - torch.cat(here.points).cpu().numpy()
    with torch.no_grad():
        surface.constant.sub_(surface.constant.new_tensor(error.mean(0)))
    off = np.split(error - error.mean(0), np.cumsum([len(each) for each in here.points])[:-1])
    curves, misfits = [], []
    for rim, own, points in zip(rims, off, here.points, strict=True):
        velocity = rim.velocity.real.reshape(len(own), -1, 3) * np.diff(rim.panels.breaks)[:, None, None]
        curves.append(curve_through(points.cpu().numpy(), velocity, own))
        misfits.append(misfit_at_points(curves[-1], own))
    area = sum(rim.area + 0.5 * float(start @ rim.at_breaks[-1].imag) for start, rim in zip(starts, rims, strict=True))
    return Found(
        surface=surface,
        curves=tuple(curves),
        matchings=tuple(
            np.column_stack([boundary.parameters[:-1], curve.breaks[:-1]])
            for boundary, curve in zip(domain.boundaries, curves, strict=True)
        ),
        misfit=Misfit.together(misfits),
        area=area,
        route="vertices",
        limit="no minimal surface near that over averages of the rims passes through their points more nearly",
    )
