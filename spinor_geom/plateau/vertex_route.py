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
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import cumulative_matrix, rule
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
from spinor_geom.plateau.start import lifted_spinors
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Gauss-Legendre nodes on each edge while p and q are sought, and where the distance is told: poles lie at least 0.35
# edges away, so the first integrate φ to 1e-9, the second to rounding errors.
_NODES, _NODES_TOLD = 16, 24
# Of those of an edge the ones at which the H¹ norm is taken: it is only a preference.
_NORM_NODES = (1, 3, 5, 7, 8, 10, 12, 14)
# Degree of the polynomials, and the most Cauchy units on rims of up to as many points: the cost grows like the cube.
_DEGREE, _MOST_UNITS = 24, 800
# The Gram matrix's diagonal is raised by this share of its mean: units with neighbouring poles are nearly dependent.
_RIDGE = 1e-11
# The Newton equations' by this one: an equation that no read-out can meet is not met at any price.
_DAMPING = 1e-9
# Newton steps go on to this share of the distance allowed.
_BELOW_ALLOWED = 0.3
# A linearisation is used again while each step brings the squared distance below this share.
_KEEP = 0.1
# A step is halved so many times at most, and the last one is that which leaves more than this share.
_HALVINGS, _STALL = 6, 0.98
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
            domain = PlaneDomain.inside(_polygon(flat.boundary), flat.log_scale)
        with self.clock.stage("features"):
            basis = _Basis.on(flat.boundary, self.device)
        with self.clock.stage("fit"):
            start = basis.nearest(lifted_spinors(disk.vertices, disk.faces, flat.boundary, self.device))
            raw, steps = self._fitted(basis, torch.tensor(points, device=self.device), start, len(history))
        with self.clock.stage("surface"):
            return self._found(basis, raw, domain, (*history, *steps))

    def _fitted(
        self, basis: _Basis, points: Float[Tensor, "n 3"], start: Complex[Tensor, "k 2"], before: int
    ) -> tuple[Complex[Tensor, "k 2"], list[Iteration]]:
        """Newton's method for the read-outs nearest to a start, in the norm of the basis, that meet the points."""
        n = len(points)
        goal = n * (_BELOW_ALLOWED * self.allowed) ** 2
        readout, steps = start, list[Iteration]()
        error = basis.rim(readout).centred(points)
        if not float(error.square().sum()) <= n * (_FAR * self.loop.mean_edge_length) ** 2:
            raise SurfaceError(
                "the flattened discrete disk over the loop is too far from conformal: p and q of its frames lead "
                f"{float(error.square().sum() / n) ** 0.5 / self.loop.mean_edge_length:.0f} edges away from the points"
            )
        linear: _Linear | None = None
        linearised = 0
        while float(error.square().sum()) > goal and len(steps) < self.max_steps and not is_out_of_time():
            fresh = linear is None
            if linear is None:
                if linearised == _MOST_LINEARISATIONS:
                    break
                linear, linearised = _Linear.at(basis, readout), linearised + 1
            # far from the points the step is the one to the solution nearest to the start, not to where it is
            step = linear.step(error, readout - start if fresh else None)
            square, length = error.square().sum(), 1.0
            for _ in range(_HALVINGS if fresh else 1):
                trial = readout + length * step
                missed = basis.rim(trial).centred(points)
                if float(missed.square().sum()) < float(square):
                    break
                length /= 2
            else:
                if fresh:
                    break
                linear = None
                continue
            readout, error = trial, missed
            left = float(error.square().sum() / square)
            steps.append(
                Iteration(
                    index=before + len(steps) + 1, method="Newton", residual=float(error.square().sum() / n) ** 0.5
                )
            )
            if self.on_iteration is not None:
                self.on_iteration(steps[-1])
            if left > _KEEP:
                if fresh and left > _STALL:
                    break
                linear = None
        return basis.raw(readout), steps

    def _found(
        self, basis: _Basis, raw: Complex[Tensor, "k 2"], domain: PlaneDomain, history: tuple[Iteration, ...]
    ) -> Found:
        points = self.loop.points
        told = basis.rim_of(raw, _NODES_TOLD)
        error = told.centred(torch.tensor(points, device=self.device)).cpu().numpy()
        curve = told.curve_through(points, error)
        bulge = curve.bulge() / self.loop.mean_edge_length
        if not bulge <= _LARGEST_BULGE:
            raise SurfaceError(
                f"the surface through the loop's points goes {bulge:.1f} edges away from the edges between them"
            )
        network = basis.network(raw)
        surface = SpinorSurface(network, domain, order=_PATH_ORDER).to(self.device)
        place = np.array([domain.boundary.vertices[0]])
        with torch.no_grad():
            shift = points[0] + error[0] - np.asarray(surface.position(place))[0]
            surface.constant.add_(torch.as_tensor(shift, device=self.device))
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
    points: Complex[Tensor, " r"]  # at which the norm is taken
    hessenberg: Complex[Tensor, "d1 d"]
    poles: Complex[Tensor, " m"]
    scales: Float[Tensor, " m"]
    features: Complex[Tensor, "nodes k"]
    norm: Complex[Tensor, "k k"]  # L with LLᴴ the Gram matrix
    mass: Complex[Tensor, "r k"]  # features at the norm's nodes times the roots of their weights
    mass_matrix: Complex[Tensor, "k k"]  # its Gram matrix, the lower triangle
    weights: Float[Tensor, " r"]  # those roots

    @classmethod
    def on(cls, vertices: Complex[np.ndarray, " n"], device: torch.device) -> _Basis:
        n = len(vertices)
        poles: Poles = polygon_poles(vertices, most=max(_MOST_UNITS, n))
        polygon = torch.as_tensor(vertices, device=device)
        edge = (polygon.roll(-1) - polygon).abs()
        positions = torch.as_tensor(poles.positions, device=device)
        scales = torch.as_tensor(poles.scales, device=device)
        nodes = _nodes(polygon, _NODES)
        kept = list(_NORM_NODES)
        coarse = nodes[:, kept].reshape(-1)
        weight = (edge / edge.sum() / len(kept)).repeat_interleave(len(kept))
        degree = min(_DEGREE, max(2, n // 2))
        hessenberg = arnoldi_hessenberg(coarse, weight, degree)
        features = raw_features(nodes.reshape(-1), hessenberg, positions, scales)
        at_kept = features.reshape(n, _NODES, -1)[:, kept]
        mass = at_kept.reshape(len(coarse), -1) * weight.sqrt()[:, None]
        # ∫|f'|² from node to node, an edge as the unit of length
        place = torch.tensor(rule("gauss", _NODES).nodes[kept], device=device)
        slope = torch.diff(at_kept, dim=1) * (edge[:, None] / edge.sum() / torch.diff(place)).sqrt()[..., None]
        mass_matrix = gram(mass)
        matrix = mass_matrix + gram(slope.reshape(-1, mass.shape[1]))
        matrix.diagonal().add_(_RIDGE * matrix.diagonal().real.mean())
        return cls(
            polygon=polygon,
            points=coarse,
            hessenberg=hessenberg,
            poles=positions,
            scales=scales,
            features=features,
            norm=torch.linalg.cholesky(matrix),
            mass=mass,
            mass_matrix=mass_matrix,
            weights=weight.sqrt(),
        )

    def raw(self, readout: Complex[Tensor, "k 2"]) -> Complex[Tensor, "k 2"]:
        """Read-outs of the features themselves from those of the features that are orthonormal in H¹."""
        raw: Tensor = torch.linalg.solve_triangular(self.norm.mH, readout, upper=True)
        return raw

    def nearest(self, spinors: Complex[Tensor, "n 2"]) -> Complex[Tensor, "k 2"]:
        """Orthonormal read-outs of the least-squares approximation to values on the edges."""
        wanted = spinors.repeat_interleave(len(_NORM_NODES), dim=0) * self.weights[:, None]
        matrix = self.mass_matrix.clone()
        matrix.diagonal().add_(1e2 * _RIDGE * matrix.diagonal().real.mean())
        raw = torch.cholesky_solve(self.mass.mH @ wanted, torch.linalg.cholesky(matrix))
        return self.norm.mH @ raw

    def rim(self, readout: Complex[Tensor, "k 2"]) -> _Rim:
        """The surface's boundary for orthonormal read-outs, at the nodes of the fit."""
        return _Rim(polygon=self.polygon, spinors=(self.features @ self.raw(readout)).reshape(-1, _NODES, 2))

    def rim_of(self, raw: Complex[Tensor, "k 2"], nodes: int) -> _Rim:
        """The same for read-outs of the features themselves, at so many nodes an edge."""
        features = raw_features(_nodes(self.polygon, nodes).reshape(-1), self.hessenberg, self.poles, self.scales)
        return _Rim(polygon=self.polygon, spinors=(features @ raw).reshape(-1, nodes, 2))

    def network(self, raw: Complex[Tensor, "k 2"]) -> CauchyNetwork:
        """The network with these read-outs."""
        return CauchyNetwork.of_raw_features(
            self.points, hessenberg=self.hessenberg, poles=self.poles, scales=self.scales, readout=raw
        )


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

    @property
    def area(self) -> float:
        """½∮ r·Im(φ dz)."""
        inner = torch.tensor(cumulative_matrix(self.nodes), device=self.polygon.device)
        r = self.starts[:, None] + torch.einsum("hg,ngk->nhk", inner, self.velocity.real)
        weights = torch.tensor(rule("gauss", self.nodes).weights, device=r.device)
        return 0.5 * float(torch.einsum("g,ngk,ngk->", weights, r, self.velocity.imag))

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
    """The distances of the vertices from the points as linear functions of the read-outs."""

    rows: Float[Tensor, "e k4"]
    factor: Float[Tensor, "e e"]

    @classmethod
    def at(cls, basis: _Basis, readout: Complex[Tensor, "k 2"]) -> _Linear:
        rim = basis.rim(readout)
        weights = torch.tensor(rule("gauss", rim.nodes).weights, device=rim.polygon.device)
        step = rim.polygon.roll(-1) - rim.polygon
        features = basis.features.reshape(len(step), rim.nodes, -1)
        parts = []
        for values in rim.spinors.unbind(-1):
            over_edge = torch.einsum("ng,ngk->nk", 2 * weights * values * step[:, None], features)
            at_vertices = over_edge.cumsum(0) - over_edge
            at_vertices = at_vertices - at_vertices.mean(0)
            parts.append(torch.linalg.solve_triangular(basis.norm, at_vertices.mH, upper=False).mH)
        p, q = parts
        # δφ = (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq))
        blocks = ((p, -q), (-1j * p, -1j * q), (q, p))
        rows = torch.cat([torch.cat([a.real, -a.imag, b.real, -b.imag], dim=1) for a, b in blocks])
        matrix = gram(rows.T)
        matrix.diagonal().add_(_DAMPING * matrix.diagonal().mean())
        return cls(rows=rows, factor=torch.linalg.cholesky(matrix))

    def step(self, error: Float[Tensor, "n 3"], away: Complex[Tensor, "k 2"] | None) -> Complex[Tensor, "k 2"]:
        """The shortest change of the read-outs that takes the distances away.

        Args:
            error: the distances.
            away: read-outs less those that the changed ones shall be nearest to; none for the change itself.
        """
        wanted = error.T.reshape(-1)
        if away is not None:
            p, q = away.unbind(-1)
            back = torch.cat([p.real, p.imag, q.real, q.imag])
            wanted = wanted - self.rows @ back
        change = -self.rows.T @ torch.cholesky_solve(wanted[:, None], self.factor)[:, 0]
        if away is not None:
            change = change - back
        a, b, c, d = change.reshape(4, -1)
        return torch.stack([torch.complex(a, b), torch.complex(c, d)], dim=1)
