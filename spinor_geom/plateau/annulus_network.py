"""Two loops and a Cauchy network on an annular domain made for them: Gauss-Newton as for disks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from spinor_geom.discrete.strip import discrete_annulus, minimum_area_strip, nodes_on_cylinder
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.lattice import lattice_inside
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary, sampled
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.corners import CornerPairs
from spinor_geom.plateau.found import Between, Found
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.network_route import (
    Budget,
    Cauchy,
    fit_and_refine,
    fitted_surface,
    limit_of,
    rim_indices,
)
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import independent_residual
from spinor_geom.plateau.roughness import roughness
from spinor_geom.plateau.start import lifted_frames
from spinor_geom.surface.frames import spin_invariant, spinors_from_phi

# vertices and faces
Mesh: TypeAlias = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]

# The first annulus only has to be near enough for its flattening to be right.
_FIRST_CHANGE = 1e-3
# Longer loops are thinned to so many points where the direction of the second one is sought.
_MOST_FOR_STRIP = 100
# Points across the hole among which its middle is sought.
_LATTICE = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class AnnulusNetworkSolver:
    """Two loops on the network route.

    Attributes:
        loops: both at unit size, with the annulus on their left.
        curves: Γ, of both.
        reverse: whether the second one runs against the loop that was given.
        options: of the network.
        budget: what a fit may cost.
        device: where the linear algebra runs.
        clock: of the stages.
    """

    loops: tuple[BoundaryLoop, BoundaryLoop]
    curves: tuple[BoundaryCurve, BoundaryCurve]
    reverse: bool
    options: Cauchy
    budget: Budget
    device: torch.device
    clock: Clock

    @classmethod
    def between(
        cls,
        loops: tuple[BoundaryLoop, BoundaryLoop, BoundaryLoop],
        curves: tuple[BoundaryCurve, BoundaryCurve, BoundaryCurve],
        *,
        options: Cauchy,
        budget: Budget,
        device: torch.device,
        clock: Clock,
    ) -> AnnulusNetworkSolver:
        """The solver for the direction of the second loop in which a strip to it has less area.

        Args:
            loops: the first, the second, and the second reversed, at unit size.
            curves: through them.
            options: of the network.
            budget: what a fit may cost.
            device: where the linear algebra runs.
            clock: of the stages.
        """
        with clock.stage("first fill"):
            thinned = [loop.points[:: math.ceil(len(loop) / _MOST_FOR_STRIP)] for loop in loops]
            areas = [minimum_area_strip(thinned[0], other)[1] for other in thinned[1:]]
        reverse = areas[1] < areas[0]
        return cls(
            loops=(loops[0], loops[1 + reverse]),
            curves=(curves[0], curves[1 + reverse]),
            reverse=reverse,
            options=options,
            budget=budget,
            device=device,
            clock=clock,
        )

    @cached_property
    def _rims(self) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " n"]]:
        """Indices of the points of each loop that stand for it."""
        return rim_indices(self.loops[0]), rim_indices(self.loops[1])

    @cached_property
    def _discrete(self) -> tuple[PlaneTriangulation, Float[np.ndarray, "v 3"]]:
        with self.clock.stage("first fill"):
            first, second = (loop.points[rim] for loop, rim in zip(self.loops, self._rims, strict=True))
            plane, descent = discrete_annulus(first, second, relative_change=_FIRST_CHANGE)
        return plane, descent.vertices

    @property
    def nodes_on_cylinder(self) -> float:
        """`nodes_on_cylinder` of the discrete annulus between the loops.

        Raises:
            DomainError: there is none.
            SingularMatrixError: it is degenerate.
        """
        return nodes_on_cylinder(*self._discrete)

    def found(self) -> Found:
        """The minimal annulus that a discrete one leads to.

        Raises:
            DomainError: no simple domain was found.
            SingularMatrixError: the discrete annulus or the fit is degenerate.
        """
        start = self._started()
        with self.clock.stage("fit"):
            fitted = fit_and_refine(start.stage, start.readout, start.slide, self.budget)
        with self.clock.stage("surface"):
            surface, astray = fitted_surface(fitted)
            closed = replace(fitted.fit, readout=fitted.stage.network.readout.detach())
            residual = independent_residual(fitted.stage, closed, points=self.budget.points)
        return Found(
            surface=surface,
            curves=tuple(self.curves[number] for number in start.order),
            matchings=tuple(fitted.stage.matchings(closed)),
            misfit=residual.misfit.and_astray(astray),
            area=surface.area(),
            route="annular network",
            limit=limit_of(fitted, self.budget, self._turning),
            between=Between(
                order=start.order,
                back=tuple(self.reverse and number == 1 for number in start.order),
                modulus=None,
                antiperiodic=(start.is_antiperiodic,),
                period=float(np.linalg.norm(surface.periods().real)),
            ),
        )

    @property
    def _turning(self) -> float:
        return max(map(roughness, self.loops))

    def _started(self) -> _Start:
        rims, (plane, vertices) = self._rims, self._discrete
        with self.clock.stage("flattening"):
            lengths = [loop.perimeter for loop in self.loops]
            order = (0, 1) if lengths[0] >= lengths[1] else (1, 0)
            number = np.arange(len(vertices))
            m, rim = len(rims[0]), len(rims[0]) + len(rims[1])
            if order[0]:
                number[:rim] = np.roll(number[:rim], rim - m)
                vertices = np.concatenate([vertices[m:rim], vertices[:m], vertices[rim:]])
            annulus = vertices, number[plane.faces]
            flat = flatten(*annulus, rim, holes=(len(rims[order[1]]),), drawn=_drawn)
            boundaries = tuple(map(SplineBoundary.through, flat.rims))
            domain = PlaneDomain.inside(boundaries[0], flat.log_scale, holes=(boundaries[1],))
        curves = tuple(self.curves[k] for k in order)
        with self.clock.stage("features"):
            phi = lifted_frames(*annulus, domain.vertices, self.device, sizes=(len(flat.rims[0]), len(flat.rims[1])))
            branch = _middle(flat.rims[1]) if self._is_antiperiodic(phi, len(flat.rims[0])) else None
            stage = Discretisation.first(
                domain,
                tuple(CurveTensors.of(curve, self.device) for curve in curves),
                CornerPairs(t=np.zeros(0), s=np.zeros(0)),
                degree=self.options.degree,
                offset=self.options.pole_offset,
                tolerance=self.budget.allowed / self.loops[0].mean_edge_length,
                branch=branch,
            )
        with self.clock.stage("start"):
            readout = _start_readout(stage, phi)
            slides = []
            for k, t, boundary in zip(order, stage.panels.own_parameters, domain.boundaries, strict=True):
                knots = np.append(self.curves[k].breaks[rims[k]], self.curves[k].breaks[rims[k][0]] + 1)
                slides.append(np.interp(t, boundary.parameters, knots))
        return _Start(
            stage=stage,
            readout=readout,
            slide=torch.as_tensor(np.concatenate(slides), device=self.device),
            order=order,
            is_antiperiodic=branch is not None,
        )

    def _is_antiperiodic(self, phi: Complex[Tensor, "r 3"], outer: int) -> bool:
        signs = [spin_invariant(*spinors_from_phi(part)) for part in torch.split(phi, [outer, len(phi) - outer])]
        return signs[0] < 0 and signs[1] < 0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Start:
    stage: Discretisation
    readout: Complex[Tensor, "n 2"]
    slide: Float[Tensor, " nodes"]
    order: tuple[int, int]
    is_antiperiodic: bool


def _drawn(rims: tuple[Complex[np.ndarray, "_"], ...]) -> tuple[Complex[np.ndarray, "_"], ...]:
    return tuple(sampled(SplineBoundary.through(rim), each=4) for rim in rims)


def _start_readout(stage: Discretisation, phi: Complex[Tensor, "r 3"]) -> Complex[Tensor, "n 2"]:
    """Read-outs of the spinors of φ on each edge of ∂Ω, the sign on the hole's that fits the features better."""
    domain, device = stage.domain, phi.device
    t, after = domain.arcs.T
    middle = torch.as_tensor(domain.point((t + after) / 2), device=device)
    sign_changing = stage.network.sign_changing(middle)
    outer = len(domain.boundary.vertices)
    single_valued = torch.split(phi / sign_changing.square()[:, None], [outer, len(phi) - outer])
    rims = [torch.stack(spinors_from_phi(part), dim=-1) for part in single_valued]
    z = torch.as_tensor(stage.panels.z, device=device)
    edge = torch.as_tensor(np.searchsorted(t, stage.panels.t, side="right") - 1, device=device)
    root = stage.problem.arc_weights.sqrt()[:, None]
    features = stage.problem.features[: stage.problem.nodes]
    tries = []
    for sign in (1, -1):
        spinors = torch.cat([rims[0], sign * rims[1]])[edge] * stage.network.sign_changing(z)[:, None]
        readout = stage.readout_of(spinors)
        tries.append((float((root * (spinors - features @ readout)).abs().square().sum()), readout))
    return min(tries, key=lambda pair: pair[0])[1]


def _middle(hole: Complex[np.ndarray, " n"]) -> complex:
    """The point of a grid in a hole that is farthest from its vertices."""
    polygon = hole[::-1]
    spacing = np.sqrt(0.5 * (np.conj(polygon) * np.roll(polygon, -1)).imag.sum()) / _LATTICE
    inside = lattice_inside(polygon, spacing)
    if not len(inside):
        return complex(hole.mean())
    distance, _ = cKDTree(plane_coordinates(hole)).query(plane_coordinates(inside))
    return complex(inside[int(np.argmax(distance))])
