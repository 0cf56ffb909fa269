"""The route for rough rims: the minimal surface through a rim's points that is nearest to a discrete one.

Of a mesh's rim only the points are in the mesh. Between them Γ is free, and a rim that was cut along triangles says
nothing of it: so Γ is the surface's own boundary there. What is left to ask for is that the surface passes through n
points, 3n equations for the read-outs of p and q, far fewer than there are read-outs. Of their solutions the one is
taken that is nearest to p and q of a discrete minimal disk, in the H¹ norm on ∂Ω: p and q hardly vary along an edge,
and Γ keeps near to the rim's edges. Ω is that disk flattened with its boundary lengths kept, a polygon whose vertices
are matched with the rim's points; nothing slides, nothing crowds, and two to six Newton steps are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import Flattening, flatten
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import CauchyNetwork, raw_features
from spinor_geom.holomorphic.poles import Poles, polygon_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.gauss_newton import gram
from spinor_geom.plateau.start import images_in_plane, lifted_spinors
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.through_points import (
    EdgeIntegrals,
    PointEquations,
    curve_through,
    misfit_at_points,
    nearest_through,
    nodes_on_edges,
    polygon_through,
    rms,
    shares,
)
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.interior import RimPrimitive
from spinor_geom.surface.spinor_surface import SpinorSurface

# Gauss-Legendre nodes on each edge while p and q are sought; with twice as many it is told how near the surface comes,
# and sought again where that is not near enough: 1 rim in 25 of those cut along triangles, with 10 nodes every third.
_NODES = 14
# Degree on each edge up to which the H¹ norm sees p and q: they hardly vary along one.
_NORM_DEGREE = 6
# Degree of the polynomials, and the most Cauchy units on rims of up to as many points: the cost grows like the cube.
_DEGREE, _MOST_UNITS = 24, 800
# The Gram matrix's diagonal is raised by this share of its mean: units with neighbouring poles are nearly dependent.
_RIDGE = 1e-9
# Newton steps go on to this share of the distance allowed.
_BELOW_ALLOWED = 0.3
# A start that is as many edges away from the points has never led to a surface through them.
_FAR = 4.0
# A surface whose boundary leaves the loop's edges by so many edges would cross what is beside them.
_LARGEST_BULGE = 2.0


def disk_through_points(
    loop: BoundaryLoop, *, allowed: float, steps: Steps, device: torch.device, clock: Clock
) -> Found:
    """The minimal disk through the points of a rough loop, as nearly as they can be met.

    Args:
        loop: at unit size.
        allowed: RMS distance of its points from the surface to reach.
        steps: gets those of Newton's method.
        device: where the linear algebra runs.
        clock: of the stages.

    Raises:
        FirstFillError: no discrete disk over the loop was found.
        DomainError: it has no simple flattening, or one with an edge of no length.
        SingularMatrixError: the discrete disk is degenerate.
        SurfaceError: no surface near the discrete one comes near to the points.
    """
    points = loop.points
    with clock.stage("first fill"):
        disk = first_disk(points)
    with clock.stage("flattening"):
        flat = flatten(disk.vertices, disk.faces, len(points))
        images = images_in_plane(disk.vertices, disk.faces, flat.boundary)
        domain = _domain(disk.faces, images, flat)
        spinors = lifted_spinors(disk.vertices, disk.faces, images, (len(points),), device)
    raw: Complex[Tensor, "k 2"] | None = None
    for nodes in (_NODES, 2 * _NODES):
        with clock.stage("features"):
            basis = _Basis.on(flat.boundary, nodes, device)
        with clock.stage("fit"):
            raw = _fitted(basis, spinors, raw, loop, allowed, steps)
        with clock.stage("surface"):
            network = basis.network(raw)
            rim = RimPrimitive.along(domain.boundary, partial(_phi_of, network), 2 * nodes)
            error = rim.at_breaks[:-1].real - points
            error -= error.mean(axis=0)
        if np.linalg.norm(error) <= allowed * len(points) ** 0.5 or is_out_of_time():
            break
    with clock.stage("surface"):
        velocity = rim.velocity.real.reshape(len(points), -1, 3) * np.diff(rim.panels.breaks)[:, None, None]
        curve = curve_through(points, velocity, error)
        bulge = curve.bulge() / loop.mean_edge_length
        if not bulge <= _LARGEST_BULGE:
            raise SurfaceError(
                f"the surface through the loop's points goes {bulge:.1f} edges away from the edges between them"
            )
        root = domain.root
        at_root = rim.at_breaks[root] if root < len(points) else rim.inside(domain.triangulation.points[[root]])[0]
        return Found(
            surface=SpinorSurface(network, domain, points[0] + error[0] + at_root.real).to(device),
            curves=(curve,),
            matchings=(np.column_stack([domain.boundary.parameters[:-1], curve.breaks[:-1]]),),
            misfit=misfit_at_points(curve, error),
            area=rim.area,
            route="vertices",
            limit="no minimal surface near the discrete one passes through the loop's points more nearly",
        )


def _fitted(
    basis: _Basis,
    spinors: Complex[Tensor, "n 2"],
    raw: Complex[Tensor, "k 2"] | None,
    loop: BoundaryLoop,
    allowed: float,
    steps: Steps,
) -> Complex[Tensor, "k 2"]:
    """Read-outs of the features that meet the loop's points, nearest to p and q of a start in the norm of the basis.

    Args:
        basis: of p and q.
        spinors: p and q of the start in the middle of each edge.
        raw: read-outs to set out from; none for the start's.
        loop: at unit size.
        allowed: RMS distance of its points.
        steps: gets those that are done.
    """
    start = basis.nearest(spinors)
    readout = start if raw is None else basis.norm.mH @ raw
    wanted = torch.tensor(loop.points, device=start.device)
    here = _Passing(basis=basis, points=wanted, rim=basis.rim(readout))
    in_edges = rms(here.error) / loop.mean_edge_length
    if not in_edges <= _FAR:
        raise SurfaceError(
            "the flattened discrete disk over the loop is too far from conformal: p and q of its frames lead "
            f"{in_edges:.0f} edges away from the points"
        )

    def told(distance: float) -> bool:
        steps.take("Newton", distance)
        return steps.left > 0

    if steps.left:
        readout = nearest_through(here, readout, start=start, enough=_BELOW_ALLOWED * allowed, on_step=told)
    return basis.raw(readout)


def _domain(faces: Int[np.ndarray, "f 3"], images: Complex[np.ndarray, " n"], flat: Flattening) -> PlaneDomain:
    """Inside the flattened boundary, with the disk's own triangles where they have a place there."""
    boundary = polygon_through(flat.boundary)
    a, b, c = images[faces].T
    if not ((np.conj(b - a) * (c - a)).imag > 0).all():
        return PlaneDomain.inside(boundary, flat.log_scale)
    mesh = PlaneTriangulation(points=images, faces=faces, boundary_size=len(flat.boundary))
    return PlaneDomain(boundary=boundary, triangulation=mesh, log_scale=flat.log_scale)


