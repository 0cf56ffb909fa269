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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import CauchyNetwork, raw_features, sign_changing
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.poles import Poles, polygon_poles
from spinor_geom.holomorphic.series import power_sums
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.gauss_newton import gram
from spinor_geom.plateau.lift import Lift
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.through_points import (
    EdgeIntegrals,
    PointEquations,
    curve_through,
    misfit_at_points,
    nearest_through,
    nodes_on_edges,
    polygon_through,
    shares,
)
from spinor_geom.plateau.vertex_route import BELOW_ALLOWED, DEGREE, NODES, RIDGE, norm_of_edge
from spinor_geom.surface.formulas import null_vector, phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Newton steps to a point's place.
_PLACINGS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class PassedRims:
    """A minimal surface through the points of several rims, at unit size.

    Attributes:
        surface: the surface.
        curves: Γ, of each rim.
        misfit: of all points.
        area: by an integral over ∂Ω.
        period: the largest |Re ∮ φ dz| around a hole.
    """

    surface: SpinorSurface
    curves: tuple[BoundaryCurve, ...]
    misfit: Misfit
    area: float
    period: float


def surface_through(
    smooth: Lift,
    starts: Sequence[Complex[Tensor, " _"]],
    points: Sequence[Float[np.ndarray, "_ 3"]],
    *,
    allowed: float,
    on_step: Callable[[float], bool],
) -> PassedRims:
    """The surface through points next to a smooth one, as nearly as they can be met.

    Args:
        smooth: the surface over averages of the rims.
        starts: for each rim points of its circle that lie about where the points shall, as the circle runs.
        points: of each rim.
        allowed: RMS distance of the points from the surface to reach.
        on_step: gets the distance after each Newton step, and says whether there may be one more.

    Raises:
        DomainError: the rims' teeth cross in the smooth surface's tangent planes.
    """
    wanted = [torch.tensor(each, device=smooth.shift.device) for each in points]
    outer, *holes = (
        polygon_through(_nearest(smooth, z, each).cpu().numpy()) for z, each in zip(starts, wanted, strict=True)
    )
    domain = PlaneDomain.inside(outer, holes=tuple(holes))
    basis = _Basis.on(domain, smooth.series)
    start = basis.start
    here = _Passing(basis=basis, points=tuple(wanted), raw=basis.raw(start))
    readout = nearest_through(here, start, start=start, enough=BELOW_ALLOWED * allowed, on_step=on_step)
    return here.at(here.at(readout).closed(readout)).passed(domain)


