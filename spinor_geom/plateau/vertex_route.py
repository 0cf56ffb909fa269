"""The route for rough rims: the minimal surface through a rim's points that is nearest to a discrete one.

Of a mesh's rim only the points are in the mesh. Between them Γ is free, and a rim that was cut along triangles says
nothing of it: so Γ is the surface's own boundary there. What is left to ask for is that the surface passes through n
points, 3n equations for the read-outs of p and q, far fewer than there are read-outs. Of their solutions the one is
taken that is nearest to p and q of a discrete minimal disk, in the H¹ norm on ∂Ω: p and q hardly vary along an edge,
and Γ keeps near to the rim's edges. Ω is that disk flattened with its boundary lengths kept, a polygon whose vertices
are matched with the rim's points; nothing slides, nothing crowds, and two to six Newton steps are enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import Flattening, flatten
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import cumulative_matrix, rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError, SurfaceError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import CauchyNetwork, raw_features
from spinor_geom.holomorphic.poles import Poles, polygon_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import places_in_piece, through
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.gauss_newton import gram
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import Iteration
from spinor_geom.plateau.start import images_in_plane, lifted_spinors
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Gauss-Legendre nodes on each edge while p and q are sought: poles lie at least 0.35 edges away, so the first integrate
# φ to 1e-4 where p and q are tame, which is told with the last; where that does not do, the second.
_NODES, _NODES_TOLD = (10, 16), 24
# Degree on each edge up to which the H¹ norm sees p and q: they hardly vary along one.
_NORM_DEGREE = 6
# Degree of the polynomials, and the most Cauchy units on rims of up to as many points: the cost grows like the cube.
_DEGREE, _MOST_UNITS = 24, 800
# The Gram matrix's diagonal is raised by this share of its mean: units with neighbouring poles are nearly dependent.
_RIDGE = 1e-9
# The Newton equations' by this one: an equation that no read-out can meet is not met at any price.
_DAMPING = 1e-9
# Newton steps go on to this share of the distance allowed.
_BELOW_ALLOWED = 0.3
# A linearisation is used again while each step brings the distance below this share.
_KEEP = 0.3
# A step is halved so many times at most, and the last one is that which leaves more than this share.
_HALVINGS, _STALL = 6, 0.99
# A start that is as many edges away from the points has never led to a surface through them.
_FAR = 4.0
# A surface whose boundary leaves the loop's edges by so many edges would cross what is beside them.
_LARGEST_BULGE = 2.0
# Linearisations in all: rims that are met take one to ten.
_MOST_LINEARISATIONS = 12
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexSolver:
    """One rough loop on its way to a surface through its points.

    Attributes:
        loop: the loop at unit size.
        allowed: RMS distance of its points from the surface to reach.
        max_steps: limit on Newton steps.
        device: where the linear algebra runs.
        clock: of the stages.
        on_iteration: is called after each step.
    """

    loop: BoundaryLoop
    allowed: float
    max_steps: int
    device: torch.device
    clock: Clock
    on_iteration: Callable[[Iteration], None] | None = None

    def found(self, history: tuple[Iteration, ...] = ()) -> Found:
        """The surface through the points, as nearly as they can be met.

        Args:
            history: steps of tries before.

        Raises:
            FirstFillError: no discrete disk over the loop was found.
            DomainError: it has no simple flattening, or one with an edge of no length.
            SingularMatrixError: the discrete disk is degenerate.
            SurfaceError: no surface near the discrete one comes near to the points.
        """
        points = self.loop.points
        with self.clock.stage("first fill"):
            disk = first_disk(points)
        with self.clock.stage("flattening"):
            flat = flatten(disk.vertices, disk.faces, len(points))
            images = images_in_plane(disk.vertices, disk.faces, flat.boundary)
            domain = _domain(disk.faces, images, flat)
            spinors = lifted_spinors(disk.vertices, disk.faces, images, len(points), self.device)
        wanted = torch.tensor(points, device=self.device)
        steps, raw = list(history), None
        for nodes in _NODES:
            with self.clock.stage("features"):
                basis = _Basis.on(flat.boundary, nodes, self.device)
            with self.clock.stage("fit"):
                raw = self._fitted(basis, basis.nearest(spinors), raw, wanted, steps)
            with self.clock.stage("surface"):
                network, told = basis.told(raw)
                error = told.centred(wanted)
            if _rms(error) <= self.allowed or is_out_of_time():
                break
        with self.clock.stage("surface"):
            return self._found(network, told, error.cpu().numpy(), domain, tuple(steps))

    def _fitted(
        self,
        basis: _Basis,
        start: Complex[Tensor, "k 2"],
        raw: Complex[Tensor, "k 2"] | None,
        points: Float[Tensor, "n 3"],
        steps: list[Iteration],
    ) -> Complex[Tensor, "k 2"]:
        """Newton's method for the read-outs nearest to a start, in the norm of the basis, that meet the points.

        Args:
            basis: of p and q.
            start: orthonormal read-outs.
            raw: read-outs of the features themselves to set out from; none for the start.
            points: to be met.
            steps: gets those that are done.
        """
        readout = start if raw is None else basis.norm.mH @ raw
        rim = basis.rim(readout)
        error = rim.centred(points)
        in_edges = _rms(error) / self.loop.mean_edge_length
        if not in_edges <= _FAR:
            raise SurfaceError(
                "the flattened discrete disk over the loop is too far from conformal: p and q of its frames lead "
                f"{in_edges:.0f} edges away from the points"
            )
        linear: _Linear | None = None
        linearised = 0
        while _rms(error) > _BELOW_ALLOWED * self.allowed and len(steps) < self.max_steps and not is_out_of_time():
            fresh = linear is None
            if linear is None:
                if linearised == _MOST_LINEARISATIONS:
                    break
                linear, linearised = _Linear.at(basis, rim), linearised + 1
            # far from the points the step is the one to the solution nearest to the start, not to where it is
            step = linear.step(error, readout - start if fresh else None)
            length = 1.0
            for _ in range(_HALVINGS if fresh else 1):
                trial = readout + length * step
                moved = basis.rim(trial)
                missed = moved.centred(points)
                if _rms(missed) < _rms(error):
                    break
                length /= 2
            else:
                if fresh:
                    break
                linear = None
                continue
            left = _rms(missed) / _rms(error)
            readout, rim, error = trial, moved, missed
            steps.append(Iteration(index=len(steps) + 1, method="Newton", residual=_rms(error)))
            if self.on_iteration is not None:
                self.on_iteration(steps[-1])
            if left > _KEEP:
                if fresh and left > _STALL:
                    break
                linear = None
        return basis.raw(readout)

    def _found(
        self,
        network: CauchyNetwork,
        told: _Rim,
        error: Float[np.ndarray, "n 3"],
        domain: PlaneDomain,
        history: tuple[Iteration, ...],
    ) -> Found:
        points = self.loop.points
        curve = told.curve_through(points, error)
        bulge = curve.bulge() / self.loop.mean_edge_length
        if not bulge <= _LARGEST_BULGE:
            raise SurfaceError(
                f"the surface through the loop's points goes {bulge:.1f} edges away from the edges between them"
            )
        constant = points[0] + error[0] + told.displacement(domain)
        surface = SpinorSurface(network, domain, constant, order=_PATH_ORDER).to(self.device)
        length, after = self.loop.edge_lengths, np.roll(error, -1, axis=0)
        beside = (length + np.roll(length, 1)) / 2
        # of what is linear from point to point: from the surface's boundary to Γ
        squares = (error * error + error * after + after * after).sum(axis=1) / 3
        return Found(
            surface=surface,
            curve=curve,
            matching=np.column_stack([domain.boundary.parameters[:-1], curve.breaks[:-1]]),
            misfit=Misfit(
                rms=float(np.sqrt(length @ squares / length.sum())),
                max=float(np.linalg.norm(error, axis=1).max()),
                max_per_local_edge=float((np.linalg.norm(error, axis=1) / beside).max()),
                length=curve.length(),
            ),
            area=told.area,
            route="vertices",
            history=history,
            limit="no minimal surface near the discrete one passes through the loop's points more nearly",
        )


def _domain(faces: Int[np.ndarray, "f 3"], images: Complex[np.ndarray, " n"], flat: Flattening) -> PlaneDomain:
    """Inside the flattened boundary, with the disk's own triangles where they have a place there."""
    boundary = _polygon(flat.boundary)
    a, b, c = images[faces].T
    if not ((np.conj(b - a) * (c - a)).imag > 0).all():
        return PlaneDomain.inside(boundary, flat.log_scale)
    mesh = PlaneTriangulation(points=images, faces=faces, boundary_size=len(flat.boundary))
    return PlaneDomain(boundary=boundary, triangulation=mesh, log_scale=flat.log_scale)