def _phi_of(network: CauchyNetwork, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
    with torch.no_grad():
        spinors = network.value(torch.from_numpy(z).to(network.poles.device))
        return np.asarray(phi(*spinors.unbind(-1)).cpu())


@dataclass(frozen=True, kw_only=True, eq=False)
class _Basis:
    """Polynomials and Cauchy units on the edges of a polygon, and the H¹ norm of their sums on it."""

    polygon: Complex[Tensor, " n"]
    hessenberg: Complex[Tensor, "d1 d"]
    poles: Complex[Tensor, " m"]
    scales: Float[Tensor, " m"]
    features: Complex[Tensor, "n g k"]
    norm: Complex[Tensor, "k k"]  # L with LLᴴ the Gram matrix in H¹

    @classmethod
    def on(cls, vertices: Complex[np.ndarray, " n"], nodes: int, device: torch.device) -> _Basis:
        n = len(vertices)
        poles: Poles = polygon_poles(vertices, most=max(_MOST_UNITS, n))
        polygon = torch.as_tensor(vertices, device=device)
        positions = torch.as_tensor(poles.positions, device=device)
        scales = torch.as_tensor(poles.scales, device=device)
        z = nodes_on_edges(polygon, nodes)
        weight = shares(polygon)[:, None] * torch.tensor(rule("gauss", nodes).weights, device=device)
        hessenberg = arnoldi_hessenberg(z.reshape(-1), weight.reshape(-1), min(_DEGREE, max(2, n // 2)))
        features = raw_features(z, hessenberg, positions, scales)
        root = _norm_of_edge(nodes, device).to(features) * shares(polygon).sqrt()[:, None, None]
        matrix = gram((root @ features).flatten(0, 1))
        matrix.diagonal().add_(_RIDGE * matrix.diagonal().real.mean())
        return cls(
            polygon=polygon,
            hessenberg=hessenberg,
            poles=positions,
            scales=scales,
            features=features,
            norm=torch.linalg.cholesky(matrix),
        )

    @property
    def nodes(self) -> int:
        """Number on each edge."""
        return self.features.shape[1]

    def raw(self, readout: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """Read-outs of the features themselves from those of the features that are orthonormal in H¹."""
        raw: Tensor = torch.linalg.solve_triangular(self.norm.mH, readout, upper=True)
        return raw

    def nearest(self, spinors: Complex[Tensor, "n 2"]) -> Complex[Tensor, "k 2"]:
        """Orthonormal read-outs of the sums nearest in H¹ to values in the middle of each edge and linear between."""
        place = torch.tensor(rule("gauss", self.nodes).nodes, device=self.polygon.device)[:, None]
        edge = shares(self.polygon)[:, None, None]
        before, after = spinors.roll(1, 0)[:, None], spinors.roll(-1, 0)[:, None]
        back = (0.5 - place).clamp(min=0) * edge * 2 / (edge + edge.roll(1, 0))
        ahead = (place - 0.5).clamp(min=0) * edge * 2 / (edge + edge.roll(-1, 0))
        wanted = (1 - back - ahead) * spinors[:, None] + back * before + ahead * after
        factor = _norm_of_edge(self.nodes, wanted.device).to(wanted)
        weighted = (factor.mT @ (factor @ wanted) * edge).flatten(0, 1)
        nearest: Tensor = torch.linalg.solve_triangular(
            self.norm, self.features.flatten(0, 1).mH @ weighted, upper=False
        )
        return nearest

    def rim(self, readout: Complex[Tensor, "k 2"]) -> EdgeIntegrals:
        """The surface's boundary for orthonormal read-outs, at the nodes of the fit."""
        return EdgeIntegrals(polygon=self.polygon, spinors=self.features @ self.raw(readout))

    def network(self, raw: Complex[Tensor, "k 2"]) -> CauchyNetwork:
        """The network with read-outs of the features themselves."""
        return CauchyNetwork.of_raw_features(
            self.polygon, hessenberg=self.hessenberg, poles=self.poles, scales=self.scales, readout=raw
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Passing:
    """The surface of a basis on its way through the loop's points."""

    basis: _Basis
    points: Float[Tensor, "n 3"]
    rim: EdgeIntegrals

    @cached_property
    def error(self) -> Float[Tensor, "n 3"]:
        return self.rim.centred(self.points)

    def at(self, readout: Complex[Tensor, "k 2"]) -> _Passing:
        return replace(self, rim=self.basis.rim(readout))

    def linearised(self) -> PointEquations:
        over_edge = self.rim.changes(self.basis.features)
        to_vertex = over_edge.cumsum(0).roll(1, 0)
        to_vertex[0] = 0
        to_vertex -= to_vertex.mean(0)
        by_p, by_q = (
            torch.linalg.solve_triangular(self.basis.norm, part.mH, upper=False) for part in to_vertex.unbind(1)
        )
        return PointEquations.of(by_p, by_q)


@lru_cache
def _norm_of_edge(count: int, device: torch.device) -> Float[Tensor, "d g"]:
    """R with |Rf|² = ∫ |f|² + |f′|² for a polynomial of low degree, from its values at an edge's nodes.

    The edge is the unit of length; of other functions it is their projection's.
    """
    places, weights = rule("gauss", count)
    degrees = np.arange(_NORM_DEGREE + 1)
    values = np.polynomial.legendre.legvander(2 * places - 1, _NORM_DEGREE)
    slopes = (
        2 * np.polynomial.legendre.legval(2 * places - 1, np.polynomial.legendre.legder(np.eye(_NORM_DEGREE + 1))).T
    )
    both = np.diag(1 / (2 * degrees + 1)) + slopes.T @ (weights[:, None] * slopes)
    projection = (2 * degrees[:, None] + 1) * (values * weights[:, None]).T
    return torch.tensor(np.linalg.cholesky(both).T @ projection, device=device)