def _nearest(smooth: Lift, start: Complex[Tensor, " n"], points: Float[Tensor, "n 3"]) -> Complex[Tensor, " n"]:
    """Where a surface comes nearest to points."""
    z = start
    with torch.no_grad():
        for _ in range(_PLACINGS):
            velocity = phi(*smooth.series.value(z).unbind(-1))
            away = points - smooth.shift - null_vector(*smooth.series.primitive(z).unbind(-1)).real
            z = z + 2 * (away * velocity.conj()).sum(-1) / velocity.abs().square().sum(-1)
    return z


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnRim:
    """The features on one rim of Ω, and on the way to it from the root of Ω; all times what changes sign."""

    polygon: Complex[Tensor, " n"]
    features: Complex[Tensor, "n g k"]
    own: slice  # those of the rim's own poles
    norm: Complex[Tensor, "c c"]  # L with LLᴴ the Gram matrix of the own ones in H¹
    start: Complex[Tensor, "c 2"]  # the smooth surface's own part, by features orthonormal in H¹
    way: Complex[Tensor, "w k"]
    weights: Complex[Tensor, " w"]  # dz

    def integrals(self, raw: Complex[Tensor, "k 2"]) -> EdgeIntegrals:
        """Those of the surface with given read-outs."""
        return EdgeIntegrals(polygon=self.polygon, spinors=self.features @ raw)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Basis:
    """Polynomials and Cauchy units, the outer rim's first."""

    hessenberg: Complex[Tensor, "d1 d"]
    poles: Complex[Tensor, " m"]
    scales: Float[Tensor, " m"]
    branches: Complex[Tensor, " b"]
    rims: tuple[_OnRim, ...]

    @classmethod
    def on(cls, domain: PlaneDomain, smooth: LaurentSeries) -> _Basis:
        circles = smooth.circles
        device = circles.radii.device
        branches = circles.centres[torch.tensor(smooth.antiperiodic, device=device)]
        beside = [polygon_poles(boundary.vertices, most=2 * len(boundary.vertices)) for boundary in domain.boundaries]
        if domain.contains(circles.centres.cpu().numpy()).any():
            raise DomainError("a hole of Ω is too narrow for the teeth of its rim", vertices=len(domain.vertices))
        for number, centre in enumerate(circles.centres.tolist(), 1):
            beside[number] += _deep_poles(domain.boundaries[number].vertices, centre)
        poles = torch.as_tensor(np.concatenate([each.positions for each in beside]), device=device)
        scales = torch.as_tensor(np.concatenate([each.scales for each in beside]), device=device)
        polygons = [torch.as_tensor(boundary.vertices, device=device) for boundary in domain.boundaries]
        nodes = [nodes_on_edges(polygon, NODES) for polygon in polygons]
        weight = shares(polygons[0])[:, None] * torch.tensor(rule("gauss", NODES).weights, device=device)
        hessenberg = arnoldi_hessenberg(nodes[0].reshape(-1), weight.reshape(-1), DEGREE)
        # the polynomials are the outer rim's own
        ends = [0, *(len(hessenberg) + np.cumsum([len(each.positions) for each in beside])).tolist()]
        edge_norm = norm_of_edge(NODES, device).to(poles)
        rims = []
        for number, (polygon, z) in enumerate(zip(polygons, nodes, strict=True)):
            features = raw_features(z, hessenberg, poles, scales)
            own = slice(*ends[number : number + 2])
            weighted = edge_norm @ features[..., own] * shares(polygon).sqrt()[:, None, None]
            matrix = gram(weighted.flatten(0, 1))
            matrix.diagonal().add_(RIDGE * matrix.diagonal().real.mean())
            norm = torch.linalg.cholesky(matrix)
            part = edge_norm @ _part(smooth, z, number) * shares(polygon).sqrt()[:, None, None]
            way, dz = _way(domain, number, device)
            rims.append(
                _OnRim(
                    polygon=polygon,
                    features=features.mul_(sign_changing(z, branches)[..., None]),
                    own=own,
                    norm=norm,
                    start=torch.linalg.solve_triangular(
                        norm, weighted.flatten(0, 1).mH @ part.flatten(0, 1), upper=False
                    ),
                    way=raw_features(way, hessenberg, poles, scales) * sign_changing(way, branches)[..., None],
                    weights=dz,
                )
            )
        return cls(hessenberg=hessenberg, poles=poles, scales=scales, branches=branches, rims=tuple(rims))

    @property
    def start(self) -> Complex[Tensor, "k 2"]:
        """Read-outs of the smooth surface."""
        return torch.cat([rim.start for rim in self.rims])

    def raw(self, readout: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """Of the features themselves from read-outs of those that are orthonormal in H¹ on their own rims."""
        return torch.cat(
            [torch.linalg.solve_triangular(rim.norm.mH, readout[rim.own], upper=True) for rim in self.rims]
        )

    def orthonormal(self, rows: Complex[Tensor, "r k"]) -> Complex[Tensor, "k r"]:
        """Conjugates of functions of the features as functions of the orthonormal ones."""
        return torch.cat(
            [torch.linalg.solve_triangular(rim.norm, rows[:, rim.own].mH, upper=False) for rim in self.rims]
        )

    def network(self, raw: Complex[Tensor, "k 2"]) -> CauchyNetwork:
        """The network with read-outs of the features themselves."""
        return CauchyNetwork.of_raw_features(
            self.rims[0].polygon,
            hessenberg=self.hessenberg,
            poles=self.poles,
            scales=self.scales,
            readout=raw,
            branches=self.branches,
        )


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Passing:
    """A surface on its way through the points of all rims."""

    basis: _Basis
    points: tuple[Float[Tensor, "_ 3"], ...]
    raw: Complex[Tensor, "k 2"]

    @cached_property
    def _integrals(self) -> tuple[EdgeIntegrals, ...]:
        return tuple(rim.integrals(self.raw) for rim in self.basis.rims)

    @cached_property
    def _on_ways(self) -> tuple[Complex[Tensor, "w 2"], ...]:
        return tuple(rim.way @ self.raw for rim in self.basis.rims)

    @cached_property
    def error(self) -> Float[Tensor, "n 3"]:
        """What the points are off, their mean at 0, and below it by how much r does not close around each hole."""
        rows = []
        for rim, values, along, points in zip(
            self.basis.rims, self._on_ways, self._integrals, self.points, strict=True
        ):
            first = (phi(*values.unbind(-1)) * rim.weights[:, None]).sum(0).real
            rows.append(first + along.starts - points)
        error = torch.cat(rows)
        return torch.cat([error - error.mean(0), *(along.gap[None] for along in self._integrals[1:])])

    def at(self, readout: Complex[Tensor, "k 2"]) -> _Passing:
        """The surface of other read-outs."""
        return replace(self, raw=self.basis.raw(readout))

    def linearised(self) -> PointEquations:
        """How the error changes with the read-outs."""
        by_points, by_gaps = [], []
        for rim, values, along in zip(self.basis.rims, self._on_ways, self._integrals, strict=True):
            over_edge = along.changes(rim.features).transpose(0, 1)
            total = over_edge.cumsum(1)
            to_first = 2 * (values * rim.weights[:, None]).mT @ rim.way
            by_points.append(total - over_edge + to_first[:, None])
            by_gaps.append(total[:, -1:])
        points = torch.cat(by_points, dim=1)
        rows = torch.cat([points - points.mean(1, keepdim=True), *by_gaps[1:]], dim=1)
        return PointEquations.of(*(self.basis.orthonormal(part) for part in rows))

    def closed(self, readout: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """The read-outs of the nearest surface that closes around all holes, to first order."""
        rows = [along.changes(rim.features).sum(0) for rim, along in zip(self.basis.rims, self._integrals, strict=True)]
        equations = PointEquations.of(*(self.basis.orthonormal(part) for part in torch.stack(rows[1:], dim=1)))
        return readout + equations.step(torch.stack([along.gap for along in self._integrals[1:]]), None)

    def passed(self, domain: PlaneDomain) -> PassedRims:
        """The surface, its distances from the points told by integrals along ∂Ω with twice as many nodes."""
        surface = SpinorSurface(self.basis.network(self.raw), domain).to(self.raw.device)
        rims = surface.rim_primitives(2 * NODES)
        starts = surface.position(np.array([boundary.vertices[0] for boundary in domain.boundaries]))
        places = [start + rim.at_breaks.real for start, rim in zip(starts, rims, strict=True)]
        error = np.concatenate([place[:-1] for place in places]) - torch.cat(self.points).cpu().numpy()
        with torch.no_grad():
            surface.constant.sub_(surface.constant.new_tensor(error.mean(0)))
        off = np.split(error - error.mean(0), np.cumsum([len(each) for each in self.points])[:-1])
        curves, misfits = [], []
        for rim, own, points in zip(rims, off, self.points, strict=True):
            velocity = rim.velocity.real.reshape(len(own), -1, 3) * np.diff(rim.panels.breaks)[:, None, None]
            curves.append(curve_through(points.cpu().numpy(), velocity, own))
            misfits.append(misfit_at_points(curves[-1], own))
        area = sum(
            rim.area + 0.5 * float(start @ rim.at_breaks[-1].imag) for start, rim in zip(starts, rims, strict=True)
        )
        return PassedRims(
            surface=surface,
            curves=tuple(curves),
            misfit=Misfit.together(misfits),
            area=area,
            period=max(float(np.linalg.norm(rim.at_breaks[-1].real)) for rim in rims[1:]),
        )
