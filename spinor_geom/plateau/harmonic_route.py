"""The harmonic route to a minimal disk: Douglas's slide on a smooth Ω, then the lift to p and q.

It takes loops without corners: milliseconds for smooth ones, and its cost grows like n·log n with the number of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.errors import DomainError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import minimise_dirichlet_energy, resampled, slide_downhill
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_fit import Fit, even, fit_together
from spinor_geom.plateau.lift import surface_of
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.omega import NodeDensity, reflattened, resolved
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.roughness import ROUGH_GRADIENT, is_rough, negligible_energy
from spinor_geom.plateau.solution import RouteName

if TYPE_CHECKING:
    from spinor_geom.plateau.task import Task

# A loop longer than so many times its width crowds on the disk: at 2.4 it is met to 1e-8 edges, at 4 no more.
_DISK_ELONGATION = 2.5
# Nodes per edge of a rough loop with which 1e-3 edges are met as a rule; smooth loops start with one.
_PER_EDGE_ROUGH = 9
# Points that Ω is made from: the cost of Λ on it is their number cubed.
_FEWEST_POINTS, _POINTS = 32, 128
# Most nodes for each edge: beyond rough loops take minutes, and smooth ones gain nothing.
_MOST_PER_EDGE = 64
# Nodes of short loops on the disk: many loops have as many nodes, and are fitted together.
_FEWEST_NODES = 256
# Nodes at which the directions of an unstable slide are found: the cost is their number cubed.
_MOST_FOR_MODES = 512
# Gradient of the energy, relative to its factors, at which a coarse solve stops, and that is rounding error. Between
# them a solve goes on to a share of the distance allowed in edges: a small one on smooth loops, where each step doubles
# the digits.
_COARSE, _ROUNDING = 1e-3, 1e-13
_FINE_SMOOTH = 1e-4
# RMS distance from Γ, in diagonals, that is rounding error.
_ROUNDED = 1e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSolver:
    """One loop on the harmonic route."""

    task: Task

    def on_disk(self) -> Found:
        """The minimal disk on the unit disk.

        Raises:
            DomainError: none was found: the loop has corners or is too long for its width, so that nodes crowd.
        """
        refusal = DomainError(
            "the loop has corners, or is too long for its width, for power series on the disk; use model='auto'",
            vertices=len(self.task.unit),
        )
        if self.task.unit.corners.any():
            raise refusal
        try:
            return self._fitted(self.task.on_disk or self._begin(), "disk")
        except DomainError as error:
            raise refusal from error

    def below_on_disk(self, matching: Float[np.ndarray, "n 2"]) -> Found | None:
        """The minimal disk of less area that an unstable one on the unit disk leads to; None where there is none.

        Args:
            matching: of the unstable one.
        """
        slide = torch.tensor(matching[:, 1], device=self.task.options.device)
        start = slide_downhill(self.exact, self._unit_disk, resampled(slide, min(len(slide), _MOST_FOR_MODES)))
        if start is None:
            return None
        try:
            return self._fitted(self._fit(self._unit_disk, start), "disk")
        except DomainError:
            return None

    def unfolded(self) -> Found:
        """The minimal disk on the loop's unfolded least-area triangulation.

        Raises:
            FirstFillError: the loop has no such triangulation.
            DomainError: it is not simple or too narrow, or nodes crowd.
        """
        even = np.arange(self._density.points) / self._density.points
        with self.task.clock.stage("first fill"):
            polygon = unfolded_loop(self.task.curve.point(self._density.slide(even)), saws=True)
        return self._on_domain(polygon, even, "unfolded")

    def flattened(self, disk: Disk, rim: Int[np.ndarray, " k"]) -> Found:
        """The minimal disk of less energy that a discrete disk leads to, on its flattening.

        Args:
            disk: over the loop at unit size.
            rim: indices of the loop's points that are its boundary vertices.

        Raises:
            DomainError: the flattening is not simple or too narrow, or nodes crowd.
        """
        with self.task.clock.stage("flattening"):
            polygon = flatten(disk.vertices, disk.faces, len(rim)).boundary
        return self._on_domain(polygon, self._density.parameter(self.task.curve.breaks[rim]), "flattened")

    @cached_property
    def exact(self) -> CurveTensors:
        """Γ."""
        return CurveTensors.of(self.task.curve, self.task.options.device)

    @cached_property
    def is_rough(self) -> bool:
        """Whether the loop is."""
        return is_rough(self.task.unit, self.task.curve)

    @property
    def _count(self) -> int:
        return points_of_domain(self.task.unit)

    @cached_property
    def _density(self) -> NodeDensity:
        return NodeDensity(self.task.curve, self._count)

    @property
    def _unit_disk(self) -> DirichletForm:
        return DirichletForm.of_disk(FourierBoundary.circle(1.0, self._count))

    @property
    def fine_gradient(self) -> float:
        """At which a slide along Γ itself stops."""
        if self.task.options.is_series:
            return _ROUNDING
        share = ROUGH_GRADIENT if self.is_rough else _FINE_SMOOTH
        return float(np.clip(share * self.task.allowed / self.task.unit.mean_edge_length, _ROUNDING, _COARSE))

    @property
    def most_nodes(self) -> int:
        """That are tried."""
        return even(max(4 * _FEWEST_NODES, _MOST_PER_EDGE * len(self.task.unit)))

    def is_enough(self, misfit: Misfit) -> bool:
        """Whether more nodes are not tried; rounding error is asked for where the curve itself has no other."""
        allowed = self.task.allowed
        if self.task.options.is_series and self.task.curve.degree > max(DEGREES):
            allowed = min(allowed, _ROUNDED)
        return misfit.excess(allowed=allowed, tolerance=allowed / self.task.unit.mean_edge_length) <= 1

    @property
    def negligible_energy(self) -> float:
        """At a fall below which a slide stops, too."""
        return negligible_energy(len(self.task.unit), self.task.allowed) if self.is_rough else 0.0

    def _on_domain(self, polygon: Complex[np.ndarray, " k"], t: Float[np.ndarray, " k"], route: RouteName) -> Found:
        """The minimal disk on the smooth Ω next to a polygon, and on what its own flattening makes of that.

        Args:
            polygon: near to ∂Ω.
            t: parameters of its vertices.
            route: for the record.
        """
        with self.task.clock.stage("flattening"):
            # points that stand for single vertices are to be followed
            is_fine = self.is_rough and len(self.task.unit) <= self._density.points
            shape, form = resolved(
                polygon, t, self._density, is_fine, count=self._count, device=self.task.options.device
            )
        slide = torch.tensor(self._density.slide(np.arange(shape.steps) / shape.steps), device=self.task.options.device)
        with self.task.clock.stage("slide"):
            disk = minimise_dirichlet_energy(
                self.exact,
                form,
                slide,
                tolerance=_COARSE,
                max_steps=self.task.steps.left,
                negligible=self.negligible_energy,
                on_step=self.take,
            )
        if disk.crowded:
            raise DomainError("the nodes crowd on the domain's boundary", vertices=len(self.task.unit))
        with self.task.clock.stage("flattening"):
            form, slide = reflattened(disk, form, shape)
        return self._fitted(self._fit(form, slide), route)

    def _begin(self) -> Fit:
        """The fit on the unit disk from equal steps."""
        n = even(max(_FEWEST_NODES, len(self.task.unit)))
        return self._fit(self._unit_disk, torch.arange(n, dtype=torch.float64, device=self.task.options.device) / n)

    def _fit(self, form: DirichletForm, slide: Float[Tensor, " n"]) -> Fit:
        """The fit on an Ω from a slide."""
        m = len(self.task.unit)
        nodes = even(max(len(slide), m * (_PER_EDGE_ROUGH if self.is_rough else 1)))
        return Fit(solver=self, form=form, slide=slide, nodes=nodes)

    def _fitted(self, fit: Fit, route: RouteName) -> Found:
        """The minimal disk with as many nodes as the tolerance asks for, or as help.

        Raises:
            DomainError: the nodes crowd, or all harmonic disks are branched.
        """
        fit_together([fit])
        if fit.best is None:
            raise DomainError(f"no minimal disk was found on this domain: {fit.limit}", vertices=len(self.task.unit))
        lift, disk = fit.best
        with self.task.clock.stage("surface"):
            surface = surface_of(lift, fit.form.boundary)
        n = len(disk.slide)
        return Found(
            curves=(self.task.curve,),
            surface=surface,
            matchings=(np.column_stack([np.arange(n) / n, disk.slide.cpu().numpy()]),),
            misfit=lift.misfit,
            area=lift.area,
            route=route,
            limit=fit.limit,
        )

    def take(self, gradient: float) -> None:
        """Takes down a step."""
        self.task.steps.take("Douglas-Newton", gradient)

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
