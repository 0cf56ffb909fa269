"""The route for several rough rims: the minimal surface through their points that is nearest to a smooth one.

As for one rough rim (see `vertex_route`) Γ is the surface's own boundary between the points. The smooth surface lies
over averages of the rims, on a circular domain. Where it comes nearest to each point, along its tangent planes, is the
point's place, and the polygons through these places, circles with the rims' teeth, bound Ω; p and q, Laurent series, go
on across the circles. What is left is to move the points along the normals: three equations a point, and three a hole
for Re ∮ φ dz = 0, for more coefficients of the series. Of their solutions the one nearest to the smooth surface is
taken, in the H¹ norm on ∂Ω, by Newton's method. Nothing slides, and no modulus changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import power_table
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
)
from spinor_geom.plateau.traces import OnCircles, closed
from spinor_geom.surface.formulas import null_vector, phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Gauss-Legendre nodes on each edge of Ω: 14 leave 9e-5 of an edge where 12 leave 1e-2.
_NODES = 16
# Powers of each circle's coordinate for each of its points: 0.75 have as many unknowns as there are equations.
_POWERS = 2.0
# Distance of the series' circles from the teeth, in mean edges.
_MARGIN = 0.4
# Powers of a circle's coordinate that are smaller on all of another rim are left away there.
_NEGLIGIBLE = 1e-9
# The Gram matrices' diagonals are raised by this share of their mean: high powers are nearly dependent on teeth.
_RIDGE = 1e-10
# Newton steps to a point's place.
_PLACINGS = 3
# Newton's method goes on to this share of the distance allowed.
_BELOW_ALLOWED = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class PassedRims:
    """A minimal surface through the points of several rims, at unit size.

    Attributes:
        surface: the surface.
        curves: Γ, of each rim.
        misfit: of all points.
        period: the largest |Re ∮ φ dz| around a hole.
    """

    surface: SpinorSurface
    curves: tuple[BoundaryCurve, ...]
    misfit: Misfit
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
    places = [_nearest(smooth, z, each).cpu().numpy() for z, each in zip(starts, wanted, strict=True)]
    edges = [float(np.abs(np.roll(z, -1) - z).mean()) for z in places]
    # the series' outer circle is the unit circle
    unit = float(np.abs(places[0]).max()) + _MARGIN * edges[0]
    outer, *holes = (z / unit for z in places)
    domain = PlaneDomain.inside(polygon_through(outer), holes=tuple(map(polygon_through, holes)))
    before = smooth.series.circles
    centres = before.centres / unit
    radii = [
        float(np.abs(hole - centre).min()) - _MARGIN * edge / unit
        for hole, centre, edge in zip(holes, centres.tolist(), edges[1:], strict=True)
    ]
    if min(radii) <= 0:
        raise DomainError("a hole of Ω is too narrow for the teeth of its rim", vertices=len(domain.vertices))
    circles = CircularDomain(centres=centres, log_radii=before.radii.new_tensor(radii).log())
    basis = _Basis.on(domain, circles, smooth.series.antiperiodic)
    here = _Passing(basis=basis, points=tuple(wanted), coefficients=_continued(smooth.series, basis, unit))
    start = basis.orthonormal(here.coefficients)
    readout = nearest_through(here, start, start=start, enough=_BELOW_ALLOWED * allowed, on_step=on_step)
    return here.at(readout).passed(domain)


def _nearest(smooth: Lift, start: Complex[Tensor, " n"], points: Float[Tensor, "n 3"]) -> Complex[Tensor, " n"]:
    """Where a surface comes nearest to points."""
    z = start
    with torch.no_grad():
        for _ in range(_PLACINGS):
            velocity = phi(*smooth.series.value(z).unbind(-1))
            away = points - smooth.shift - null_vector(*smooth.series.primitive(z).unbind(-1)).real
            z = z + 2 * (away * velocity.conj()).sum(-1) / velocity.abs().square().sum(-1)
    return z


def _continued(model: LaurentSeries, basis: _Basis, unit: float) -> Complex[Tensor, "k 2"]:
    """The coefficients of a series on circles of other radii, in a unit of length of its domain."""
    before = model.circles
    # p and q are half a differential, and so is each root
    factor = unit ** ((1 + sum(model.antiperiodic)) / 2)
    ratios = [unit, *(before.radii / unit / basis.circles.radii).tolist()]
    parts = []
    for number, (ratio, count, part) in enumerate(
        zip(ratios, basis.powers, [model.outward, *model.inward], strict=True)
    ):
        own = part.new_zeros(count, 2)
        kept = min(count, len(part))
        k = torch.arange(kept, dtype=before.radii.dtype, device=part.device) + (number > 0)
        own[:kept] = part[:kept].detach() * (factor * ratio**k)[:, None]
        parts.append(own)
    return torch.cat(parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnRim:
    """Powers of the circles' coordinates on one rim of Ω, and on the way to it from the root of Ω."""

    polygon: Complex[Tensor, " n"]
    root: Complex[Tensor, "n g"]  # the square of what p and q are divided by
    features: Complex[Tensor, "n g k"]
    columns: Int[Tensor, " k"]  # of all powers those that are not negligible here
    norm: Complex[Tensor, "c c"]  # L with LLᴴ the Gram matrix of the rim's own powers in H¹
    way: Complex[Tensor, "w all"]  # all powers on the way
    weights: Complex[Tensor, " w"]  # dz there, times the square of the root

    def integrals(self, coefficients: Complex[Tensor, "all 2"]) -> EdgeIntegrals:
        """Those of the surface with given coefficients."""
        spinors = self.features @ coefficients[self.columns]
        return EdgeIntegrals(polygon=self.polygon, spinors=spinors * self.root.sqrt()[..., None])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Basis:
    """Powers of the coordinates of circles around Ω, the outer circle's first."""

    circles: CircularDomain
    antiperiodic: tuple[bool, ...]
    powers: list[int]
    rims: tuple[_OnRim, ...]

    @classmethod
    def on(cls, domain: PlaneDomain, circles: CircularDomain, antiperiodic: tuple[bool, ...]) -> _Basis:
        powers = [math.ceil(_POWERS * len(boundary.vertices)) for boundary in domain.boundaries]
        device, first = circles.radii.device, np.cumsum([0, *powers]).tolist()
        rims = []
        for number, boundary in enumerate(domain.boundaries):
            polygon = torch.as_tensor(boundary.vertices, device=device)
            z = nodes_on_edges(polygon, _NODES)
            root, zeta = circles.squared_root(z, antiperiodic), circles.coordinates(z)
            largest = zeta.abs().amax((1, 2)).tolist()
            counts = [
                most if j == number else min(most, 1 + math.ceil(math.log(_NEGLIGIBLE) / math.log(largest[j])))
                for j, most in enumerate(powers)
            ]
            parts = [_own_powers(zeta[j], count, of_hole=j > 0) for j, count in enumerate(counts)]
            norm = gram(_in_h1(parts[number], z, polygon, centre=circles.centres[number - 1] if number else None))
            norm *= root.abs().mean()
            norm.diagonal().add_(_RIDGE * norm.diagonal().real.mean())
            on_way, dz = _way(domain, number, device)
            zeta = circles.coordinates(on_way)
            rims.append(
                _OnRim(
                    polygon=polygon,
                    root=root,
                    features=torch.cat(parts, dim=-1),
                    columns=torch.cat(
                        [torch.arange(a, a + count, device=z.device) for a, count in zip(first, counts, strict=False)]
                    ),
                    norm=torch.linalg.cholesky(norm),
                    way=torch.cat([_own_powers(zeta[j], most, of_hole=j > 0) for j, most in enumerate(powers)], dim=-1),
                    weights=dz * circles.squared_root(on_way, antiperiodic),
                )
            )
        return cls(circles=circles, antiperiodic=antiperiodic, powers=powers, rims=tuple(rims))

    def coefficients(self, readout: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """Of the powers themselves from read-outs of those that are orthonormal in H¹ on their own rims."""
        parts = zip(self.rims, torch.split(readout, list(self.powers)), strict=True)
        return torch.cat([torch.linalg.solve_triangular(rim.norm.mH, part, upper=True) for rim, part in parts])

    def orthonormal(self, coefficients: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """The other way round."""
        parts = zip(self.rims, torch.split(coefficients, list(self.powers)), strict=True)
        return torch.cat([rim.norm.mH @ part for rim, part in parts])

    def model(self, coefficients: Complex[Tensor, "k 2"]) -> LaurentSeries:
        """The series, with the residues of φ made real."""
        outward, *inward = torch.split(coefficients, list(self.powers))
        # a hole's own powers begin with the first
        rows = [outward, *(torch.nn.functional.pad(part, (0, 0, 1, 0)) for part in inward)]
        own = torch.nn.utils.rnn.pad_sequence(rows, batch_first=True).permute(2, 0, 1)[None]
        traces = OnCircles(domain=self.circles, nodes=2 * own.shape[-1], antiperiodic=self.antiperiodic)
        (spinors,), _, _ = closed(traces, own, traces.weights(2 * traces.nodes))
        return traces.laurent(spinors)


def _own_powers(zeta: Complex[Tensor, "*pts"], count: int, *, of_hole: bool) -> Complex[Tensor, "*pts k"]:
    """The powers of a circle's coordinate that a Laurent series has: from the first for holes, else from the zeroth."""
    table = power_table(zeta, count).movedim(0, -1)
    return zeta[..., None] * table if of_hole else table


def _in_h1(
    powers: Complex[Tensor, "n g k"],
    z: Complex[Tensor, "n g"],
    polygon: Complex[Tensor, " n"],
    *,
    centre: Complex[Tensor, ""] | None,
) -> Complex[Tensor, "_ k"]:
    """Rows whose squares sum to ∫ |f|² + |f′|² |dz| of powers of a coordinate, f′ by edges; z itself has no centre."""
    edge = (polygon.roll(-1) - polygon).abs()[:, None, None]
    weights = torch.tensor(rule("gauss", z.shape[1]).weights, device=z.device)[:, None]
    k = torch.arange(powers.shape[-1], dtype=edge.dtype, device=z.device)
    slopes = powers * (k if centre is None else k + 1) / (z if centre is None else z - centre)[..., None] * edge
    return (torch.stack([powers, slopes]) * (weights * edge).sqrt()).flatten(0, 2)


def _way(domain: PlaneDomain, number: int, device: torch.device) -> tuple[Complex[Tensor, " w"], Complex[Tensor, " w"]]:
    """Quadrature nodes from the root of Ω to the first vertex of a rim, and dz times their weights."""
    way = [sum(len(boundary.vertices) for boundary in domain.boundaries[:number])]
    while way[-1] != domain.root:
        way.append(int(domain.paths.parent[way[-1]]))
    corners = torch.as_tensor(domain.triangulation.points[way[::-1]], device=device)
    nodes, weights = (torch.tensor(part, device=device) for part in rule("gauss", _NODES))
    step = corners.diff()[:, None]
    return (corners[:-1, None] + nodes * step).flatten(), (weights * step).flatten()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Passing:
    """A surface on its way through the points of all rims."""

    basis: _Basis
    points: tuple[Float[Tensor, "_ 3"], ...]
    coefficients: Complex[Tensor, "k 2"]

    @cached_property
    def _integrals(self) -> tuple[EdgeIntegrals, ...]:
        return tuple(rim.integrals(self.coefficients) for rim in self.basis.rims)

    @cached_property
    def _on_ways(self) -> tuple[Complex[Tensor, "w 2"], ...]:
        return tuple(rim.way @ self.coefficients for rim in self.basis.rims)

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
        return replace(self, coefficients=self.basis.coefficients(readout))

    def linearised(self) -> PointEquations:
        """How the error changes with the read-outs."""
        n, holes = sum(map(len, self.points)), len(self.points) - 1
        rows = self.coefficients.new_zeros(2, n + holes, len(self.coefficients))
        start = 0
        for number, (rim, values, along) in enumerate(
            zip(self.basis.rims, self._on_ways, self._integrals, strict=True)
        ):
            over_edge = along.changes(rim.features * rim.root.sqrt()[..., None]).transpose(0, 1)
            total = over_edge.cumsum(1)
            own = slice(start, start + len(rim.polygon))
            rows[:, own, rim.columns] = total - over_edge
            rows[:, own] += (2 * (values * rim.weights[:, None]).mT @ rim.way)[:, None]
            if number:
                rows[:, n + number - 1, rim.columns] = total[:, -1]
            start = own.stop
        rows[:, :n] -= rows[:, :n].mean(1, keepdim=True)
        return PointEquations.of(*(self._orthonormal(part) for part in rows))

    def _orthonormal(self, rows: Complex[Tensor, "r k"]) -> Complex[Tensor, "k r"]:
        parts = zip(self.basis.rims, torch.split(rows, list(self.basis.powers), dim=1), strict=True)
        return torch.cat([torch.linalg.solve_triangular(rim.norm, part.mH, upper=False) for rim, part in parts])

    def passed(self, domain: PlaneDomain) -> PassedRims:
        """The surface, its distances from the points told by its series in closed form."""
        model = self.basis.model(self.coefficients)
        surface = SpinorSurface(model, domain).to(self.coefficients.device)
        points = torch.cat(self.points).cpu().numpy()
        error = surface.position(domain.vertices) - points
        with torch.no_grad():
            surface.constant.sub_(surface.constant.new_tensor(error.mean(0)))
        off = np.split(error - error.mean(0), np.cumsum([len(each) for each in self.points])[:-1])
        curves = tuple(
            curve_through(each.cpu().numpy(), along.velocity.real.cpu().numpy(), own)
            for along, each, own in zip(self._integrals, self.points, off, strict=True)
        )
        misfits = [misfit_at_points(curve, own) for curve, own in zip(curves, off, strict=True)]
        period = float((2 * math.pi * null_vector(*model.residues().detach().unbind(-1)).imag).norm(dim=-1).max())
        return PassedRims(surface=surface, curves=curves, misfit=Misfit.together(misfits), period=period)
