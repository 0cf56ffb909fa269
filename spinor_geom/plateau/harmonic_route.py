"""The harmonic route to a minimal disk: Douglas's slide on a smooth Ω, then the lift to p and q.

It takes loops without corners: milliseconds for smooth ones, and its cost grows like n·log n with the number of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.domain.flattening import flatten
from spinor_geom.errors import DomainError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import minimise_dirichlet_energy, resampled, slide_downhill
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_fit import COARSE, FEWEST_NODES, Aims, Fit, even, fit_together
from spinor_geom.plateau.lift import surface_of
from spinor_geom.plateau.omega import NodeDensity, reflattened, resolved
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.request import Request
from spinor_geom.plateau.roughness import is_rough
from spinor_geom.plateau.solution import RouteName
from spinor_geom.plateau.stability import curvature_within

# A loop longer than so many times its width crowds on the disk: at 2.4 it is met to 1e-8 edges, at 4 no more.
_DISK_ELONGATION = 2.5
# Points that Ω is made from: the cost of Λ on it is their number cubed.
_FEWEST_POINTS, _POINTS = 32, 128


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSolver:
    """One loop on the harmonic route."""

    request: Request

    @cached_property
    def aims(self) -> Aims:
        """What its slides go on to."""
        return Aims(request=self.request)

    def on_disk(self, begun: Fit | None = None) -> Found:
        """The minimal disk on the unit disk, by a fit that may have been begun together with others."""
        refusal = DomainError(
            "the loop has corners, or is too long for its width, for power series on the disk; use model='auto'",
            vertices=len(self.request.unit),
        )
        if self.request.unit.corners.any():
            raise refusal
        try:
            return self._fitted(begun or self._begin(), "disk")
        except DomainError as error:
            raise refusal from error

    def below_on_disk(self, matching: Float[np.ndarray, "n 2"]) -> Found | None:
        """The minimal disk of less area that an unstable one on the unit disk leads to; None where there is none."""
        slide = torch.tensor(matching[:, 1], device=self.request.options.device)
        # the cost of its directions is the number of nodes cubed
        start = slide_downhill(self.aims.exact, self._unit_disk, resampled(slide, min(len(slide), 2 * FEWEST_NODES)))
        if start is None:
            return None
        try:
            return self._fitted(self._fit(self._unit_disk, start), "disk")
        except DomainError:
            return None

    def unfolded(self) -> Found:
        """The minimal disk on the loop's unfolded least-area triangulation."""
        even = np.arange(self._density.points) / self._density.points
        with self.request.clock.stage("first fill"):
            polygon = unfolded_loop(self.request.curve.point(self._density.slide(even)), saws=True)
        return self._on_domain(polygon, even, "unfolded")

    def flattened(self, disk: Disk, rim: Int[np.ndarray, " k"]) -> Found:
        """The minimal disk of less energy that a discrete disk over the points `rim` leads to, on its flattening."""
        with self.request.clock.stage("flattening"):
            polygon = flatten(disk.vertices, disk.faces, len(rim)).boundary
        return self._on_domain(polygon, self._density.parameter(self.request.curve.breaks[rim]), "flattened")

    @property
    def _count(self) -> int:
        return points_of_domain(self.request.unit)

    @cached_property
    def _density(self) -> NodeDensity:
        return NodeDensity(self.request.curve, self._count)

    @property
    def _averaged(self) -> CurveTensors:
        """Γ as the points of Ω tell it: nodes that are too few for its bends would fall anywhere among them."""
        return CurveTensors.of(self.request.curve.smoothed(1 / self._density.points), self.request.options.device)

    @property
    def _unit_disk(self) -> DirichletForm:
        return DirichletForm.of_disk(self._count)

    def _on_domain(self, polygon: Complex[np.ndarray, " k"], t: Float[np.ndarray, " k"], route: RouteName) -> Found:
        """The minimal disk on the smooth Ω next to a polygon, at parameters t, and on its own flattening."""
        with self.request.clock.stage("flattening"):
            # points that stand for single vertices are to be followed
            is_fine = self.aims.is_rough and len(self.request.unit) <= self._density.points
            shape, form = resolved(
                polygon, t, self._density, is_fine, count=self._count, device=self.request.options.device
            )
        start = torch.tensor(
            self._density.slide(np.arange(shape.steps) / shape.steps), device=self.request.options.device
        )
        with self.request.clock.stage("slide"):
            disk = minimise_dirichlet_energy(
                self._averaged if self.aims.is_rough and not is_fine else self.aims.exact,
                form,
                start,
                tolerance=COARSE,
                max_steps=self.request.steps.left,
                negligible=self.aims.negligible_energy,
                on_step=self.aims.take,
            )
        if disk.crowded:
            raise DomainError("the nodes crowd on the domain's boundary", vertices=len(self.request.unit))
        with self.request.clock.stage("flattening"):
            form, slide = reflattened(disk, form, shape)
        return self._fitted(self._fit(form, slide), route)

    def _begin(self) -> Fit:
        """The fit on the unit disk from equal steps."""
        n = even(max(FEWEST_NODES, len(self.request.unit)))
        return self._fit(self._unit_disk, torch.arange(n, dtype=torch.float64, device=self.request.options.device) / n)

    def _fit(self, form: DirichletForm, slide: Float[Tensor, " n"]) -> Fit:
        """The fit on an Ω from a slide."""
        return Fit(aims=self.aims, form=form, slide=slide, nodes=even(max(len(slide), len(self.request.unit))))

    def _fitted(self, fit: Fit, route: RouteName) -> Found:
        """The minimal disk with as many nodes as the tolerance asks for, or as help."""
        fit_together([fit])
        if fit.best is None:
            raise DomainError(f"no minimal disk was found on this domain: {fit.limit}", vertices=len(self.request.unit))
        lift, disk = fit.best
        with self.request.clock.stage("surface"):
            surface = surface_of(lift, fit.form.boundary)
        n = len(disk.slide)
        return Found(
            curves=(self.request.curve,),
            surface=surface,
            matchings=(np.column_stack([np.arange(n) / n, disk.slide.cpu().numpy()]),),
            misfit=lift.misfit,
            area=lift.area,
            route=route,
            limit=fit.limit,
            curvature=curvature_within([lift.spinors[:, 0].T.cpu().numpy()]),
        )

    @staticmethod
    def side_by_side(solvers: Sequence[HarmonicSolver]) -> list[Fit]:
        """The fits on the unit disk, made together."""
        fits = [solver._begin() for solver in solvers]
        fit_together(fits)
        return fits


def suits_unit_disk(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether the unit disk is likely to do."""
    return loop.elongation < _DISK_ELONGATION and not is_rough(loop, curve)


def points_of_domain(loop: BoundaryLoop) -> int:
    """Points that Ω is made from, but for those that narrow places want."""
    return int(np.clip(len(loop), _FEWEST_POINTS, _POINTS))