def _nodes(polygon: Complex[Tensor, " n"], count: int) -> Complex[Tensor, "n g"]:
    """Gauss-Legendre nodes on the edges of a polygon."""
    place = torch.tensor(rule("gauss", count).nodes, device=polygon.device)
    nodes: Tensor = polygon[:, None] + place * (polygon.roll(-1) - polygon)[:, None]
    return nodes


def _polygon(vertices: Complex[np.ndarray, " n"]) -> SplineBoundary:
    """The closed polygon through vertices; p and q have no singularity at them, so they are no corners."""
    step = np.roll(vertices, -1) - vertices
    if not step.all():
        raise DomainError("two neighbouring points of the flattened disk's boundary are one", vertices=len(vertices))
    along = np.append(0.0, np.cumsum(np.abs(step)) / np.abs(step).sum())
    along[-1] = 1.0
    return SplineBoundary(along, np.stack([step / np.diff(along), vertices]), np.zeros(len(vertices), dtype=bool))


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
        z = _nodes(polygon, nodes)
        weight = _shares(polygon)[:, None] * torch.tensor(rule("gauss", nodes).weights, device=device)
        hessenberg = arnoldi_hessenberg(z.reshape(-1), weight.reshape(-1), min(_DEGREE, max(2, n // 2)))
        features = raw_features(z, hessenberg, positions, scales)
        root = _norm_of_edge(nodes, device).to(features) * _shares(polygon).sqrt()[:, None, None]
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
        edge = _shares(self.polygon)[:, None, None]
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

    def rim(self, readout: Complex[Tensor, "k 2"]) -> _Rim:
        """The surface's boundary for orthonormal read-outs, at the nodes of the fit."""
        return _Rim(polygon=self.polygon, spinors=self.features @ self.raw(readout))

    def told(self, raw: Complex[Tensor, "k 2"]) -> tuple[CauchyNetwork, _Rim]:
        """The network with read-outs of the features themselves, and its boundary at nodes that tell it."""
        network = CauchyNetwork.of_raw_features(
            self.polygon, hessenberg=self.hessenberg, poles=self.poles, scales=self.scales, readout=raw
        )
        with torch.no_grad():
            return network, _Rim(polygon=self.polygon, spinors=network.value(_nodes(self.polygon, _NODES_TOLD)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rim:
    """p and q at Gauss-Legendre nodes on the edges of ∂Ω, and the surface's boundary that they make."""

    polygon: Complex[Tensor, " n"]
    spinors: Complex[Tensor, "n g 2"]

    @property
    def nodes(self) -> int:
        """Number on each edge."""
        return self.spinors.shape[1]

    @cached_property
    def velocity(self) -> Complex[Tensor, "n g 3"]:
        """φ dz by the share of the edge."""
        step = self.polygon.roll(-1) - self.polygon
        return phi(self.spinors[..., 0], self.spinors[..., 1]) * step[:, None, None]

    @cached_property
    def starts(self) -> Float[Tensor, "n 3"]:
        """R at the vertices of ∂Ω, 0 at the first."""
        weights = torch.tensor(rule("gauss", self.nodes).weights, device=self.polygon.device)
        length = torch.einsum("g,ngk->nk", weights, self.velocity.real)
        return length.cumsum(0) - length

    def centred(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Distances of the vertices from given points, with the constant of r that makes their sum 0."""
        error = self.starts - points
        return error - error.mean(0)

    @cached_property
    def primitive(self) -> Complex[Tensor, "n g 3"]:
        """∫ φ dz from the first vertex to the nodes."""
        inner, weights = cumulative_matrix(self.nodes), rule("gauss", self.nodes).weights
        whole = torch.tensor(np.vstack([inner, weights]), device=self.polygon.device).to(self.velocity)
        within = torch.einsum("hg,ngk->nhk", whole, self.velocity)
        length = within[:, -1:]
        return length.cumsum(0) - length + within[:, :-1]

    def displacement(self, domain: PlaneDomain) -> Float[np.ndarray, "3"]:
        """R at the root of Ω less that at the first vertex, by Cauchy's formula."""
        if domain.root < len(self.polygon):
            return np.asarray(self.starts[domain.root].cpu())
        z = _nodes(self.polygon, self.nodes)
        weights = torch.tensor(rule("gauss", self.nodes).weights, device=z.device)
        kernel = weights * (self.polygon.roll(-1) - self.polygon)[:, None]
        kernel = kernel / (z - complex(domain.triangulation.points[domain.root]))
        # the formula for 1 below that for ∫φ: near ∂Ω their errors are nearly the same
        return np.asarray((torch.einsum("ng,ngk->k", kernel, self.primitive) / kernel.sum()).real.cpu())

    @property
    def area(self) -> float:
        """½∮ r·Im(φ dz)."""
        weights = torch.tensor(rule("gauss", self.nodes).weights, device=self.polygon.device)
        return 0.5 * float(torch.einsum("g,ngk,ngk->", weights, self.primitive.real, self.velocity.imag))

    def curve_through(self, points: Float[np.ndarray, "n 3"], error: Float[np.ndarray, "n 3"]) -> BoundaryCurve:
        """Γ: the surface's boundary less its distances from the points, which change linearly from one to the next."""
        place = places_in_piece()
        within = np.einsum("hg,ngk->hnk", cumulative_matrix(self.nodes, tuple(place)), self.velocity.real.cpu().numpy())
        drift = np.roll(error, -1, axis=0) - error
        values = points + within - place[:, None, None] * drift
        chord = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        breaks = np.append(0.0, np.cumsum(chord) / chord.sum())
        breaks[-1] = 1.0
        values[0] = points
        return BoundaryCurve(
            breaks=breaks, coefficients=through(values, np.diff(breaks)), corners=np.ones(len(points), dtype=bool)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linear:
    """The distances of the vertices from the points as linear functions of the read-outs.

    δr = Re ∫ (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq)) dz, so that two complex matrices say all.
    """

    by_p: Complex[Tensor, "k n"]  # conjugates of ∫ 2pf dz to each vertex, less their mean, for all features f
    by_q: Complex[Tensor, "k n"]  # of ∫ 2qf dz
    factor: Float[Tensor, "n3 n3"]  # of the Gram matrix of the 3n functions

    @classmethod
    def at(cls, basis: _Basis, rim: _Rim) -> _Linear:
        n = len(rim.polygon)
        weights = torch.tensor(rule("gauss", rim.nodes).weights, device=rim.polygon.device)
        step = rim.polygon.roll(-1) - rim.polygon
        # of both at once, edge by edge: (n, 2, g) times (n, g, k)
        over_edge = (2 * step[:, None, None] * weights * rim.spinors.mT) @ basis.features
        to_vertex = over_edge.cumsum(0).roll(1, 0)
        to_vertex[0] = 0
        to_vertex -= to_vertex.mean(0)
        by_p, by_q = (torch.linalg.solve_triangular(basis.norm, part.mH, upper=False) for part in to_vertex.unbind(1))
        lower = gram(torch.cat([by_p, by_q], dim=1))
        pp, qp, qq = lower[:n, :n], lower[n:, :n], lower[n:, n:]
        matrix = torch.zeros(3 * n, 3 * n, dtype=torch.float64, device=lower.device)
        for k in range(3):
            matrix[k * n : (k + 1) * n, k * n : (k + 1) * n] = (pp + qq).real
        difference = (pp - qq).imag.tril()
        matrix[n : 2 * n, :n] = difference - difference.mT
        matrix[2 * n :, :n] = (qp - qp.mH).real
        matrix[2 * n :, n : 2 * n] = -(qp + qp.mH).imag
        matrix.diagonal().add_(_DAMPING * matrix.diagonal().mean())
        return cls(by_p=by_p, by_q=by_q, factor=torch.linalg.cholesky(matrix))

    def step(self, error: Float[Tensor, "n 3"], away: Complex[Tensor, "k 2"] | None) -> Complex[Tensor, "k 2"]:
        """The shortest change of the read-outs that takes the distances away.

        Args:
            error: the distances.
            away: read-outs less those that the changed ones shall be nearest to; none for the change itself.
        """
        wanted = error if away is None else error - self._change(away)
        x, y, z = torch.cholesky_solve(wanted.T.reshape(-1, 1), self.factor).reshape(3, -1)
        xy, z = torch.complex(x, y), torch.complex(z, torch.zeros_like(z))
        p, q = self.by_p, self.by_q
        change = -torch.stack([p @ xy + q @ z, p @ z - q @ xy.conj()], dim=1)
        return change if away is None else change - away

    def _change(self, readout: Complex[Tensor, "k 2"]) -> Float[Tensor, "n 3"]:
        """Of the vertices by a change of the read-outs."""
        (pp, pq), (qp, qq) = (self.by_p.mH @ readout).T, (self.by_q.mH @ readout).T
        return torch.stack([pp - qq, -1j * (pp + qq), qp + pq], dim=1).real


def _rms(error: Float[Tensor, "n 3"]) -> float:
    return float(error.square().sum(1).mean().sqrt())


def _shares(polygon: Complex[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Lengths of a polygon's edges by all."""
    edge = (polygon.roll(-1) - polygon).abs()
    return edge / edge.sum()


@lru_cache
def _norm_of_edge(count: int, device: torch.device) -> Float[Tensor, "d g"]:
    """R with |Rf|² = ∫ |f|² + |f′|² for a polynomial of low degree, from its values at an edge's nodes.

    The edge is the unit of length; of other functions it is their projection's.
    """
    places, weights = rule("gauss", count)
    x, degrees = 2 * places - 1, np.arange(_NORM_DEGREE + 1)
    values = np.polynomial.legendre.legvander(x, _NORM_DEGREE)
    slopes = 2 * np.polynomial.legendre.legval(x, np.polynomial.legendre.legder(np.eye(_NORM_DEGREE + 1))).T
    both = np.diag(1 / (2 * degrees + 1)) + slopes.T @ (weights[:, None] * slopes)
    projection = (2 * degrees[:, None] + 1) * (values * weights[:, None]).T
    return torch.tensor(np.linalg.cholesky(both).T @ projection, device=device)
